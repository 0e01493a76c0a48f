"""EULUMDAT files: the same light as IES files, closed forms of their lumens, and what is refused."""

from __future__ import annotations

import random
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import SceneError, SceneWarning
from glpath.io.photometry import read_profile
from glpath.scene.model import Float64
from glpath.scene.source_location import SourceLocation
from tests.support.photometry import eulumdat, ies

PLACE = SourceLocation("room.toml", "lights[0].profile")
GAMMA, C = np.arange(0.0, 181.0, 10.0), np.arange(0.0, 360.0, 15.0)
UNEVEN = np.array([0, 20, 90, 100, 180, 250, 270, 280.0])


def web(c: Float64, gamma: Float64) -> Float64:
    """(C, gamma) of a luminaire without any symmetry."""
    c, gamma = np.radians(c)[:, None], np.radians(gamma)[None]
    found: Float64 = (
        90 + 40 * np.cos(c + 0.4) * np.sin(gamma) + 20 * np.sin(2 * c) * np.sin(gamma) ** 2 + 10 * np.cos(gamma)
    )
    return found


# By symmetry: the planes that are stored, and for any C the one among them that it is like.
SYMMETRIES: dict[int, tuple[Callable[[Float64], Float64], Callable[[Float64], Float64]]] = {
    0: (lambda c: c, lambda c: c),
    1: (lambda c: c[:1], lambda c: 0 * c),
    2: (lambda c: c[c <= 180], lambda c: np.minimum(c, 360 - c)),
    3: (lambda c: np.concatenate([c[c >= 270], c[c <= 90]]), lambda c: np.where(np.abs(c - 180) <= 90, 180 - c, c)),
    4: (lambda c: c[c <= 90], lambda c: np.minimum(np.minimum(c, 360 - c), np.abs(180 - c))),
}


@pytest.mark.parametrize("symmetry", SYMMETRIES)
def test_a_lamp_of_each_symmetry_is_that_of_an_ies_file_with_all_planes(symmetry: int, tmp_path: Path) -> None:
    stored, like = SYMMETRIES[symmetry]
    ldt = eulumdat(tmp_path / "a.ldt", GAMMA, C, web(stored(C), GAMMA), symmetry=symmetry, sets=[(2, 3600)])
    around = np.append(C, 360.0)
    full = ies(tmp_path / "a.ies", GAMMA, around, 3.6 * web(like(around % 360), GAMMA))
    one, other = read_profile(ldt, PLACE), read_profile(full, PLACE)
    at = np.random.default_rng(0).uniform((0, 0), (360, 180), (500, 2))
    np.testing.assert_allclose(one.at(*at.T), other.at(*at.T), rtol=1e-7)
    assert one.flux == pytest.approx(other.flux, rel=1e-7)


@pytest.mark.parametrize("symmetry", [0, 2, 4])
def test_planes_may_be_uneven(symmetry: int, tmp_path: Path) -> None:
    stored, like = SYMMETRIES[symmetry]
    path = eulumdat(tmp_path / "a.LDT", GAMMA, UNEVEN, web(stored(UNEVEN), GAMMA), symmetry=symmetry)
    profile = read_profile(path, PLACE)
    for c in UNEVEN:
        expected = web(like(np.array([c])), GAMMA)[0]
        if like(np.array([c]))[0] in stored(UNEVEN):
            np.testing.assert_allclose(profile.at(np.full(len(GAMMA), c), GAMMA), expected, rtol=1e-7)


@pytest.mark.parametrize("power", [1, 3])
@pytest.mark.parametrize("number", [1, -12], ids=["relative", "absolute"])
def test_its_lumens_are_those_of_the_lamps_times_the_output_ratio(power: int, number: int, tmp_path: Path) -> None:
    """I0 cos^n sends 2 pi I0 / (n + 1): of 65 % of 1000 lm in cd per 1000 lm."""
    gamma = np.linspace(0.0, 90.0, 181)
    peak = 650 * (power + 1) / (2 * np.pi)
    values = peak * np.cos(np.radians(gamma))[None] ** power
    path = eulumdat(
        tmp_path / "a.ldt", gamma, np.zeros(1), values, symmetry=1, sets=[(number, 3600)], output_ratio=65
    )
    profile = read_profile(path, PLACE)  # without a warning: the output ratio is that of the intensities
    assert profile.flux == pytest.approx(0.65 * 3600, rel=1e-4)
    assert profile.max == pytest.approx(3.6 * peak, rel=1e-7)


