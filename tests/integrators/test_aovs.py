"""AOVs of what the eye sees: beside a ray caster in numpy, beside Mitsuba, and as a file has them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from benchmarks.peers import mitsuba as mitsuba_peer
from glpath.errors import ImageError, UsageError
from glpath.film.aovs import AOVS, DENOISER_AOVS, FAR
from glpath.film.exr import read_exr_channels
from glpath.film.film import Film
from glpath.film.image import read_image
from glpath.integrators import aovs
from glpath.rendering import RenderJob, run
from glpath.scene import Scene
from tests.reference import numpy_ray_tracer as slow
from tests.support.engines import coarse, with_depth

#: A texture, a smooth sphere, a lamp, the black back of a card, and the sky behind.
RESOLUTION = (40, 30)
Aovs = dict[str, NDArray[Any]]

#: Of the surfaces themselves.
SURFACES = ("albedo", "normal", "depth", "position", "object_id", "material_id")

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
    """The same by float64 rays, SIDE x SIDE of them through every pixel, on exact spheres.

    Also as "shapes" (H, W, shapes) the share of the samples that meet each.
    """
    width, height = scene.camera.resolution
    total = {name: np.zeros((width * height, 3)) for name in (*DENOISER_AOVS, "position")}
    met, depth = np.zeros((width * height, len(scene.shapes))), np.zeros((width * height, 1))
    forward = scene.camera.frame()[2]
    of_shape = slow.shape_of_primitive(scene)
    places = (np.arange(SIDE) + 0.5) / SIDE
    for x in places:
        for y in places:
            origins, directions = slow.camera_rays(scene, (x, y))
            primitive, t = slow.nearest(scene, origins, directions)
            albedo, normal = slow.sky_radiance(scene, directions), np.zeros_like(directions)
            hit = primitive >= 0
            n, uv = slow.surface_of(scene, primitive[hit], origins[hit] + t[hit, None] * directions[hit])
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
            total["position"][hit] += origins[hit] + t[hit, None] * directions[hit]
            depth[hit] += (t[hit] * (directions[hit] @ forward))[:, None]
            met[np.flatnonzero(hit), of_shape[primitive[hit]]] += 1
    hits = met.sum(axis=1, keepdims=True)
    found = {name: (total[name] / SIDE**2).reshape(height, width, 3) for name in DENOISER_AOVS}
    found["position"] = (total["position"] / np.maximum(hits, 1)).reshape(height, width, 3)
    found["depth"] = np.where(hits > 0, depth / np.maximum(hits, 1), FAR).reshape(height, width)
    materials = np.zeros((len(met), len(scene.materials)))
    for number, shape in enumerate(scene.shapes):
        materials[:, shape.material] += met[:, number]
    for name, counts in (("object_id", met), ("material_id", materials)):
        found[name] = np.where(hits[:, 0] > 0, counts.argmax(axis=1) + 1, 0).reshape(height, width)
    return found | {"shapes": (met / SIDE**2).reshape(height, width, -1)}


@pytest.fixture(scope="module")
def expected() -> Aovs:
    return slow_aovs(glpath.load_scene(SCENE).with_camera(resolution=RESOLUTION))


#: Two cards that face the camera, the nearer one askew in the picture, at depths of 2 and 5; nothing behind.
CARDS: dict[str, object] = {
    "camera": {"position": [0, 0, 5], "target": [0, 0, 0], "fov": 60},
    "materials": {"near": {"reflectance": 0.7}, "far": {"reflectance": 0.3}},
    "sky": {"zenith": [1, 1, 1], "horizon": 1},
    "shapes": [
        {"type": "quad", "corners": [[-1.9, -2, 0], [2, -1.8, 0], [1.9, 2, 0], [-2, 1.8, 0]], "material": "far"},
        {
            "type": "quad",
            "corners": [[-0.4, -0.5, 3], [0.5, -0.4, 3], [0.4, 0.5, 3], [-0.5, 0.4, 3]],
            "material": "near",
        },
    ],
}
EVERY: list[dict[str, Any]] = [
    {"integrator": "path"},
    {"integrator": "path-buffer"},
    {"integrator": "gather"},
    {"integrator": "t-buffer"},
    {"integrator": "classic"},
]


@pytest.mark.parametrize("options", EVERY, ids=lambda options: "-".join(map(str, options.values())))
def test_masks_have_one_number_a_pixel_and_depths_that_a_surface_has(
    options: dict[str, Any], tmp_path: Path
) -> None:
    scene = glpath.load_scene(CARDS).with_camera(resolution=(40, 30))
    options = {**with_depth(options, 2), "aovs": ("depth", "depth_min", "object_id", "material_id")}
    if options["integrator"] == "gather":
        options["radiosity"] = coarse(scene)
    film = glpath.render(scene, spp=24, **options)
    depth, least, number = (film.aov(name) for name in ("depth", "depth_min", "object_id"))
    surfaces = np.array([2.0, 5.0, FAR])
    distance = np.abs(least[..., None] / surfaces - 1)
    assert distance.min(axis=-1).max() < 1e-5
    assert np.any(np.abs(depth[..., None] / surfaces - 1).min(axis=-1) > 0.05)  # edges, where they are mixed
    assert number.dtype == np.int64
    assert set(np.unique(number)) == {0, 1, 2}
    # Of pixels without an edge all say the same; the near card is the second one.
    of_depth = np.array([2, 1, 0])[distance.argmin(axis=-1)]
    whole = np.abs(depth / least - 1) < 1e-5
    sky = film.cryptomatte("object").coverage.sum(axis=-1) < 1 - 1e-6
    assert np.array_equal(number[whole & ~sky], of_depth[whole & ~sky])
    assert np.all(least <= depth * (1 + 1e-6))
    # As parts, and as files, to the bit.
    parts = [glpath.render(scene, spp=12, first_path_set=first, **options) for first in (0, 12)]
    assert np.array_equal(parts[0].merge(parts[1]).aov("depth_min"), least)
    film.save(tmp_path / "a.npz")
    assert np.array_equal(Film.load(tmp_path / "a.npz").aov("depth_min"), least)
    film.save(tmp_path / "a.exr")
    channels, _ = read_exr_channels(tmp_path / "a.exr")
    assert np.array_equal(channels["depth_min.Z"], least.astype(np.float32))
    assert np.array_equal(channels["object_id.X"], number)


def test_aovs_of_more_path_sets_than_a_word_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums are collected before they run over; the bits stay those of all at once."""
    whole = glpath.render("cornell-box-36", spp=8, resolution=(24, 24), max_depth=1, aovs=AOVS)
    monkeypatch.setattr(aovs, "_MAX_PATH_SETS", 3)
    monkeypatch.setattr(aovs, "_SETS_READ", 3)
    parts = glpath.render("cornell-box-36", spp=8, resolution=(24, 24), max_depth=1, aovs=AOVS)
    assert_same_aovs(parts, whole)
    for name in ("albedo", "normal", "depth", "position", "direct"):
        assert np.abs(whole.aov_sums[name]).max() > 4


