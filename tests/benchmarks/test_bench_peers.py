"""What the benches at equal error stand on: comparable scenes, references, samples to a target, other programs."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.benches.equal_error import Contestant, compared_with, error_of, scaled
from benchmarks.peers import cycles as cycles_peer
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.peers import other_python
from benchmarks.peers import radiance as radiance_peer
from benchmarks.references import kept as references
from benchmarks.references.kept import Reference, reference_picture
from benchmarks.references.stored import stored_reference
from glpath.compare import relative_mse
from glpath.errors import GlpathError, SceneError, UsageError
from glpath.io import load_scene
from glpath.scene.model import Shapes

LAMP = {"type": "quad", "corners": [[0, 2, 0], [1, 2, 0], [1, 2, 1], [0, 2, 1]], "emission": {"radiance": 4}}
BALL = {"type": "sphere", "radius": 0.5, "subdivisions": 2}
CAMERA = {"position": [0, 1, 4], "target": [0, 1, 0]}


def scene_of(**fields: object):
    return load_scene({"camera": CAMERA, "shapes": [LAMP, BALL]} | fields)


# Scenes


def test_a_sphere_is_the_same_flat_triangles_for_all() -> None:
    scene, notes = mitsuba_peer.comparable(scene_of())
    assert len(scene.triangles) == 2 + 20 * 4**2
    assert not np.any(scene.shapes.vertex_normals)
    assert len(notes) == 1
    assert "flat" in notes[0]


def test_the_shipped_scenes_are_compared_as_they_are() -> None:
    for name in ("cornell-box-36", "room", "office"):
        scene = load_scene(name)
        assert mitsuba_peer.comparable(scene) == (scene, [])


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"sky": {"zenith": 1, "horizon": 1}}, "has a sky"),
        ({"ambient": 0.5}, "has ambient light"),
        ({"lights": [{"type": "point", "name": "bulb", "position": [0, 3, 0], "intensity": 1}]}, "lights (bulb)"),
        (
            {
                "shapes": [LAMP, BALL | {"material": "wax"}],
                "materials": {"wax": {"type": "phong", "reflectance": 0.5, "specular": 0.5}},
            },
            "highlights (wax)",
        ),
    ],
)
def test_what_a_peer_cannot_take_is_refused_by_name(fields, words) -> None:
    with pytest.raises(SceneError) as refused:
        mitsuba_peer.comparable(scene_of(**fields))
    assert words in str(refused.value)


def test_a_scene_without_light_is_refused() -> None:
    box = load_scene("cornell-box-36")
    with pytest.raises(SceneError, match="no shape emits"):
        mitsuba_peer.comparable(replace(box, shapes=Shapes(box.shapes[1:])))


# References


@pytest.fixture
def noisy(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Mitsuba's batches: a grey picture with noise by their seed; the seeds that were asked for."""
    seeds: list[int] = []

    def render(peer, spp, seed):
        seeds.append(seed)
        return 0.5 + 0.05 * np.random.default_rng(seed).normal(size=(6, 8, 3))

    monkeypatch.setattr(mitsuba_peer, "to_mitsuba", lambda *_, **__: None)
    monkeypatch.setattr(mitsuba_peer, "render_peer", render)
    monkeypatch.setattr(references, "versions", lambda name: {name: "3"})
    return seeds


