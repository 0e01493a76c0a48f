"""Small valid files of every format that glpath reads, and edits by hypothesis that spoil them.

A seed is a file with the files that it needs, its reader, and the part of it to spoil. For packed formats that is
the content, so that the reader gets past the container.
"""

from __future__ import annotations

import io
import json
import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

import glpath
from glpath.compare import Picture, read_picture
from glpath.film.exr import write_exr
from glpath.film.film import Film
from glpath.film.image import picture_size
from glpath.io.weather import read_weather
from glpath.jobs.connection import _address_in
from glpath.radiosity import RadiositySolution
from glpath.rendering import RenderJob
from glpath.system.locks import Lock
from tests.support import damaged, honeybee_model, photometry, weather_files
from tests.support.gltf_files import Gltf, encoded, glb
from tests.support.rgbe_files import run_lengths


@dataclass(frozen=True)
class Seed:
    """A file to spoil.

    name    : name of the file to spoil, in an empty folder
    content : part to spoil
    read    : reader, which gets the folder
    pack    : function that makes the file from its content
    beside  : other files by name
    text    : whether words and numbers can be exchanged
    """

    name: str
    content: bytes
    read: Callable[[Path], object]
    pack: Callable[[bytes], bytes] = bytes
    beside: dict[str, bytes] = field(default_factory=dict)
    text: bool = True

    def write(self, folder: Path, content: bytes) -> None:
        for name, other in self.beside.items():
            (folder / name).write_bytes(other)
        (folder / self.name).write_bytes(self.pack(content))


# Words that can replace a number, a name or a part of a statement.
WORDS = [
    *("0", "-1", "1", "2", "4294967295", "4294967296", "2147483648", "-2147483649", "9223372036854775808"),
    *("1e308", "-1e308", "1e400", "1e-320", "nan", "-nan(ind)", "inf", "-inf", "9" * 400, "9" * 5000),
    *("1_0", "\u0661\u0662", "\u00b2", "0x10", "1.5", "", "a", "true", "null", '"', "'", "{", "}", "[", "]"),
    *(
        "[" * 300,
        "{" * 300,
        '{"a":' * 2000,
        "<a>" * 200,
        "(" * 200,
        "-" * 100,
        ",",
        ";",
        "\t",
        "\n",
        "\r",
        "\\",
        "#",
    ),
    *("../../../../etc/passwd", "/dev/zero", "a" * 400, "\ud800", "\ufeff", "\u202e", "%s%n", "{0}", "$a", "&amp;"),
]
# Numbers in their stored forms.
STORED = [
    number.to_bytes(size, order, signed=number < 0)
    for number in (0, 1, -1, 255, 2**15, 2**31 - 1, 2**31, 2**62)
    for size in (1, 2, 4, 8)
    for order in ("little", "big")
    if -(2 ** (8 * size - 1)) <= number < 2 ** (8 * size)
] + [struct.pack("<f", np.nan), struct.pack("<f", np.inf), struct.pack("<f", 3e38), struct.pack("<d", 1e308)]
_WORD = re.compile(rb"[A-Za-z0-9_.+-]+")

Edit = tuple[str, int, int, int]


def edits(text: bool) -> st.SearchStrategy[list[Edit]]:
    """Return a few edits: a kind, a place as a fraction of 2**16, a length, and the number of the replacement."""
    kinds = ["cut", "flip", "drop", "repeat", "bytes"] + ["word", "word", "word", "line"] * text
    place, number = st.integers(0, 2**16 - 1), st.integers(0, 2**16 - 1)
    edit = st.tuples(st.sampled_from(kinds), place, st.integers(1, 64), number)
    return st.lists(edit, min_size=1, max_size=4)


def spoiled(content: bytes, made: list[Edit]) -> bytes:
    """Apply the edits to the content in order."""
    for kind, place, length, number in made:
        at = place * len(content) >> 16
        before, middle, after = content[:at], content[at : at + length], content[at + length :]
        if kind == "cut":
            content = before
        elif kind == "flip":
            content = before + bytes(each ^ 1 << number % 8 for each in middle[:1]) + content[at + 1 :]
        elif kind == "drop":
            content = before + after
        elif kind == "repeat":
            content = before + middle * (2 + number % 30) + after
        elif kind == "bytes":
            stored = STORED[number % len(STORED)]
            content = before + stored + content[at + len(stored) :]
        elif kind == "word" and (found := list(_WORD.finditer(content, max(0, at - 400), at + 400))):
            word = found[number % len(found)]
            other = WORDS[length * 7919 % len(WORDS)].encode("utf-8", "surrogatepass")
            content = content[: word.start()] + other + content[word.end() :]
        elif kind == "line":
            lines = content.split(b"\n")
            line = lines.pop(at % len(lines))
            content = b"\n".join([*lines[: number % (len(lines) + 1)], line, *lines[number % (len(lines) + 1) :]])
    return content


