"""Daylight of an office over a year, from the scene to sDA and ASE, beside Radiance; sky and suns of a city.

The office has one band of glass windows, blinds, and sensors half a metre apart. Its weather is the year in the
file that comes with pvlib. Coefficients are compared with those of `rfluxmtx` for the same patches and up to the
fifth reflection. Errors of both are relative to Radiance with many more rays. Radiance's time to our error is
extrapolated: its error is inversely proportional to the square root of its number of rays.

Source:   issue 43 for the limits; ClimateStudio claims ten seconds for such an office.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks.peers import radiance
from benchmarks.scenes.city import City
from benchmarks.scenes.daylit_office import as_toml, office, sensors
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.compute import daylight_coefficients
from glpath.apps.daylight.hourly_skies import HourlySkies
from glpath.apps.daylight.metrics import AUTONOMY, daylight_autonomy, spatial_autonomy
from glpath.apps.daylight.year import GROUND, daylight_year
from glpath.errors import GlpathError
from glpath.gl.context import open_context
from glpath.io import scene_from_dict
from glpath.io.weather import Weather, read_weather
from glpath.scene.model import Float64, Scene
from glpath.sky.sun_position import quiet_pvlib
from glpath.system.machine import peak_resident_bytes
from glpath.system.versions import versions

Row = dict[str, Any]
Say = Callable[[str], None]

CLAIM = (
    "the year of an office in 10 s, ten times sooner than Radiance; a million sensors of a city in 5 minutes; "
    "a shard of a matrix of 100,000 x 2,305 in a GiB"
)
RULE = (
    Condition("office_s", "<=", 10.0),
    Condition("sda_off", "<=", 0.01),
    Condition("radiance_ratio", ">=", 10.0),
    Condition("city_s", "<=", 300.0),
    Condition("shard_GiB", "<=", 1.0),
)
ALONE = (RULE[0], *RULE[3:])
#: Maximum number of surfaces that light meets, including the sensor's surface.
BOUNCES = 5
#: Rays per sensor of Radiance, and rays of the coefficients that serve as reference.
RAYS, CONVERGED = (1000, 4000, 16000), 200_000
#: Numbers of directions into each patch.
SAMPLES = (4, 16, 64)
CITY, SENSORS = 43_000, 1_000_000
#: Number of sensors of a matrix, and number of its shards.
SHARDED, SHARDS = 100_000, 8
_UP = [0.0, 0.0, 1.0]


def real_year() -> Path:
    """Return the weather file of Greensboro, a typical year [NREL, TMY3], which comes with pvlib."""
    with quiet_pvlib() as pvlib:
        return Path(pvlib.__file__).parent / "data" / "723170TYA.CSV"


def office_seconds(rounds: int, say: Say) -> tuple[list[float], str]:
    """Return the seconds of each round of the process from the scene to sDA and ASE, and its printed text."""
    found, printed = [], ""
    with tempfile.TemporaryDirectory() as folder:
        for name, blinds in (("office.toml", False), ("closed.toml", True)):
            Path(folder, name).write_text(as_toml(office(blinds)))
        rows = [",".join(f"{v:g}" for v in (*point, *_UP)) for point in sensors()]
        Path(folder, "desk.csv").write_text("\n".join(["x,y,z,nx,ny,nz", *rows]))
        weather = Path(folder, "weather.csv")
        weather.write_bytes(real_year().read_bytes())
        command = [sys.executable, "-m", "glpath", "daylight", "office.toml", "-o", "year.nc", "-o", "year.csv"]
        command += ["--points", "desk.csv", "--weather", "weather.csv", "--blinds", "closed.toml"]
        command += ["--max-depth", str(BOUNCES)]
        for _ in range(rounds):
            started = time.perf_counter()
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            found.append(time.perf_counter() - started)
            if done.returncode:
                raise GlpathError(f"glpath daylight failed: {done.stderr}")
            printed = done.stderr
            say(f"office: {found[-1]:.1f} s")
    return found, printed


def patches_alone(weather: Weather, found: Any) -> Float64:
    """Return luminance (P, H), cd m^-2, for the hours of the year, with the sun spread over its patch."""
    skies = HourlySkies.of(weather, found, GROUND)
    sky = skies.sky("illuminance").astype(np.float64)
    altitude, azimuth = (each[skies.hours] for each in weather.sun)
    to_sun = found.compass.directions(np.radians(azimuth), np.sin(np.radians(altitude)))
    patch = found.patches.containing(to_sun, found.compass)
    sky[patch, np.arange(len(skies))] += skies.sun("illuminance") / found.patches.solid_angles[patch]
    hours = np.zeros((len(sky), len(weather.times)))
    hours[:, skies.hours] = sky
    return hours


def error(found: Float64, expected: Float64) -> float:
    """Return the relative error of coefficients: RMS of the errors divided by RMS of the expected values."""
    return float(np.sqrt(np.sum((found - expected) ** 2) / np.sum(expected**2)))


def beside_radiance(scale: float, say: Say) -> tuple[list[Row], dict[str, float], list[str]]:
    """Return rows and numbers of both programs, and faults. Raises GlpathError if Radiance is missing.

    In both, blinds are closed in the same hours: those in which the sun reaches more than 2 % of the sensors.
    """
    version = radiance.version()
    bare, closed, at = scene_from_dict(office()), scene_from_dict(office(blinds=True)), sensors()
    up = np.tile(_UP, (len(at), 1))
    weather = read_weather(real_year())
    most = max(2000, round(CONVERGED * scale))

    def of_glpath(scene: Scene, samples: int, suns: bool = False) -> tuple[float, DaylightCoefficients]:
        latitude = weather.latitude if suns else None
        started = time.perf_counter()
        found = daylight_coefficients(scene, at, up, samples=samples, max_depth=BOUNCES, latitude=latitude)
        return time.perf_counter() - started, found

    seconds, expected = radiance.daylight_matrix(bare, at, up, 1, most, BOUNCES)
    say(f"Radiance {version}, {most:,} rays a sensor: {seconds:.1f} s")
    rows: list[Row] = [{"program": "Radiance", "samples": most, "seconds": seconds, "error": None}]
    for rays in RAYS:
        took, matrix = radiance.daylight_matrix(bare, at, up, 1, max(100, round(rays * scale)), BOUNCES)
        rows.append({"program": "Radiance", "samples": rays, "seconds": took, "error": error(matrix, expected)})
        say(f"Radiance, {rays:,} rays: {took:.1f} s, error {rows[-1]['error']:.2%}")
    theirs = rows[-1]
    of_glpath(bare, 2)  # compiles
    best, ratio = 0, 0.0
    for samples in SAMPLES:
        took, found = of_glpath(bare, samples)
        off = error(found.sky().astype(np.float64), expected)
        rows.append({"program": "glpath", "samples": samples, "seconds": took, "error": off})
        say(f"glpath, {samples} directions into a patch: {took:.1f} s, error {off:.2%}")
        # Radiance's cost is proportional to its rays, and its error to the inverse square root of their number.
        of_this = theirs["seconds"] * (theirs["error"] / off) ** 2 / took
        if of_this > ratio:
            best, ratio = samples, of_this
    year = daylight_year(of_glpath(bare, best, suns=True)[1], weather, blinds=of_glpath(closed, best, suns=True)[1])
    skies = patches_alone(weather, year.coefficients)[:, year.occupied]
    shut = year.closed[year.occupied]
    with_blinds = radiance.daylight_matrix(closed, at, up, 1, most // 4, BOUNCES)[1]
    pairs = {
        "glpath": tuple(each.sky().astype(np.float64) for each in (year.coefficients, *year.blinds)),
        "Radiance": (expected, with_blinds),
    }
    numbers, faults = {"samples": float(best), "radiance_ratio": ratio}, []
    for name, (open_matrix, shut_matrix) in pairs.items():
        lux = np.empty((len(at), len(shut)))
        for which, matrix in ((~shut, open_matrix), (shut, shut_matrix)):
            lux[:, which] = radiance.matrix_product(matrix, skies[:, which])
            off = np.abs(lux[:, which] - matrix @ skies[:, which]).max() / lux[:, which].max()
            faults += [f"dctimestep and numpy differ by {off:.1e} of {name}'s"] if off > 1e-4 else []
        autonomy = daylight_autonomy(lux, AUTONOMY)
        numbers[f"sda_{name.lower()}"] = spatial_autonomy(autonomy)
        numbers[f"mean_autonomy_{name.lower()}"] = float(autonomy.mean())
    ours, theirs_closed = pairs["glpath"], pairs["Radiance"]
    numbers |= {
        "sda_off": abs(numbers["sda_glpath"] - numbers["sda_radiance"]),
        "sum_off": float(ours[0].sum() / theirs_closed[0].sum() - 1),
        "sum_off_with_blinds": float(ours[1].sum() / theirs_closed[1].sum() - 1),
    }
    return rows, numbers, faults


def city(scale: float, say: Say) -> dict[str, float]:
    """Compute direct coefficients of sensors on the ground and the roofs for 577 patches and the suns of a year."""
    blocks = City.of(CITY)
    at = blocks.points(max(1000, round(SENSORS * scale)))
    started = time.perf_counter()
    found = daylight_coefficients(
        blocks.scene, at, _UP, subdivision=2, samples=1, latitude=47.0, max_depth=1, up=_UP
    )
    seconds = time.perf_counter() - started
    say(f"city: {seconds:.0f} s")
    rays = float(len(at) * len(found.directions))
    return {
        "city_s": seconds / scale if scale < 1 else seconds,
        "city_sensors": float(len(at)),
        "city_directions": float(len(found.directions)),
        "city_rays_per_s": rays / seconds,
        "city_GiB": peak_resident_bytes() / 2**30,
    }


def shard(scale: float) -> dict[str, float]:
    """Return the seconds and memory of this process to compute a shard, with all reflections, and save it."""
    blocks = City.of(max(500, round(CITY * scale)))
    at = blocks.points(max(800, round(SHARDED * scale)))
    started = time.perf_counter()
    found = daylight_coefficients(blocks.scene, at, _UP, subdivision=4, latitude=47.0, up=_UP, shard=(1, SHARDS))
    with tempfile.TemporaryDirectory() as folder:
        found.save(Path(folder, "shard.npz"))
    return {
        "shard_sensors": float(len(found.points)),
        "shard_directions": float(len(found.directions)),
        "shard_s": time.perf_counter() - started,
        "shard_GiB": peak_resident_bytes() / 2**30,
    }


def shard_alone(scale: float, say: Say) -> dict[str, float]:
    """Run `shard` in a separate process, so that its memory is measured alone."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        found = processes.submit(shard, scale).result()
    say(f"shard of a city: {found['shard_s']:.0f} s, {found['shard_GiB']:.2f} GiB")
    return found


