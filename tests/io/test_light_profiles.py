"""Photometric profiles: files of every year's form, hostile ones, and every engine beside closed forms."""

from __future__ import annotations

import os
import random
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation

import glpath
from benchmarks.peers import other_python
from glpath.errors import GlpathError, SceneError, SceneWarning
from glpath.io.export.mitsuba import projectors
from glpath.io.gltf import read_gltf
from glpath.io.photometry import read_profile
from glpath.lights.samples import incident
from glpath.scene.model import Float64, Light, LightProfile
from glpath.scene.source_location import SourceLocation
from tests.support.gltf_files import Gltf
from tests.support.photometry import ies, written

PLACE = SourceLocation("room.toml", "lights[0].profile")


def web(c: Float64, gamma: Float64) -> Float64:
    """(C, gamma) candela of a luminaire without any symmetry."""
    c, gamma = np.radians(c)[:, None], np.radians(gamma)[None]
    return 90 + 40 * np.cos(c) * np.sin(gamma) + 20 * np.sin(2 * c) * np.sin(gamma) ** 2 + 10 * np.cos(gamma)


GAMMA, C = np.arange(0.0, 181.0, 5.0), np.arange(0.0, 361.0, 15.0)


# Files.


@pytest.mark.parametrize(
    "head",
    ["", "a lamp\nof 1986\n", "IESNA91\n[TEST] 1\n", "IESNA:LM-63-1995\n[OTHER] [MORE] x\n"],
    ids=["bare", "1986", "1991", "1995"],
)
def test_every_years_form_is_read(head: str, tmp_path: Path) -> None:
    path = ies(tmp_path / "a.ies", GAMMA, C, web(C, GAMMA), head=head, factors=(2, 0.5, 0.25))
    profile = read_profile(path, PLACE)
    assert profile.gamma == (0, 180)
    assert profile.candela.shape == (24, 37)
    np.testing.assert_allclose(profile.candela, 0.25 * web(C, GAMMA)[:-1], rtol=1e-8)


@pytest.mark.parametrize("head", ["IESNA:LM-63-2002\n", "IES:LM-63-2019\n[TEST] 1\n"], ids=["2002", "2019"])
@pytest.mark.parametrize("second", [1.1, 1.11011, 0], ids=["accredited", "all-flags", "none"])
def test_the_file_generation_type_is_no_factor(head: str, second: float, tmp_path: Path) -> None:
    """LM-63-2019 writes 1.10000 for a file of an accredited laboratory; LM-63-2002 reserves the number."""
    path = ies(tmp_path / "a.ies", GAMMA, C, web(C, GAMMA), head=head, factors=(2, 0.5, second))
    np.testing.assert_allclose(read_profile(path, PLACE).candela, web(C, GAMMA)[:-1], rtol=1e-8)


def test_numbers_may_be_parted_in_any_way(tmp_path: Path) -> None:
    """As LM-63 shows its own example: numbers over lines at will, commas, and old line ends."""
    (tmp_path / "a.IES").write_bytes(
        b"TILT=INCLUDE\r\n1\r\n3, 0 45 90\r\n1.0,1,1\r\n1,1000, 1.5 3\r\n 2 1\t1 0 0 0\r\n1.0 1.0 50.\r\n"
        b"0\r\n45,90\r\n0 180\r\n100 50\r\n0,200 60 1e1\r\n"
    )
    profile = read_profile(tmp_path / "a.IES", PLACE)
    # Alike on both sides of the plane through 0 and 180.
    assert profile.candela.tolist() == [[150, 75, 0], [300, 90, 15]]
    assert profile.gamma == (0, 90)


def test_a_tilt_with_factors_is_told_of(tmp_path: Path) -> None:
    path = ies(tmp_path / "a.ies", GAMMA, C, web(C, GAMMA), tilt="TILT=INCLUDE\n1\n2\n0 90\n1 0.8")
    with pytest.warns(SceneWarning, match="depends on how its lamp is tilted"):
        assert read_profile(path, PLACE).candela.shape == (24, 37)