def assert_same_aovs(one: Film, other: Film) -> None:
    """Bit for bit."""
    assert one.metadata.aovs == other.metadata.aovs
    assert one.aov_sums.keys() == other.aov_sums.keys()
    for name, sums in one.aov_sums.items():
        assert sums.tobytes() == other.aov_sums[name].tobytes(), name
    assert one.shape_counts == other.shape_counts


ENGINES: dict[str, dict[str, object]] = {
    "path": {},
    "pair": {"integrator": "path-buffer"},
    "gather": {"integrator": "gather"},
    "gather-pair": {"integrator": "gather", "cast": "path-buffer"},
    "t-buffer": {"integrator": "t-buffer"},
    "classic": {"integrator": "classic"},
}


@pytest.mark.parametrize("options", ENGINES.values(), ids=ENGINES)
def test_aovs_are_those_of_a_slow_ray_caster(options: dict[str, object], expected: Aovs) -> None:
    if options.get("integrator") == "gather":
        options = options | {"radiosity": coarse(SCENE)}
    film = glpath.render(SCENE, resolution=RESOLUTION, spp=64, aovs=AOVS, **with_depth(options, 2))
    whole = expected["shapes"].sum(axis=2) == 1
    for name in DENOISER_AOVS:
        found, wanted = film.aov(name), expected[name]
        assert found.shape == wanted.shape
        assert found.dtype == np.float64
        # Within surfaces they are equal, but for the facets of the sphere; edges have 64 places in either.
        difference = np.abs(found - wanted).max(axis=2)
        assert np.percentile(difference, 75) < 1e-5, name
        assert difference.max() < 0.1, name
        assert found.mean(axis=(0, 1)) == pytest.approx(wanted.mean(axis=(0, 1)), abs=5e-4)
    for name in ("depth", "position"):
        found, wanted = film.aov(name), expected[name]
        assert found.shape == wanted.shape
        # The places of 64 samples in a pixel are others than those of the grid: of a slope the means differ.
        difference = np.abs(found - wanted)[whole]
        assert np.percentile(difference, 75) < 2e-4, name
        assert np.mean(difference) < 2e-3, name
    assert np.array_equal(film.aov("depth") == FAR, expected["depth"] == FAR)
    for name in ("object_id", "material_id"):
        found, wanted = film.aov(name), expected[name]
        assert found.dtype == np.int64
        assert set(np.unique(found)) == set(np.unique(wanted)) == {0, 1, 2, 3, 4}
        assert np.mean(found != wanted) < 0.01  # where two share a pixel
    matte = film.cryptomatte("object")
    for number, shape in enumerate(glpath.load_scene(SCENE).shapes):
        difference = np.abs(matte.matte(shape.name) - expected["shapes"][..., number])
        assert difference.max() < 0.1
        assert difference.mean() < 2e-3


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["cornell-box-36", "room"])
def test_aovs_are_those_of_mitsuba(name: str) -> None:
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    scene = glpath.load_scene(name).with_camera(resolution=(128, 128))
    mi = mitsuba_peer.load_mitsuba()
    integrator = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal,p:position,t:depth"})
    peer = np.array(mi.render(mitsuba_peer.to_mitsuba(scene, 1), integrator=integrator, spp=64), np.float64)
    film = glpath.render(scene, spp=64, max_depth=1, aovs=AOVS)
    # Mitsuba's depth runs along the ray, and its means are over all samples: of pixels that one surface fills.
    hits = film.cryptomatte("object", 2).coverage
    inside = hits[..., 0] == 1
    assert inside.mean() > 0.5
    size = float(np.linalg.norm(np.subtract(*scene.bounds)))
    position, cosine = film.aov("position"), scene.camera.rays() @ scene.camera.frame()[2]
    for found, wanted in ((position, peer[..., 6:9]), (film.aov("depth") / cosine, peer[..., 9])):
        difference = np.abs(found - wanted)[inside] / size
        # A pixel is about a hundredth of the scene, and the mean of Mitsuba's 64 places in it 0.04 of a pixel off.
        assert np.median(difference) < 3e-4
        assert np.percentile(difference, 95) < 2e-3
    for found, wanted in ((film.aov("albedo"), peer[..., :3]), (film.aov("normal"), peer[..., 3:6])):
        difference = np.abs(found - wanted).max(axis=2)
        assert np.median(difference) < 1e-4
        assert np.percentile(difference, 95) < 0.04
        assert np.mean(difference > 0.2) < 0.006  # lamps, whose albedo has their emission in it here


