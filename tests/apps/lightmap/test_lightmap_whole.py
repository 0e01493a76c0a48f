"""Nothing of a model is missing from its lightmap: what has no texels is the inside of closed solids, by proof."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

import glpath
from glpath.apps.lightmap import atlas, surfaces
from glpath.apps.lightmap.overlaps import overlapping
from glpath.apps.lightmap.surfaces import AtlasSurfaces
from glpath.cli.main import app
from glpath.errors import GlpathError, SceneWarning, TimeLimitError, UsageError
from glpath.io import load_scene
from glpath.rendering.sides import Sides, _lit
from glpath.scene import Scene
from glpath.scene.sight import winding_number
from glpath.scene.triangulate import path_traceable
from glpath.system.time_limit import limited
from tests.support.gltf_files import ReadGlb

pytest.importorskip("xatlas")

CAMERA = {"position": [0, -9, 4], "target": [0, 0, 0.5], "up": [0, 0, 1], "fov": 40}
MATERIALS = {"grey": {"reflectance": 0.5}, "glass": {"type": "principled", "transmission": 1, "roughness": 0}}
SHIPPED = ["cornell-box", "cornell-box-36", "furnace", "office", "office-premesh", "parlour", "room", "stacked",
           "teapot", "terrain"]  # fmt: skip


def mesh_of(model: trimesh.Trimesh, **more: Any) -> dict[str, Any]:
    return {"type": "mesh", "vertices": model.vertices, "faces": model.faces, "material": "grey"} | more


def box(size: float = 1.0, at: tuple[float, float, float] = (0, 0, 0), **more: Any) -> dict[str, Any]:
    model = trimesh.creation.box((size, size, size))
    return mesh_of(model.apply_translation(at), **more)


def bulb(at: tuple[float, float, float], size: float = 0.05) -> dict[str, Any]:
    return mesh_of(trimesh.creation.icosphere(1, size).apply_translation(at), emission={"radiance": 50})


def scene_of(*shapes: dict[str, Any], **parts: Any) -> Scene:
    return load_scene({"camera": CAMERA, "materials": MATERIALS, "shapes": list(shapes), **parts})


def _leaves(count: int) -> trimesh.Trimesh:
    random = np.random.default_rng(3)
    corners = random.normal(size=(count, 1, 3)) + 0.1 * random.normal(size=(count, 3, 3))
    return trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), process=False)


def _hills(side: int) -> trimesh.Trimesh:
    x, y = np.meshgrid(*[np.linspace(-3, 3, side)] * 2, indexing="ij")
    i = np.arange(side * side).reshape(side, side)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1).reshape(-1, 4)
    vertices = np.stack([x, y, 0.3 * np.sin(2 * x) * np.cos(3 * y)], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(vertices, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]), process=False)


def _tube() -> trimesh.Trimesh:
    model = trimesh.creation.cylinder(1, 2)
    level = np.abs(model.face_normals[:, 2]) > 0.5
    return trimesh.Trimesh(model.vertices, model.faces[~level])


def _moebius() -> trimesh.Trimesh:
    t = np.linspace(0, 2 * np.pi, 24, endpoint=False)[:, None]
    s = np.array([-0.3, 0.3])
    radius = 1 + s * np.cos(t / 2)
    vertices = np.stack([radius * np.cos(t), radius * np.sin(t), s * np.sin(t / 2)], axis=-1).reshape(-1, 3)
    a = 2 * np.arange(24)
    b = (a + 2) % 48
    turn = b == 0
    c, d = np.where(turn, 1, b), np.where(turn, 0, b + 1)
    return trimesh.Trimesh(vertices, np.concatenate([np.stack([a, a + 1, d], 1), np.stack([a, d, c], 1)]))


def _inside_out() -> trimesh.Trimesh:
    model = trimesh.creation.icosphere(2)
    model.invert()
    return model


SKY = {"ambient": 1.0}
FOREIGN: dict[str, Scene] = {
    "a box in a box": scene_of(box(2), box(0.5), bulb((0, 0, 3))),
    "a closed room": scene_of(
        mesh_of(trimesh.creation.box((4, 4, 4)), material="grey"), box(0.5), bulb((1, 1, 1), 0.02)
    ),
    "leaves": scene_of(mesh_of(_leaves(120)), **SKY),
    "hills": scene_of(mesh_of(_hills(12)), bulb((0, 0, 2), 0.01)),
    "moebius": scene_of(mesh_of(_moebius()), bulb((0, 0, 2))),
    "inside out": scene_of(mesh_of(_inside_out()), **SKY),
    "torus": scene_of(mesh_of(trimesh.creation.torus(1, 0.3, 12, 8)), bulb((0, 0, 2))),
    "an open tube": scene_of(mesh_of(_tube()), **SKY),
    "crossing boxes": scene_of(box(1), box(1, (0.4, 0.3, 0.2)), bulb((0, 0, 2))),
    "capsules": scene_of(*(mesh_of(trimesh.creation.capsule(1, 0.3, (6, 6)).apply_translation((i, 0, 0)))
                           for i in range(3)), bulb((0, 0, 3))),
}  # fmt: skip


def in_triangles(name: str) -> Scene:
    return FOREIGN[name] if name in FOREIGN else path_traceable(load_scene(name).at())


@pytest.mark.parametrize("name", [*SHIPPED, *FOREIGN])
def test_every_triangle_is_shown_whatever_the_seed(name: str) -> None:
    """At four walks a triangle, other seeds lost other books, and all lost the painting."""
    scene = in_triangles(name)
    found = [Sides.of(scene, seed) for seed in range(2 if len(scene.triangles) > 1000 else 4)]
    for sides in found:
        assert sides.shown.any(axis=1).all()
        assert np.array_equal(sides.shown, found[0].shown)
        assert not (sides.shown & sides.hidden).any()
    # The witness: rays by chance, that know of no solids, never find light on a side that was proved to be hidden.
    first = found[0]
    by_chance = _lit(scene, first.rays, first.surfaces, first.surfaces.sends, 9, first.beyond)
    assert not (by_chance & first.hidden).any()
    if name == "parlour":
        assert all((sides.lit[:, 0] | sides.lit[:, 1]).all() for sides in found)


@pytest.mark.parametrize("name", [pytest.param("parlour", marks=pytest.mark.evidence), *FOREIGN])
def test_every_triangle_is_in_the_file(name: str, tmp_path: Path) -> None:
    scene = in_triangles(name)
    found = AtlasSurfaces.of(scene, size=512).atlas
    assert np.array_equal(np.unique(found.triangle), np.arange(len(scene.triangles)))
    assert (found.page == 0).all()
    assert np.isfinite(found.uv).all()


def test_a_baked_file_has_the_triangles_of_the_model(tmp_path: Path) -> None:
    baked = glpath.lightmap(FOREIGN["leaves"], size=256, spp=1, max_depth=1)
    for materials, sides in (("unlit", 2), ("keep", 2)):
        baked.save(tmp_path / "a.glb", materials=materials)  # type: ignore[arg-type]
        read = ReadGlb.of(tmp_path / "a.glb")
        count = sum(len(read.values(p["indices"])) for mesh in read.json["meshes"] for p in mesh["primitives"])
        assert count == 3 * sides * 120


HIDING = {
    "alone": ((box(),), 12),
    "with a lamp in it": ((box(), bulb((0, 0, 0))), 0),
    "with a lamp through it": ((box(), bulb((0.5, 0, 0), 0.2)), 0),
    "with a lamp beside it": ((box(), bulb((0.7, 0, 0))), 12),
    "about another": ((box(), box(0.5)), 24),
    "of glass": ((box(material="glass"),), 0),
    "without a lid": ((box(faces=trimesh.creation.box().faces[2:]),), 0),
    "about the camera": ((mesh_of(trimesh.creation.box((40, 40, 40))),), 0),
    "that is a sheet twice": (({"type": "mesh", "vertices": np.eye(3), "faces": [[0, 1, 2], [2, 1, 0]]},), 0),
}  # fmt: skip


@pytest.mark.parametrize("kind", list(HIDING))
def test_the_inside_of_a_box_is_hidden_where_nothing_can_be_in_it(kind: str) -> None:
    shapes, count = HIDING[kind]
    # The bulbs are closed solids themselves, whose insides are hidden, too.
    bulbs = sum(80 for shape in shapes if "emission" in shape and kind != "with a lamp through it")
    sides = Sides.of(scene_of(*shapes, **SKY))
    assert sides.hidden.sum() == count + bulbs
    assert not sides.hidden[:, 0].any(), "fronts are outside"


def test_a_surface_that_crosses_itself_hides_nothing() -> None:
    """A tube of a lying eight: one of its loops is wound the other way, so that no side is inside everywhere."""
    t = np.linspace(0, 2 * np.pi, 16, endpoint=False) + 0.1
    ring = np.stack([np.sin(t), np.sin(t) * np.cos(t)], axis=1)
    vertices = np.concatenate([np.c_[ring, np.zeros(16)], np.c_[ring, np.ones(16)], [[0, 0, 0], [0, 0, 1]]])
    i = np.arange(16)
    j = (i + 1) % 16
    walls = np.concatenate([np.stack([i, j, j + 16], 1), np.stack([i, j + 16, i + 16], 1)])
    caps = np.concatenate([np.stack([j, i, 0 * i + 32], 1), np.stack([i + 16, j + 16, 0 * i + 33], 1)])
    model = {"type": "mesh", "vertices": vertices, "faces": np.concatenate([walls, caps]), "material": "grey"}
    assert not Sides.of(scene_of(model, **SKY)).hidden.any()


def test_the_winding_number_of_a_ball_is_one_inside_and_zero_outside() -> None:
    triangles = trimesh.creation.icosphere(2).triangles
    assert winding_number(triangles, np.array([0.3, -0.5, 0.4])) == pytest.approx(1)
    assert winding_number(triangles, np.array([1.3, -0.5, 0.4])) == pytest.approx(0)


def test_dark_sides_have_texels_but_fewer() -> None:
    """A crate that stands open on a floor: its inside is not proved to be one."""
    crate = box()
    corners = trimesh.creation.box().triangles
    crate["faces"] = crate["faces"][~(corners[:, :, 2] < 0).all(axis=1)]
    floor = box(6, (0, 0, -3.5))
    sides = Sides.of(scene_of(crate, floor, **SKY))
    assert set(np.unique(sides.density[:10])) == {0.25, 1.0}
    found = AtlasSurfaces.of(scene_of(crate, floor, **SKY), size=256).atlas
    assert np.sort(np.bincount(found.triangle)).tolist() == [1] * 12 + [2] * 10


@pytest.mark.parametrize("name", ["cornell-box", "office", pytest.param("room", marks=pytest.mark.evidence)])
def test_the_exposure_is_that_of_a_picture(name: str) -> None:
    """Of all texels it was more by 0.7 stops in the room, so that a third of the view was white."""
    baked = glpath.lightmap(name, size=512 if name == "room" else 256, spp=4)
    picture = glpath.render(name, spp=16, resolution=(64, 64), max_depth=64, roulette=4)
    assert abs(baked.exposure_stops("auto") - picture.exposure_stops("auto")) <= 0.26
    assert baked.exposure_stops(1.5) == 1.5
    with pytest.raises(UsageError, match="exposure is"):
        baked.exposure_stops("bright")  # type: ignore[arg-type]


def test_a_lightmap_shows_itself_and_its_page_while_it_converges(monkeypatch: pytest.MonkeyPatch) -> None:
    """It printed 251 lines of arrays, and rows of texels in place of the page."""
    import IPython.display

    bundles: list[dict[str, Any]] = []
    handle = SimpleNamespace(update=lambda bundle, raw: bundles.append(bundle))
    monkeypatch.setattr(IPython.display, "display", lambda bundle, **_: bundles.append(bundle) or handle)
    monkeypatch.setattr("glpath.rendering.progress.in_notebook", lambda: True)
    baked = glpath.lightmap("cornell-box", size=64, spp=2, progress=True)
    assert len(repr(baked)) < 200
    assert "1 page of 64 x 64" in repr(baked)
    pictures = [bundle["image/png"] for bundle in bundles if "image/png" in bundle]
    assert pictures
    for png in (baked._repr_mimebundle_()["image/png"], *pictures):
        assert isinstance(png, bytes)
        assert png[:4] == b"\x89PNG"
        assert np.frombuffer(png[16:24], ">u4").tolist() == [64, 64], "the page, not rows of texels"


def test_kept_metal_is_said_to_be_black(tmp_path: Path) -> None:
    gold = {"gold": {"type": "principled", "reflectance": [1, 0.8, 0.3], "metallic": 1, "roughness": 0.3}}
    scene = load_scene({"camera": CAMERA, "materials": gold, "shapes": [box(material="gold")], **SKY})
    baked = glpath.lightmap(scene, size=64, spp=1, max_depth=1)
    with pytest.warns(SceneWarning, match='"gold": mirrors and metal are black in a viewer without an environment'):
        baked.save(tmp_path / "a.glb", materials="keep")


def test_the_command_says_what_it_did_and_what_helps(tmp_path: Path) -> None:
    asked = ["lightmap", "cornell-box", "-o", str(tmp_path / "a.glb"), "--size", "64", "--spp", "16"]
    asked += ["--progress", "none", "--no-denoise", "--max-depth", "3"]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    told = " ".join(done.stderr.split())
    assert "all 32 triangles are in it" in told
    assert "for less noise: leave out --no-denoise, or --noise 0.02 (some " in told
    assert "exposure +" in told


def test_without_xatlas_nothing_is_read_or_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise GlpathError("xatlas cannot be imported")

    monkeypatch.setattr(atlas, "require_xatlas", missing)
    monkeypatch.setattr("glpath.cli.lightmap.read_scene", None)
    done = CliRunner().invoke(app, ["lightmap", "cornell-box", "-o", str(tmp_path / "a.glb")])
    assert done.exit_code == 1
    assert "xatlas cannot be imported" in done.stderr


# Large models


def test_a_fine_terrain_is_cut_into_patches() -> None:
    """The time for charts grew with the square of what hangs together."""
    scene = scene_of(mesh_of(_hills(110)), **SKY)
    parts = atlas._parts(scene, np.ones((len(scene.triangles), 2)))
    assert max(len(triangles) for triangles, _, _ in parts) <= 250
    for side in range(2):
        those = np.concatenate([triangles for triangles, of, _ in parts if of == side])
        assert np.array_equal(np.sort(those), np.arange(len(scene.triangles)))


def test_areas_are_not_found_anew_for_each_instance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of N instances of a mesh it was N times the area of all N."""
    calls = []
    areas = Scene.areas.fget  # type: ignore[attr-defined]
    monkeypatch.setattr(Scene, "areas", property(lambda scene: calls.append(1) or areas(scene)))
    scene = scene_of(*(box(0.1, (x, y, 0)) for x in range(10) for y in range(10)), **SKY)
    AtlasSurfaces.of(scene, size=512)
    assert len(calls) < 60


