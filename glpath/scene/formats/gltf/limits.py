"""What a glTF file may ask for. Beyond that it is refused before memory is taken for it."""

#: Of the file, and of each buffer and image beside it; a .glb can say no more.
MAX_FILE_BYTES = 2**32
#: Numbers, texts, lists and tables in the JSON.
MAX_JSON_VALUES = 2**22
#: How deep they lie in one another.
MAX_JSON_DEPTH = 64
MAX_NODES = 2**20
MAX_ACCESSORS = 2**20
#: Elements of an accessor without data, which are zeros and cost no bytes in the file.
MAX_ZEROS = 2**24
#: Of all that is decoded: arrays, meshes and pixels. What a file uses again is not decoded again.
MAX_DECODED_BYTES = 2**33
#: Of all instances together: vertices have 32 bit numbers.
MAX_TRIANGLES = 2**28
MAX_TEXTURE_SIDE = 16384
MAX_TEXTURE_PIXELS = 2**26
#: Letters of a name that are kept.
MAX_NAME = 120