@pytest.mark.parametrize("options", ENGINES.values(), ids=ENGINES)
def test_who_asks_for_aovs_gets_the_same_picture(options: dict[str, object]) -> None:
    options = {"spp": 9, "resolution": (24, 18), **with_depth(options, 3)}
    if options.get("integrator") == "gather":
        options["radiosity"] = coarse(SCENE)
    plain, both = glpath.render(SCENE, **options), glpath.render(SCENE, aovs=AOVS, **options)
    assert plain.radiance_sums.tobytes() == both.radiance_sums.tobytes()
    assert plain.metadata.settings == both.metadata.settings
    assert plain.aov_sums == {}
    one = glpath.render(SCENE, aovs="normal", **options)
    assert one.metadata.aovs == ("normal",)
    assert np.array_equal(one.aov("normal"), both.aov("normal"))


def test_aovs_of_parts_merge_into_those_of_the_whole_bit_for_bit(tmp_path: Path) -> None:
    """Through JSON and files, as on other machines; and as tiles would have it, a crop is a part of the whole."""
    job = RenderJob.of("cornell-box-36", spp=24, max_depth=2, resolution=(20, 16), aovs="all")
    assert RenderJob.from_json(job.to_json()) == job
    parts = []
    for i, part in enumerate(job.split(3)):
        part.save(tmp_path / f"{i}.json")
        run(RenderJob.load(tmp_path / f"{i}.json")).save(tmp_path / f"{i}.npz")
        parts.append(Film.load(tmp_path / f"{i}.npz"))
    merged, whole = parts[2].merge(parts[0]).merge(parts[1]), run(job)
    assert whole.metadata.aovs == AOVS
    crop = glpath.render("cornell-box-36", spp=24, max_depth=2, resolution=(20, 16), crop=(3, 4, 9, 7), aovs=AOVS)
    assert_same_aovs(merged, whole)
    for name in AOVS:
        assert np.array_equal(merged.aov(name), whole.aov(name))
        assert np.array_equal(crop.aov(name), whole.aov(name)[4:11, 3:12])
    cut, matte = crop.cryptomatte("material"), whole.cryptomatte("material")
    assert np.array_equal(cut.ids, matte.ids[4:11, 3:12])
    assert np.array_equal(cut.coverage, matte.coverage[4:11, 3:12])


