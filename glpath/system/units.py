"""Unit of a scene's light: watts or lumens. Only this module defines the lumens of a watt.

    radiometric : W sr^-1 m^-2 of radiance, W sr^-1 of intensity, W m^-2 of irradiance; default of TOML and Python
    photometric : cd m^-2 (nits), cd, lx; unit of glTF and IES profiles, by their specifications

All light of a `Scene` is in the unit of the scene; sources in the other unit are converted when they are read.
Colours are Rec. 709 in both units. A photometric quantity is the luminance of its three channels.

Source: Larson & Shakespeare 1998, Rendering with Radiance: WHTEFFICACY. glTF 2.0, 3.9.4; KHR_lights_punctual.
"""

from __future__ import annotations

from typing import Literal, get_args

Unit = Literal["radiometric", "photometric"]
UNITS: tuple[Unit, ...] = get_args(Unit)

#: Lumens per watt of white light (three equal channels). The renderer Radiance converts measured lamps by this
#: value.
EFFICACY = 179.0

Quantity = Literal["power", "intensity", "radiance", "irradiance"]

_SYMBOLS: dict[Unit, dict[Quantity, str]] = {
    "radiometric": {"power": "W", "intensity": "W sr^-1", "radiance": "W sr^-1 m^-2", "irradiance": "W m^-2"},
    "photometric": {"power": "lm", "intensity": "cd", "radiance": "cd m^-2", "irradiance": "lx"},
}


def conversion(given: Unit, wanted: Unit) -> float:
    """Return the factor that converts a value in unit `given` to unit `wanted`."""
    if given == wanted:
        return 1.0
    return EFFICACY if wanted == "photometric" else 1.0 / EFFICACY


def symbol(unit: Unit, quantity: Quantity) -> str:
    """Return the symbol of a quantity's unit, such as cd m^-2."""
    return _SYMBOLS[unit][quantity]