#: Names of all seeds; those of LAS, LAZ and GeoTIFF need the extra `terrain`.
NAMES = (
    "scene.toml",
    "mitsuba.xml",
    "wavefront.obj",
    "wavefront.mtl",
    "honeybee.hbjson",
    "job.json",
    "scheduler.json",
    "lock",
    "points.csv",
    "table.csv",
    "ascii.ply",
    "binary.ply",
    "ascii.stl",
    "binary.stl",
    "mesh.off",
    "coloured.ply",
    "cloud.ply",
    "json of a.glb",
    "binary of a.glb",
    "whole.glb",
    "a.gltf",
    "stream of a.serialized",
    "whole.serialized",
    "a.ies",
    "a.ldt",
    "weather.epw",
    "heights.asc",
    "texture.png",
    "picture.png",
    "texture.jpg",
    "picture.jpg",
    "texture.bmp",
    "picture.bmp",
    "texture.tga",
    "texture.tif",
    "picture.tif",
    "texture.gif",
    "picture.gif",
    "texture.webp",
    "picture.webp",
    "radiance a.exr",
    "radiance a.hdr",
    "radiance a.npy",
    "baseline.exr",
    "metadata of film.npz",
    "ranges of film.npz",
    "radiance_sums of film.npz",
    "divisions of solution.npz",
    "elements of solution.npz",
    "whole film.npz",
    "stream.npy",
    "a.las",
    "a.laz",
    "heights.tif",
)

# --- the seeds ---

_TOML = b"""
unit = "radiometric"
[film]
resolution = [8, 6]
[camera]
position = [0.5, 0.5, 5]
target = [0.5, 0.5, 0]
up = [0, 1, 0]
fov = 40
[sky]
zenith = [1, 1, 1]
horizon = 0.5
[textures.wood]
type = "checker"
colors = [[0.2, 0.2, 0.2], [0.8, 0.8, 0.8]]
[materials.grey]
reflectance = [0.5, 0.5, 0.5]
two_sided = true
[materials.glass]
type = "principled"
ior = 1.5
[[shapes]]
type = "quad"
material = "grey"
corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
transform = [{ translate = [0, 0, 1] }, { rotate = { axis = [0, 1, 0], angle = 30 } }]
[[shapes]]
type = "sphere"
center = [0, 2, 0]
radius = 0.5
material = "glass"
[[shapes]]
type = "mesh"
vertices = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 2, 0]]
faces = [[0, 1, 2], [0, 2, 3]]
emission = { radiance = [1, 1, 1] }
[[lights]]
type = "point"
position = [0, 3, 0]
intensity = 5
"""

_XML = b"""<?xml version="1.0" encoding="utf-8"?>
<scene version="3.0.0">
<default name="w" value="8"/>
<integrator type="path"><integer name="max_depth" value="5"/></integrator>
<sensor type="perspective"><float name="fov" value="40"/><string name="fov_axis" value="smaller"/>
<transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="$w"/><integer name="height" value="6"/></film></sensor>
<bsdf type="twosided" id="a"><bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf></bsdf>
<bsdf type="principled" id="b"><rgb name="base_color" value="0.5,0.5,0.5"/>
<float name="roughness" value="0.4"/></bsdf>
<bsdf type="dielectric" id="c"><float name="int_ior" value="1.5"/></bsdf>
<bsdf type="diffuse" id="d"><texture type="checkerboard" name="reflectance">
<transform name="to_uv"><scale x="2" y="3"/></transform></texture></bsdf>
<shape type="cube"><ref id="a"/><transform name="to_world"><rotate x="1" angle="30"/><translate x="2"/></transform>
</shape>
<shape type="sphere"><float name="radius" value="0.5"/><point name="center" x="0" y="1" z="0"/><ref id="c"/></shape>
<shape type="rectangle"><ref id="d"/><emitter type="area"><rgb name="radiance" value="1,2,3"/></emitter></shape>
<shape type="disk"><ref id="b"/></shape>
<emitter type="point"><point name="position" value="0,3,0"/><spectrum name="intensity" value="5"/></emitter>
<emitter type="constant"><rgb name="radiance" value="1,1,1"/></emitter>
</scene>"""