def test_what_would_take_an_hour_is_refused_with_an_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atlas, "_packed", None)  # is not come to
    monkeypatch.setattr(atlas, "_SECONDS_EACH", 20.0)
    monkeypatch.setattr(atlas, "_MAX_SECONDS", 400.0)
    with pytest.raises(UsageError, match=r"atlas of 24 sides of triangles in 2 pieces would take about 8 minutes"):
        atlas.packed(scene_of(box(), **SKY), np.ones((12, 2)), None, 256)
    many = scene_of(*(box(0.1, (x, y, 0)) for x in range(10) for y in range(10)), **SKY)
    with pytest.raises(UsageError, match="has 100 meshes and instances"):
        AtlasSurfaces.of(many, size=16)


def test_default_page_grows_until_all_charts_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page that is chosen is the smallest power of two that may be given as a size."""
    monkeypatch.setattr(surfaces, "DEFAULT_SIZE", 16)
    many = scene_of(*(box(0.1, (x, y, 0)) for x in range(4) for y in range(4)), **SKY)
    found = AtlasSurfaces.of(many).atlas
    assert (found.pages, found.size[0] > 16) == (1, True)
    with pytest.raises(UsageError, match="too small"):
        AtlasSurfaces.of(many, size=found.size[0] // 2)
    monkeypatch.setattr(surfaces, "LARGEST_PAGE", 16)
    with pytest.raises(UsageError, match="a page of 16 x 16 texels is too small"):
        AtlasSurfaces.of(many)


def test_atlas_that_takes_longer_than_the_time_left_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atlas, "_packed", None)  # is not reached
    monkeypatch.setattr(atlas, "_SECONDS_EACH", 2.0)
    monkeypatch.setattr(atlas, "core_count", lambda: 4)
    with limited(7.0), pytest.raises(TimeLimitError, match=r"time_limit=7: making the atlas would take about 12 s"):
        atlas.packed(scene_of(box(), **SKY), np.ones((12, 2)), None, 256)  # 24 sides, by 4 cores


def test_instances_share_their_charts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Charts were made anew for each instance and each trial: 170 s for 300 balls of 1,280 triangles, now 20."""
    made: list[int] = []
    corners = atlas._corners

    def counted(scene: Scene, part: Any, unit: float) -> Any:
        made.append(len(part[0]))
        return corners(scene, part, unit)

    monkeypatch.setattr(atlas, "_corners", counted)
    monkeypatch.setattr(atlas, "_MANY", 1000)
    scene = path_traceable(scene_of({"type": "sphere", "center": [0, 0, 0], "radius": 0.4}, **SKY).at())
    mesh = scene.shapes[0].geometry
    places = np.zeros((12, 3, 4))
    for i, (turn, scale) in enumerate(zip(np.linspace(0, 3, 12), np.linspace(1, 2, 12), strict=True)):
        c, s = np.cos(turn), np.sin(turn)
        places[i, :, :3] = scale * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        places[i, :, 3] = [3 * i, i, 0]
    places[11, 0, :3] *= 1.5  # one is stretched, and has charts of its own
    scene = replace(scene, shapes=(replace(scene.shapes[0], geometry=mesh, world_from_object=places),))
    count = 12 * len(mesh.faces)
    density = np.stack([np.ones(count), np.zeros(count)], axis=1)
    found = atlas.packed(scene, density, None, 1024)
    assert sum(made) == 2 * len(mesh.faces)
    assert np.array_equal(np.sort(found.triangle), np.arange(count))
    assert overlapping(found.uv, found.size) is None
    stretch = np.sqrt(found.areas.reshape(12, -1).sum(1) / scene.areas[found.triangle].reshape(12, -1).sum(1))
    np.testing.assert_allclose(stretch / found.texels, 1.0, atol=0.06)
    assert ((found.uv >= 0) & (found.uv <= 1024)).all()


def test_a_long_atlas_is_announced_with_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atlas, "_SECONDS_EACH", 1.0)
    (tmp_path / "a.toml").write_text(
        "[camera]\nposition = [0, -9, 4]\ntarget = [0, 0, 0]\n[sky]\nzenith = 1\nhorizon = 1\n"
        '[[shapes]]\ntype = "box"\nsize = [1, 1, 1]\ncenter = [0, 0, 0]\n'
    )
    command = ["lightmap", str(tmp_path / "a.toml"), "-o", str(tmp_path / "a.glb"), "--size", "64", "--spp", "1"]
    said = CliRunner().invoke(app, command)
    assert said.exit_code == 0, said.output
    assert "atlas of 12 sides of triangles in 1 pieces: about 12 s of processor time" in said.output
    assert "about 12 s" not in CliRunner().invoke(app, [*command, "--quiet"]).output
