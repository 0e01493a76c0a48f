"""The sky of Perez: parameters and light of Radiance's gendaylit; and what its map makes of ground and walls."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from benchmarks.peers import other_python
from glpath.errors import GlpathError
from glpath.sky.perez import Daylight, PerezSky, extraterrestrial

UP = np.array([0.0, 0.0, 1.0])

# What gendaylit 2.5 of Radiance prints with -ang ALTITUDE AZIMUTH -W DIRECT DIFFUSE, and -O 1 or -O 2: altitude and
# irradiances; epsilon and delta; the five parameters; the scale of the sky in W and in lm; the sun's radiance and
# luminance.
GENDAYLIT = [
    ((30, 600, 100), (3.7329, 0.1408), (-1.050738, -0.314913, 13.060300, -3.432704, 0.324402),
     (40.00, 6101), (8.828e6, 8.547e8)),
    ((60, 900, 80), (10.7874, 0.0652), (-0.994820, -0.213633, 22.353588, -6.127064, 1.303873),
     (36.83, 4990), (1.324e7, 1.373e9)),
    ((30, 0, 100), (1.0, 0.1408), (0.832968, -0.605102, 0.501177, -0.415291, -0.028838), (18.42, 2206), (0, 0)),
    ((12, 700, 60), (4.2171, 0.1995), (-0.932654, -0.289314, 13.263786, -3.334803, 0.408164),
     (24.62, 3769), (1.030e7, 7.674e8)),
    ((10, 100, 150), (1.1739, 0.5916), (-0.554236, -1.712680, 10.934867, -3.253803, -0.127292),
     (35.12, 3922), (1.471e6, 1.105e8)),
    ((40, 400, 250), (1.9457, 0.2743), (-1.031993, -0.748280, 12.759539, -3.158334, 0.146363),
     (51.46, 6308), (5.885e6, 5.616e8)),
    ((50, 150, 350), (1.3165, 0.3225), (-0.983371, -1.034621, 11.276323, -3.262437, 0.106082),
     (63.55, 7408), (2.207e6, 2.131e8)),
    ((25, 250, 150), (1.6614, 0.2495), (-1.168467, -0.655377, 11.787328, -3.181714, 0.060806),
     (42.86, 5443), (3.678e6, 3.259e8)),
]  # fmt: skip
# gendaylit takes the first day of January where it has no date, counted from 0.
JANUARY = extraterrestrial(0)


def to_sun(altitude: float, turn: float = 0.9) -> np.ndarray:
    a = np.radians(altitude)
    return np.array([np.cos(a) * np.cos(turn), np.cos(a) * np.sin(turn), np.sin(a)])


def upper_half(n: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """(n, 4 n, 3) directions above the horizon, and weights (n,) of their rows' means."""
    u, w = leggauss(n)
    z = (u + 1) / 2
    phi = (np.arange(4 * n) + 0.5) * (2 * np.pi / (4 * n))
    r = np.sqrt(1 - z * z)[:, None]
    directions = np.stack([r * np.cos(phi), r * np.sin(phi), np.broadcast_to(z[:, None], (n, 4 * n))], axis=-1)
    return directions, np.pi * w


def irradiance(seen: np.ndarray, directions: np.ndarray, weights: np.ndarray, normal: np.ndarray) -> float:
    return float(weights @ (seen * np.maximum(directions @ normal, 0.0)).mean(axis=1))


def scale_of(sky: PerezSky, sun: np.ndarray, diffuse: float) -> float:
    """Of the relative luminance, exactly: gendaylit takes 145 directions for it, and is off by some per cent."""
    directions, weights = upper_half(400)
    return diffuse / irradiance(
        sky.relative_luminance(directions[..., 2], directions @ sun), directions, weights, UP
    )


@pytest.mark.parametrize(("given", "indices", "parameters", "scales", "suns"), GENDAYLIT)
def test_parameters_and_efficacies_are_those_of_gendaylit(
    given: tuple[float, float, float],
    indices: tuple[float, float],
    parameters: tuple[float, ...],
    scales: tuple[float, float],
    suns: tuple[float, float],
) -> None:
    altitude, direct, diffuse = given
    sky = PerezSky.of(direct, diffuse, altitude, JANUARY)
    assert (sky.clearness, sky.brightness) == pytest.approx(indices, abs=5.1e-5)
    assert (sky.a, sky.b, sky.c, sky.d, sky.e) == pytest.approx(parameters, abs=3e-6)
    assert sky.diffuse_efficacy() == pytest.approx(scales[1] / scales[0], rel=1e-3)
    if direct:
        assert sky.direct_efficacy() == pytest.approx(suns[1] / suns[0], rel=1e-3)
    # Its own sum over the 145 directions of Tregenza's patches is not the integral.
    assert scale_of(sky, to_sun(altitude), diffuse) == pytest.approx(scales[0], rel=0.02)


def test_many_skies_at_once_are_as_each_alone() -> None:
    altitude, direct, diffuse = np.array([given for given, *_ in GENDAYLIT], float).T
    for k, alone in enumerate(zip(direct, diffuse, altitude, strict=True)):
        np.testing.assert_array_equal([x[k] for x in PerezSky.of(direct, diffuse, altitude)], PerezSky.of(*alone))