_MTL_SCENE = "newmtl a\nKd 0.5 0.4 0.3\nKs 0.2 0.2 0.2\nNs 50\nd 0.9\nillum 2\nNi 1.5\nmap_Kd -s 2 2 a.png\n"
_MTL_SCENE += "newmtl b\nKe 1 1 1\nTf 0.5 0.5 0.5\nillum 7\nPr 0.3\nPm 1\nPc 0.5\naniso 0.2\n"
_OBJ = "mtllib a.mtl\no one\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl a\n"
_OBJ += "f 1/1/1 2/2/1 3/3/1\nusemtl b\nf -4 -3 -2 -1\nl 1 2\np 3\n"


def _scene(name: str) -> Callable[[Path], object]:
    return lambda folder: damaged.check_scene(glpath.load_scene(folder / name))


def _pixels(height: int = 5, width: int = 7) -> Any:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3))


def _gltf() -> Gltf:
    """Return a triangle with many features of a glTF file."""
    file = Gltf()
    image = file.add("images", bufferView=file.view(encoded(_pixels())), mimeType="image/png")
    texture = file.add("textures", source=image, sampler=file.add("samplers", wrapS=33071, magFilter=9729))
    pbr = {"baseColorTexture": {"index": texture}, "roughnessFactor": 0.3, "baseColorFactor": [1, 0.5, 0.5, 0.9]}
    extension = {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5}, "KHR_materials_ior": {"ior": 1.4}}
    material = file.add("materials", pbrMetallicRoughness=pbr, alphaMode="BLEND", extensions=extension)
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    mesh = file.mesh(
        corners,
        [0, 1, 2, 0, 2, 3],
        material=material,
        NORMAL=[[0, 0, 1]] * 4,
        TEXCOORD_0=[[0, 0], [1, 0], [1, 1], [0, 1]],
    )
    node = file.node(mesh=mesh, translation=[0, 0, 1], rotation=[0, 0, 0, 1])
    camera = file.add("cameras", type="perspective", perspective={"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.3})
    file.node(camera=camera, translation=[0, 0, 5])
    times, moved = file.accessor([0.0, 1.0]), file.accessor([[0, 0, 1], [0, 0, 2]])
    sampler = {"input": times, "output": moved, "interpolation": "LINEAR"}
    target = {"node": node, "path": "translation"}
    file.add("animations", samplers=[sampler], channels=[{"sampler": 0, "target": target}])
    file.json["extensionsUsed"] = ["KHR_materials_clearcoat", "KHR_materials_ior", "KHR_lights_punctual"]
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 5.0}]}}
    file.node(extensions={"KHR_lights_punctual": {"light": 0}})
    return file


def _serialized(stream: bytes) -> bytes:
    return struct.pack("<HH", 0x041C, 4) + zlib.compress(stream) + struct.pack("<QI", 0, 1)


def _npz(name: str, arrays: dict[str, Any]) -> tuple[bytes, Callable[[bytes], bytes]]:
    """Return the bytes of one member, and a function that makes the archive from them."""
    whole = io.BytesIO()
    np.savez(whole, **arrays)
    members = damaged.members_of(whole.getvalue())
    return members[f"{name}.npy"], lambda member: damaged.zipped(members | {f"{name}.npy": member})


def _lock(folder: Path) -> None:
    """Take a lock whose file has any content: this must succeed or raise an error."""
    with Lock(folder / "a.png", "a test"):
        pass


def _horizon_table(folder: Path) -> object:
    from glpath.cli.horizon import _table

    return _table(folder / "a.csv", "--points", ("x", "y"), ("z",))


def _points(folder: Path) -> object:
    from glpath.apps.measure.tables import read_points

    return read_points(folder / "points.csv", None)


def _pictured(suffix: str) -> list[Callable[[Path], object]]:
    """Return readers of a picture: as a texture of an OBJ, and for a comparison."""
    return [_scene("a.obj"), lambda folder: read_picture(folder / f"a{suffix}")]