def test_an_output_ratio_that_contradicts_the_intensities_is_told(tmp_path: Path) -> None:
    values = np.full((1, len(GAMMA)), 1000 / (4 * np.pi))
    path = eulumdat(tmp_path / "a.ldt", GAMMA, np.zeros(1), values, symmetry=1, output_ratio=65)
    with pytest.warns(SceneWarning, match=r"sum up to 100 % .*output ratio is 65 %"):
        assert read_profile(path, PLACE).flux == pytest.approx(1000, rel=1e-7)


def test_of_several_sets_of_lamps_the_first_is_taken(tmp_path: Path) -> None:
    values = web(C[:1], GAMMA)
    path = eulumdat(tmp_path / "a.ldt", GAMMA, C, values, symmetry=1, sets=[(1, 1000), (2, 2500)])
    with pytest.warns(SceneWarning, match=r"2 sets of lamps.* 1000 lm\..*2500 lm \(intensity = 2\.5\)"):
        assert read_profile(path, PLACE).candela.max() == pytest.approx(values.max())
    alike = eulumdat(tmp_path / "b.ldt", GAMMA, C, values, symmetry=1, sets=[(1, 1000), (2, 1000)])
    read_profile(alike, PLACE)  # nothing to choose, nothing to warn of


@pytest.mark.parametrize(("factor", "times"), [("0,5", 0.5), ("", 1), ("0", 1), ("2.0", 2)])
def test_numbers_are_read_as_files_have_them(factor: str, times: float, tmp_path: Path) -> None:
    """Decimal commas, ends of lines of every system, the ellipsis of Windows, and old ends of files."""
    path = eulumdat(tmp_path / "a.ldt", GAMMA, C, web(C[:1], GAMMA), symmetry=1, factor=factor, end="\n")
    plain = path.read_bytes()
    odd = b"\xef\xbb\xbf" + plain.replace(b"made up", b"made up\x85 and on", 1) + b"\n\x1a"
    for data in (plain, odd, plain.replace(b"\n", b"\r"), plain.replace(b"\n", b"\r\n")):
        path.write_bytes(data)
        np.testing.assert_allclose(read_profile(path, PLACE).candela[0], times * web(C[:1], GAMMA)[0], rtol=1e-7)


GOOD = ["x", 3, 4, 4, 90, 2, 90, "", "", "", "", "", *[0] * 9, 100, 0, 1, 0, 1, 1, "", 1000, "", "", "", *[0] * 10]
GOOD += [0, 90, 180, 270, 0, 90, 5, 1, 6, 2]