@pytest.mark.parametrize("options", ENGINES.values(), ids=ENGINES)
def test_a_picture_in_tiles_has_the_aovs_of_the_picture_in_one(
    options: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"spp": 3, "resolution": (24, 18), "aovs": "all", **with_depth(options, 2)}
    if options.get("integrator") == "gather":
        options["radiosity"] = coarse(SCENE)
    whole = glpath.render(SCENE, **options)
    monkeypatch.setattr("glpath.rendering.tiles.MAX_PATHS", 100)
    tiled = glpath.render(SCENE, **options)
    for name in SURFACES:
        assert np.array_equal(tiled.aov(name), whole.aov(name)), name
    if "path-buffer" not in options.values():  # whose cells are a window's
        assert_same_aovs(tiled, whole)


def test_an_exr_has_aovs_as_layers(tmp_path: Path) -> None:
    film = glpath.render(SCENE, spp=3, max_depth=2, resolution=(16, 12), aovs="all")
    film.save(tmp_path / "a.exr")
    channels, header = read_exr_channels(tmp_path / "a.exr")
    mattes = {f"Crypto{kind}0{i}.{c}" for kind in ("Object", "Material") for i in range(3) for c in "RGBA"}
    assert set(channels) == {*"RGB", *mattes, *(f"{name}.{axis}" for name, axes in LAYERS.items() for axis in axes)}
    for name, axes in LAYERS.items():
        stored = np.stack([channels[f"{name}.{axis}"] for axis in axes], axis=2)
        assert np.array_equal(stored, film.aov(name).astype(np.float32).reshape(stored.shape))
    assert np.array_equal(read_image(tmp_path / "a.exr"), film.mean.astype(np.float32))
    assert json.loads(header["glpath.aovs"]) == [*AOVS]
    matte = film.cryptomatte("object")
    for rank in range(6):
        layer, (number, cover) = f"CryptoObject0{rank // 2}", ("RG", "BA")[rank % 2]
        assert np.array_equal(channels[f"{layer}.{number}"], matte.ids[..., rank])
        assert np.array_equal(channels[f"{layer}.{cover}"], matte.coverage[..., rank].astype(np.float32))


#: What each AOV is called in a file.
LAYERS = {
    "albedo": "RGB",
    "normal": "XYZ",
    "depth": "Z",
    "depth_min": "Z",
    "uv": "XY",
    "position": "XYZ",
    "object_id": "X",
    "material_id": "X",
    "direct": "RGB",
    "indirect": "RGB",
    "samples": "X",
}


def test_aovs_that_are_not_there_are_refused_with_what_to_do() -> None:
    with pytest.raises(UsageError, match="'albedo'; those that it holds: normal") as caught:
        glpath.render(SCENE, spp=1, max_depth=1, resolution=(8, 6), aovs=["normal"]).aov("albedo")
    assert 'aovs=("albedo", "normal")' in str(caught.value)
    with pytest.raises(UsageError, match=r"aovs: 'fog'; allowed are albedo, normal, depth, .*, samples, all"):
        glpath.render(SCENE, aovs=["fog"])
    with pytest.raises(UsageError, match=r"aovs: 3 where some of albedo, normal, .* are needed"):
        glpath.render(SCENE, aovs=3)
    film = glpath.render(SCENE, spp=1, max_depth=1, resolution=(8, 6), aovs="object_id")
    with pytest.raises(UsageError, match="'fog'; those that it holds: object_id") as caught:
        film.aov("fog")
    assert "There are albedo, " in str(caught.value)
    with pytest.raises(UsageError, match="holds no AOV 'depth'"):
        film.aov("depth")
    with pytest.raises(UsageError, match="cryptomatte: 'asset'; allowed are object, material"):
        film.cryptomatte("asset")
    with pytest.raises(UsageError, match="0 ranks where one is needed"):
        film.cryptomatte("object", 0)
    plain = glpath.render(SCENE, spp=1, max_depth=1, resolution=(8, 6))
    with pytest.raises(UsageError, match=r"holds no AOV 'material_id'") as caught:
        plain.cryptomatte("material")
    assert "aovs=('material_id',)" in str(caught.value)


def test_films_with_other_aovs_do_not_merge() -> None:
    options = {"spp": 8, "max_depth": 1, "resolution": (8, 6)}
    plain = glpath.render(SCENE, **options)
    both = glpath.render(SCENE, aovs=DENOISER_AOVS, first_path_set=8, **options)
    with pytest.raises(UsageError, match=r'aovs is \["albedo", "normal"\] in one film and \[\] in the other'):
        plain.merge(both)


@pytest.mark.parametrize("aovs", [["fog"], ["all"], ["normal", "albedo"], 3, [["albedo"]], {"albedo": 1}])
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
    Film.empty(replace(film.metadata, aovs=DENOISER_AOVS)).save(path)
    assert Film.load(path).aov_sums.keys() == set(DENOISER_AOVS)
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
