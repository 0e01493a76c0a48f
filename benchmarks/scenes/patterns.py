"""Procedural textures for shipped scenes: wood, cloth, paper, plaster, a painting, a view.

Each is made of noise with a fixed seed, and is equal on all machines but for the last bit of transcendental
functions. All repeat seamlessly, except those of a single subject. Pixels are uint8, row 0 at the top; colours are
sRGB, other data is linear. Bumps are heights in texels, from which `normals` makes a normal map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.scene.model import Float64
from glpath.system.colour import encode_srgb

UInt8 = NDArray[np.uint8]


@dataclass(frozen=True)
class Pattern:
    """The textures of a surface.

    colour : (h, w, 3) sRGB
    bumps  : (h, w, 3) normal map; None if it is flat
    finish : (h, w, 3) linear, roughness in green and metal in blue; None if it is uniform
    """

    colour: UInt8
    bumps: UInt8 | None = None
    finish: UInt8 | None = None


def noise(rng: np.random.Generator, side: int, fall: float, stretch: tuple[float, float] = (1.0, 1.0)) -> Float64:
    """Return (side, side) periodic noise, mean 0, deviation 1: amplitudes fall as frequency to the power `fall`.

    stretch : factors of the features' lengths along x and along y
    """
    frequency = np.fft.fftfreq(side) * side
    fx, fy = np.meshgrid(frequency * stretch[0], frequency * stretch[1])
    radius = np.hypot(fx, fy)
    radius[0, 0] = np.inf
    spectrum = np.fft.fft2(rng.standard_normal((side, side))) * radius**-fall
    made = np.real(np.fft.ifft2(spectrum))
    return np.asarray(made / made.std())


def normals(height: Float64) -> UInt8:
    """Return the (h, w, 3) normal map of periodic heights (h, w) in texels."""
    dx = (np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)) / 2
    dy = (np.roll(height, -1, axis=0) - np.roll(height, 1, axis=0)) / 2
    # v increases upwards, opposite to the rows.
    n = np.stack([-dx, dy, np.ones_like(height)], axis=2)
    n /= np.linalg.norm(n, axis=2, keepdims=True)
    return np.asarray(np.round(127.5 + 127.5 * n), np.uint8)


def _srgb(colour: Float64) -> UInt8:
    return np.asarray(np.round(255 * encode_srgb(np.clip(colour, 0, 1))), np.uint8)


def _finish(roughness: Float64) -> UInt8:
    made = np.zeros((*roughness.shape, 3), np.uint8)
    made[..., 0] = 255
    made[..., 1] = np.round(255 * np.clip(roughness, 0, 1))
    return made


def _mixed(share: ArrayLike, one: ArrayLike, other: ArrayLike) -> Float64:
    t = np.clip(share, 0, 1)[..., None]
    return np.asarray((1 - t) * np.asarray(one) + t * np.asarray(other))


def boards(seed: int, side: int = 512, count: int = 8) -> Pattern:
    """Return floor boards along y, with different colours and grains, and with bevelled edges."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side]
    wide = side // count
    number = x // wide
    offset = rng.integers(0, side, count)[number]
    along = (y + offset) % side
    tone = rng.uniform(-1, 1, (count, 2))[number, (along >= side // 2).astype(int)]
    grain = noise(rng, side, 1.1, (24.0, 1.0))
    grain = np.take_along_axis(grain, along, axis=0)
    rings = np.sin(9 * noise(rng, side, 2.0, (10.0, 1.5)) + 2 * np.pi * x / wide)
    share = 0.45 + 0.22 * tone + 0.10 * grain + 0.08 * rings
    colour = _mixed(share, (0.16, 0.075, 0.032), (0.50, 0.30, 0.155))
    edge = np.minimum(x % wide, wide - 1 - x % wide)
    end = np.minimum(along % (side // 2), side // 2 - 1 - along % (side // 2))
    gap = np.minimum(edge, end)
    colour *= np.where(gap < 1, 0.35, 1.0)[..., None]
    height = 1.2 * np.minimum(gap, 3) / 3 + 0.10 * grain
    return Pattern(_srgb(colour), normals(height), _finish(0.36 + 0.05 * grain + 0.25 * (gap < 1)))


def wood(seed: int, dark: ArrayLike, light: ArrayLike, side: int = 256) -> Pattern:
    """Return planed wood, with its grain along y."""
    rng = np.random.default_rng(seed)
    grain, wave = noise(rng, side, 1.0, (20.0, 1.0)), noise(rng, side, 2.2, (6.0, 1.0))
    share = 0.5 + 0.16 * grain + 0.22 * np.sin(7 * wave)
    return Pattern(_srgb(_mixed(share, dark, light)), normals(0.15 * grain), _finish(0.42 + 0.06 * grain))


def wallpaper(seed: int, ground: ArrayLike, figure: ArrayLike, side: int = 256) -> Pattern:
    """Return a damask: a figure that is smoother than its ground, and slightly raised."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side] * (2 * np.pi / side)

    def bloom(x: Float64, y: Float64) -> Float64:
        leaf = np.cos(x) + np.cos(y) + 0.55 * np.cos(3 * x) * np.cos(2 * y) + 0.35 * np.cos(5 * y) * np.cos(2 * x)
        return np.asarray(leaf)

    # Every other row is shifted by half a repeat.
    field = np.maximum(bloom(x, 2 * y), bloom(x + np.pi, 2 * y + np.pi))
    share = 1 / (1 + np.exp(-7 * (field - 1.05)))
    paper = noise(rng, side, 0.6)
    colour = _mixed(share, ground, figure) * (1 + 0.015 * paper)[..., None]
    return Pattern(_srgb(colour), normals(1.0 * share + 0.05 * paper), _finish(0.85 - 0.35 * share))


def plaster(seed: int, side: int = 256) -> Pattern:
    """Return white paint over marks of a trowel."""
    rng = np.random.default_rng(seed)
    coarse, fine = noise(rng, side, 1.6), noise(rng, side, 0.5)
    colour = np.array([0.80, 0.78, 0.73]) * (1 + 0.012 * coarse)[..., None]
    return Pattern(_srgb(colour), normals(0.7 * coarse + 0.06 * fine))


def cloth(seed: int, side: int = 128, threads: int = 16) -> Pattern:
    """Return grey linen, whose colour the material multiplies: threads that cross over and under each other."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side] * (threads / side)
    over = (np.floor(x) + np.floor(y)) % 2
    warp, weft = np.sin(np.pi * (x % 1)) * (0.6 + 0.4 * over), np.sin(np.pi * (y % 1)) * (1.0 - 0.4 * over)
    height = np.where(over > 0, warp, weft)
    uneven = noise(rng, side, 1.0, (1.0, 3.0)) + noise(rng, side, 1.0, (3.0, 1.0))
    colour = (0.55 + 0.40 * height) * (1 + 0.05 * uneven)
    return Pattern(_srgb(np.repeat(colour[..., None], 3, axis=2)), normals(2.2 * height))


def rug(seed: int, size: tuple[int, int] = (384, 256)) -> Pattern:
    """Return a woven rug (width, height) with a border, lozenges and a medallion; it does not repeat."""
    rng = np.random.default_rng(seed)
    width, height = size
    y, x = np.mgrid[:height, :width].astype(float)
    red, blue, cream, gold = (0.34, 0.045, 0.04), (0.05, 0.07, 0.17), (0.66, 0.55, 0.36), (0.48, 0.28, 0.06)
    depth = np.minimum(np.minimum(x, width - 1 - x), np.minimum(y, height - 1 - y))
    u, v = (x - width / 2) / height, (y - height / 2) / height
    lozenge = np.abs((u * 9) % 1 - 0.5) + np.abs((v * 9) % 1 - 0.5)
    colour = _mixed((lozenge < 0.22).astype(float), red, blue)
    colour = np.where((lozenge > 0.30)[..., None] & (lozenge < 0.36)[..., None], gold, colour)
    star = np.hypot(u, v) * (1 + 0.16 * np.cos(8 * np.arctan2(v, u)))
    for radius, tone in ((0.27, cream), (0.25, blue), (0.17, gold), (0.15, red), (0.06, cream)):
        colour = np.where((star < radius)[..., None], tone, colour)
    wave = np.abs(((x + y) / 16) % 1 - 0.5) < 0.25
    border = np.where(wave[..., None], blue, cream)
    colour = np.where((depth < 34)[..., None], red, colour)
    colour = np.where((depth < 28)[..., None], border, colour)
    colour = np.where((depth < 8)[..., None], red, colour)
    pile = np.resize(noise(rng, 256, 0.4), (height, width))
    colour = colour * (1 + 0.10 * pile)[..., None]
    rows = np.sin(np.pi * y / 2) + 0.6 * np.sin(np.pi * x / 1.5)
    return Pattern(_srgb(colour), normals(0.5 * rows + 0.4 * pile))


def painting(seed: int, size: tuple[int, int] = (320, 240)) -> Pattern:
    """Return a painting in oil of hills in the evening: (width, height)."""
    rng = np.random.default_rng(seed)
    width, height = size
    y, x = np.mgrid[:height, :width] / float(height)
    colour = _mixed(y / 0.55, (0.18, 0.30, 0.55), (0.85, 0.55, 0.28))
    sun = np.hypot(x - 0.9, y - 0.40)
    colour = colour + np.exp(-((sun / 0.10) ** 2))[..., None] * np.array([0.5, 0.35, 0.1])
    for level, rough, tone in (
        (0.50, 0.05, (0.22, 0.26, 0.36)),
        (0.60, 0.06, (0.16, 0.22, 0.16)),
        (0.74, 0.05, (0.23, 0.24, 0.06)),
        (0.88, 0.04, (0.06, 0.10, 0.03)),
    ):
        ridge = noise(rng, 512, 1.5)[0, :width] * rough
        colour = np.where((y > level + ridge)[..., None], tone, colour)
    strokes = np.resize(noise(rng, 512, 0.9, (1.0, 4.0)), (height, width))
    return Pattern(_srgb(colour * (1 + 0.10 * strokes)[..., None]), normals(1.2 * strokes))


def view(seed: int, size: tuple[int, int] = (256, 256)) -> UInt8:
    """Return (height, width, 3), the view from a window: a sky over trees and a lawn."""
    rng = np.random.default_rng(seed)
    width, height = size
    y = np.mgrid[:height, :width][0] / float(height)
    colour = _mixed(y / 0.6, (0.42, 0.62, 0.95), (0.92, 0.95, 1.0))
    cloud = noise(rng, 512, 1.7, (1.0, 2.0))[:height, :width]
    colour = _mixed(np.clip(0.8 * cloud, 0, 0.9) * (y < 0.7), colour, (1.0, 1.0, 1.0))
    leaves = noise(rng, 512, 0.8)[:height, :width]
    for level, tone in ((0.60, (0.22, 0.30, 0.20)), (0.68, (0.09, 0.17, 0.06))):
        ridge = 0.05 * noise(rng, 512, 1.2)[0, :width] + 0.01 * leaves
        colour = np.where((y > level + ridge)[..., None], np.array(tone) * (1 + 0.2 * leaves)[..., None], colour)
    lawn = np.array([0.16, 0.28, 0.06]) * (1 + 0.08 * leaves)[..., None]
    return _srgb(np.where((y > 0.84)[..., None], lawn, colour))