@pytest.mark.parametrize(
    ("c", "of"),
    [
        (np.array([0.0]), lambda c: 0 * c),
        (np.arange(0, 91, 22.5), lambda c: np.minimum(c % 180, 180 - c % 180)),
        (np.arange(0, 181, 15.0), lambda c: np.minimum(c, 360 - c)),
        (np.arange(90, 271, 30.0), lambda c: np.abs((c - 90) % 360 - 180) * -1 + 270),
        (np.array([90, 200, 270.0]), lambda c: np.abs((c - 90) % 360 - 180) * -1 + 270),
        (np.arange(0, 361, 5.0), lambda c: c),
    ],
    ids=["round", "quarters", "halves", "halves-90", "halves-90-uneven", "none"],
)
def test_what_the_file_leaves_out_follows_by_symmetry(c: Float64, of, tmp_path: Path) -> None:
    """`of`: from any C to the one in the file that it is like."""
    if c[0] == 90:
        # Mirrored at 90 and at 270: from 270 on back to 90.
        def of(angle: Float64) -> Float64:
            beyond = np.where(angle > 270, 540 - angle, angle)
            return np.where(beyond < 90, 180 - beyond, beyond)

    path = ies(tmp_path / "a.ies", GAMMA, c, web(c, GAMMA))
    profile = read_profile(path, PLACE)
    angle = np.arange(0.0, 360.0, 5.0)
    table = np.stack([np.interp(of(angle), c, column) for column in web(c, GAMMA).T], axis=1)
    found = np.stack([profile.at(np.full(len(GAMMA), a), GAMMA) for a in angle])
    np.testing.assert_allclose(found, table, rtol=1e-7)


@pytest.mark.parametrize(
    "gamma",
    [[0, 7.5, 10, 30, 90], [0, 0.01, 0.03, 60], [90, 95, 130, 180], [12.5, 20]],
    ids=["uneven", "fine", "up", "band"],
)
def test_uneven_angles_are_kept(gamma: list[float], tmp_path: Path) -> None:
    c = np.array([0, 10, 45, 80, 90.0])
    profile = read_profile(ies(tmp_path / "a.ies", np.array(gamma), c, web(c, np.array(gamma))), PLACE)
    expected = RegularGridInterpolator((c, gamma), web(c, np.array(gamma)))
    at = np.random.default_rng(0).uniform((0, gamma[0]), (90, gamma[-1]), (500, 2))
    np.testing.assert_allclose(profile.at(at[:, 0], at[:, 1]), expected(at), rtol=1e-7)
    beyond = np.array([gamma[0] - 0.1, gamma[-1] + 0.1])
    assert np.all(profile.at(np.zeros(2), beyond) == 0)


GOOD = "IESNA91\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 10\n0 90\n0\n5 1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 0 has no line TILT=NONE"),
        ("a\nb\n", "line 2 has no line TILT=NONE or TILT=INCLUDE"),
        (GOOD.replace("NONE", "lamp.tlt"), "line 2 has TILT=LAMP.TLT"),
        (GOOD.replace("5 1", "5"), "line 7 has the end of the file where candela is expected"),
        (GOOD.replace("5 1", "5,5 1,5"), r"line 7 has 2 more words than(.|\n)*If they are decimal commas"),
        (GOOD.replace("1 -1 1 2", "1 -1 0,9 2"), r"line 3 has 0 as the candela(.|\n)*If they are decimal commas"),
        (GOOD.replace("5 1", "5 nan"), "line 7 has nan where candela is expected"),
        (GOOD.replace("5 1", "5 -inf"), "line 7 has -inf where candela"),
        (GOOD.replace("5 1", "5 -1"), "line 7 has -1 where candela is expected, 0 or more"),
        (GOOD.replace("5 1", "5 lamp"), "line 7 has 'lamp' where candela is expected"),
        (GOOD.replace("5 1", "5 1e30"), r"line 7 has 1e\+30 candela; at most"),
        (
            GOOD.replace("-1 1 2", "-1 1e300 2").replace("1 1 10", "1e300 1 10").replace("5 1", "5 0"),
            "inf candela; at most",
        ),
        (GOOD.replace("1 -1 1 2 1", "1 -1 1 5000000000 1"), r"line 3 has 5e\+09 gamma \(vertical\) angles"),
        (GOOD.replace("1 -1 1 2 1", "1 -1 1 7000 7000"), "7000 gamma .* angles, but only"),
        (GOOD.replace("1 -1 1 2 1", "1 -1 1 1 1"), r"line 3 has 1 gamma \(vertical\) angles; expected 2"),
        (GOOD.replace("1 -1 1 2 1", "1 -1 1 -3 1"), "line 3 has -3 gamma"),
        (GOOD.replace("1 -1 1 2 1", "1 -1 1 2.5 1"), "line 3 has 2.5 gamma"),
        (GOOD.replace("1 -1 1 2 1", "1 -1 0 2 1"), "line 3 has 0 as the candela multiplier"),
        (GOOD.replace("2 1 1 2", "2 1 2 2"), "line 3 has photometry of type B"),
        (GOOD.replace("2 1 1 2", "2 1 3 2"), "line 3 has photometry of type A"),
        (GOOD.replace("2 1 1 2", "2 1 7 2"), "line 3 has a photometric type of '7'"),
        (GOOD.replace("2 1 1 2", "2 1 1 5"), "line 3 has a unit that is neither"),
        (GOOD.replace("0 90\n", "90 0\n"), "line 5 has angles of gamma that do not ascend"),
        (GOOD.replace("0 90\n", "0 190\n"), "gamma from 0 to 190"),
        (GOOD.replace("0 90\n0\n", "0 90\n45\n"), "line 6 has a single angle of C, 45"),
        (GOOD.replace("2 1 1 2", "2 2 1 2").replace("\n0\n5 1", "\n0 120\n5 1 5 1"), "C from 0 to 120; expected"),
    ],
)
def test_hostile_files_are_refused_with_their_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.ies").write_text(text)
    with pytest.raises(SceneError, match=message) as caught:
        read_profile(tmp_path / "a.ies", PLACE)
    assert str(caught.value).startswith(f"room.toml: lights[0].profile names {tmp_path / 'a.ies'}")


