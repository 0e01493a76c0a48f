"""Radiance as a peer: same triangles, all bounces by its ambient cache; `rpict` with the same
camera, `rtrace` at points.

Its result is biased, because it interpolates between cached values. So it is one picture with an error and a time,
and it has no number of samples to a target. The programs come with the package pyradiance; `other_python` says how
to install it.

Poor at:  surfaces with a black back, which Radiance lacks: its polygons reflect on both sides; lights that reflect.
Source:   Ward et al. 1988, A ray tracing solution for diffuse interreflection; https://www.radiance-online.org
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.peers import other_python
from glpath.errors import GlpathError
from glpath.scene.model import Float64, Scene
from glpath.system.machine import core_count

#: Options: 12 bounces, 512 rays from each cached value, and lights subdivided and jittered for soft shadows.
SETTINGS = "-ab 12 -ad 512 -as 256 -aa .15 -ar 128 -ds .05 -dj .9 -dt 0 -dc 1 -lr 16 -ps 1 -pj .9"
#: Limit in seconds.
PATIENCE = 900.0
# Number of rays along a pixel's side; their mean is a box filter.
_RAYS = 2


def version() -> str:
    """Return the version of the pyradiance that would run. Raises GlpathError if there is none."""
    return other_python.find_package("pyradiance", other_python.python())[1]


def render(scene: Scene) -> tuple[float, Float64]:
    """Return seconds, with reading of the scene, and (H, W, 3) radiance of a comparable scene, row 0 at the top.

    Raises GlpathError if Radiance is missing or fails.
    """
    width, height = scene.camera.resolution
    with tempfile.TemporaryDirectory() as folder:
        radiance = _Programs(folder)
        start = time.perf_counter()
        radiance.compile(scene)
        size = ["-x", str(_RAYS * width), "-y", str(_RAYS * height), "-pa", "0"]
        picture = radiance.run("rpict", *view(scene), *size, *SETTINGS.split(), "scene.oct")
        Path(folder, "a.hdr").write_bytes(picture)
        seconds = time.perf_counter() - start
        values = np.frombuffer(radiance.run("pvalue", "-h", "-H", "-df", "a.hdr"), np.float32)
    fine = values.reshape(height, _RAYS, width, _RAYS, 3)
    return seconds, fine.mean(axis=(1, 3), dtype=np.float64)


def irradiance(scene: Scene, points: Float64, normals: Float64, settings: str) -> tuple[float, Float64]:
    """Return seconds, with reading of the scene, and (N, 3) irradiance at points by `rtrace -I`, on all cores.

    points, normals : (N, 3) each
    settings        : sampling options of the command line

    Raises GlpathError if Radiance is missing or fails.
    """
    table = np.concatenate([points, normals], axis=1).astype("<f4").tobytes()
    with tempfile.TemporaryDirectory() as folder:
        radiance = _Programs(folder)
        start = time.perf_counter()
        radiance.compile(scene)
        how = ["-I", "-h", "-fff", "-n", str(core_count()), *settings.split()]
        found = radiance.run("rtrace", *how, "scene.oct", given=table)
        seconds = time.perf_counter() - start
    return seconds, np.frombuffer(found, np.float32).reshape(len(points), 3).astype(np.float64)


def daylight_matrix(
    scene: Scene, points: Float64, normals: Float64, subdivision: int, rays: int, bounces: int = 1
) -> tuple[float, Float64]:
    """Return seconds, and (N, 1 + P) daylight coefficients by `rfluxmtx`: ground, then Reinhart's patches.

    scene       : a comparable scene, with z up and y to the north
    subdivision : subdivision of the sky, MF of `reinsrc.cal`
    rays        : number of rays from each point
    bounces     : largest number of bounces; 1 is direct light

    Raises GlpathError if Radiance is missing or fails.
    """
    table = np.concatenate([points, normals], axis=1).astype("<f4").tobytes()
    with tempfile.TemporaryDirectory() as folder:
        radiance = _Programs(folder)
        Path(folder, "scene.rad").write_text(described(scene))
        Path(folder, "sky.rad").write_text(_SKY.format(subdivision))
        start = time.perf_counter()
        how = [
            "-I+",
            "-h",
            "-fff",
            "-ab",
            str(bounces),
            "-ad",
            str(rays),
            "-lw",
            f"{0.01 / rays:g}",
            "-y",
            str(len(points)),
        ]
        found = radiance.run("rfluxmtx", *how, "-n", str(core_count()), "-", "sky.rad", "scene.rad", given=table)
        seconds = time.perf_counter() - start
    return seconds, np.frombuffer(found, np.float32).reshape(len(points), -1, 3)[..., 1].astype(np.float64)


def matrix_product(coefficients: Float64, skies: Float64) -> Float64:
    """Multiply coefficients (N, P) with T hours' skies (P, T) by `dctimestep`, which has three channels: (N, T).

    Raises GlpathError if Radiance is missing or fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        radiance = _Programs(folder)
        for name, matrix in (("dc.mtx", coefficients), ("sky.mtx", skies)):
            head = f"#?RADIANCE\nNROWS={matrix.shape[0]}\nNCOLS={matrix.shape[1]}\nNCOMP=3\nFORMAT=float\n\n"
            values = np.repeat(matrix[..., None], 3, axis=2).astype("<f4")
            Path(folder, name).write_bytes(head.encode() + values.tobytes())
        found = radiance.run("dctimestep", "-h", "-of", "dc.mtx", "sky.mtx")
    return np.frombuffer(found, np.float32).reshape(len(coefficients), -1, 3)[..., 1].astype(np.float64)


