"""Reading a scene ends at the time limit, and the message names the file."""

from __future__ import annotations

import os
import struct
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from glpath.apps.measure.tables import read_points
from glpath.cli.scene import read_scene
from glpath.errors import TimeLimitError
from glpath.lights.lighting import max_radiance
from glpath.scene import check_scene
from glpath.system.files import read_bytes
from glpath.system.time_limit import limited
from tests.support.check_gaps import check_gaps, grid
from tests.support.clock import Clock

#: Models have neither camera nor light.
pytestmark = pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
#: Squares along each side of the grid: 51,200 triangles.
SIDE = 160
#: Largest fraction of the reading time that may pass between two checks.
LARGEST_GAP = 0.5


def rows(words: str, values: NDArray[np.number]) -> str:
    """Return a line for each row of values, with the format `words`."""
    return "".join(words % tuple(row) for row in values.tolist())


def write_obj(path: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    path.write_text(rows("v %.5f %.5f %.5f\n", vertices) + rows("f %d %d %d\n", faces + 1))


def write_off(path: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    head = f"OFF\n{len(vertices)} {len(faces)} 0\n"
    path.write_text(head + rows("%.5f %.5f %.5f\n", vertices) + rows("3 %d %d %d\n", faces))


def write_stl(path: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    facet = "facet normal 0 1 0\nouter loop\n" + 3 * "vertex %.5f %.5f %.5f\n" + "endloop\nendfacet\n"
    path.write_text(f"solid a\n{rows(facet, vertices[faces].reshape(-1, 9))}endsolid a\n")


def write_ply(path: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    """Write triangles and a last face of four corners, so that rows have different lengths."""
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces) + 1}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    lists = np.empty(len(faces), [("count", "u1"), ("vertices", "<i4", 3)])
    lists["count"], lists["vertices"] = 3, faces
    quad = struct.pack("<B4i", 4, *faces[0], faces[0, 0] + 1)
    path.write_bytes(head.encode() + vertices.astype("<f4").tobytes() + lists.tobytes() + quad)


def write_glb(path: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.Trimesh(vertices, faces, process=False).export(path)


def write_xml(path: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    write_obj(path.with_suffix(".obj"), vertices, faces)
    shape = f'<shape type="obj"><string name="filename" value="{path.stem}.obj"/></shape>'
    path.write_text(f'<scene version="3.0.0"><emitter type="constant"/>{shape}</scene>')


def write_toml(path: Path, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    write_obj(path.with_suffix(".obj"), vertices, faces)
    path.write_text(
        "[camera]\nposition = [0, 3, 4]\ntarget = [0, 0, 0]\nfov = 45\n[materials.a]\nreflectance = 0.5\n"
        '[sky]\nzenith = [1, 1, 1]\nhorizon = [1, 1, 1]\n[[shapes]]\ntype = "mesh"\nmaterial = "a"\n'
        f'file = "{path.stem}.obj"\n'
    )


WRITERS: dict[str, Callable[[Path, NDArray[np.float64], NDArray[np.int64]], None]] = {
    ".obj": write_obj, ".off": write_off, ".stl": write_stl, ".ply": write_ply, ".glb": write_glb,
    ".xml": write_xml, ".toml": write_toml,
}  # fmt: skip


@pytest.mark.parametrize("suffix", WRITERS)
def test_reading_checks_the_time_limit_between_its_parts(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"grid{suffix}"
    WRITERS[suffix](path, *grid(2))
    glpath.load_scene(path)  # imports modules
    WRITERS[suffix](path, *grid(SIDE))
    with check_gaps(monkeypatch) as gaps:
        glpath.load_scene(path)
    assert max(gaps) < LARGEST_GAP * sum(gaps)


@pytest.mark.parametrize("suffix", WRITERS)
def test_reading_that_exceeds_the_limit_names_the_file(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, clock = tmp_path / f"grid{suffix}", Clock(monkeypatch)
    WRITERS[suffix](path, *grid(2))
    with limited(1.0):
        clock.ahead = 2.5
        with pytest.raises(TimeLimitError, match=rf"time_limit=1: over while reading grid{suffix}, before"):
            glpath.load_scene(path)


def test_reading_without_a_scene_file_has_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    content = b"[camera]\nposition = [0, 3, 4]\ntarget = [0, 0, 0]\n"
    monkeypatch.setattr("glpath.cli.scene.read_standard_input", lambda limit: content)
    read: dict[str, Callable[[], object]] = {
        "standard input": lambda: read_scene("-", []),
        "the scene": lambda: glpath.load_scene(tomllib.loads(content.decode())),
        "stacked": lambda: glpath.load_scene("stacked", {"objects": 1}),
        "room.hbjson": lambda: read_points(Path("room.hbjson"), None),
    }
    clock = Clock(monkeypatch)
    for name, call in read.items():
        clock.ahead = 0.0
        with limited(1.0):
            clock.ahead = 2.5
            with pytest.raises(TimeLimitError, match=f"over while reading {name}, before"):
                call()


def test_wait_for_the_writer_of_a_pipe_has_the_time_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    os.mkfifo(tmp_path / "a")
    monkeypatch.setattr("glpath.system.files._WRITER_S", 0.3)
    with limited(1.0):
        clock.ahead = 2.5
        with pytest.raises(TimeLimitError, match="over while reading a pipe, before"):
            read_bytes(tmp_path / "a")


def test_mesh_file_of_a_scene_is_named_while_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, clock = tmp_path / "grid.toml", Clock(monkeypatch)
    write_toml(path, *grid(2))

    def later(content: bytes) -> str:
        clock.ahead = 2.5
        return content.decode()

    monkeypatch.setattr("glpath.io.obj.decoded", later)
    with limited(1.0), pytest.raises(TimeLimitError, match=r"over while reading grid\.obj, before"):
        glpath.load_scene(path)


def test_picture_that_exceeds_the_limit_is_not_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image = pytest.importorskip("PIL.Image")
    path, clock = tmp_path / "grid.obj", Clock(monkeypatch)
    path.write_text("mtllib grid.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n")
    (tmp_path / "grid.mtl").write_text("newmtl a\nmap_Kd wood.png\n")
    Image.new("RGB", (2, 2)).save(tmp_path / "wood.png")

    def later(*_: object) -> None:
        clock.ahead = 2.5

    monkeypatch.setattr("glpath.io.pictures.check_file", later)
    with limited(1.0), pytest.raises(TimeLimitError, match=r"over while reading wood\.png, before"):
        glpath.load_scene(path)


def test_parts_of_a_mesh_file_check_the_time_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, checks = tmp_path / "grid.obj", []
    parts = "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(30))
    path.write_text(f"mtllib grid.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n{parts}")
    (tmp_path / "grid.mtl").write_text("newmtl m0\nmap_Kd -s 1 1 1 -o 0 0 0 wood.png\n")
    monkeypatch.setattr("glpath.io.mesh_models.check_time", lambda: checks.append("part"))
    monkeypatch.setattr("glpath.io.mtl.check_time", lambda: checks.append("option"))
    glpath.load_scene(path)
    assert (checks.count("part"), checks.count("option")) == (30, 2)


def test_reading_for_a_resumed_film_does_not_end_with_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    options: dict[str, Any] = {"integrator": "path", "guide": "cosine", "resolution": (16, 12)}
    begun = glpath.render("cornell-box-36", spp=2, **options)
    clock = Clock(monkeypatch)

    def later(*_: object) -> None:
        clock.ahead = 1e6

    monkeypatch.setattr("glpath.io.library.refuse_other_file", later)
    film = glpath.render("cornell-box-36", film=begun, time_limit=10.0, **options)
    assert (film.path_sets, film.metadata.stop_rule) == (2, "time limit")


@pytest.mark.parametrize(
    "module",
    ["io.load", "io.build", "io.lights", "io.materials", "scene.check", "system.digest", "lights.lighting"],
)
def test_loops_over_shapes_lights_and_materials_check_the_time_limit_for_each_item(
    module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    count, checks = 30, []
    monkeypatch.setattr(f"glpath.{module}.check_time", lambda *_: checks.append(module))
    scene = glpath.load_scene(
        {
            "camera": {"position": [0, 3, 4], "target": [0, 0, 0], "fov": 45},
            "materials": {f"m{i}": {"reflectance": 0.5} for i in range(count)},
            "shapes": [
                {"type": "sphere", "center": [i, 0, 0], "radius": 0.1, "material": "m0"} for i in range(count)
            ],
            "lights": [{"type": "point", "position": [i, 1, 0], "intensity": 1} for i in range(count)],
        }
    )
    check_scene(scene)
    scene.digest()
    max_radiance(scene)
    assert len(checks) >= count


def test_scene_that_is_checked_beyond_the_limit_is_named_as_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, clock = glpath.load_scene("cornell-box-36"), Clock(monkeypatch)

    def later(*_: object) -> list[str]:
        clock.ahead = 12.0
        return []

    monkeypatch.setattr("glpath.rendering.session.check_scene", later)
    with pytest.raises(TimeLimitError, match="time_limit=10: over while preparing the scene, before"):
        glpath.render(scene, spp=1, resolution=(4, 4), time_limit=10.0)


def test_points_file_that_exceeds_the_limit_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, clock = tmp_path / "points.csv", Clock(monkeypatch)
    path.write_text("x,y,z\n0,0,0\n1,0,0\n")

    def later(cell: str) -> float:
        clock.ahead = 2.5
        return float(cell) if cell.isdigit() else float("nan")

    monkeypatch.setattr("glpath.apps.measure.tables.real", later)
    with limited(1.0), pytest.raises(TimeLimitError, match=r"over while reading points\.csv, before"):
        read_points(path, (0.0, 1.0, 0.0))
