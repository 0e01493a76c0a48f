"""Limits of a glTF file. Beyond them it is refused before memory is allocated."""

#: Bytes of the file, and of each buffer and image beside it; a .glb can hold no more.
MAX_FILE_BYTES = 2**32
#: Numbers, texts, lists and tables in the JSON.
MAX_JSON_VALUES = 2**23
#: How deep they lie in one another.
MAX_JSON_DEPTH = 64
MAX_NODES = 2**20
MAX_ACCESSORS = 2**20
#: Elements of an accessor without data, which are zeros and cost no bytes in the file.
MAX_ZEROS = 2**22
#: Bytes of all decoded arrays, meshes and pixels: in any case, and for each byte of the files. What a file uses
#: again is not decoded again. Draco's meshes unfold to some hundred times their bytes.
MAX_DECODED_BYTES = 2**33
ALWAYS_DECODED_BYTES = 2**30
MAX_DECODED_RATIO = 512
#: Vertices of all instances together, which have 32 bit numbers.
MAX_TRIANGLES = 2**28
MAX_TEXTURE_SIDE = 16384
MAX_TEXTURE_PIXELS = 2**26
#: Letters of a name that are kept.
MAX_NAME = 120
