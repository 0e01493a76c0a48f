"""Daylight coefficients: closed forms of open sensors and of a window, the file, and resuming."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from benchmarks.peers import radiance as radiance_peer
from benchmarks.scenes.city import City
from glpath.apps.daylight import compute
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.compass import Compass
from glpath.apps.daylight.compute import DaylightProgress
from glpath.apps.daylight.indirect import Indirect
from glpath.apps.daylight.shard import Shard
from glpath.apps.daylight.sky_patches import SkyPatches
from glpath.apps.daylight.visibility import visible
from glpath.errors import GlpathError, ImageError, UsageError
from glpath.io import scene_from_dict

Float64 = NDArray[np.float64]
# Reflected light has tests of its own.
daylight_coefficients = partial(compute.daylight_coefficients, max_depth=1)
VIEW = {"position": [0, -9, 2], "target": [0, 0, 0], "up": [0, 0, 1]}


def scene(*quads: Any, **more: Any) -> Any:
    shapes = [{"type": "quad", "corners": corners} for corners in quads]
    return scene_from_dict({"camera": VIEW, "shapes": shapes, **more})


def box(window: tuple[float, float] = (0.5, 1.5)) -> Any:
    """A room of 4 x 4 x 2 around the middle of its floor, with a window of 2 x 1 in the wall at y = 2."""
    low, high = window
    wall = [
        [[-2, 2, 0], [2, 2, 0], [2, 2, low], [-2, 2, low]],
        [[-2, 2, high], [2, 2, high], [2, 2, 2], [-2, 2, 2]],
        [[-2, 2, low], [-1, 2, low], [-1, 2, high], [-2, 2, high]],
        [[1, 2, low], [2, 2, low], [2, 2, high], [1, 2, high]],
    ]
    floor, ceiling = ([[-2, -2, z], [2, -2, z], [2, 2, z], [-2, 2, z]] for z in (0, 2))
    others = [[[x, -2, 0], [x, 2, 0], [x, 2, 2], [x, -2, 2]] for x in (-2, 2)]
    back = [[-2, -2, 0], [2, -2, 0], [2, -2, 2], [-2, -2, 2]]
    return scene(floor, ceiling, back, *others, *wall)


def configuration_factor(corners: Float64, point: Float64, normal: Float64) -> float:
    """Of a polygon from a plane element, by the angles that its edges subtend (Lambert)."""
    to = corners - point
    to /= np.linalg.norm(to, axis=1, keepdims=True)
    after = np.roll(to, -1, axis=0)
    across = np.cross(to, after)
    angle = np.arccos(np.clip(np.sum(to * after, axis=1), -1, 1))
    return float(abs(np.sum(angle * (across @ normal) / np.linalg.norm(across, axis=1))) / (2 * np.pi))


GROUND = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]


def test_an_open_sensor_sees_all_of_the_sky() -> None:
    found = daylight_coefficients(scene(GROUND), [[0.0, 0, 0], [0.0, 0, 1]], [0.0, 0, 1], latitude=50.0)
    assert found.sky().shape == (2, 146)
    assert np.allclose(found.sky_view, 1.0, rtol=2e-4)
    assert np.allclose(found.sky()[:, 0], 0.0)
    assert np.allclose(found.sun(), found.suns[:, 2])
    assert found.dark == 0
    assert (found.standard_errors < 0.003 * np.pi).all()


def test_a_description_without_light_has_the_up_of_its_camera() -> None:
    """A studio stands in for light as it is loaded, whose own up is y."""
    described = {"camera": VIEW, "shapes": [{"type": "quad", "corners": GROUND}]}
    found = daylight_coefficients(described, [[0.0, 0, 0]], [0.0, 0, 1], samples=1)
    assert found.up.tolist() == [0.0, 0.0, 1.0]
    assert found.sky_view == pytest.approx([1.0], rel=1e-2)


def test_receivers_have_their_closed_forms() -> None:
    """Under a white sky: pi/2 on a wall, and as the mean of a cylinder and of a sphere."""
    nowhere = scene([[90, 90, 0], [91, 90, 0], [91, 91, 0], [90, 91, 0]])
    at, up = [[0.0, 0, 1]], [0.0, 0, 1]
    sky = np.concatenate([[0.0], np.ones(145)])
    wall = daylight_coefficients(nowhere, at, [1.0, 0, 0]).irradiance(sky)
    cylinder = daylight_coefficients(nowhere, at, up, receiver="cylinder").irradiance(sky)
    sphere = daylight_coefficients(nowhere, at, receiver="sphere").irradiance(sky)
    assert [wall[0, 0], cylinder[0, 0], sphere[0, 0]] == pytest.approx([np.pi / 2] * 3, rel=3e-3)


def test_the_ground_lights_a_wall() -> None:
    nowhere = scene([[90, 90, 0], [91, 90, 0], [91, 91, 0], [90, 91, 0]])
    found = daylight_coefficients(nowhere, [[0.0, 0, 1]], [1.0, 0, 0], samples=32)
    assert found.sky()[0, 0] == pytest.approx(np.pi / 2, rel=0.03)
    assert found.standard_errors[0] < 0.06
    assert abs(found.sky_sums[0] - np.pi) < 3 * found.standard_errors[0]


@pytest.mark.parametrize("y", [-1.0, 0.0, 1.0])
def test_a_window_has_its_configuration_factor(y: float) -> None:
    point, up = np.array([0.2, y, 0.0]), np.array([0.0, 0.0, 1.0])
    window = np.array([[-1.0, 2, 0.5], [1, 2, 0.5], [1, 2, 1.5], [-1, 2, 1.5]])
    expected = np.pi * configuration_factor(window, point, up)
    found = daylight_coefficients(box(), [point], up, subdivision=2, samples=32)
    error = found.standard_errors[0]
    assert error < 0.03 * expected
    assert abs(found.sky_sums[0] - expected) < 3 * error


def test_standard_errors_are_those_of_other_seeds() -> None:
    points = [[0.2, -1.0, 0.0], [0.0, 0.0, 0.0], [0.1, 1.0, 0.0]]
    runs = [daylight_coefficients(box(), points, [0.0, 0, 1], samples=4, seed=seed) for seed in range(24)]
    spread = np.std([run.sky_sums for run in runs], axis=0, ddof=1)
    reported = np.mean([run.standard_errors for run in runs], axis=0)
    # 24 runs tell a deviation to 15 %; a lattice is better than independent directions.
    assert (spread < 1.4 * reported).all()
    assert (spread > 0.3 * reported).all()


def test_bits_are_what_is_visible() -> None:
    room, points = box(), [[0.0, 0, 0], [1.0, 1, 0]]
    found = daylight_coefficients(room, points, [0.0, 0, 1], samples=1)
    seen = np.stack(list(visible(room, points, [0.0, 0, 1], found.directions)))
    bits = found.words[:, None] >> np.arange(32, dtype=np.uint32)[None, :, None] & np.uint32(1)
    assert np.array_equal(bits.reshape(-1, 2)[: len(seen)], seen)
    assert 0 < seen.sum() < 40


def test_a_year_is_a_product() -> None:
    found = daylight_coefficients(box(), [[0.0, 0, 0], [1.0, 1, 0]], [0.0, 0, 1], latitude=-30.0, suns=50)
    random = np.random.default_rng(1)
    sky, sun = random.random((146, 7)), random.random((len(found.suns), 7))
    expected = found.sky() @ sky + found.sun() @ sun
    assert np.allclose(found.irradiance(sky, sun), expected, rtol=1e-5)
    assert np.allclose(found.sparse() @ np.concatenate([sky, sun]), expected, rtol=1e-5)
    assert found.sparse().nnz < 0.2 * found.sparse().shape[0] * found.sparse().shape[1]
    with pytest.raises(UsageError, match=r"where \(146,\)"):
        found.irradiance(np.ones(145))
    with pytest.raises(UsageError, match="Give both alike"):
        found.irradiance(sky, sun[:, :3])


def test_glass_lets_less_through() -> None:
    pane = [[-3, 2.1, -1], [3, 2.1, -1], [3, 2.1, 3], [-3, 2.1, 3]]
    room = box()
    glass = {"glass": {"type": "principled", "reflectance": 1, "roughness": 0, "transmission": 1, "thin": True}}
    glazed = scene_from_dict(
        {
            "camera": VIEW,
            "materials": {"wall": {"reflectance": 0.5}, **glass},
            "shapes": [
                *({"type": "mesh", "vertices": s.reshape(-1, 3), "faces": np.arange(3 * len(s)).reshape(-1, 3),
                   "material": "wall"} for s in [room.triangles]),
                {"type": "quad", "corners": pane, "material": "glass"},
            ],
        }
    )  # fmt: skip
    point, up = [[0.0, 0.0, 0.5]], [0.0, 1.0, 0.0]
    clear = daylight_coefficients(room, point, up, samples=8)
    through = daylight_coefficients(glazed, point, up, samples=8)
    assert through.shares is not None
    share = through.sky_sums[0] / clear.sky_sums[0]
    # 0.96 along the normal, less at a slant.
    assert 0.9 < share < 0.961
    assert np.array_equal(clear.words, through.words)


def test_the_file_gives_all_back(tmp_path: Path) -> None:
    found = daylight_coefficients(box(), [[0.0, 0, 0], [1.0, 1, 0]], [0.0, 0, 1], latitude=10.0, suns=20)
    found.save(tmp_path / "dc.npz")
    again = DaylightCoefficients.load(tmp_path / "dc.npz")
    assert np.array_equal(again.sky(), found.sky())
    assert np.array_equal(again.sun(), found.sun())
    assert (again.receiver, again.subdivision, again.latitude) == ("plane", 1, 10.0)
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(ImageError, match="glpath_daylight"):
        DaylightCoefficients.load(tmp_path / "other.npz")
    with np.load(tmp_path / "dc.npz") as arrays:
        np.savez(tmp_path / "new.npz", **{**arrays, "glpath_daylight": 99})
    with pytest.raises(ImageError, match="of format 99"):
        DaylightCoefficients.load(tmp_path / "new.npz")


def test_what_is_interrupted_resumes_with_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    part = tmp_path / "dc.npz.part"
    given: Any = {"points": [[0.0, 0, 0], [1.0, 1, 0]], "normals": [0.0, 0, 1], "samples": 8}
    whole = daylight_coefficients(box(), **given)

    def stop(progress: DaylightProgress) -> None:
        if progress.done >= 96:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        daylight_coefficients(box(), **given, resume=part, on_progress=stop)
    with open(part, "ab") as file:
        file.write(b"half a word"[:5])
    asked: list[int] = []
    see_out = compute.PointVisibility.see_out

    def counted(self: Any, directions: Float64, number: int) -> Any:
        asked.append(len(directions))
        return see_out(self, directions, number)

    monkeypatch.setattr(compute.PointVisibility, "see_out", counted)
    again = daylight_coefficients(box(), **given, resume=part)
    assert asked == [len(whole.directions) - 96]
    assert np.array_equal(again.words, whole.words)
    assert not part.exists()


def test_blended_surfaces_let_the_same_through_after_an_interruption(tmp_path: Path) -> None:
    """What is seen through them is random, by the number of the direction."""
    veil = scene_from_dict(
        {
            "camera": VIEW,
            "materials": {"veil": {"reflectance": 0.5, "opacity": 0.5, "alpha": "blend"}},
            "shapes": [
                {"type": "quad", "corners": [[-9, -9, 1], [9, -9, 1], [9, 9, 1], [-9, 9, 1]], "material": "veil"}
            ],
        }
    )
    given: Any = {"points": [[0.0, 0, 0], [1.0, 1, 0]], "normals": [0.0, 0, 1], "samples": 2}
    whole = daylight_coefficients(veil, **given)
    assert 0.4 < whole.sky_view.mean() < 0.6

    def stop(progress: DaylightProgress) -> None:
        if progress.done >= 64:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        daylight_coefficients(veil, **given, resume=tmp_path / "part", on_progress=stop)
    assert np.array_equal(daylight_coefficients(veil, **given, resume=tmp_path / "part").words, whole.words)


def test_the_words_of_other_work_are_refused(tmp_path: Path) -> None:
    part = tmp_path / "dc.npz.part"
    part.write_bytes(b"glpath daylight 1 something else entirely\n" + bytes(200))
    with pytest.raises(ImageError, match="other sensors or directions"):
        daylight_coefficients(box(), [[0.0, 0, 0]], [0.0, 0, 1], resume=part)


def test_options_that_are_none_are_refused() -> None:
    for wrong, text in (({"samples": 3}, "even number"), ({"receiver": "cube"}, "receiver")):
        with pytest.raises(UsageError, match=text):
            daylight_coefficients(box(), [[0.0, 0, 0]], [0.0, 0, 1], **wrong)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="normals: none"):
        daylight_coefficients(box(), [[0.0, 0, 0]])
    with pytest.raises(UsageError, match="along up"):
        daylight_coefficients(box(), [[0.0, 0, 0]], [0.0, 0, 1], north=[0, 0, 1])
    with pytest.raises(UsageError, match="other than zero"):
        daylight_coefficients(box(), [[0.0, 0, 0]], [0.0, 0, 0])


def test_sensors_inside_of_solids_are_counted() -> None:
    closed = glpath.load_scene("cornell-box")
    found = daylight_coefficients(closed, [[0.0, 0.0, 0.0]], [0.0, 1.0, 0.0], samples=1)
    assert found.dark in (0, 1)
    assert found.dark == int(not found.words.any())


@pytest.mark.evidence
@pytest.mark.parametrize("subdivision", [1, 2])
def test_radiance_finds_the_same_coefficients(subdivision: int) -> None:
    try:
        radiance_peer.version()
    except GlpathError as error:
        pytest.skip(str(error))
    city = City.of(300)
    up = np.broadcast_to([0.0, 0.0, 1.0], (12, 3))
    points = city.points(12) + 1e-4 * up
    _, theirs = radiance_peer.daylight_matrix(city.scene, points, up, subdivision, 1 << 17)
    found = daylight_coefficients(city.scene, points, up, subdivision=subdivision, samples=64)
    ours = found.sky()
    assert ours.shape == theirs.shape
    assert ours.sum(axis=1) == pytest.approx(theirs.sum(axis=1), rel=0.01)
    # Of single patches rfluxmtx has some hundred rays: each row's differences are noise, without another order.
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.1 * np.sqrt(np.mean(ours**2))
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] > 0.99


def open_sensor(**fields: Any) -> DaylightCoefficients:
    """Return coefficients of one sensor that sees all directions, with some fields replaced."""
    compass = Compass((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    made = SkyPatches(1).directions(compass, samples=2)
    right: dict[str, Any] = {
        "points": np.zeros((1, 3)),
        "normals": np.array([[0.0, 0.0, 1.0]]),
        "receiver": "plane",
        "subdivision": 1,
        "up": np.array(compass.up),
        "north": np.array(compass.north),
        "latitude": np.nan,
        "samples": 2,
        "directions": made.directions,
        "column": made.patch,
        "weight": made.weight,
        "words": np.full((-(-len(made.weight) // 32), 1), 0xFFFFFFFF, np.uint32),
    }
    return DaylightCoefficients(**right | fields)


RIGHT = open_sensor()


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"points": np.zeros((0, 3))}, "points: none"),
        ({"points": np.full((1, 3), np.nan)}, r"points\[0, 0\]: nan"),
        ({"normals": np.zeros((2, 3))}, r"normals: of shape \(2, 3\)"),
        ({"normals": np.zeros((1, 3))}, "normals: a vector of length 0"),
        ({"receiver": "cube"}, "receiver: 'cube'"),
        ({"subdivision": 3}, r"577 patches"),
        ({"subdivision": 2}, "577 patches and the suns"),
        ({"subdivision": []}, r"subdivision: \[\]"),
        ({"up": np.array([0.0, 0.0, 2.0])}, "up: a vector of length 2"),
        ({"samples": 4}, "where samples is 4"),
        ({"directions": np.full((322, 3), np.inf)}, r"directions\[0, 0\]: inf"),
        ({"directions": RIGHT.directions[1:]}, r"column: of shape \(322,\) where \(321,\)"),
        ({"column": RIGHT.column[::-1].copy()}, "ascending order"),
        ({"column": np.where(RIGHT.column == 7, 8, RIGHT.column)}, "ascending order"),
        ({"column": RIGHT.column.astype(float)}, "column: .* whole numbers"),
        ({"weight": -RIGHT.weight}, r"weight\[0\]: -"),
        ({"weight": np.full(322, np.nan)}, r"weight\[0\]: nan"),
        ({"words": RIGHT.words[1:]}, r"words: an array \(10, 1\) of uint32"),
        ({"words": RIGHT.words.astype(np.uint64)}, "uint64"),
        ({"shares": np.zeros((3, 1), np.float16)}, r"shares: an array \(3, 1\)"),
        ({"indirect": Indirect(np.zeros((1, 1)), np.zeros((1, 7)), np.zeros(1))}, "indirect: of other sensors"),
        ({"shard": Shard(1, 1, "")}, "does not contain 1 sensors"),
    ],
)
def test_coefficients_refuse_wrong_fields(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        open_sensor(**fields)


def test_suns_need_their_latitude() -> None:
    sun = {
        "directions": np.concatenate([RIGHT.directions, [[0.0, 0.6, 0.8]]]),
        "column": np.append(RIGHT.column, 146),
        "weight": np.append(RIGHT.weight, 1.0),
    }
    # The sun's irradiance is the cosine of its angle to the normal.
    assert open_sensor(**sun, latitude=40.0).sun() == pytest.approx(np.array([[0.8]]))
    assert open_sensor().sky_view == pytest.approx([1.0], rel=5e-3)
    with pytest.raises(UsageError, match="latitude: nan of suns"):
        open_sensor(**sun)


def test_a_file_with_wrong_fields_is_refused_by_name(tmp_path: Path) -> None:
    RIGHT.save(tmp_path / "right.npz")
    assert np.array_equal(DaylightCoefficients.load(tmp_path / "right.npz").sky(), RIGHT.sky())
    with np.load(tmp_path / "right.npz") as arrays:
        np.savez(tmp_path / "bad.npz", **{**arrays, "weight": -RIGHT.weight})
    with pytest.raises(ImageError, match=r"bad.npz: cannot be read as daylight coefficients: weight\[0\]: -"):
        DaylightCoefficients.load(tmp_path / "bad.npz")


@pytest.mark.parametrize("rows", [slice("a", None), slice(None, 1.5), slice(None, None, 0)])
def test_a_slice_of_sensors_has_whole_numbers(rows: slice) -> None:
    for method in (RIGHT.sky, RIGHT.sun, RIGHT.sunlight, RIGHT.indirect_sun):
        with pytest.raises(UsageError, match=r"rows: slice.* where a slice of whole numbers"):
            method(rows)
