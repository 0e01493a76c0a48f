"""Albedo and normal of what the eye sees: beside a ray caster in numpy, and beside Mitsuba."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from reference import numpy_ray_tracer as slow

import glpath
from glpath.errors import ImageError, UsageError
from glpath.experiments import mitsuba_peer
from glpath.film import Film
from glpath.film_metadata import AOVS
from glpath.image import read_exr_channels, read_image
from glpath.integrators import aovs
from glpath.rendering import RenderJob, run
from glpath.scene import Scene

#: A texture, a smooth sphere, a lamp, the black back of a card, and the sky behind.
RESOLUTION = (40, 30)
Aovs = dict[str, NDArray[np.float64]]

SCENE: dict[str, object] = {
    "camera": {"position": [0.3, 2.2, 4.5], "target": [0, 0.7, 0], "fov": 42},
    "textures": {"squares": {"type": "checker", "colors": [[0.8, 0.3, 0.2], [0.1, 0.2, 0.6]], "scale": 2}},
    "materials": {
        "floor": {"texture": "squares"},
        "ball": {"reflectance": [0.3, 0.5, 0.1]},
        "card": {"reflectance": [0.9, 0.9, 0.9], "two_sided": False},
    },
    "sky": {"zenith": [0.2, 0.3, 3.0], "horizon": 0.5},
    "shapes": [
        {"type": "quad", "corners": [[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]], "material": "floor"},
        {"type": "sphere", "center": [0.6, 0.6, 0.3], "radius": 0.6, "material": "ball", "subdivisions": 3},
        {"type": "box", "min": [-0.9, 1.7, -0.9], "max": [0.1, 1.9, -0.2], "emission": {"radiance": [0.3, 2, 0]}},
        {
            "type": "quad",
            "corners": [[-1.5, 0.1, 0.5], [-1.5, 1, 0.5], [-0.6, 1, 0.5], [-0.6, 0.1, 0.5]],
            "material": "card",
        },
    ],
}
SIDE = 8  # places along a pixel's side that the slow one asks


def slow_aovs(scene: Scene) -> Aovs:
    """The same by float64 rays, SIDE x SIDE of them through every pixel, on exact spheres."""
    width, height = scene.camera.resolution
    total = {name: np.zeros((width * height, 3)) for name in AOVS}
    of_shape = slow._shape_of_primitive(scene)
    places = (np.arange(SIDE) + 0.5) / SIDE
    for x in places:
        for y in places:
            origins, directions = slow.camera_rays(scene, (x, y))
            primitive, t = slow.nearest(scene, origins, directions)
            albedo, normal = slow.sky_radiance(scene, directions), np.zeros_like(directions)
            hit = primitive >= 0
            n, uv = slow._surface(scene, primitive[hit], origins[hit] + t[hit, None] * directions[hit])
            front = np.sum(n * directions[hit], axis=1) < 0
            normal[hit] = np.where(front[:, None], n, -n)
            seen = np.zeros_like(n)
            for i, shape in enumerate(of_shape[primitive[hit]]):
                material, s = scene.materials[scene.shapes[shape].material], scene.shapes[shape]
                if front[i] or material.two_sided:
                    seen[i] = material.reflectance
                if material.texture is not None:
                    seen[i] *= slow.texture_colour(scene, material.texture.texture, uv[i : i + 1])[0]
                if s.emits and (front[i] or s.emission_two_sided):
                    seen[i] += s.emission
            albedo[hit] = seen
            total["albedo"] += np.clip(albedo, 0, 1)
            total["normal"] += normal
    return {name: found.reshape(height, width, 3) / SIDE**2 for name, found in total.items()}


@pytest.fixture(scope="module")
def expected() -> Aovs:
    return slow_aovs(glpath.load_scene(SCENE).with_camera(resolution=RESOLUTION))


def test_aovs_of_more_path_sets_than_a_word_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums are collected before they run over; the bits stay those of all at once."""
    whole = glpath.render("cornell-box-36", spp=8, resolution=(24, 24), max_depth=1, aovs=AOVS)
    monkeypatch.setattr(aovs, "_MOST_PATH_SETS", 3)
    parts = glpath.render("cornell-box-36", spp=8, resolution=(24, 24), max_depth=1, aovs=AOVS)
    for name in AOVS:
        assert parts.aov_sums[name].tobytes() == whole.aov_sums[name].tobytes()
        assert np.abs(whole.aov_sums[name]).max() > 4