@pytest.mark.parametrize("end", ["\x1a", "\x1arubbish", "\n\0\0\0", "\n\x1a\n"])
def test_control_characters_at_the_end_are_not_read(end: str, tmp_path: Path) -> None:
    (tmp_path / "a.ies").write_text(GOOD + end)
    assert read_profile(tmp_path / "a.ies", PLACE).candela.tolist() == [[5, 1]]


def test_words_after_the_last_candela_are_told_of(tmp_path: Path) -> None:
    (tmp_path / "a.ies").write_text(GOOD + "\n[END] 7\n")
    with pytest.warns(SceneWarning, match=r'2 more words than its counts .* from "\[END\]" in line 9'):
        assert read_profile(tmp_path / "a.ies", PLACE).candela.tolist() == [[5, 1]]


@pytest.mark.parametrize("step", [15, 90, 120])
def test_a_plane_at_360_degrees_that_is_missing_is_the_first(step: int, tmp_path: Path) -> None:
    c, gamma = np.arange(0.0, 361.0, step), np.array([0.0, 90.0])
    values = 1.0 + np.arange(len(c))[:, None] * np.ones(2)
    values[-1] = values[0]
    whole = read_profile(ies(tmp_path / "whole.ies", gamma, c, values), PLACE)
    found = read_profile(ies(tmp_path / "open.ies", gamma, c[:-1], values[:-1]), PLACE)
    assert np.array_equal(found.candela, whole.candela)
    with pytest.raises(SceneError, match="expected 0 alone"):
        read_profile(ies(tmp_path / "gap.ies", gamma, c[:-1] * 0.8, values[:-1]), PLACE)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "b.ies").write_text(GOOD)
    with pytest.raises(SceneError, match=r"does not exist") as caught:
        read_profile(tmp_path / "a.ies", PLACE)
    assert "b.ies" in str(caught.value)
    with pytest.raises(SceneError, match=r"ends in \.ies or \.ldt"):
        read_profile(tmp_path / "a.png", PLACE)
    with (tmp_path / "large.ies").open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(SceneError, match=r"1,073,741,824 bytes, more than the 16,777,216"):
        read_profile(tmp_path / "large.ies", PLACE)
    (tmp_path / "dir.ies").mkdir()
    with pytest.raises(SceneError, match=r"is not a file"):
        read_profile(tmp_path / "dir.ies", PLACE)


def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    """A thousand files, each with some bytes other than they were."""
    chance, path = random.Random(0), tmp_path / "a.ies"
    whole = ies(
        path, GAMMA[::6], C[::6], web(C[::6], GAMMA[::6]), tilt="TILT=INCLUDE\n1\n2\n0 90\n1 1"
    ).read_bytes()
    refused = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        for _ in range(1000):
            spoilt = bytearray(whole)
            for _ in range(chance.randint(1, 4)):
                at = chance.randrange(len(spoilt))
                spoilt[at : at + chance.choice((0, 1, 1, 5))] = chance.choice(
                    (b"", b"9", b"-", b"\xff", b"\n", b" 1e9 ")
                )
            path.write_bytes(spoilt)
            try:
                profile = read_profile(path, PLACE)
            except SceneError:
                refused += 1
            else:
                assert np.isfinite(profile.candela).all()
                assert profile.candela.min() >= 0
                assert 0 <= profile.gamma[0] < profile.gamma[1] <= 180
    assert 300 < refused < 1000


# What a profile says.