_SKY = """#@rfluxmtx h=u u=+Y
void glow ground_glow
0
0
4 1 1 1 0
ground_glow source ground
0
0
4 0 0 -1 180
#@rfluxmtx h=r{} u=+Y
void glow sky_glow
0
0
4 1 1 1 0
sky_glow source sky
0
0
4 0 0 1 180
"""


class _Programs:
    """Radiance's programs, run in a folder."""

    def __init__(self, folder: str) -> None:
        self._package = Path(other_python.find_package("pyradiance", other_python.python())[0])
        programs = str(self._package / "bin")
        self._environment = os.environ | {
            "RAYPATH": f".:{self._package / 'lib'}",
            "PATH": f"{programs}{os.pathsep}{os.environ.get('PATH', '')}",
        }
        self._folder = folder

    def compile(self, scene: Scene) -> None:
        """Write scene.oct of a comparable scene."""
        Path(self._folder, "scene.rad").write_text(described(scene))
        Path(self._folder, "scene.oct").write_bytes(self.run("oconv", "scene.rad"))

    def run(self, program: str, *arguments: str, given: bytes = b"") -> bytes:
        """Run a program with this input, and return its output."""
        command = [str(self._package / "bin" / program), *arguments]
        try:
            done = subprocess.run(
                command,
                cwd=self._folder,
                env=self._environment,
                input=given,
                capture_output=True,
                timeout=PATIENCE,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise GlpathError(
                f"Radiance's {program} took longer than {PATIENCE:.0f} s.", "Take a smaller --resolution."
            ) from error
        if done.returncode:
            said = done.stderr.decode(errors="replace").strip()
            raise GlpathError(f"Radiance's {program} failed: {said}", "See its manual.")
        return done.stdout


def described(scene: Scene) -> str:
    """Return a comparable scene in Radiance's language, with a material per shape and a polygon per triangle."""
    lines = []
    for i, (shape, part) in enumerate(zip(scene.shapes, scene.shapes.ranges, strict=True)):
        material = scene.materials[shape.material]
        if shape.emits:
            lines.append(f"void light m{i}\n0\n0\n3 {_numbers(shape.emission)}")
        elif material.slab:
            # The fraction of light at normal incidence that passes through the glass once, and its index.
            lines.append(f"void glass m{i}\n0\n0\n4 {_numbers(material.reflectance)} {material.ior:g}")
        elif material.diffuse_transmission > 0:
            # Radiance's `trans` has one colour for reflected and transmitted light, and a transmitted fraction.
            through = material.diffuse_transmission * material.diffuse_transmission_colour
            both = (1 - material.diffuse_transmission) * material.reflectance + through
            share = float(through.sum() / both.sum())
            lines.append(f"void trans m{i}\n0\n0\n7 {_numbers(both)} 0 0 {share:.9g} 0")
        else:
            lines.append(f"void plastic m{i}\n0\n0\n5 {_numbers(material.reflectance)} 0 0")
        for k, corners in enumerate(scene.triangles[part]):
            lines.append(f"m{i} polygon s{i}.{k}\n0\n0\n9 {_numbers(corners.ravel())}")
    return "\n".join(lines) + "\n"


def view(scene: Scene) -> list[str]:
    """Return the camera as arguments of rpict."""
    camera = scene.camera
    _, up, forward = camera.frame()
    across = 2 * np.degrees(np.arctan(camera.extent[0]))
    return [
        *("-vtv", "-vp", *_numbers(camera.position).split(), "-vd", *_numbers(forward).split()),
        *("-vu", *_numbers(up).split(), "-vv", f"{camera.fov:.9g}", "-vh", f"{across:.9g}"),
    ]


def _numbers(values: Float64) -> str:
    return " ".join(f"{float(v):.9g}" for v in values)