@pytest.mark.parametrize(
    "options",
    [{}, {"directions": "pair"}, {"integrator": "gather"}, {"integrator": "gather", "directions": "pair"}],
    ids=["own", "pair", "gather", "gather-pair"],
)
def test_aovs_are_those_of_a_slow_ray_caster(
    options: dict[str, object], expected: dict[str, NDArray[np.float64]]
) -> None:
    if "integrator" in options:
        options["radiosity"] = glpath.solve_radiosity(SCENE, method="monte-carlo", particles=1000)
    film = glpath.render(SCENE, resolution=RESOLUTION, spp=64, max_depth=2, aovs=AOVS, **options)
    for name in AOVS:
        found, wanted = film.aov(name), expected[name]
        assert found.shape == wanted.shape
        assert found.dtype == np.float64
        # Within surfaces they are equal, but for the facets of the sphere; edges have 64 places in either.
        difference = np.abs(found - wanted).max(axis=2)
        assert np.percentile(difference, 75) < 1e-5, name
        assert difference.max() < 0.1, name
        assert found.mean(axis=(0, 1)) == pytest.approx(wanted.mean(axis=(0, 1)), abs=5e-4)


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["cornell-box-36", "room"])
def test_aovs_are_those_of_mitsuba(name: str) -> None:
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    scene = glpath.load_scene(name).with_camera(resolution=(128, 128))
    mi = mitsuba_peer.load_mitsuba()
    integrator = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})
    peer = np.array(mi.render(mitsuba_peer.to_mitsuba(scene, 1), integrator=integrator, spp=64), np.float64)
    film = glpath.render(scene, spp=64, max_depth=1, aovs=AOVS)
    for found, wanted in ((film.aov("albedo"), peer[..., :3]), (film.aov("normal"), peer[..., 3:])):
        difference = np.abs(found - wanted).max(axis=2)
        assert np.median(difference) < 1e-4
        assert np.percentile(difference, 95) < 0.04
        assert np.mean(difference > 0.2) < 0.006  # lamps, whose albedo has their emission in it here


@pytest.mark.parametrize("directions", ["own", "pair"])
def test_who_asks_for_aovs_gets_the_same_picture(directions: str) -> None:
    options = {"spp": 9, "max_depth": 2, "resolution": (24, 18), "directions": directions}
    plain, both = glpath.render(SCENE, **options), glpath.render(SCENE, aovs=AOVS, **options)
    assert plain.radiance_sums.tobytes() == both.radiance_sums.tobytes()
    assert plain.metadata.settings == both.metadata.settings
    assert plain.aov_sums == {}
    one = glpath.render(SCENE, aovs="normal", **options)
    assert one.metadata.aovs == ("normal",)
    assert np.array_equal(one.aov("normal"), both.aov("normal"))


def test_aovs_of_parts_merge_into_those_of_the_whole_bit_for_bit(tmp_path: Path) -> None:
    """Through JSON and files, as on other machines; and as tiles would have it, a crop is a part of the whole."""
    job = RenderJob.of("cornell-box-36", spp=24, max_depth=1, resolution=(20, 16), aovs=["normal", "albedo"])
    assert RenderJob.from_json(job.to_json()) == job
    parts = []
    for i, part in enumerate(job.split(3)):
        part.save(tmp_path / f"{i}.json")
        run(RenderJob.load(tmp_path / f"{i}.json")).save(tmp_path / f"{i}.npz")
        parts.append(Film.load(tmp_path / f"{i}.npz"))
    merged, whole = parts[2].merge(parts[0]).merge(parts[1]), run(job)
    assert whole.metadata.aovs == AOVS
    crop = glpath.render("cornell-box-36", spp=24, max_depth=1, resolution=(20, 16), crop=(3, 4, 9, 7), aovs=AOVS)
    for name in AOVS:
        assert np.array_equal(merged.aov(name), whole.aov(name))
        assert np.array_equal(crop.aov(name), whole.aov(name)[4:11, 3:12])