def test_flux_is_the_integral_over_the_sphere(tmp_path: Path) -> None:
    gamma = np.arange(0.0, 91.0, 1.0)
    cosine = LightProfile(100 * np.cos(np.radians(gamma))[None] ** 3, (0, 90))
    assert cosine.flux == pytest.approx(2 * np.pi * 100 / 4, rel=2e-4)  # of the pieces between degrees
    assert LightProfile(np.full((3, 5), 7.0)).flux == pytest.approx(4 * np.pi * 7)
    profile = LightProfile(web(C, GAMMA)[:-1])
    fine_c, fine = np.arange(0, 360, 1.0) + 0.5, (np.arange(1800) + 0.5) / 10
    at = np.stack([profile.at(np.full(len(fine), c), fine) for c in fine_c])
    assert profile.flux == pytest.approx(2 * np.pi * np.radians(0.1) * (at.mean(axis=0) @ np.sin(np.radians(fine))))


def test_between_angles_it_is_bilinear() -> None:
    candela = web(C, GAMMA)
    profile = LightProfile(candela[:-1])
    expected = RegularGridInterpolator((C, GAMMA), candela)
    at = np.random.default_rng(1).uniform((0, 0), (360, 180), (2000, 2))
    np.testing.assert_allclose(profile.at(at[:, 0], at[:, 1]), expected(at), rtol=1e-9)
    np.testing.assert_allclose(profile.at(at[:, 0] - 720, at[:, 1]), expected(at), rtol=1e-9)
    axis, c0 = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
    c, gamma = np.radians(at).T
    directions = np.stack([np.cos(c) * np.sin(gamma), np.sin(c) * np.sin(gamma), -np.cos(gamma)], axis=1)
    np.testing.assert_allclose(profile.intensity(directions, axis, c0), expected(at), rtol=1e-9)


# Pictures.


