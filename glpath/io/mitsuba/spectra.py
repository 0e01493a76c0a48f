"""Conversion of spectra to linear Rec. 709 as in Mitsuba's RGB variants: by the CIE curves of 1931.

Reflectances are weighted by D65, so 1 at all wavelengths is white. Light is not weighted. Its unit is Mitsuba's, in
which D65 of luminance 1 has the colour (1, 1, 1). Colours outside the gamut are clipped at 0.

Source: Mitsuba 3.9, `spectrum_list_to_srgb`; CIE 018:2019, tables of the 2 degree observer and of illuminant D65.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from glpath.scene.geometry import Float64

# Colour-matching functions x, y, z, and D65 relative to 560 nm, from 360 to 830 nm in steps of 5 nm.
_TABLE = """
0.0001299 3.9e-06 0.0006061 0.46638   0.0002321 7e-06 0.001086 0.49364   0.0004149 1.2e-05 0.001946 0.52089
0.0007416 2.2e-05 0.003486 0.51032   0.001368 3.9e-05 0.00645 0.49976   0.002236 6.4e-05 0.01055 0.52312
0.004243 0.00012 0.02005 0.54648   0.00765 0.000217 0.03621 0.68702   0.01431 0.000396 0.06785 0.82755
0.02319 0.00064 0.1102 0.8712   0.04351 0.00121 0.2074 0.91486   0.07763 0.00218 0.3713 0.92459
0.13438 0.004 0.6456 0.93432   0.21477 0.0073 1.0391 0.90057   0.2839 0.0116 1.3856 0.86682
0.3285 0.01684 1.623 0.95774   0.34828 0.023 1.7471 1.0487   0.34806 0.0298 1.7826 1.1094
0.3362 0.038 1.7721 1.1701   0.3187 0.048 1.7441 1.1741   0.2908 0.06 1.6692 1.1781
0.2511 0.0739 1.5281 1.1634   0.19536 0.09098 1.2876 1.1486   0.1421 0.1126 1.0419 1.1539
0.09564 0.13902 0.81295 1.1592   0.05795 0.1693 0.6162 1.1237   0.03201 0.20802 0.46518 1.0881
0.0147 0.2586 0.3533 1.0908   0.0049 0.323 0.272 1.0935   0.0024 0.4073 0.2123 1.0858
0.0093 0.503 0.1582 1.078   0.0291 0.6082 0.1117 1.063   0.06327 0.71 0.07825 1.0479
0.1096 0.7932 0.05725 1.0624   0.1655 0.862 0.04216 1.0769   0.22575 0.91485 0.02984 1.0605
0.2904 0.954 0.0203 1.0441   0.3597 0.9803 0.0134 1.0423   0.43345 0.99495 0.00875 1.0405
0.51205 1 0.00575 1.0202   0.5945 0.995 0.0039 1   0.6784 0.9786 0.00275 0.98167
0.7621 0.952 0.0021 0.96334   0.8425 0.9154 0.0018 0.96061   0.9163 0.87 0.00165 0.95788
0.9786 0.8163 0.0014 0.92237   1.0263 0.757 0.0011 0.88686   1.0567 0.6949 0.001 0.89346
1.0622 0.631 0.0008 0.90006   1.0456 0.5668 0.0006 0.89803   1.0026 0.503 0.00034 0.89599
0.9384 0.4412 0.00024 0.88649   0.85445 0.381 0.00019 0.87699   0.7514 0.321 0.0001 0.85494
0.6424 0.265 5e-05 0.83289   0.5419 0.217 3e-05 0.83494   0.4479 0.175 2e-05 0.83699
0.3608 0.1382 1e-05 0.81863   0.2835 0.107 0 0.80027   0.2187 0.0816 0 0.80121
0.1649 0.061 0 0.80215   0.1212 0.04458 0 0.81246   0.0874 0.032 0 0.82278
0.0636 0.0232 0 0.80281   0.04677 0.017 0 0.78284   0.0329 0.01192 0 0.74003
0.0227 0.00821 0 0.69721   0.01584 0.005723 0 0.70665   0.011359 0.004102 0 0.71609
0.0081109 0.002929 0 0.72979   0.0057903 0.002091 0 0.74349   0.0041095 0.001484 0 0.67977
0.0028993 0.001047 0 0.61604   0.0020492 0.00074 0 0.65745   0.00144 0.00052 0 0.69886
0.00099995 0.0003611 0 0.72486   0.00069008 0.0002492 0 0.75087   0.00047602 0.0001719 0 0.6934
0.0003323 0.00012 0 0.63593   0.00023483 8.5e-05 0 0.55005   0.00016615 6e-05 0 0.46418
0.00011741 4.2e-05 0 0.56612   8.3e-05 3e-05 0 0.66805   5.9e-05 2.1e-05 0 0.65094
4.2e-05 1.5e-05 0 0.63383   2.9e-05 1.1e-05 0 0.63843   2.1e-05 7.5e-06 0 0.64304
1.5e-05 5.3e-06 0 0.61878   1e-05 3.7e-06 0 0.59452   7.2e-06 2.6e-06 0 0.55705
5.1e-06 1.8e-06 0 0.51959   3.6e-06 1.3e-06 0 0.547   2.5e-06 9.1e-07 0 0.57441
1.8e-06 6.4e-07 0 0.58877   1.3e-06 4.5e-07 0 0.60313
"""
_NODES = np.arange(360.0, 831.0, 5.0)
_STEPS = 1000
_RGB_FROM_XYZ = np.array(
    [
        [3.240479, -1.537150, -0.498535],
        [-0.969256, 1.875991, 0.041556],
        [0.055648, -0.204043, 1.057311],
    ]
)
# Constant 2 h c^2 of Planck's law, W m^2 sr^-1.
_FIRST_RADIATION = 1.191042972e-16
# Constant h c / k of Planck's law, m K.
_SECOND_RADIATION = 1.438776877e-2


def colour_of_spectrum(wavelengths: ArrayLike, values: ArrayLike, *, light: bool) -> Float64:
    """Return (3,) linear Rec. 709, 0 or more, of a spectrum that is linear between values and 0 outside them.

    wavelengths : (N,) nm, ascending
    light       : True for a light; False for a reflectance or another property of a surface
    """
    at, curves, daylight = _curves()
    spectrum = np.interp(at, np.asarray(wavelengths, np.float64), np.asarray(values, np.float64), 0.0, 0.0)
    seen_under = np.ones_like(at) if light else daylight
    return np.maximum(_RGB_FROM_XYZ @ ((spectrum * seen_under) @ curves) / (curves[:, 1] @ seen_under), 0.0)


def colour_of_black_body(temperature: float) -> Float64:
    """Return the (3,) linear Rec. 709 radiance of a black body, W m^-2 sr^-1 per nm. temperature: kelvin."""
    metres = 1e-9 * np.arange(360.0, 831.0)
    radiance = 1e-9 * _FIRST_RADIATION / metres**5 / np.expm1(_SECOND_RADIATION / (metres * temperature))
    return colour_of_spectrum(1e9 * metres, radiance, light=True)


@cache
def _curves() -> tuple[Float64, Float64, Float64]:
    """Return wavelengths (N,) in nm, the observer's curves (N, 3), and D65 (N,)."""
    table = np.array(_TABLE.split(), np.float64).reshape(-1, 4)
    at = np.linspace(_NODES[0], _NODES[-1], _STEPS)
    columns = [np.interp(at, _NODES, column) for column in table.T]
    return at, np.stack(columns[:3], axis=1), columns[3]