def seeds(folder: Path) -> dict[str, Seed]:
    """Return all seeds by name; `folder` is for temporary files."""
    folder.mkdir(exist_ok=True)
    damaged.make(folder)

    def stored(name: str) -> bytes:
        return (folder / name).read_bytes()

    png = encoded(_pixels())
    found = {
        "scene.toml": Seed("a.toml", _TOML, _scene("a.toml")),
        "mitsuba.xml": Seed("a.xml", _XML, _scene("a.xml")),
        "wavefront.obj": Seed(
            "a.obj", _OBJ.encode(), _scene("a.obj"), beside={"a.mtl": _MTL_SCENE.encode(), "a.png": png}
        ),
        "wavefront.mtl": Seed(
            "a.mtl", _MTL_SCENE.encode(), _scene("a.obj"), beside={"a.obj": _OBJ.encode(), "a.png": png}
        ),
        "honeybee.hbjson": Seed("a.hbjson", json.dumps(honeybee_model.two_rooms()).encode(), _scene("a.hbjson")),
        "job.json": Seed("job.json", stored("job.json"), lambda folder: RenderJob.load(folder / "job.json")),
        "scheduler.json": Seed(
            "a.json",
            b'{"address": "tcp://127.0.0.1:8786", "workers": {}}',
            lambda folder: _address_in(str(folder / "a.json")),
        ),
        "lock": Seed("a.png.lock", b'[{"pid": 1, "host": "a", "since": "now", "range": [0, 1]}]', _lock),
        "points.csv": Seed("points.csv", b"x,y,z,nx,ny,nz\n0,0,0,0,0,1\n1,2,3,0,1,0\n", _points),
        "table.csv": Seed("a.csv", b"x,y,z\n0,0,0\n1,2,3\n", _horizon_table),
    }
    for name in ("ascii.ply", "binary.ply", "ascii.stl", "binary.stl", "mesh.off"):
        found[name] = Seed(name, stored(name), _scene(name), text="binary" not in name)
    coloured = damaged.PLY_HEAD.format("ascii").replace(
        "float z\n", "float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    )
    rows = "".join(f"{x} {y} 0 10 20 30\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    found["coloured.ply"] = Seed("a.ply", (coloured + rows + "3 0 1 2\n4 0 1 2 3\n").encode(), _scene("a.ply"))
    cloud = coloured.partition("element face")[0] + "end_header\n" + rows
    found["cloud.ply"] = Seed("a.ply", cloud.encode(), _scene("a.ply"))

    file = _gltf()
    file.json["buffers"] = [{"byteLength": len(file.binary)}]
    binary = bytes(file.binary)
    document = json.dumps(file.json).encode()
    found["json of a.glb"] = Seed("a.glb", document, _scene("a.glb"), pack=lambda text: glb(text, binary))
    found["binary of a.glb"] = Seed(
        "a.glb", binary, _scene("a.glb"), pack=lambda data: glb(document, data), text=False
    )
    found["whole.glb"] = Seed("a.glb", glb(document, binary), _scene("a.glb"), text=False)
    file.json["buffers"] = [{"byteLength": len(binary), "uri": "a.bin"}]
    found["a.gltf"] = Seed("a.gltf", json.dumps(file.json).encode(), _scene("a.gltf"), beside={"a.bin": binary})

    stream = struct.pack("<I", 0x1000 | 0x0002) + b"a\0" + struct.pack("<QQ", 3, 1)
    stream += np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    stream += np.zeros((3, 2), "<f4").tobytes() + np.array([0, 1, 2], "<u4").tobytes()
    shape = (
        b'<scene version="3.0.0"><shape type="serialized"><string name="filename" value="a.serialized"/></shape>'
    )
    around = {"b.xml": shape + b"</scene>"}
    found["stream of a.serialized"] = Seed(
        "a.serialized", stream, _scene("b.xml"), pack=_serialized, beside=around, text=False
    )
    found["whole.serialized"] = Seed(
        "a.serialized", _serialized(stream), _scene("b.xml"), beside=around, text=False
    )

    gamma, c = np.array([0.0, 45.0, 90.0]), np.array([0.0, 90.0, 180.0, 270.0])
    lamp = b'[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n[[shapes]]\ntype = "quad"\n'
    lamp += b"corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]\n"
    lamp += b'[[lights]]\ntype = "point"\nposition = [0, 0, 3]\ndirection = [0, 0, -1]\nprofile = "%s"\n'
    photometry.ies(folder / "a.ies", gamma, np.array([0.0, 90.0]), np.ones((2, 3)))
    photometry.eulumdat(folder / "a.ldt", gamma, c, np.ones((4, 3)))
    for name in ("a.ies", "a.ldt"):
        found[name] = Seed(name, stored(name), _scene("b.toml"), beside={"b.toml": lamp % name.encode()})

    weather_files.write_epw(folder / "a.epw")
    epw = b"".join(stored("a.epw").splitlines(keepends=True)[: 8 + 24])
    found["weather.epw"] = Seed("a.epw", epw, lambda folder: read_weather(folder / "a.epw"))

    grid = (
        b"ncols 4\nnrows 3\nxllcorner 10\nyllcorner 20\ncellsize 2\nNODATA_value -9999\n1 2 3 4\n5 6 7 8\n9 1 2 3\n"
    )
    found["heights.asc"] = Seed("a.asc", grid, lambda folder: glpath.load_height_field(folder / "a.asc"))

    for name, kind in (
        (".png", "PNG"),
        (".jpg", "JPEG"),
        (".bmp", "BMP"),
        (".tga", "TGA"),
        (".tif", "TIFF"),
        (".gif", "GIF"),
        (".webp", "WEBP"),
    ):
        beside = {"a.obj": _OBJ.encode(), "a.mtl": _MTL_SCENE.replace("a.png", f"a{name}").encode()}
        found[f"texture{name}"] = Seed(
            f"a{name}", encoded(_pixels(), kind), _scene("a.obj"), beside=beside, text=False
        )
        if name != ".tga":
            found[f"picture{name}"] = Seed(
                f"a{name}",
                encoded(_pixels(), kind),
                lambda folder, name=name: read_picture(folder / f"a{name}"),
                text=False,
            )
    write_exr(folder / "b.exr", np.random.default_rng(0).random((5, 7, 3)))
    pixels = np.random.default_rng(0).integers(100, 130, (5, 9, 4)).astype(np.uint8)
    hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.0\n\n-Y 5 +X 9\n" + run_lengths(pixels)
    for name, content in (("a.exr", stored("b.exr")), ("a.hdr", hdr), ("a.npy", stored("picture.npy"))):

        def both(folder: Path, name: str = name) -> None:
            damaged.check_picture(glpath.read_image(folder / name))
            if not name.endswith(".npy"):
                picture_size(folder / name)

        found[f"radiance {name}"] = Seed(name, content, both, text=False)
    found["baseline.exr"] = Seed(
        "a.exr", stored("baseline.exr"), lambda folder: Picture.load(folder / "a.exr"), text=False
    )

    film, solution = dict(np.load(folder / "film.npz")), dict(np.load(folder / "solution.npz"))
    for name in ("metadata", "ranges", "radiance_sums"):
        content, pack = _npz(name, film)
        found[f"{name} of film.npz"] = Seed(
            "a.npz",
            content,
            lambda folder: damaged.check_film(Film.load(folder / "a.npz")),
            pack=pack,
            text=name == "metadata",
        )
    for name in ("divisions", "elements"):
        content, pack = _npz(name, solution)
        found[f"{name} of solution.npz"] = Seed(
            "a.npz", content, lambda folder: RadiositySolution.load(folder / "a.npz"), pack=pack, text=False
        )
    found["whole film.npz"] = Seed(
        "a.npz", stored("film.npz"), lambda folder: Film.load(folder / "a.npz"), text=False
    )
    stream_of = b'[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n[[shapes]]\ntype = "stream"\nfile = "a.npy"\n'
    array = io.BytesIO()
    np.save(array, np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], np.float32))
    found["stream.npy"] = Seed(
        "a.npy",
        array.getvalue(),
        lambda folder: glpath.load_scene(folder / "b.toml"),
        beside={"b.toml": stream_of},
        text=False,
    )
    found |= _with_packages(folder)
    return found