def lamp_scene(profile: Path, **light: object) -> dict[str, object]:
    """A grey floor seen from above under a lamp, which is turned; in candela, as its profile."""
    return {
        "unit": "photometric",
        "camera": {"position": [0, 0.01, 6], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 50},
        "film": {"resolution": [32, 32]},
        "materials": {"grey": {"reflectance": 0.5}},
        "shapes": [
            {"type": "quad", "corners": [[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], "material": "grey"}
        ],
        "lights": [
            {
                "type": "point",
                "position": [0.3, 0.2, 2.0],
                "profile": str(profile),
                "direction": [0, 0, -3],
                "c0": [0.6, 0.8, 5],
            }
            | light
        ],
    }


def on_the_floor(scene: glpath.Scene) -> tuple[Float64, Float64]:
    """(H, W, 3) from the lamp to where each pixel's centre sees the floor, and radiance there over intensity."""
    camera = scene.camera
    d = camera.rays()
    x = camera.position - d * (camera.position[2] / d[..., 2])[..., None]
    w = x - scene.lights[0].position
    r = np.linalg.norm(w, axis=-1)
    return w / r[..., None], 0.5 / np.pi * -w[..., 2] / r**3


ENGINES: dict[str, dict[str, object]] = {
    "path": {"max_depth": 1, "spp": 16},
    "pair": {"max_depth": 1, "spp": 16, "integrator": "path-buffer"},
    "gather": {"integrator": "gather", "spp": 16},
    "gather-pair": {"integrator": "gather", "spp": 16, "cast": "path-buffer"},
    "t-buffer": {"integrator": "t-buffer", "spp": 1},
    "t-buffer-cube": {"integrator": "t-buffer", "spp": 1, "shadows": "cube"},
    "classic": {"integrator": "classic", "spp": 1},
}


@pytest.mark.parametrize("options", ENGINES.values(), ids=ENGINES)
def test_a_floor_under_a_lamp_of_cosines_is_as_in_the_closed_form(
    options: dict[str, object], tmp_path: Path
) -> None:
    """Intensity 100 cos^3: radiance is 100 cos^4 rho / (pi r^2), within what degrees do to the cosine."""
    gamma = np.arange(0.0, 91.0, 1.0)
    path = ies(tmp_path / "a.ies", gamma, np.zeros(1), 100 * np.cos(np.radians(gamma))[None] ** 3)
    scene = glpath.load_scene(lamp_scene(path, intensity=[1, 0.5, 0.25]))
    w, rest = on_the_floor(scene)
    expected = (100 * np.maximum(-w[..., 2], 0) ** 3 * rest)[..., None] * [1, 0.5, 0.25]
    film = glpath.render(scene, **options)
    exact = options["spp"] == 1  # through the pixels' centres
    np.testing.assert_allclose(film.mean, expected, rtol=1e-3 if exact else 0.01)


@pytest.mark.parametrize("options", ENGINES.values(), ids=ENGINES)
def test_a_lamp_without_symmetry_is_turned_as_it_is_told(options: dict[str, object], tmp_path: Path) -> None:
    scene = glpath.load_scene(lamp_scene(ies(tmp_path / "a.ies", GAMMA, C, web(C, GAMMA))))
    light = scene.lights[0]
    np.testing.assert_allclose(light.c0, [0.6, 0.8, 0], atol=1e-12)
    w, rest = on_the_floor(scene)
    # C = 0 along (0.6, 0.8), C = 90 at a right angle to it, counter-clockwise seen from above.
    c = np.degrees(np.arctan2(-0.8 * w[..., 0] + 0.6 * w[..., 1], 0.6 * w[..., 0] + 0.8 * w[..., 1]))
    gamma = np.degrees(np.arccos(-w[..., 2]))
    candela = RegularGridInterpolator((C, GAMMA), web(C, GAMMA))(np.stack([c % 360, gamma], axis=-1))
    film = glpath.render(scene, **options)
    np.testing.assert_allclose(film.mean[..., 0], candela * rest, rtol=1e-4 if options["spp"] == 1 else 0.015)


def test_solvers_have_the_same_light(tmp_path: Path) -> None:
    scene = glpath.load_scene(lamp_scene(ies(tmp_path / "a.ies", GAMMA, C, web(C, GAMMA))))
    solution = glpath.solve_radiosity(scene, patches=400)
    at = np.random.default_rng(0).uniform(0.1, 0.4, (40, 2))
    found = solution.irradiance(np.zeros(40, int), at)
    a, b, c = scene.triangles[0]
    points = a + at[:, :1] * (b - a) + at[:, 1:] * (c - a)
    there = incident(scene.lights[0], points)
    expected = there.irradiance * there.wi[:, 2:]
    np.testing.assert_allclose(found, expected, rtol=0.05)


def test_every_engine_finds_the_same_among_other_lamps(tmp_path: Path) -> None:
    """Two lamps of one file and one of another beside lamps with and without an extent, with all bounces."""
    half = ies(tmp_path / "a.ies", GAMMA[:19], C, web(C, GAMMA[:19]) / 30)
    other = ies(tmp_path / "b.ies", GAMMA, np.zeros(1), web(np.zeros(1), GAMMA) / 30)
    scene = {
        "unit": "photometric",
        "camera": {"position": [0, 2.2, 4.5], "target": [0, 0.4, 0], "fov": 35},
        "materials": {"floor": {"reflectance": [0.8, 0.3, 0.2]}, "box": {"reflectance": [0.3, 0.5, 0.8]}},
        "film": {"resolution": [24, 18]},
        "shapes": [
            {"type": "quad", "corners": [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]], "material": "floor"},
            {"type": "box", "min": [0.2, 0, 0], "max": [1.2, 0.9, 0.7], "material": "box"},
            {"type": "box", "min": [-0.9, 1.2, -0.9], "max": [0.1, 1.3, -0.2], "emission": {"radiance": 1}},
        ],
        "lights": [
            {"type": "point", "position": [-1, 1.8, 0.6], "profile": str(half), "direction": [0.4, -1, 0]},
            {"type": "point", "position": [1, 2, 0.6], "profile": str(half), "direction": [0, -1, 0.3]},
            {"type": "point", "position": [0, 1, 1], "profile": str(other), "intensity": [1, 0.5, 0]},
            {"type": "point", "position": [0, 2, 0], "intensity": 1},
        ],
    }
    own = glpath.render(scene, spp=128, max_depth=5).mean
    for options in ({"integrator": "path-buffer", "max_depth": 5}, {"integrator": "gather"}):
        found = glpath.render(scene, spp=128, **options).mean
        assert found.mean(axis=(0, 1)) == pytest.approx(own.mean(axis=(0, 1)), rel=0.03)  # noise of the mean
        lit = own > 0  # the ground, not what is beyond it
        assert np.median(np.abs(found - own)[lit] / own[lit]) < 0.05
    direct = glpath.render(scene, spp=128, max_depth=1).mean
    traced = glpath.render(scene, spp=64, integrator="t-buffer").mean
    assert traced.mean(axis=(0, 1)) == pytest.approx(direct.mean(axis=(0, 1)), rel=0.01)
    assert direct.mean() < 0.97 * own.mean()


