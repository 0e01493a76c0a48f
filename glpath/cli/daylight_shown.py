"""Output files of `glpath daylight` that show values on a model (.vtp, .glb), and sensors at the model's texels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from glpath.errors import UsageError
from glpath.system.files import is_stream
from glpath.system.outputs import Save

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from glpath.apps.daylight.coefficients import DaylightCoefficients
    from glpath.apps.daylight.texels import Texels
    from glpath.apps.daylight.year import DaylightYear
    from glpath.scene import Scene

TEXELS = "texels"
#: Suffixes of files that show values at the sensors' positions.
SHOWN = (".vtp", ".glb")
# Quantity that colours a .glb if a year is computed and --show is not given.
_OF_YEAR = "irradiation_year"
# Quantity that colours a .glb if no year is computed.
_OF_SKY = "sky_view_factor"
#: Quantities that may colour a .glb if a year is computed.
OF_YEARS = (
    "daylight_autonomy",
    *(f"useful_daylight_{name}" for name in ("low", "supplementary", "enough", "high")),
    *("mean_illuminance", "sunlight_hours", _OF_SKY, _OF_YEAR),
)


@dataclass(frozen=True)
class TexelRequest:
    """Request for sensors at texels of a model.

    size   : size of a texel, scene units
    shapes : names of the shapes with sensors; None for all
    """

    size: float
    shapes: Sequence[str] | None

    def of(self, scene: Scene) -> Texels:
        """Return the texels of a scene. Raises UsageError and SceneError, as `texels` does."""
        from glpath.apps.daylight.texels import texels

        return texels(scene, self.size, shapes=self.shapes)


def texel_request(
    receiver: str, size: float | None, shapes: Sequence[str] | None, points: Path | None, normal: str | None
) -> TexelRequest | None:
    """Return the request for texels; None for other receivers. Raises UsageError if the options contradict it."""
    if receiver != TEXELS:
        for option, is_typed in (("--texel-size", size is not None), ("--texel-shape", bool(shapes))):
            if is_typed:
                raise UsageError(f"{option}: belongs to --receiver {TEXELS}.", "Leave it out.")
        return None
    for option, given in (("--points", points), ("--normal", normal)):
        if given is not None:
            raise UsageError(f"{option}: beside --receiver {TEXELS}, which are the sensors.", "Leave it out.")
    if size is None:
        raise UsageError(f"--receiver {TEXELS}: how large?", "Give --texel-size, in scene units.")
    return TexelRequest(size, shapes or None)


def check_shown(out: Sequence[Path], are_texels: bool, show: str | None, of_year: bool) -> None:
    """Raise UsageError, before the computation, if a file of `out` cannot show values of these sensors.

    Raises GlpathError if matplotlib is needed and missing.

    are_texels : True if the sensors are texels, or come from a file of coefficients and so may be texels
    of_year    : True if weather is given
    """
    models = [path for path in out if path.suffix.lower() == ".glb"]
    if show is not None and not models:
        raise UsageError("--show: is what colours a .glb.", "Give -o FILE.glb.")
    known = OF_YEARS if of_year else (_OF_SKY,)
    if show is not None and show not in known:
        others = "" if of_year else "; with --weather others"
        raise UsageError(f"--show {show}: there is no such value.", f"There is {', '.join(known)}{others}.")
    if not models:
        return
    if is_stream(models[0]) or not are_texels:
        raise UsageError(
            f"{models[0]}: shows values on texels, but the sensors are points.", f"Give --receiver {TEXELS}."
        )
    from glpath.film.charts import require_matplotlib

    require_matplotlib()


def values_of(found: DaylightCoefficients, year: DaylightYear | None) -> dict[str, tuple[NDArray[np.float64], str]]:
    """Return a dictionary from quantity name to the values of all sensors, (N,), and their unit."""
    if year is None:
        return {_OF_SKY: (found.sky_view, "")}
    return {name: (each, unit) for name, each, unit in year.of_sensors()}


def saves_shown(
    out: Sequence[Path], found: DaylightCoefficients, year: DaylightYear | None, show: str | None
) -> dict[Path, Save]:
    """Return, for each path of `out`, the function that writes its .vtp or .glb."""
    if not out:
        return {}
    values = values_of(found, year)
    chosen = show or (_OF_SKY if year is None else _OF_YEAR)
    return {path: partial(_save, found=found, values=values, chosen=chosen) for path in out}


def _save(
    path: Path, found: DaylightCoefficients, values: dict[str, tuple[NDArray[np.float64], str]], chosen: str
) -> None:
    from glpath.io.vtk import points_with_values

    if path.suffix.lower() == ".glb":
        if found.texels is None:
            raise UsageError(f"{path}: shows values on texels, but these sensors are points.")
        shown, unit = values[chosen]
        found.texels.to_glb(path, shown, quantity=chosen, unit=unit, up=found.up)
        return
    data = {name: each for name, (each, _) in values.items()}
    mesh = points_with_values(found.points, data) if found.texels is None else found.texels.to_vtk(data)
    mesh.save(path)
