"""Feeds damaged and hostile files to every reader, which must raise GlpathError or return a well-formed result.

    python tests/support/damaged.py [ROUNDS [EVERY]]     prints the outcomes as JSON

Each file is written, then damaged blindly: cut off, or with bits flipped, or with blocks zeroed, repeated or
omitted. If the format has parts, it is also damaged with knowledge of the format. ROUNDS multiplies the blind
damages; only one in EVERY is tried. The run is deterministic. A reader may take 1 GB of memory more than the
program had before.
"""

from __future__ import annotations

import contextlib
import functools
import io
import json
import pickle
import random
import resource
import sys
import tempfile
import traceback
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

import glpath
from glpath.compare import Picture, read_picture
from glpath.errors import GlpathError
from glpath.film import image
from glpath.film.batches import blocks
from glpath.film.film import Film
from glpath.film.metadata import FilmMetadata
from glpath.film.tonemap import tonemap
from glpath.radiosity import RadiositySolution
from glpath.rendering import RenderJob

BLIND = 12

FILM_AOVS = ("albedo", "depth", "object_id", "samples")

OBJ = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0 1 0 0\nvt 0 0\nvt 1 1\nf 1/1 2/2 3/1\nf 1/1 3/2 -1/1\n"
PLY_HEAD = (
    "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
)


# Checks that a result is well-formed; each raises AssertionError if not.


def check_picture(pixels: Any) -> None:
    assert pixels.ndim == 3
    assert pixels.shape[2] == 3
    assert pixels.dtype == np.float64
    assert pixels.size
    assert np.isfinite(pixels).all()