def test_a_lamp_with_a_profile_is_chosen_by_what_it_sends(tmp_path: Path) -> None:
    """Not by what its brightest direction would send all around."""
    gamma = np.arange(0.0, 181.0, 1.0)
    beam = np.where(gamma <= 5, 1000.0, 0.0)[None]
    path = ies(tmp_path / "a.ies", gamma, np.zeros(1), beam)
    scene = glpath.load_scene(lamp_scene(path))
    profile = scene.lights[0].profile
    assert profile is not None
    assert profile.flux < 0.01 * 4 * np.pi * profile.max
    with pytest.warns(SceneWarning, match="will be black"):
        assert glpath.render(lamp_scene(path, intensity=0), spp=1, max_depth=1).mean.max() == 0


# Scene files.


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ({"profile": "a.ies", "c0": [0, 0, 1]}, r"\]\[\"c0\"\] goes along `direction`"),
        ({"profile": "a.ies", "direction": [0, 0, 0]}, "must be a vector of any length but zero"),
        ({"intensity": 1, "direction": [0, 0, 1]}, "turns a profile, which the light does not have"),
        ({"intensity": 1, "c0": [0, 0, 1]}, "turns a profile, which the light does not have"),
        ({}, "lacks the field `intensity`, which a light without a `profile`"),
        ({"profile": "no.ies"}, "does not exist"),
        ({"profile": "a.ies", "intensity": -1}, "intensity"),
    ],
)
def test_lights_that_make_no_sense_are_refused(light: dict[str, object], message: str, tmp_path: Path) -> None:
    path = ies(tmp_path / "a.ies", GAMMA, C, web(C, GAMMA))
    scene = lamp_scene(path)
    given = {"type": "point", "position": [0, 0, 2], **light}
    if "profile" in given:
        given["profile"] = str(tmp_path / str(given["profile"]))
    if "c0" in given and "direction" not in given:
        scene = {**scene, "camera": {**scene["camera"], "up": [0, 0, 1], "position": [0, 6, 1]}}  # type: ignore[dict-item]
    with pytest.raises(SceneError, match=message):
        glpath.load_scene({**scene, "lights": [given]})


def test_a_scene_file_names_a_profile_beside_it(tmp_path: Path) -> None:
    (tmp_path / "lamps").mkdir()
    ies(tmp_path / "lamps" / "a.ies", GAMMA, C, web(C, GAMMA))
    (tmp_path / "room.toml").write_text(
        '[camera]\ntype = "perspective"\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\nfov = 40\n'
        '[materials]\ngrey = { type = "diffuse", reflectance = 0.5 }\n'
        '[[shapes]]\ntype = "quad"\ncorners = [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]\nmaterial = "grey"\n'
        '[[lights]]\ntype = "point"\nposition = [0, 2, 0]\nprofile = "lamps/a.ies"\n'
    )
    light = glpath.load_scene(tmp_path / "room.toml").lights[0]
    assert light.direction.tolist() == [0, -1, 0]  # against the camera's up
    assert light.c0.tolist() == [1, 0, 0]
    np.testing.assert_allclose(light.intensity, 1 / 179)  # watts per candela, in a file that is in watts
    assert light.profile is not None
    assert light.profile.candela.shape == (24, 37)


def test_a_profile_is_in_the_digest_of_its_scene(tmp_path: Path) -> None:
    one = glpath.load_scene(lamp_scene(ies(tmp_path / "a.ies", GAMMA, C, web(C, GAMMA))))
    other = glpath.load_scene(lamp_scene(ies(tmp_path / "b.ies", GAMMA, C, web(C, GAMMA) + 1)))
    same = glpath.load_scene(lamp_scene(ies(tmp_path / "c.ies", GAMMA, C, web(C, GAMMA))))
    assert one.digest() == same.digest() != other.digest()


def test_a_model_says_that_it_leaves_the_profile_out(tmp_path: Path) -> None:
    scene = glpath.load_scene(lamp_scene(ies(tmp_path / "a.ies", GAMMA, C, web(C, GAMMA))))
    with pytest.warns(SceneWarning, match="its profile is left out"):
        glpath.export(scene, tmp_path / "a.glb")


@pytest.mark.parametrize("last", [40, 90, 180])
def test_projectors_for_mitsuba_send_what_the_profile_does(last: int) -> None:
    """Its flux, over a plane one unit away: one image for a narrow lamp, a cube's five or six for others."""
    gamma = np.linspace(0, last, 37)
    profile = LightProfile(web(C[:-1], gamma), (0.0, float(last)))
    axis, c0 = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    made = list(projectors("lamp", profile, axis, c0, np.array([1.0, 2.0, 0.5])))
    assert len(made) == {40: 1, 90: 5, 180: 6}[last]
    flux = np.zeros(3)
    for each in made:
        image = each["irradiance"]["image"].astype(float)
        texel = (2 * np.tan(np.radians(each["fov"] / 2)) / len(image)) ** 2
        flux += np.pi * texel * image.sum(axis=(0, 1))
    np.testing.assert_allclose(flux, profile.flux * np.array([1.0, 2.0, 0.5]), rtol=5e-3)