def with_lines(**lines: object) -> list[object]:
    changed = list(GOOD)
    for name, value in lines.items():
        changed[int(name[1:]) - 1] = value
    return changed


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "line 0 has the end of the file above it, where the type is expected"),
        (with_lines(l2="lamp"), "line 2 has 'lamp' where the type is expected"),
        (with_lines(l2=9), "line 2 has 9 as the type; expected 0 to 3"),
        (with_lines(l3=5), "line 3 has 5 as the symmetry; expected 0 to 4"),
        (with_lines(l4=2.5), "line 4 has 2.5 as the number of planes of C; expected 1"),
        (with_lines(l4=7000, l6=7000), "line 6 has 7000 x 7000 intensities, more than"),
        (with_lines(l6=1), "line 6 has 1 as the number of angles gamma; expected 2"),
        (with_lines(l24=-1), "line 24 has -1 where the factor of intensities is expected, 0 or more"),
        (with_lines(l26=0), "line 26 has 0 as the number of sets of lamps; expected 1"),
        (with_lines(l29=0), "line 29 has 0 as the lumens of the lamps: no light"),
        (with_lines(l29=""), "line 29 has '' where the lumens of the lamps is expected"),
        (with_lines(l43=10), "line 46 has angles above it of which the first of C is 10"),
        (with_lines(l44=80), "line 46 has angles above it that lack C = 90, which symmetry 4 needs"),
        (with_lines(l45=80), "line 46 has angles C above it that do not ascend"),
        (with_lines(l46=400), "line 46 has 400 as an angle C; at most 360"),
        (with_lines(l48=190), "line 48 has 190 as an angle gamma; at most 180"),
        (with_lines(l50="nan"), "line 50 has nan where an intensity is expected"),
        (with_lines(l50=-1), "line 50 has -1 where an intensity is expected, 0 or more"),
        (with_lines(l50=1e30), r"an intensity of up to 1e\+30 cd; at most"),
        (with_lines(l24=1e300, l29=1e300, l50=0), "an intensity of up to inf cd; at most"),
        (GOOD[:-1], "line 51 has 3 lines of intensities above it, where 2 planes of 2 angles have 4"),
        ([*GOOD, 7], "line 53 has 5 lines of intensities above it"),
        (GOOD[:46], "line 46 has the end of the file above it, where an angle gamma is expected"),
    ],
)
def test_what_is_wrong_with_a_file_is_told_with_its_line(lines: list[Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / "a.ldt"
    path.write_text("\n".join(map(str, lines)))
    with pytest.raises(SceneError, match=message) as caught:
        read_profile(path, PLACE)
    assert str(caught.value).startswith(f"room.toml: lights[0].profile names {path}, which cannot be used: line ")


def test_the_lines_that_are_changed_above_are_right_without_the_change(tmp_path: Path) -> None:
    (tmp_path / "a.ldt").write_text("\n".join(map(str, GOOD)))
    profile = read_profile(tmp_path / "a.ldt", PLACE)
    assert profile.candela.tolist() == [[5, 1], [6, 2], [5, 1], [6, 2]]


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_the_symmetry_counts_whatever_the_type(kind: int, tmp_path: Path) -> None:
    (tmp_path / "a.ldt").write_text("\n".join(map(str, with_lines(l2=kind))))
    profile = read_profile(tmp_path / "a.ldt", PLACE)
    assert profile.candela.tolist() == [[5, 1], [6, 2], [5, 1], [6, 2]]


def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    """Some hundred files, each with some bytes other than they were."""
    chance, path = random.Random(0), tmp_path / "a.ldt"
    whole = eulumdat(path, GAMMA[::3], C[::3], web(C[::3], GAMMA[::3])).read_bytes()
    refused = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        for _ in range(300):
            spoilt = bytearray(whole)
            for _ in range(chance.randint(1, 4)):
                at = chance.randrange(len(spoilt))
                spoilt[at : at + chance.choice((0, 1, 1, 5))] = chance.choice((b"", b"9", b"-", b"\xff", b"\n"))
            path.write_bytes(spoilt)
            try:
                profile = read_profile(path, PLACE)
            except SceneError:
                refused += 1
            else:
                assert np.isfinite(profile.candela).all()
                assert profile.candela.min() >= 0
    assert 50 < refused < 300


def test_a_lamp_of_a_scene_lights_the_floor_as_its_ies_file_does(tmp_path: Path) -> None:
    """250 cos cd of 1000 lm at 2 m: 62.5 lx below it for each 1000 lm."""
    gamma = np.arange(0.0, 91.0, 1.0)
    values = 250 * np.cos(np.radians(gamma))[None]
    eulumdat(tmp_path / "a.ldt", gamma, np.zeros(1), values, symmetry=1, sets=[(1, 3000)])
    ies(tmp_path / "a.ies", gamma, np.zeros(1), 3 * values)
    scene = {
        "camera": {"position": [0, 0.01, 6], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 50},
        "materials": {"grey": {"reflectance": 0.5}},
        "shapes": [
            {"type": "quad", "corners": [[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], "material": "grey"}
        ],
    }
    points = np.array([[0, 0, 0], [1, 0.5, 0]])
    found = []
    for name in ("a.ldt", "a.ies"):
        lamp: dict[str, Any] = {"type": "point", "position": [0, 0, 2], "profile": str(tmp_path / name)}
        found.append(glpath.irradiance({**scene, "lights": [lamp]}, points, [0, 0, 1], spp=1, max_depth=1))
    np.testing.assert_array_equal(found[0].values, found[1].values)
    assert found[0].illuminance()[0] == pytest.approx(3 * 62.5, rel=1e-4)