def check_film(film: Film) -> None:
    assert np.isfinite(film.radiance_sums).all()
    assert film.radiance_sums.shape[1:] == (*film.metadata.window[:1:-1], 3)
    again = np.zeros_like(film.batch_counts)
    for start, stop in film.ranges:
        assert 0 <= start < stop
        for first, last in blocks(start, stop) if stop - start < 10_000 else ():
            again[first // 8 % 8] += last - first
    assert film.path_sets >= 0
    assert film.path_sets > 10_000 or np.array_equal(again, film.batch_counts)
    if film.path_sets:
        check_picture(film.mean)
        if "object_id" in film.metadata.aovs:
            film.cryptomatte("object")
        for name in film.metadata.aovs:
            found = film.aov(name)
            assert found.shape[:2] == film.mean.shape[:2]
            assert np.isfinite(found).all()
    repr(film)
    film.provenance()
    film.merge(Film.empty(film.metadata))


def check_solution(solution: RadiositySolution) -> None:
    assert np.isfinite(solution.elements).all()
    assert solution.elements.shape == (2, 2, solution.element_count, 3)
    repr(solution)
    solution.irradiance([0], [[0.2, 0.3]])


def check_scene(scene: glpath.Scene) -> None:
    assert np.isfinite(scene.triangles).all()
    assert len(scene.triangles)


def check_baseline(picture: Picture) -> None:
    check_picture(picture.mean)


def read(path: Path) -> None:
    check_picture(glpath.read_image(path))


def compare(path: Path) -> None:
    check_picture(read_picture(path).mean)


def size(path: Path) -> None:
    found = image.picture_size(path)
    assert found.width > 0
    assert found.height > 0


READERS: dict[str, tuple[Callable[[Path], None], ...]] = {
    "film.npz": (lambda path: check_film(Film.load(path)), read),
    "solution.npz": (lambda path: check_solution(RadiositySolution.load(path)), read),
    "radiance.npz": (read, compare, lambda path: check_film(Film.load(path))),
    "picture.npy": (read, compare),
    "picture.exr": (read, compare, size),
    "baseline.exr": (lambda path: check_baseline(Picture.load(path)), compare),
    "picture.png": (read, compare, size),
    "picture.jpg": (read, compare, size),
    "job.json": (lambda path: repr(RenderJob.load(path)),),
    **dict.fromkeys(
        ("mesh.obj", "ascii.ply", "binary.ply", "ascii.stl", "binary.stl", "mesh.off"),
        (lambda path: check_scene(glpath.load_scene(path)),),
    ),
}

# What the command line does with them; {} is the file.
COMMANDS = {
    "film.npz": ("diff {} {}", "diff --stat {} {}"),
    "solution.npz": ("render cornell-box-36 --integrator gather --spp 1 -o OUT.png -q --radiosity {}",),
    "baseline.exr": ("diff --mode stat {} {}",),
    "picture.png": ("diff --json {} {}",),
    "job.json": ("render --job {} -o OUT.gif",),
    "mesh.obj": ("info {}", "validate {}"),
}


def make(folder: Path) -> None:
    """The whole files."""
    rng = np.random.default_rng(0)
    fields = {"sampling": "sobol", "ambient": [0.0, 0.0, 0.0]}
    sizes = (8, 6), (1, 1, 6, 4)
    metadata = FilmMetadata("a", "0", "path", 0, 5, fields, *sizes, statistics={"n": 2}, aovs=FILM_AOVS)
    metadata = replace(metadata, shape_names=("a", "b"), material_names=("c",), shape_materials=(0, 0))
    film = Film.empty(metadata)
    for first, last in ((0, 20), (30, 40)):
        for start, stop in blocks(first, last):
            aovs = {name: rng.random((4, 6, n)) for name, n in metadata.aov_sums.items()}
            aovs["dropped"] = np.floor(2 * aovs["dropped"])
            shapes = rng.integers(0, 3, (4, 6, stop - start)).astype(np.uint32)
            film.add(start, stop, rng.random((4, 6, 3)), aovs | {"shapes": shapes})
    film.save(folder / "film.npz")
    film.save(folder / "picture.exr")
    film.save(folder / "picture.png")
    Picture.of_film(film).save(folder / "baseline.exr")
    scene = glpath.load_scene("cornell-box-36")
    divisions = np.full(len(scene.triangles), 2)
    RadiositySolution(
        scene.digest(camera=False),
        divisions,
        rng.random((2, 2, int((divisions**2).sum()), 3), np.float32),
        rng.random((2, 2, int(((divisions + 1) * (divisions + 2) // 2).sum()), 3), np.float32),
    ).save(folder / "solution.npz")
    np.savez_compressed(folder / "radiance.npz", radiance=film.mean)
    np.save(folder / "picture.npy", film.mean)
    from PIL import Image

    Image.fromarray(tonemap(film.mean)).save(folder / "picture.jpg")
    RenderJob.of("cornell-box-36", spp=4, resolution=(8, 8)).save(folder / "job.json")
    (folder / "mesh.obj").write_text(OBJ)
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
    faces = "3 0 1 2\n3 0 2 3\n"
    rows = "".join("{:g} {:g} {:g}\n".format(*row) for row in vertices)
    (folder / "ascii.ply").write_text(PLY_HEAD.format("ascii") + rows + faces)
    (folder / "mesh.off").write_text(f"OFF\n4 2 0\n{rows}{faces}")
    packed = b"".join(b"\x03" + np.array(f, "<i4").tobytes() for f in ([0, 1, 2], [0, 2, 3]))
    (folder / "binary.ply").write_bytes(
        PLY_HEAD.format("binary_little_endian").encode() + vertices.tobytes() + packed
    )
    facets = [vertices[[0, 1, 2]], vertices[[0, 2, 3]]]
    text = "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {:g} {:g} {:g}\n".format(*v) for v in facet)
        + "endloop\nendfacet\n"
        for facet in facets
    )
    (folder / "ascii.stl").write_text(f"solid a\n{text}endsolid a\n")
    (folder / "binary.stl").write_bytes(
        b"\xfc" * 80 + np.uint32(2).tobytes() + b"".join(bytes(12) + f.tobytes() + bytes(2) for f in facets)
    )


# Damages that need not know the format.


def blind(content: bytes, rounds: int, seed: str) -> Iterator[tuple[str, bytes]]:
    rng = random.Random(seed)
    count = BLIND * rounds
    yield "empty", b""
    yield "twice", content * 2
    for _ in range(count):
        yield "cut", content[: rng.randrange(len(content))]
    for _ in range(2 * count):
        changed = bytearray(content)
        for _ in range(rng.choice((1, 1, 3, 20))):
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        yield "flipped", bytes(changed)
    for _ in range(count):
        start, length = rng.randrange(len(content)), rng.randrange(1, 64)
        middle = content[start : start + length]
        for kind, instead in (
            ("zeroed", bytes(len(middle))),
            ("ones", b"\xff" * len(middle)),
            ("repeated", middle * 3),
            ("left out", b""),
            ("random", rng.randbytes(len(middle))),
        ):
            yield kind, content[:start] + instead + content[start + length :]


# Damages with knowledge of the format.


def npz(**arrays: Any) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def zipped(members: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


def members_of(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def header(shape: tuple[int, ...], descr: str) -> bytes:
    file = io.BytesIO()
    npy.write_array_header_1_0(file, {"shape": shape, "fortran_order": False, "descr": descr})
    return file.getvalue()


@functools.cache
def bomb(shape: tuple[int, ...], descr: str, megabytes: int) -> bytes:
    """Return a compressed member that expands to zeros, made without expanding it."""
    head = header(shape, descr)
    squeeze, check, parts = zlib.compressobj(1, zlib.DEFLATED, -15), zlib.crc32(head), [b""]
    parts.append(squeeze.compress(head))
    zeros = bytes(1 << 20)
    for _ in range(megabytes):
        parts.append(squeeze.compress(zeros))
        check = zlib.crc32(zeros, check)
    data = b"".join([*parts, squeeze.flush()])
    name, length = b"radiance.npy", len(head) + (megabytes << 20)
    sizes = check.to_bytes(4, "little") + len(data).to_bytes(4, "little") + length.to_bytes(4, "little")
    common = b"\x14\x00\x00\x00\x08\x00\x00\x00\x21\x00" + sizes + len(name).to_bytes(2, "little") + b"\0\0"
    local = b"PK\x03\x04" + common + name + data
    central = b"PK\x01\x02\x14\x00" + common + bytes(14) + name
    end = b"PK\x05\x06" + bytes(4) + b"\1\0\1\0" + len(central).to_bytes(4, "little")
    return local + central + end + len(local).to_bytes(4, "little") + b"\0\0"


def write_jpeg_of_scans(path: Path, count: int) -> Path:
    """Write a progressive JPEG that has its last scan `count` times."""
    from PIL import Image

    Image.fromarray(np.zeros((16, 16, 3), np.uint8)).save(path, "JPEG", progressive=True, comment=b"\xff\xda" * 200)
    content = path.read_bytes()
    last = content.rindex(b"\xff\xda")
    path.write_bytes(content[:last] + content[last:-2] * count + b"\xff\xd9")
    return path


class Exploding:
    """Fails the test if it is unpickled."""

    def __reduce__(self) -> Any:
        return sys.exit, ("a pickle was loaded",)


def knowing_npz(content: bytes) -> Iterator[tuple[str, bytes]]:
    arrays = dict(np.load(io.BytesIO(content)))
    members = members_of(content)
    names = list(arrays)
    for name, array in arrays.items():
        yield f"without {name}", npz(**{k: v for k, v in arrays.items() if k != name})
        for kind in ("O", "U3", "c16", "M8[s]", "f2", "i1", "u8", "V4"):
            with contextlib.suppress(TypeError, ValueError):
                yield f"{name} as {kind}", npz(**arrays | {name: np.zeros(array.shape, kind)})
        pickled = header(array.shape, "|O") + pickle.dumps(Exploding())
        yield f"{name} a pickle", zipped(members | {f"{name}.npy": pickled})
        yield f"{name} raw pickle", zipped(members | {f"{name}.npy": pickle.dumps(Exploding())})
        for shape in ((10**9, 10**9), (1 << 62,), (-1,), (10**30,), (0, 10**30), (), (3,) * 40, (1 << 31, 4, 6, 3)):
            yield f"{name} {shape}", zipped(members | {f"{name}.npy": header(shape, "<f8") + bytes(64)})
        yield f"{name} empty", npz(**arrays | {name: np.zeros((0, *array.shape[1:]), array.dtype)})
        for value in (np.nan, np.inf, -np.inf, -1, 1e308, 2**62):
            changed = array.copy()
            if array.dtype.kind != "U" and array.size:
                with contextlib.suppress(OverflowError, ValueError):
                    changed.reshape(-1)[-1] = value
            yield f"{name} holds {value}", npz(**arrays | {name: changed})
        for other in names:
            yield f"{name} is {other}", npz(**arrays | {name: arrays[other]})
    yield "compressed", zipped(members, zipfile.ZIP_DEFLATED)
    yield "lzma", zipped(members, zipfile.ZIP_LZMA)
    yield "a long header", zipped(members | {f"{names[0]}.npy": b"\x93NUMPY\x02\0\xff\xff\xff\x7f" + b" " * 5000})
    yield "bomb", bomb((300 << 17,), "<f8", 300)


def knowing_film(content: bytes) -> Iterator[tuple[str, bytes]]:
    yield from knowing_npz(content)
    arrays = dict(np.load(io.BytesIO(content)))
    for ranges in (
        [[0, 20], [10, 20]],
        [[0, 30], [40, 30]],
        [[20, 0]],
        [[30, 40], [0, 20]],
        [[-5, 25]],
        [[0, 2**62]],
    ):
        yield f"ranges {ranges}", npz(**arrays | {"ranges": np.array(ranges)})
    counts = arrays["batch_counts"]
    for changed in (-counts, counts * 2**60, np.roll(counts, 1), counts.astype(float), np.zeros(8, int)):
        yield f"counts {changed}", npz(**arrays | {"batch_counts": changed})
    metadata = json.loads(str(arrays["metadata"]))
    for name in metadata:
        for value in (
            None,
            -1,
            10**400,
            "x",
            [],
            {},
            [1, 2],
            [10**9] * 4,
            {"n": "x"},
            {"n": [1]},
            float("nan"),
            True,
        ):
            yield f"{name} = {value}", npz(**arrays | {"metadata": np.array(json.dumps(metadata | {name: value}))})
    for text in ("", "[]", "null", "[" * 100_000, '{"a": 1e999}', "9" * 10_000):
        yield f"metadata {text[:9]}", npz(**arrays | {"metadata": np.array(text)})


def knowing_solution(content: bytes) -> Iterator[tuple[str, bytes]]:
    yield from knowing_npz(content)
    arrays = dict(np.load(io.BytesIO(content)))
    for n in (0, -1, 2**31 - 1, 2**40):
        yield f"divisions {n}", npz(**arrays | {"divisions": np.full(36, n)})
    for text in ("", "[]", "[" * 100_000, "{}", '{"scene_hash": 1}', "null"):
        yield f"made by {text[:9]}", npz(**arrays | {"made_by": np.array(text)})


def knowing_npy(content: bytes) -> Iterator[tuple[str, bytes]]:
    for shape in ((10**5, 10**5, 3), (1 << 62, 2, 3), (-4, 6, 3), (10**30, 1, 3), (0, 6, 3), (4, 6, 3, 0)):
        yield f"{shape}", header(shape, "<f8") + content[128:]
    for kind in ("|O", "<c16", "<U4", "|V8", "<M8[s]"):
        yield kind, header((4, 6, 3), kind) + content[128:]
    for value in (np.nan, np.inf):
        file = io.BytesIO()
        np.save(file, np.full((4, 6, 3), value))
        yield f"{value}", file.getvalue()
    yield "pickle", pickle.dumps(Exploding())


def knowing_exr(content: bytes) -> Iterator[tuple[str, bytes]]:
    at = content.index(b"dataWindow\0") + len(b"dataWindow\0box2i\0") + 4
    for box in ((0, 0, 10**5, 10**5), (0, 0, 2**31 - 1, 2**31 - 1), (5, 5, 0, 0), (-(2**31), 0, 2**31 - 1, 3)):
        yield f"window {box}", content[:at] + np.array(box, "<i4").tobytes() + content[at + 16 :]
    for name, value in ((b"compression\0compression\0", 99), (b"lineOrder\0lineOrder\0", 99)):
        where = content.index(name) + len(name) + 4
        yield f"{name!r}", content[:where] + bytes([value]) + content[where + 1 :]
    for value in (b"[", b"{}", b"[1e999]", b"[-1, 2]", b"[" * 6):
        if b"glpath.batch_counts" in content:
            where = content.index(b"glpath.batch_counts\0string\0") + len(b"glpath.batch_counts\0string\0") + 4
            yield f"counts {value!r}", content[:where] + value + content[where + len(value) :]


def knowing_png(content: bytes) -> Iterator[tuple[str, bytes]]:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    for width, height in ((12_000, 12_000), (2**31 - 1, 2**31 - 1), (0, 5), (100_000, 100_000)):
        first = chunk(b"IHDR", width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 2, 0, 0, 0]))
        yield f"{width} x {height}", content[:8] + first + content[33:]
    yield "text bomb", content[:33] + chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(20 << 20))) + content[33:]


def knowing_json(content: bytes) -> Iterator[tuple[str, bytes]]:
    job = json.loads(content)
    for name in job:
        for value in (None, -1, 10**400, "x", [], {}, [2**70, 2**71], [float("nan")] * 4):
            yield f"{name} = {value}", json.dumps(job | {name: value}).encode()
    for name in job["integrator"]:
        for value in (-1, 10**40, "x", [], {}):
            yield name, json.dumps(job | {"integrator": job["integrator"] | {name: value}}).encode()
    for name in job["sensor"]:
        for value in ([1e308] * 3, [0, 0, 0], 1e999, [10**9, 10**9]):
            yield name, json.dumps(job | {"sensor": job["sensor"] | {name: value}}).encode()
    yield "deep", b"[" * 100_000
    yield "deep setting", content.replace(b'"seed": 0', b'"seed": ' + b"[" * 100_000)


def knowing_mesh(content: bytes) -> Iterator[tuple[str, bytes]]:
    for old, new in (
        (b"element vertex 4", b"element vertex 4000000000"),
        (b"element face 2", b"element face 4000000000"),
        (b"uchar int", b"float double"),
        (b"3 0 1 2", b"255 0 1 2"),
        (b"f 1/1", b"f 99999999999999999999/1"),
        (b"f 1/1", b"f -9/1"),
        (b"f 1/1", b"f 1/7"),
        (b"f 1/1", b"f 1/0"),
        (b"f 1/1", b"f x"),
        (b"\x02\0\0\0", b"\xff\xff\xff\xff"),
        (b"1 1 0", b"nan inf 1e400"),
    ):
        if old in content:
            yield f"{new!r}", content.replace(old, new, 1)


KNOWING: dict[str, Callable[[bytes], Iterator[tuple[str, bytes]]]] = {
    "film.npz": knowing_film,
    "solution.npz": knowing_solution,
    "radiance.npz": knowing_npz,
    "picture.npy": knowing_npy,
    "picture.exr": knowing_exr,
    "baseline.exr": knowing_exr,
    "picture.png": knowing_png,
    "job.json": knowing_json,
}


def command_line(line: str, path: Path, folder: Path) -> str:
    """Return how a command ended: well, with a clear error, or a description of a forbidden outcome."""
    from typer.testing import CliRunner

    from glpath.cli.main import app

    words = [word.replace("{}", str(path)).replace("OUT", str(folder / "out")) for word in line.split()]
    result = CliRunner().invoke(app, words)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        return "".join(traceback.format_exception(result.exception))
    if result.exit_code and "error" not in result.output and "not the same" not in result.output:
        return f"exit code {result.exit_code} without a reason: {result.output}"
    return "error" if result.exit_code else "result"


def attempt(reader: Callable[[Path], None], path: Path) -> str:
    """ "error" or "result"; or, in words, what should not be."""
    try:
        reader(path)
    except GlpathError as error:
        if isinstance(error.__cause__, MemoryError):
            return f"asked for too much memory: {error}"
        return "error"
    except Exception as error:
        return "".join(traceback.format_exception(error))
    return "result"


@contextlib.contextmanager
def limited_memory() -> Iterator[None]:
    """Limit the block to 1 GB more memory. Damage files outside of it, because LZMA needs much."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + (1 << 30), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (most, hard))


def attack(rounds: int = 1, every: int = 1) -> dict[str, Any]:
    """Return the counts of outcomes, and the first forbidden ones."""
    counts: Counter[str] = Counter()
    wrong = []
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(name)
        make(folder)
        for file, readers in READERS.items():
            assert attempt(readers[0], folder / file) == "result", file
        for file in READERS:
            path = folder / file
            content = path.read_bytes()
            damages = [*blind(content, rounds, file), *KNOWING.get(file, knowing_mesh)(content)]
            for number, (damage, changed) in enumerate(damages[::every]):
                path.write_bytes(changed)
                with limited_memory():
                    ends = [attempt(reader, path) for reader in READERS[file]]
                    if number % 8 == 0:
                        ends += [command_line(line, path, folder) for line in COMMANDS.get(file, ())]
                counts["files"] += 1
                for end in ends:
                    counts[end if end in ("error", "result") else "wrong"] += 1
                    if end not in ("error", "result"):
                        wrong.append(f"{file}, {damage}: {end}")
    return {**counts, "wrong": counts["wrong"], "first": wrong[:20]}


if __name__ == "__main__":
    # OpenEXR prints on standard output what it cannot read.
    with contextlib.redirect_stdout(io.StringIO()):
        found = attack(*map(int, sys.argv[1:]))
    print(json.dumps(found))