def test_a_reference_is_as_good_as_it_says_and_is_kept(noisy, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    scene = scene_of().with_camera(resolution=(8, 6))
    found = reference_picture(None, scene, 5, True, 5e-4, lambda text: None)
    assert found is not None
    assert found.relmse <= 5e-4
    assert relative_mse(found.image, np.full((6, 8, 3), 0.5)) == pytest.approx(found.relmse, rel=0.5)
    assert noisy[:2] == [references.FIRST_SEED, references.FIRST_SEED + 1]
    batches = len(noisy)
    again = reference_picture(None, scene, 5, True, 5e-4, lambda text: None)
    assert len(noisy) == batches
    np.testing.assert_array_equal(again.image, found.image)
    # A better one goes on where that ended.
    better = reference_picture(None, scene, 5, True, 2.5e-4, lambda text: None)
    assert better.relmse <= 2.5e-4
    assert noisy == list(range(references.FIRST_SEED, references.FIRST_SEED + len(noisy)))
    # Another view is another picture; a damaged file is none.
    (kept,) = (tmp_path / "glpath" / "references").iterdir()
    assert references._kept(kept, scene)[0] == len(noisy)
    kept.write_bytes(kept.read_bytes()[:100])
    assert references._kept(kept, scene)[0] == 0
    reference_picture(None, scene.with_camera(fov=20.0), 5, True, 5e-4, lambda text: None)
    assert len(list(kept.parent.iterdir())) == 2


def test_what_ships_is_taken_where_it_is_the_scene_and_good_enough(noisy, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    box = load_scene("cornell-box-36")
    found = reference_picture(None, box, 3, True, 1e-4, lambda text: None)
    assert (found.source, noisy) == ("benchmarks/references/cornell-box-36-depth3.npz", [])
    assert found.relmse == pytest.approx(1.6e-6, rel=0.1)
    assert reference_picture(None, box.with_camera(resolution=(8, 6)), 3, False, 1e-4, lambda text: None) is None
    assert reference_picture(None, box.with_camera(fov=50.0), 3, False, 1e-4, lambda text: None) is None


def test_a_given_reference_must_have_the_size(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", radiance=np.ones((6, 8, 3)))
    box = load_scene("cornell-box-36")
    found = reference_picture(tmp_path / "a.npz", box.with_camera(resolution=(8, 6)), 3, False, 1, print)
    assert np.isnan(found.relmse)
    with pytest.raises(UsageError, match="is a picture of 8 x 6, the bench's is 256 x 256"):
        reference_picture(tmp_path / "a.npz", box, 3, False, 1, print)


# Equal error


def program(error_of_one: float, seed: int = 0) -> Contestant:
    """One whose error falls as 1 / n, ten milliseconds a sample."""
    random = np.random.default_rng(seed)

    def draw(counts, seed):
        images = [0.5 + np.sqrt(error_of_one * 0.26 / n) * random.normal(size=(64, 64, 3)) for n in counts]
        return [10.0 for _ in counts], images

    return Contestant((32, 64, 128), draw)


def test_numbers_of_samples_grow_until_the_target_is_among_them() -> None:
    truth = Reference(np.full((64, 64, 3), 0.5), 0.0, "")
    easy, hard = program(0.1), program(1.0)
    for contestant in (easy, hard):
        contestant.grow(truth, 1e-3)
        contestant.run(0, truth)
    assert easy.counts == (32, 64, 128)
    assert hard.counts[-1] == pytest.approx(1250, rel=0.1)
    assert hard.error[-1] < 1e-3 < hard.error[0]
    assert [row["samples"] for row in hard.rows("hard")] == list(hard.counts)
    assert scaled((32, 64, 128), 0.01) == (1,)


def test_what_the_reference_adds_to_an_error_is_taken_off() -> None:
    random = np.random.default_rng(1)
    image, truth = (0.5 + 0.02 * random.normal(size=(64, 64, 3)) for _ in range(2))
    relmse = 0.02**2 / 0.26
    assert error_of(image, Reference(truth, relmse, "")) == pytest.approx(relmse, rel=0.1)
    assert error_of(image, Reference(truth, np.nan, "")) == pytest.approx(2 * relmse, rel=0.1)


def test_a_program_with_another_picture_is_not_compared() -> None:
    measured = {"cycles_mean_off": 0.002, "cycles_s": 20.0}
    assert compared_with("cycles", measured, 5.0) == {"vs_cycles": 4.0}
    assert compared_with("cycles", measured | {"cycles_mean_off": 0.02}, 5.0) == {}
    assert compared_with("cycles", measured | {"cycles_s": np.nan}, 5.0) == {}
    assert compared_with("cycles", {}, 5.0) == {}


# Other programs


def test_a_program_that_is_absent_says_how_to_install_it() -> None:
    with pytest.raises(GlpathError, match=r"pip install glpath\[peers\], or name a Python"):
        other_python.find_package("no_such_renderer", sys.executable)
    with pytest.raises(GlpathError, match="does not run as a Python"):
        other_python.find_package("bpy", "/no/such/python")
    folder, version = other_python.find_package("numpy", sys.executable)
    assert Path(folder).is_dir()
    assert version == np.__version__


def test_cycles_gets_the_scene_as_it_is(tmp_path: Path) -> None:
    box = load_scene("cornell-box-36")
    cycles_peer.write_scene(box, 3, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as written:
        assert (int(written["shapes"]), int(written["bounces"])) == (len(box.shapes), 2)
        np.testing.assert_array_equal(
            np.concatenate([written[f"corners{i}"] for i in range(len(box.shapes))]), box.triangles
        )
        np.testing.assert_allclose(
            written["light0"], [0.885809, 0.698859, 0.666422, 0, 18.387, 13.9873, 6.75357, 0]
        )
        view = written["world_from_camera"]
    np.testing.assert_allclose(view @ [0, 0, -1, 1], [0, 0, 2.9, 1], atol=1e-12)
    np.testing.assert_allclose(view[:3, :2], np.eye(3)[:, :2], atol=1e-12)


def test_radiance_gets_the_scene_in_its_language() -> None:
    box = load_scene("cornell-box-36")
    lines = radiance_peer.described(box).splitlines()
    assert lines[0] == "void light m0"
    assert sum(" polygon " in line for line in lines) == 36
    assert "5 0.885809 0.698859 0.666422 0 0" in lines
    arguments = radiance_peer.view(box)
    assert arguments[:5] == ["-vtv", "-vp", "0", "0", "3.9"]
    assert arguments[-1] == arguments[-3] == "39.3077"


@pytest.mark.evidence  # needs the peers extra
def test_cycles_sees_what_mitsuba_sees() -> None:
    """Mean within 0.5 %, and an error that is noise: it falls as 1 / n."""
    try:
        cycles_peer.version()
    except GlpathError as error:
        pytest.skip(str(error))
    truth = stored_reference("cornell-box-36", 3)
    with cycles_peer.cycles(load_scene("cornell-box-36"), 3) as program:
        errors = {}
        for spp in (16, 256):
            _, image = program.render(spp, 1)
            errors[spp] = relative_mse(image, truth)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), truth.mean(axis=(0, 1)), rtol=5e-3)
    assert errors[256] < errors[16] / 12


@pytest.mark.evidence  # needs the peers extra
def test_radiance_sees_about_what_mitsuba_sees() -> None:
    try:
        radiance_peer.version()
    except GlpathError as error:
        pytest.skip(str(error))
    box = load_scene("cornell-box-36").with_camera(resolution=(64, 64))
    truth = stored_reference("cornell-box-36", 64).reshape(64, 4, 64, 4, 3).mean(axis=(1, 3))
    _, image = radiance_peer.render(box)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), truth.mean(axis=(0, 1)), rtol=0.03)
    assert relative_mse(image, truth) < 0.01
