"""The guides of docs/howto: their commands are accepted, their scenes load, their Python runs."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest
import trimesh
from typer.main import get_command

import glpath
from glpath.cli.main import app
from tests.support.repository import ROOT

GUIDES = sorted((ROOT / "docs/howto").glob("*.md"))

#: Candela by angle from straight down, LM-63.
LAMP = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 5 1 1 2 0 0 0\n1 1 100\n0 22.5 45 67.5 90\n0\n1000 920 700 380 0\n"

#: Not run here, and why.
ELSEWHERE = {
    ("image-tests", "python"): "tests/pytest_plugin/test_pytest_suite.py runs it",
    ("image-tests", "ini"): "tests/pytest_plugin/test_pytest_suite.py runs it",
    ("lightmap-threejs", "js"): "tests/bake/test_lightmap_seen.py runs it",
    ("lightmap-babylonjs", "js"): "tests/bake/test_lightmap_seen.py runs it",
    ("probes", "js"): "a page of a browser; tests/bake/test_probes.py reads the file by three.js",
    ("docker", "dockerfile"): "needs Docker",
    ("kubernetes", "yaml"): "needs a cluster",
}


def blocks(page: Path, kind: str) -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def guides(kind: str) -> list[Path]:
    """Those that have such blocks, but for `ELSEWHERE`."""
    return [page for page in GUIDES if blocks(page, kind) and (page.stem, kind) not in ELSEWHERE]


def with_kind(kind: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("page", guides(kind), ids=lambda page: page.stem)


def commands(page: Path) -> list[list[str]]:
    """The arguments of each `glpath` in the shell blocks of a page."""
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    called = [match[1] for line in lines if (match := re.match(r"(?:.* & )?glpath (.*)", line))]
    values = {"$a": "0", "$b": "256"}
    for name, value in values.items():
        called = [line.replace(name, value) for line in called]
    return [shlex.split(line.partition(" & ")[0].partition(" > ")[0], comments=True) for line in called]


def make_files(folder: Path) -> None:
    """What the guides suppose to be there."""
    model = trimesh.creation.box([6, 3, 4])
    for name in ("room.obj", "zone.obj", "hall.stl", "street.stl", "model.glb"):
        model.export(folder / name)
    seat = trimesh.visual.material.PBRMaterial(name="Seat")
    trimesh.Trimesh(
        model.vertices, model.faces, visual=trimesh.visual.TextureVisuals(uv=model.vertices[:, :2], material=seat)
    ).export(folder / "chair.glb")
    (folder / "lamp.ies").write_text(LAMP)
    shutil.copy(ROOT / "scenes/parlour.glb", folder)
    grey = bytes([128, 128, 128, 129])
    (folder / "studio.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + 128 * grey)


def test_every_kind_of_block_is_run_or_named() -> None:
    found = {
        (page.stem, kind)
        for page in GUIDES
        for kind in re.findall(r"^```(\w+)$", page.read_text("utf-8"), re.MULTILINE)
    }
    assert {pair for pair in found if pair[1] not in ("sh", "python", "toml")} - set(ELSEWHERE) == set()
    assert set(ELSEWHERE) <= found


@with_kind("sh")
def test_commands_of_a_guide_are_accepted(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are parsed, with all values of options, and not run."""
    monkeypatch.chdir(tmp_path)
    make_files(tmp_path)
    program = get_command(app)
    for arguments in commands(page):
        context = program.make_context("glpath", list(arguments), resilient_parsing=True)
        name, *rest = arguments
        command = program.get_command(context, name) if not name.startswith("-") else None
        if command is not None and not "".join(rest).startswith("--help"):
            command.make_context(name, rest)


@with_kind("toml")
@pytest.mark.filterwarnings("ignore:chair.glb. not used. The time")  # the model here stands still
def test_scenes_of_a_guide_load(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    make_files(tmp_path)
    for block in blocks(page, "toml"):
        camera = (
            ""
            if "[camera]" in block
            else 'camera = { type = "panorama", position = [0, 1, 0], target = [0, 1, 1] }\n'
        )
        Path("scene.toml").write_text(camera + block)
        glpath.load_scene("scene.toml")


@with_kind("python")
@pytest.mark.filterwarnings("ignore:model.glb. has no camera")
def test_python_of_a_guide_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of a page in order, with few samples."""
    monkeypatch.chdir(tmp_path)
    make_files(tmp_path)
    lines = "\n".join(blocks(page, "python")).splitlines()
    code = "\n".join(line if "RenderJob" in line else re.sub(r"\bspp=\d+", "spp=4", line) for line in lines)
    exec(compile(code, page.name, "exec"), {"__name__": "guide"})