@pytest.mark.parametrize("given", [given for given, *_ in GENDAYLIT])
def test_map_has_the_light_of_the_formula(given: tuple[float, float, float]) -> None:
    """On open ground as given; on walls, and where the sky is looked at, within half a per cent of the formula."""
    altitude, direct, diffuse = given
    sun, sky = to_sun(altitude), PerezSky.of(direct, diffuse, altitude)
    made = Daylight(sky, sun, 0.0, diffuse, 0.0).environment(UP)
    directions, weights = upper_half()
    seen = made.radiance(directions)[..., 0]
    formula = scale_of(sky, sun, diffuse) * sky.relative_luminance(directions[..., 2], directions @ sun)
    assert irradiance(seen, directions, weights, UP) == pytest.approx(diffuse, rel=2e-4)
    for wall in np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0]]):
        there = irradiance(formula, directions, weights, wall)
        assert irradiance(seen, directions, weights, wall) == pytest.approx(there, rel=5e-3)
    away = (directions @ sun < np.cos(np.radians(2))) & (directions[..., 2] > np.sin(np.radians(2)))
    away &= directions[..., 2] < np.cos(np.radians(0.5))
    np.testing.assert_allclose(seen[away], formula[away], rtol=5e-3)


def test_ground_has_its_albedo_and_the_sun_its_irradiance() -> None:
    sun = to_sun(30)
    made = Daylight(PerezSky.of(600, 100, 30), sun, 600.0, 100.0, 0.3).environment(UP)
    assert made.radiance([[0.3, 0.1, -0.5]])[0, 0] == pytest.approx(0.3 * (600 * 0.5 + 100) / np.pi, rel=1e-6)
    assert made.sun is not None
    np.testing.assert_allclose(made.sun.irradiance, 600)
    below = np.pi * 0.3 * 400 / np.pi * 2  # a hemisphere of one radiance
    above = made.mean_integral - 600 - below
    assert 100 < above < 400
    # Without a diffuse irradiance the sky is dark.
    alone = Daylight(PerezSky.of(600, 0, 30), sun, 600.0, 0.0, 0.0).environment(UP)
    assert alone.mean_integral == pytest.approx(600, rel=2e-5)
    assert alone.sun_share == pytest.approx(1.0, rel=1e-12)


def test_extremes_are_within_the_model() -> None:
    sky = PerezSky.of([1300, 0, 1000, 5], [0.1, 0, 900, 3], [90, 0, 0.01, -3])
    assert all(np.isfinite(x).all() for x in sky)
    assert ((sky.clearness >= 1) & (sky.clearness <= 12)).all()
    heights = np.linspace(0, 1, 9)[:, None]
    assert np.isfinite(sky.relative_luminance(heights, 0.3)).all()
    assert (sky.relative_luminance(heights, 0.3) >= 0).all()
    assert ((sky.diffuse_efficacy() > 50) & (sky.diffuse_efficacy() < 250)).all()


@pytest.mark.evidence  # needs the peers extra
def test_radiance_in_many_directions_beside_radiance(tmp_path: Path) -> None:
    """Forty days: rtrace's radiance of gendaylit's skies, over their own irradiance of open ground."""
    try:
        package, _ = other_python.find_package("pyradiance", other_python.python())
    except GlpathError as error:
        pytest.skip(str(error))
    programs, library = Path(package) / "bin", {"RAYPATH": f"{Path(package) / 'lib'}:{tmp_path}"}
    rng = np.random.default_rng(0)
    directions, weights = upper_half(48)
    rays = np.concatenate([np.zeros_like(directions), directions], axis=-1).reshape(-1, 6)
    worst = 0.0
    for _ in range(40):
        altitude = rng.uniform(3, 85)
        diffuse = rng.uniform(30, 300)
        direct = rng.choice([0.0, rng.uniform(20, 900)])
        words = [
            "-ang",
            f"{altitude:.6f}",
            "0",
            "-W",
            f"{direct:.4f}",
            f"{diffuse:.4f}",
            "-O",
            "1",
            "-g",
            "0",
            "-s",
            "-w",
        ]
        sky_file = subprocess.run(
            [programs / "gendaylit", *words], env=library, capture_output=True, check=True
        ).stdout
        glow = b"\nskyfunc glow sky_glow 0 0 4 1 1 1 0\nsky_glow source sky 0 0 4 0 0 1 180\n"
        (tmp_path / "sky.rad").write_bytes(sky_file + glow)
        octree = subprocess.run(
            [programs / "oconv", "sky.rad"], env=library, cwd=tmp_path, capture_output=True, check=True
        ).stdout
        (tmp_path / "sky.oct").write_bytes(octree)
        found = subprocess.run(
            [programs / "rtrace", "-h", "-fff", "sky.oct"],
            env=library, cwd=tmp_path, input=rays.astype("<f4").tobytes(), capture_output=True, check=True,
        ).stdout  # fmt: skip
        theirs = np.frombuffer(found, "<f4").reshape(*directions.shape)[..., 0]
        sun = np.array([0.0, -np.cos(np.radians(altitude)), np.sin(np.radians(altitude))])
        made = Daylight(PerezSky.of(direct, diffuse, altitude, JANUARY), sun, 0.0, diffuse, 0.0).environment(UP)
        # perezlum.cal blends the sky into the ground, which is black here.
        above = (directions[..., 2] + 1.01) ** 10
        theirs = theirs * (above + 1 / above) / above
        theirs = theirs * diffuse / irradiance(theirs, directions, weights, UP)
        away = (directions @ sun < np.cos(np.radians(2))) & (directions[..., 2] > 0.1)
        worst = max(worst, float(np.abs(made.radiance(directions)[..., 0] / theirs - 1)[away].max()))
    assert worst < 0.01
