"""Texels: they tile the surfaces, and what a box in the open receives on them has closed forms."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.apps.daylight.merging import merge_coefficients
from glpath.apps.daylight.texels import Texels, texels
from glpath.errors import ImageError, SceneError, UsageError
from glpath.io.export.false_colours import Facets
from tests.io.test_vtk import arrays

SIZE = np.array([4.0, 3.0, 2.5])
BLOCK: dict[str, Any] = {
    "camera": {"position": [10, -10, 5], "target": [0, 0, 1], "up": [0, 0, 1]},
    "materials": {"black": {"reflectance": 0}},
    "shapes": [
        {"type": "box", "name": "block", "min": [0, 0, 0], "max": SIZE.tolist(), "material": "black"},
        {
            "type": "mesh",
            "name": "roof-1",
            "vertices": [[20, 0, 0], [20.3, 5, 0], [20, 0, 7]],
            "faces": [[0, 1, 2]],
            "material": "black",
        },
    ],
}


CORNERS = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])


def edges(found: Texels) -> np.ndarray[Any, Any]:
    return np.asarray(np.linalg.norm(np.roll(found.corners, -1, axis=1) - found.corners, axis=2))


@pytest.mark.parametrize("size", [0.7, 1.0, 50.0])
def test_cells_tile_a_box_and_face_as_it_does(size: float) -> None:
    found = texels(BLOCK, size, shapes="block")
    a, b, c = np.ceil(SIZE / size - 1e-9)
    assert len(found) == 2 * (a * b + b * c + a * c)
    assert edges(found).max() <= size * (1 + 1e-9)
    for axis in range(3):
        for end in (0.0, SIZE[axis]):
            there = np.abs(found.points[:, axis] - end) < 1e-12
            assert found.areas[there].sum() == pytest.approx(SIZE.prod() / SIZE[axis])
            expected = np.eye(3)[axis] * (1 if end else -1)
            np.testing.assert_allclose(
                found.normals[there], np.broadcast_to(expected, (there.sum(), 3)), atol=1e-12
            )
            # Each of its own place.
            assert len(np.unique(found.points[there].round(9), axis=0)) == there.sum()


def test_too_many_cells_of_narrow_parallelograms_are_refused_at_once() -> None:
    """A strip of 1e5 x 0.15 has ceil(1e5 / 1.2) = 83,334 cells, although its area is that of 10,417 squares."""
    corners = [[[0, i, 0], [1e5, i, 0], [1e5, i + 0.15, 0], [0, i + 0.15, 0]] for i in range(60)]
    strips = {**BLOCK, "shapes": [{"type": "quad", "corners": each, "material": "black"} for each in corners]}
    with pytest.raises(UsageError, match=f"texels: {60 * 83_334:,} or more of size 1.2; at most 4,000,000"):
        texels(strips, 1.2)
    assert len(texels({**strips, "shapes": strips["shapes"][:1]}, 1.2)) == 83_334


def test_methods_of_no_texels_and_of_ragged_values_name_the_argument(tmp_path: Path) -> None:
    at = texels(BLOCK, 50.0)
    for call, words in (
        (lambda: at[:0].mean([]), "mean: there are no texels"),
        (lambda: at[:0].to_glb(tmp_path / "a.glb", [], quantity="q"), "to_glb: there are no texels"),
        (lambda: at[:2].to_vtk({"lux": [[1], [1, 2]]}), r"lux: \[\[1\], \[1, 2\]\] where an array of real numbers"),
    ):
        with pytest.raises(UsageError, match=words):
            call()


def test_triangles_are_halved_until_they_are_small() -> None:
    found = texels(BLOCK, 0.5, shapes=["roof*"])
    a, b, c = np.array(BLOCK["shapes"][1]["vertices"])
    across = np.cross(b - a, c - a)
    assert found.areas.sum() == pytest.approx(np.linalg.norm(across) / 2)
    assert edges(found).max() <= 0.5 * (1 + 1e-9)
    np.testing.assert_allclose(
        found.normals, np.broadcast_to(across / np.linalg.norm(across), (len(found), 3)), atol=1e-9
    )
    # Not slivers: of the triangle's own angles, halved at their longest edge, none becomes less than half.
    assert (found.areas / edges(found).max(axis=1) ** 2).min() > 0.1
    # The middle of all is the middle of the triangle.
    np.testing.assert_allclose(found.mean(found.points), (a + b + c) / 3, atol=1e-9)


def test_a_block_in_the_open_sees_all_of_the_sky_from_its_roof_and_half_from_its_sides(tmp_path: Path) -> None:
    alone = {**BLOCK, "shapes": BLOCK["shapes"][:1]}
    at = texels(alone, 1.5)
    found = glpath.daylight_coefficients(alone, at.points, at.normals, samples=16, max_depth=1)
    np.testing.assert_allclose(found.sky_view, 0.5 + 0.5 * at.normals[:, 2], atol=0.01)
    kept = replace(found, texels=at)
    kept.save(tmp_path / "dc.npz")
    read = glpath.DaylightCoefficients.load(tmp_path / "dc.npz")
    assert read.texels is not None
    np.testing.assert_array_equal(read.texels.corners, at.corners)
    np.testing.assert_array_equal(read.texels.shape, at.shape)
    assert read.texels.shape_names == ("block",)
    found.save(tmp_path / "plain.npz")
    assert glpath.DaylightCoefficients.load(tmp_path / "plain.npz").texels is None


def test_shards_have_their_own_texels_and_together_all(tmp_path: Path) -> None:
    at = texels(BLOCK, 2.0)
    options: dict[str, Any] = {"samples": 2, "max_depth": 1}
    for k in (2, 1):
        part = glpath.daylight_coefficients(BLOCK, at.points, at.normals, shard=(k, 2), **options)
        assert part.shard is not None
        first = part.shard.first
        replace(part, texels=at[first : first + len(part)]).save(tmp_path / f"{k}.npz")
    whole, _ = merge_coefficients([tmp_path / "2.npz", tmp_path / "1.npz"])
    assert whole.shard is None
    assert whole.texels is not None
    np.testing.assert_array_equal(whole.texels.corners, at.corners)
    np.testing.assert_array_equal(whole.texels.shape, at.shape)
    np.testing.assert_allclose(whole.texels.points, whole.points)


def test_values_are_shown_on_the_model(tmp_path: Path) -> None:
    at = texels(BLOCK, 1.0)
    values = at.points[:, 2]
    at.to_vtk({"sky view": values, "rgb": at.points}).save(tmp_path / "a.vtp")
    found = arrays(tmp_path / "a.vtp")
    sides = np.diff(found["Polys/offsets"], prepend=0)
    assert sorted(set(sides.tolist())) == [3, 4]
    np.testing.assert_array_equal(sides == 3, at.shape == 1)
    np.testing.assert_array_equal(found["CellData/sky view"], values)
    np.testing.assert_array_equal(found["CellData/area"], at.areas)
    np.testing.assert_array_equal(found["CellData/rgb"], at.points)
    pytest.importorskip("matplotlib")
    trimesh = pytest.importorskip("trimesh")
    at.to_glb(tmp_path / "a.glb", values, quantity="height", unit="m")
    model = trimesh.load(tmp_path / "a.glb", force="scene")
    (mesh,) = model.geometry.values()
    assert mesh.area == pytest.approx(at.areas.sum())
    # glTF has y up, and x as it was.
    np.testing.assert_allclose(model.bounds, [[0, 0, -5], [20.3, 7, 0]], atol=1e-5)
    content = (tmp_path / "a.glb").read_bytes()
    told = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])["extras"]
    assert (told["quantity"], told["unit"]) == ("height", "m")
    assert told["last_colour"] == pytest.approx(values.max())
    legend = Facets(at.corners, "difference", values - 3.0, "m").legend
    assert (legend["first_colour"], legend["last_colour"]) == (values.min() - 3.0, values.max() - 3.0)
    with pytest.raises(UsageError, match="values are infinite"):
        at.to_glb(tmp_path / "b.glb", np.full(len(at), np.inf), quantity="height")


def test_what_cannot_be_texels_is_refused(tmp_path: Path) -> None:
    for size in (0, -1, float("nan"), float("inf")):
        with pytest.raises(UsageError, match=r"must be from 1e-15 to 1e\+15 scene units"):
            texels(BLOCK, size)
    with pytest.raises(UsageError, match="at most 4,000,000"):
        texels(BLOCK, 1e-4)
    with pytest.raises(UsageError, match=r"no shape is called 'tower'\.\n  The shapes are block, roof-1\."):
        texels(BLOCK, 1, shapes="tower")
    plane = {"type": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": "black"}
    with pytest.raises(SceneError, match="plane"):
        texels({**BLOCK, "shapes": [*BLOCK["shapes"], plane]}, 1)
    at = texels(BLOCK, 2)
    with pytest.raises(UsageError, match="faces"):
        at.to_glb(tmp_path / "a.glb", [1.0], quantity="height")
    with pytest.raises(UsageError, match="cells"):
        at.to_vtk({"height": [1.0]})
    with pytest.raises(UsageError, match=r"written as \.glb"):
        at.to_glb(tmp_path / "a.obj", at.areas, quantity="height")


@pytest.mark.parametrize("values", [5.0, [1.0, 2.0], "x", None])
def test_mean_of_values_that_are_not_one_per_texel_is_refused(values: Any) -> None:
    with pytest.raises(UsageError, match="values"):
        texels("cornell-box-36", 1.0).mean(values)


def test_no_parts_cannot_be_joined() -> None:
    with pytest.raises(UsageError, match="no texels"):
        Texels.joined([])


@pytest.mark.parametrize("rows", [slice("a", None), slice(None, None, 0), "a", (slice(None), 9)])
def test_rows_of_texels_that_are_no_slice_are_refused(rows: Any) -> None:
    one = Texels(CORNERS, np.zeros(1, np.int32), ("a",))
    with pytest.raises(UsageError, match=r"texels: \[.*\] where a slice of whole numbers is needed"):
        one[rows]


def test_file_of_texels_without_an_area_is_refused(tmp_path: Path) -> None:
    found = glpath.daylight_coefficients(BLOCK, [[0, 0, 9.0]], [0, 0, 1.0], samples=1, max_depth=1)
    replace(found, texels=Texels(CORNERS, np.zeros(1, np.int32), ("a",))).save(tmp_path / "whole.npz")
    with np.load(tmp_path / "whole.npz") as stored:
        np.savez(tmp_path / "flat.npz", **{**stored, "texel_corners": np.ones((1, 4, 3))})
    with pytest.raises(ImageError, match=r"flat\.npz: cannot be read .* corners\[0\]: a texel without an area"):
        glpath.DaylightCoefficients.load(tmp_path / "flat.npz")


@pytest.mark.parametrize("up", [(0, 0), (0, 0, 0), (np.nan, 0, 0), "x"])
def test_up_that_is_no_direction_is_refused(up: Any, tmp_path: Path) -> None:
    found = texels("cornell-box-36", 1.0)
    with pytest.raises(UsageError, match="up"):
        found.to_glb(tmp_path / "a.glb", np.ones(len(found)), quantity="x", up=up)


def test_name_that_utf_8_cannot_encode_is_refused(tmp_path: Path) -> None:
    found = texels("cornell-box-36", 1.0)
    with pytest.raises(ImageError, match="UTF-8"):
        found.to_glb(tmp_path / "a.glb", np.ones(len(found)), quantity="\ud800")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"corners": np.zeros((1, 3, 3))}, r"corners: of shape \(1, 3, 3\) where \(N, 4, 3\)"),
        ({"corners": "x"}, "corners: 'x' where an array of numbers"),
        ({"corners": CORNERS * np.nan}, r"corners\[0, 0, 0\]: nan where finite numbers"),
        ({"corners": CORNERS * 1e40}, r"corners\[0, 1, 0\]: 1e\+40"),
        ({"corners": CORNERS.astype("m8[s]")}, "corners: "),
        ({"corners": np.ones((1, 4, 3))}, r"corners\[0\]: a texel without an area"),
        ({"corners": CORNERS[:, [0, 1, 1, 1]]}, r"corners\[0\]: a texel without an area"),
        ({"shape": [0, 0]}, r"shape: of shape \(2,\) where \(1,\)"),
        ({"shape": [0.5]}, r"shape: \[0.5\] where an array of whole numbers"),
        ({"shape": [-1]}, r"shape\[0\]: -1 where whole numbers from 0 to 0"),
        ({"shape": [1]}, r"shape\[0\]: 1 "),
        ({"shape_names": ()}, r"shape\[0\]: 0 "),
        ({"shape_names": 3}, "shape_names: 3 "),
        ({"shape_names": (3,)}, "shape_names: "),
    ],
)
def test_arrays_that_are_no_texels_are_refused(values: dict[str, Any], words: str) -> None:
    right = {"corners": CORNERS, "shape": np.zeros(1, np.int32), "shape_names": ("a",)}
    assert len(Texels(**right)) == 1
    with pytest.raises(UsageError, match=words):
        Texels(**{**right, **values})
