"""The blocks of code in the README and in docs/, the files that they need, and the blocks that no test can run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import trimesh

import glpath
from benchmarks.walks import FENCE, LAMP, commands_of
from tests.support.honeybee_model import two_rooms
from tests.support.honeybee_model import write as write_honeybee
from tests.support.repository import ROOT
from tests.support.weather_files import write_epw

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

#: Languages of blocks that are not code.
PROSE = ("", "text")

#: Blocks that another test runs, by language and a phrase in them, with the test's file.
ELSEWHERE = {
    ("js", "light.channel = 1"): "tests/apps/lightmap/test_lightmap_seen.py",
    ("js", "new BABYLON.Texture"): "tests/apps/lightmap/test_lightmap_seen.py",
    ("python", "import bpy\n"): "tests/apps/lightmap/test_lightmap_seen.py",
    ("python", "render_regression("): "tests/apps/image_tests/test_pytest_suite.py",
    ("ini", "[pytest]"): "tests/apps/image_tests/test_pytest_suite.py",
}

#: Blocks that no test runs, by language and a phrase in them, with the reason.
NOT_RUN = {
    ("dockerfile", "FROM debian"): "needs Docker and a network",
    ("yaml", "kind: Job"): "needs Kubernetes",
    ("yaml", "upload-artifact"): "needs GitHub",
    ("sh", "#SBATCH"): "needs Slurm",
    ("glsl", "shader_type spatial"): "needs Godot",
    ("python", "mpl_image_compare"): "is of pytest-mpl; benchmarks/image_suite has such a test",
    (
        "sh",
        "--blinds office-closed.toml",
    ): "the page has a part of that scene; tests/apps/daylight/test_year.py has blinds",
    ("js", "probe.sh.fromArray"): "a part of a page; tests/apps/test_probes.py holds what it reads",
}

#: Patterns of shell lines that no test runs, with the reasons.
LINES_NOT_RUN = {
    r"\b(apt-get|pip) install\b": "changes the machine",
    r"^make\b": "sets a checkout up",
    r"^python3 -m venv\b": "makes an environment for what pip installs",
    r"\bpython -m benchmarks\b": "tests of benchmarks run it",
    r"^npm install\b": "needs a network",
    r"\bdocker\b": "needs Docker",
    r"^srun\b|^sbatch\b": "needs Slurm",
    r"--cluster (?!local)": "needs a cluster",
    r"(^|\s)/data/": "a folder of a cluster",
    r"^pytest\b": "tests of the README run it",
    r"^jupyter lab\b": "waits for a person; `make test` runs the notebooks",
    r"--install-completion": "changes the shell's own files",
}


@dataclass(frozen=True)
class Block:
    """A block of code.

    page : file that contains it
    line : number of its first line
    kind : language
    """

    page: Path
    line: int
    kind: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def listed(self, entries: dict[tuple[str, str], str]) -> str | None:
        """Return the entry of a list for this block."""
        found = (said for (kind, phrase), said in entries.items() if kind == self.kind and phrase in self.text)
        return next(found, None)

    @property
    def runs(self) -> bool:
        """Return whether the test of blocks runs it."""
        return self.listed(ELSEWHERE) is None and self.listed(NOT_RUN) is None

    def commands(self) -> Iterator[str]:
        """Yield the lines of a shell block to run, without comments."""
        return commands_of(self.text, LINES_NOT_RUN)


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page, except MyST directives."""
    text = page.read_text("utf-8")
    return [
        Block(page, text.count("\n", 0, found.start()) + 2, found["kind"], found["text"])
        for found in FENCE.finditer(text)
        if not text[found.start() + 3 :].startswith("{")
    ]


# ---- the files that pages name -----------------------------------------------------------------------------------

#: 16 x 8 pixels of radiance 1, RGBE.
WHITE = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + bytes([128, 128, 128, 129]) * 128


def write_models(folder: Path) -> None:
    """Write models, a lamp's profile and an environment map under the names that the pages use."""
    box = trimesh.creation.box([6, 3, 4])
    for name in ("room.obj", "hall.stl", "street.stl"):
        box.export(folder / name)
    walls = ["o wall-{}\nf {} {} {}".format(i, *(face + 1)) for i, face in enumerate(box.faces)]
    corners = ["v {} {} {}".format(*vertex) for vertex in box.vertices]
    (folder / "zone.obj").write_text("\n".join([*corners, *walls]) + "\n")
    (folder / "lamp.ies").write_text(LAMP)
    write_honeybee(two_rooms(), folder / "room.hbjson")
    (folder / "studio.hdr").write_bytes(WHITE)
    header = "ncols 16\nnrows 12\nxllcorner 0\nyllcorner -24\ncellsize 2\n"
    (folder / "dem.asc").write_text(
        header + "\n".join(" ".join(str(r * c % 7) for c in range(16)) for r in range(12))
    )
    for name in ("desk.csv", "sensors.csv"):
        (folder / name).write_text("x,y,z,nx,ny,nz\n1.0,1.0,0.76,0,0,1\n2.0,3.0,0.76,0,0,1\n")
    write_epw(folder / "zurich.epw")
    write_epw(folder / "bern.epw", latitude=46.9)
    (folder / "suns.csv").write_text("azimuth,altitude,hours\n120,20,365\n180,35,365\n")
    seat = {"type": "box", "min": [0, 0, 0], "max": [1, 1, 1], "material": "Seat"}
    scene = {
        "camera": {"position": [0, 2, 5], "target": [0, 1, 0]},
        "materials": {"Seat": {"reflectance": 0.5}},
        "shapes": [seat],
        "lights": [{"type": "point", "position": [0, 3, 2], "intensity": 10}],
    }
    for name in ("model.glb", "chair.glb", "parlour.glb", "city.glb"):
        glpath.export(scene, folder / name)


def write_films(folder: Path) -> None:
    """Write films and pictures under the names that the pages use."""
    for number, name in enumerate(("new", "old", "shard-0", "shard-256")):
        film = glpath.render("cornell-box-36", spp=96, first_path_set=96 * number, resolution=(32, 32), max_depth=2)
        film.save(folder / f"{name}.npz")
        if number < 2:
            film.save(folder / f"{'ab'[number]}.exr")
