"""Limits for glTF files. A file that exceeds a limit is rejected before memory is allocated."""

#: Maximum size in bytes of the model file and of each buffer and image file; the .glb format cannot hold more.
MAX_FILE_BYTES = 2**32
#: Maximum count of numbers, texts, lists and tables in the JSON.
MAX_JSON_VALUES = 2**23
#: Maximum nesting depth of the JSON.
MAX_JSON_DEPTH = 64
MAX_NODES = 2**20
#: Maximum depth of the tree of nodes.
MAX_NODE_DEPTH = 10_000
MAX_ACCESSORS = 2**20
#: Maximum number of elements of an accessor without a buffer view. Its elements are zeros that the file does not
#: contain, so even a tiny file can ask for many.
MAX_ZEROS = 2**22
#: Maximum size of all decoded arrays, meshes and pixels together, bytes. Data that are used again are decoded once.
MAX_DECODED_BYTES = 2**33
#: Number of decoded bytes that every file may have, however small it is.
ALWAYS_DECODED_BYTES = 2**30
#: Maximum ratio of decoded bytes to file bytes, for models that exceed ALWAYS_DECODED_BYTES. Decoded Draco meshes
#: are hundreds of times as large as in the file.
MAX_DECODED_RATIO = 512
#: Maximum number of triangles of all instances together, because their vertices have 32-bit indices.
MAX_TRIANGLES = 2**28
#: Number of triangles of all instances that every file may have, however small it is. They take 1 GB.
ALWAYS_TRIANGLES = 2**23
#: Number of triangles that balls and rods, which stand for points and lines, may have in every file. A stored point
#: takes several bytes of a file, so only files with accessors of zeros, which are not stored, reach this limit.
ALWAYS_STROKE_TRIANGLES = 2**20
#: Maximum number of triangles of all instances, or of all balls and rods, per byte of the file, for models that
#: exceed ALWAYS_TRIANGLES or ALWAYS_STROKE_TRIANGLES.
MAX_TRIANGLES_RATIO = 64
#: Number of instances of primitives by nodes that every file may have, however small it is. They take 100 MB. If
#: many nodes share a mesh of many primitives, each node has an instance of each primitive.
ALWAYS_INSTANCES = 2**20
#: Maximum number of instances of primitives by nodes per byte of the file, for models that exceed ALWAYS_INSTANCES.
MAX_INSTANCES_RATIO = 1
#: Number of meshes with a skin or morph weights of a node that every file may have, however small it is. For each
#: such node, a primitive counts once, and once more for each weighted morph target. Each takes about 1 ms.
ALWAYS_DEFORMED = 2**13
#: Number of bytes of the file per deformed mesh, for models that exceed ALWAYS_DEFORMED.
BYTES_PER_DEFORMED = 256
MAX_TEXTURE_SIDE = 16384
MAX_TEXTURE_PIXELS = 2**26
#: Maximum number of characters of a name; longer names are cut.
MAX_NAME = 120