# Models: EXT_lights_ies.


def lamps(*nodes: dict[str, object], profiles: list[dict[str, object]]) -> Gltf:
    file = Gltf()
    for node in nodes:
        file.node(**node)
    file.json["extensions"] = {"EXT_lights_ies": {"lights": profiles}}
    file.json["extensionsRequired"] = ["EXT_lights_ies"]
    return file


def of(**fields: object) -> dict[str, object]:
    return {"EXT_lights_ies": fields}


def test_a_model_has_profiles_turned_as_their_nodes_are(tmp_path: Path) -> None:
    """By the extension's words: gamma 0 is -z, C 0 in the plane of x and z, turning from x to y."""
    ies(tmp_path / "lamp.ies", GAMMA, C, web(C, GAMMA))
    half = np.sqrt(0.5)
    turned: dict[str, object] = {"rotation": [half, 0, 0, half], "translation": [1, 2, 3], "scale": [2, 2, 2]}
    file = lamps(
        {"extensions": of(light=0), "name": "plain"},
        {"extensions": of(light=1, multiplier=2, color=[1, 0.5, 0]), **turned},
        profiles=[{"uri": "lamp.ies"}, {"bufferView": 0, "mimeType": "application/x-ies-lm-63"}],
    )
    file.view((tmp_path / "lamp.ies").read_bytes())
    model = read_gltf(file.write(tmp_path), light_factor=3)
    assert model.notes == ()
    plain, other = model.lights
    assert (plain.name, other.name) == ("plain", "light-1")
    np.testing.assert_allclose(other.position, [1, 2, 3])
    np.testing.assert_allclose(plain.intensity, 3)
    np.testing.assert_allclose(other.intensity, [6, 3, 0])
    local = np.random.default_rng(0).normal(size=(200, 3))
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    gamma, c = np.degrees(np.arccos(-local[:, 2])), np.degrees(np.arctan2(local[:, 1], local[:, 0])) % 360
    expected = RegularGridInterpolator((C, GAMMA), web(C, GAMMA))(np.stack([c, gamma], axis=1))
    quarter = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # about x, from y to z
    for light, world in ((plain, local), (other, local @ quarter.T)):
        assert light.profile is not None
        np.testing.assert_allclose(light.profile.intensity(world, light.direction, light.c0), expected, rtol=1e-7)


def test_a_lamp_that_is_scaled_to_a_plane_is_left_out(tmp_path: Path) -> None:
    ies(tmp_path / "lamp.ies", GAMMA, C, web(C, GAMMA))
    flat = ({"extensions": of(light=0), "scale": scale} for scale in ([0, 1, 1], [1, 1, 0], [1, 0, 1]))
    model = read_gltf(lamps(*flat, profiles=[{"uri": "lamp.ies"}]).write(tmp_path))
    assert [light.name for light in model.lights] == ["light-2"]
    assert any("scaled to nothing" in note for note in model.notes)


def test_mirrored_nodes_and_assets_mirror_and_turn_profiles(tmp_path: Path) -> None:
    """The intensity in a direction is the file's in the direction before the maps of node and asset."""
    ies(tmp_path / "lamp.ies", GAMMA, C, web(C, GAMMA))
    file = lamps({"extensions": of(light=0), "scale": [1, -1, 1]}, profiles=[{"uri": "lamp.ies"}])
    file.one_triangle().write(tmp_path)
    steps = ("{ rotate = { axis = [1, 2, 3], angle = 70 } }", "{ scale = [-2, 2, 2] }")
    (tmp_path / "scene.toml").write_text(
        'unit = "photometric"\ncamera = { position = [2, 2, 6], target = [0, 0, 0] }\n'
        + "".join(f'[[assets]]\nfile = "model.gltf"\ntransform = [{step}]\n' for step in steps)
    )
    (alone,) = read_gltf(tmp_path / "model.gltf").lights
    turned, twice = glpath.load_scene(tmp_path / "scene.toml").lights
    local = np.random.default_rng(0).normal(size=(200, 3))
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    gamma, c = np.degrees(np.arccos(-local[:, 2])), np.degrees(np.arctan2(local[:, 1], local[:, 0])) % 360
    expected = RegularGridInterpolator((C, GAMMA), web(C, GAMMA))(np.stack([c, gamma], axis=1))
    of_node = local * [1, -1, 1]
    rotation = Rotation.from_rotvec(np.radians(70) * np.array([1, 2, 3]) / 14**0.5)
    for light, world in ((alone, of_node), (turned, rotation.apply(of_node)), (twice, of_node * [-1, 1, 1])):
        assert light.profile is not None
        np.testing.assert_allclose(light.profile.intensity(world, light.direction, light.c0), expected, rtol=1e-7)