def test_an_exr_has_aovs_as_layers(tmp_path: Path) -> None:
    film = glpath.render("cornell-box-36", spp=2, max_depth=1, resolution=(16, 12), aovs=AOVS)
    film.save(tmp_path / "a.exr")
    channels, header = read_exr_channels(tmp_path / "a.exr")
    layers = {"albedo": "RGB", "normal": "XYZ"}
    assert set(channels) == {*"RGB", *(f"{name}.{axis}" for name, axes in layers.items() for axis in axes)}
    for name, axes in layers.items():
        stored = np.stack([channels[f"{name}.{axis}"] for axis in axes], axis=2)
        assert np.array_equal(stored, film.aov(name).astype(np.float32))
    assert np.array_equal(read_image(tmp_path / "a.exr"), film.mean.astype(np.float32))
    assert header["glpath.aovs"] == '["albedo", "normal"]'


def test_aovs_that_are_not_there_are_refused_with_what_to_do() -> None:
    with pytest.raises(UsageError, match="'albedo'; those that it holds: normal") as caught:
        glpath.render(SCENE, spp=1, max_depth=1, resolution=(8, 6), aovs=["normal"]).aov("albedo")
    assert "aovs=('albedo', 'normal')" in str(caught.value)
    with pytest.raises(UsageError, match="aovs: 'depth'; allowed are albedo, normal"):
        glpath.render(SCENE, aovs=["depth"])
    with pytest.raises(UsageError, match="aovs: 3 where some of albedo, normal are needed"):
        glpath.render(SCENE, aovs=3)
    with pytest.raises(UsageError, match='option of "path" and "gather"'):
        glpath.render(SCENE, integrator="t-buffer", aovs=AOVS)


def test_films_with_other_aovs_do_not_merge() -> None:
    options = {"spp": 8, "max_depth": 1, "resolution": (8, 6)}
    plain = glpath.render(SCENE, **options)
    both = glpath.render(SCENE, aovs=AOVS, first_path_set=8, **options)
    with pytest.raises(UsageError, match=r'aovs is \["albedo", "normal"\] in one film and \[\] in the other'):
        plain.merge(both)


@pytest.mark.parametrize("aovs", [["depth"], ["normal", "albedo"], 3, [["albedo"]], {"albedo": 1}])
def test_a_film_that_names_other_aovs_than_there_are_is_refused(aovs: object, make_film, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    make_film().save(path)
    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["metadata"] = np.array(json.dumps(json.loads(str(arrays["metadata"])) | {"aovs": aovs}))
    np.savez(path, **arrays)
    with pytest.raises(ImageError):
        Film.load(path)


def test_a_film_without_its_sums_or_with_wrong_ones_is_refused(make_film, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    film = Film.empty(make_film().metadata)
    Film.empty(replace(film.metadata, aovs=AOVS)).save(path)
    assert Film.load(path).aov_sums.keys() == set(AOVS)
    with np.load(path) as stored:
        arrays = dict(stored)
    for wrong in (np.zeros((2, 2, 3)), np.full((4, 6, 3), np.nan), np.zeros((4, 6, 3), np.int64)):
        np.savez(path, **arrays | {"albedo_sums": wrong})
        with pytest.raises(ImageError):
            Film.load(path)
    np.savez(path, **{name: array for name, array in arrays.items() if name != "albedo_sums"})
    with pytest.raises(ImageError, match="albedo_sums"):
        Film.load(path)


def test_sums_of_fewer_bits_are_read_as_what_films_have(tmp_path: Path) -> None:
    path = tmp_path / "film.npz"
    glpath.render("cornell-box-36", spp=1, max_depth=1, resolution=(8, 6), aovs=AOVS).save(path)
    with np.load(path) as stored:
        parts = {name: stored[name] for name in stored.files}
    np.savez(path, **{**parts, "albedo_sums": parts["albedo_sums"].astype(np.float16)})
    assert Film.load(path).aov("albedo").dtype == np.float64