def _with_packages(folder: Path) -> dict[str, Seed]:
    """Return the seeds of the extra `terrain`; empty if it is missing."""
    try:
        import laspy
        import rasterio
    except ImportError:
        return {}
    size = {"width": 6, "height": 5, "count": 1, "dtype": "float32", "nodata": -9999.0}
    transform = rasterio.Affine(2, 0, 10, 0, -2, 30)
    with rasterio.open(
        folder / "h.tif", "w", driver="GTiff", transform=transform, compress="deflate", **size
    ) as raster:
        raster.write(np.arange(30, dtype=np.float32).reshape(5, 6), 1)
    cloud = laspy.create(file_version="1.4", point_format=6)
    cloud.x, cloud.y, cloud.z = np.arange(12.0).reshape(3, 4)
    for name in ("a.las", "a.laz"):
        cloud.write(folder / name)
    found = {
        name: Seed(
            name,
            (folder / name).read_bytes(),
            lambda folder, name=name: glpath.load_point_cloud(folder / name),
            text=False,
        )
        for name in ("a.las", "a.laz")
    }
    found["heights.tif"] = Seed(
        "a.tif",
        (folder / "h.tif").read_bytes(),
        lambda folder: glpath.load_height_field(folder / "a.tif"),
        text=False,
    )
    return found