def test_a_symmetric_profile_is_its_own_mirror_image() -> None:
    even = LightProfile(np.array([[1.0, 2], [3, 4], [5, 6], [3, 4]]))
    odd = LightProfile(np.array([[1.0, 2], [3, 4], [5, 6], [7, 8]]))
    assert even.mirrored is even
    assert odd.mirrored.candela[:, 0].tolist() == [1, 7, 5, 3]


def test_a_lamp_of_both_extensions_is_one(tmp_path: Path) -> None:
    ies(tmp_path / "lamp.ies", GAMMA, C, web(C, GAMMA))
    file = lamps(
        {"extensions": of(light=0) | {"KHR_lights_punctual": {"light": 0}}}, profiles=[{"uri": "lamp.ies"}]
    )
    file.json["extensions"]["KHR_lights_punctual"] = {"lights": [{"type": "point"}]}
    model = read_gltf(file.write(tmp_path))
    assert [light.profile is not None for light in model.lights] == [True]
    assert any("KHR_lights_punctual" in note for note in model.notes)


@pytest.mark.parametrize(
    ("profile", "light", "message"),
    [
        ({"uri": "none.ies"}, 0, r"EXT_lights_ies\.lights\[0\]\.uri names .none.ies., which does not exist"),
        ({"uri": "../outside.ies"}, 0, "outside the folder"),
        ({"uri": "lamp.ies"}, 1, r"nodes\[0\]\.extensions\.EXT_lights_ies\.light"),
        ({"uri": "data:,TILT=NONE 1"}, 0, r"lights\[0\]\.uri names data, which cannot be used: line 1"),
        ({}, 0, "bufferView"),
    ],
)
def test_profiles_of_a_model_that_are_wrong_are_refused(
    profile: dict[str, object], light: int, message: str, tmp_path: Path
) -> None:
    ies(tmp_path / "lamp.ies", GAMMA, C, web(C, GAMMA))
    with pytest.raises(SceneError, match=message):
        read_gltf(lamps({"extensions": of(light=light)}, profiles=[profile]).write(tmp_path))


# Beside Radiance.


@pytest.mark.evidence
def test_radiance_sends_the_same_in_every_direction(tmp_path: Path) -> None:
    """ies2rad and rtrace: irradiance far away, in W of 179 lumens each; gamma = 0 is -z there, C = 0 +x."""
    try:
        folder = Path(other_python.find_package("pyradiance", other_python.python())[0])
    except GlpathError as error:
        pytest.skip(str(error))
    path = ies(tmp_path / "lamp.ies", GAMMA, C, web(C, GAMMA))
    environment = os.environ | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "RAYPATH": f"{folder / 'lib'}:."}

    def run(*command: str, given: str = "") -> bytes:
        tool = [str(folder / "bin" / command[0]), *command[1:]]
        return subprocess.run(
            tool, cwd=tmp_path, env=environment, input=given.encode(), capture_output=True, timeout=60, check=True
        ).stdout

    run("ies2rad", "-dm", "-o", "lamp", "-c", "1", "1", "1", str(path))
    (tmp_path / "lamp.oct").write_bytes(run("oconv", "lamp.rad"))
    directions = np.random.default_rng(0).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays = "".join(f"{written(1000 * d)} {written(-d)}\n" for d in directions)
    options = "-h -I -ab 0 -dj 0 -ds 0 -dt 0 -dc 1 -lw 0"
    answer = run("rtrace", *options.split(" "), "lamp.oct", given=rays)
    theirs = np.array([line.split()[0] for line in answer.decode().splitlines()], np.float64) * 1000**2 * 179
    light = Light(
        "lamp",
        "point",
        np.ones(3),
        direction=np.array([0.0, 0.0, -1.0]),
        profile=read_profile(path, PLACE),
        c0=np.array([1.0, 0.0, 0.0]),
    )
    ours = incident(light, 1000 * directions).irradiance[:, 0] * 1000**2
    np.testing.assert_allclose(theirs, ours, rtol=1e-4)