def bench_daylight(rounds: int = 3, scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes ten minutes on two cores, most of it Radiance's reference.

    The report's numbers: `office_s`, seconds of the whole process; `radiance_ratio`, Radiance's time to the same
    error of the coefficients, divided by ours; `sda_off`, difference of both fractions of sensors with 300 lx in
    half of the time; `city_s`; `shard_GiB`, peak resident memory; and others.

    Parameters
    ----------
    rounds : number of runs of the office
    scale  : below 1, fewer sensors in the city, fewer rays of Radiance, and a shard of a smaller city
    say    : function that gets messages about the progress
    """
    seconds, printed = office_seconds(rounds, say)
    numbers: dict[str, float] = {"office_s": median(seconds), "office_sensors": float(len(sensors()))}
    rows: list[Row] = []
    notes = [line.strip() for line in printed.splitlines() if "sDA" in line or "ASE" in line]
    faults: list[str] = []
    rule: tuple[Condition, ...] = RULE
    programs = ["glpath", "moderngl", "numpy", "pvlib"]
    try:
        rows, beside, faults = beside_radiance(scale, say)
        numbers |= beside
        programs_of_others = {"Radiance": radiance.version()}
    except GlpathError as missing:
        notes.append(f"without Radiance: {missing}")
        rule, programs_of_others = ALONE, {}
    numbers |= city(scale, say) | shard_alone(scale, say)
    claim, holds = judge(CLAIM, rule, numbers)
    with open_context() as context:
        device = context.info.renderer
    return Report(
        "daylight",
        claim,
        numbers,
        holds,
        rows,
        machine(device),
        versions(*programs) | programs_of_others,
        notes,
        faults,
    )
