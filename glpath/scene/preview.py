"""Scene previews for notebooks: a small image made on the CPU, and tables of the contents.

Engines are avoided on purpose: viewing a scene needs no OpenGL, no context and no compilation, and no driver can
fail. The method is the T-buffer in numpy. For each primitive, it casts the rays of the pixels that the primitive
may cover, and keeps (primitive, depth) for the nearest hit. Each hit is lit from the eye. Textures are replaced by
their mean colour, and lamps are as bright as white.

Cost: a fraction of a millisecond for a large primitive; small primitives are processed together.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.film.image import encode_png, png_html
from glpath.scene.appearance import Appearance
from glpath.scene.camera import Camera
from glpath.scene.geometry import Float64, sphere_extent
from glpath.system.colour import encode_srgb

if TYPE_CHECKING:
    from glpath.scene.model import Scene
from glpath.system.units import Quantity, Unit, symbol

#: Maximum number of rows of a table, because a scene can have thousands of shapes.
ROWS = 12

_BACKGROUND = 0.8
# Maximum width and height, in pixels, of primitives that are processed together.
_SMALL = 8
# Fraction of a surface's shading that does not depend on its orientation.
_FLAT = 0.3
# Distance, in scene sizes, of a pinhole that replaces an orthographic camera: its rays are nearly parallel.
_AFAR = 1e3


def preview(scene: Scene, longest: int) -> NDArray[np.uint8]:
    """Return a preview image of a scene, see `Scene.preview`."""
    if longest < 1:
        raise UsageError(f"Scene.preview: {longest} pixels; at least 1 is needed.")
    scene = scene.at()
    camera = _smaller(scene.camera, longest)
    # Four rays per pixel.
    fine = replace(camera, resolution=(2 * camera.resolution[0], 2 * camera.resolution[1]))
    colour = _shaded(scene, fine)
    small = 0.25 * (colour[::2, ::2] + colour[1::2, ::2] + colour[::2, 1::2] + colour[1::2, 1::2])
    return (255 * encode_srgb(small) + 0.5).astype(np.uint8)


def first_hits(scene: Scene) -> tuple[NDArray[np.int64], Float64]:
    """Return the first hits of rays through the centres of the camera's pixels.

    Returns (H, W) int64 primitive numbers, -1 for none, with triangles, spheres and planes numbered consecutively;
    and (H, W) float64 distances, inf for none. Row 0 is at the top.
    """
    view = _View(scene.camera)
    found = _found(scene, view)
    return found, view.nearest * view.stretch


def _smaller(camera: Camera, longest: int) -> Camera:
    width, height = camera.resolution
    share = min(1.0, longest / max(width, height))
    return replace(camera, resolution=(max(1, round(share * width)), max(1, round(share * height))))


def _shaded(scene: Scene, camera: Camera) -> Float64:
    """Return (H, W, 3) linear colours in [0, 1]. A lens is replaced by a pinhole at its centre."""
    if camera.projection == "panorama":
        return _shaded_around(scene, camera)
    near = 0.0
    if camera.projection == "orthographic":
        camera, near = _from_afar(scene, camera)
    scene = replace(scene, camera=camera)
    view = _View(camera, near)
    found = _found(scene, view)
    directions = camera.rays()
    colour = np.empty_like(directions)
    missed = found < 0
    colour[missed] = _sky(scene, directions[missed])
    number = found[~missed]
    base, lamp = _colours(scene)
    kinds = ("triangle", "sphere", "plane")
    shape = np.concatenate([scene.shapes.primitive_shape(kind) for kind in kinds])[number]  # type: ignore[arg-type]
    normals = _normals(scene, number, directions[~missed], view.nearest[~missed] * view.stretch[~missed])
    facing = np.abs(np.einsum("ij,ij->i", normals, directions[~missed]))
    lit = _FLAT + (1 - _FLAT) * facing
    colour[~missed] = np.where(lamp[shape, None], base[shape], lit[:, None] * base[shape])
    return np.clip(colour, 0.0, 1.0)


def _from_afar(scene: Scene, camera: Camera) -> tuple[Camera, float]:
    """Return a pinhole camera far behind an orthographic one, with nearly parallel rays, and its distance.

    Surfaces nearer than this distance are not visible.
    """
    lower, upper = scene.bounds
    away = _AFAR * (camera.height + float(np.linalg.norm(upper - lower)))
    fov = float(np.degrees(2.0 * np.arctan(0.5 * camera.height / away)))
    position = camera.position - away * camera.frame()[2]
    return replace(camera, projection="perspective", position=position, fov=fov), away


def _shaded_around(scene: Scene, camera: Camera) -> Float64:
    """Return the colours of a panorama, resampled from six views of 90 degrees."""
    right, up, forward = camera.frame()
    rays = camera.rays()
    side = max(1, round(camera.resolution[1] / 2))
    colour, filled = np.zeros_like(rays), np.zeros(rays.shape[:2], np.bool_)
    level = [(forward, up), (right, up), (-forward, up), (-right, up)]
    for towards, above in (*level, (up, -forward), (-up, forward)):
        face = Camera(camera.position, camera.position + towards, above, 90.0, (side, side))
        at, depth = face.project(camera.position + rays)
        seen = ~filled & (depth > 0) & (np.abs(at - side / 2) <= side / 2 * (1 + 1e-9)).all(axis=-1)
        column, row = np.clip(np.floor(at[seen]).astype(np.int64), 0, side - 1).T
        colour[seen] = _shaded(scene, face)[row, column]
        filled |= seen
    return colour


class _View:
    """Pixel directions forward + x right + y up. Only surfaces at depths beyond `near` are visible.

    Depth is measured along `forward`.

    nearest : (H, W) depth of the nearest hit, infinite for none
    stretch : (H, W) ratio of distance to depth
    """

    def __init__(self, camera: Camera, near: float = 0.0) -> None:
        self.near = near
        width, height = camera.resolution
        self.eye = camera.position
        self.right, self.up, self.forward = camera.frame()
        self.focal, self.middle = camera.focal_lengths, camera.centre
        self.size = width, height
        self.x = (np.arange(width) + 0.5 - self.middle[0]) / self.focal[0]
        self.y = (self.middle[1] - 0.5 - np.arange(height)) / self.focal[1]
        self.nearest = np.full((height, width), np.inf)
        self.stretch = np.sqrt(1 + self.x**2 + self.y[:, None] ** 2)

    def windows(self, corners: Float64) -> NDArray[np.int64]:
        """Return the (N, 4) windows of pixels that contain the images of bodies inside corners (N, K, 3).

        A window is the first column, the last column + 1, the first row, and the last row + 1.
        """
        width, height = self.size
        at = corners - self.eye
        depth = at @ self.forward
        safe = np.where(depth > 1e-9 * np.abs(at).max(axis=2), depth, 1.0)
        column = at @ self.right / safe * self.focal[0] + self.middle[0]
        row = self.middle[1] - at @ self.up / safe * self.focal[1]
        edges = np.stack([column.min(axis=1), column.max(axis=1), row.min(axis=1), row.max(axis=1)], axis=1)
        # The image of a body that crosses the plane of the eye is unbounded.
        edges[(depth <= 1e-9 * np.abs(at).max(axis=2)).any(axis=1)] = (-np.inf, np.inf, -np.inf, np.inf)
        edges[depth.max(axis=1) <= 0] = np.inf
        limit = np.array([width, width, height, height])
        pixels: NDArray[np.int64] = np.clip(np.floor(edges) + np.array([0, 1, 0, 1]), 0, limit).astype(np.int64)
        return pixels

    def linear(self, vector: Float64, rows: slice, columns: slice) -> Float64:
        """Return the (h, w) dot products of a vector with the directions of a window's pixels."""
        along = vector @ self.forward + vector @ self.right * self.x[columns]
        return np.asarray(along + (vector @ self.up * self.y[rows])[:, None])


def _found(scene: Scene, view: _View) -> NDArray[np.int64]:
    """Return (H, W) nearest primitives, -1 for none, and fill the view's depths.

    Triangles, spheres and planes are numbered consecutively.
    """
    half, centre = sphere_extent(scene.spheres), scene.spheres[:, :, 3]
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    around = centre[:, None] + half[:, None] * cube
    windows = np.concatenate([view.windows(scene.triangles), view.windows(around)])
    found = np.full(view.nearest.shape, -1)
    unit_from_world: Float64 = np.linalg.inv(scene.spheres[:, :, :3]).astype(np.float64)
    sides, volumes = _triangle_planes(scene.triangles - view.eye)
    appearance = Appearance(scene)
    if appearance.varies("opacity").any():
        windows[: len(scene.triangles)][appearance.mean_opacity() < 0.5] = 0  # skip mostly clear ones
    across, down = windows[:, 1] - windows[:, 0], windows[:, 3] - windows[:, 2]
    seen, small = (across > 0) & (down > 0), (across <= _SMALL) & (down <= _SMALL)
    _take_small(scene, sides, volumes, unit_from_world, view, windows, np.flatnonzero(seen & small), found)
    first_sphere, first_plane = len(scene.triangles), len(scene.triangles) + len(scene.spheres)
    for number in np.flatnonzero(seen & ~small).tolist():
        left, right, top, bottom = windows[number].tolist()
        rows, columns = slice(top, bottom), slice(left, right)
        if number < first_sphere:
            products = [view.linear(side, rows, columns) for side in sides[number]]
            depth = _triangle_depth(products, volumes[number])
        else:
            sphere = number - first_sphere
            start = unit_from_world[sphere] @ (view.eye - centre[sphere])
            to = np.stack([view.linear(axis, rows, columns) for axis in unit_from_world[sphere]])
            depth = _sphere_depth(start[:, None, None], to)
        _keep(view, found, rows, columns, depth, number)
    whole = slice(0, view.size[1]), slice(0, view.size[0])
    for number, plane in enumerate(scene.planes):
        along = view.linear(plane[:, 2], *whole)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = plane[:, 2] @ (plane[:, 3] - view.eye) / along
        _keep(view, found, *whole, depth, first_plane + number)
    return found


def _keep(view: _View, found: NDArray[np.int64], rows: slice, columns: slice, depth: Float64, number: int) -> None:
    nearest = view.nearest[rows, columns]
    nearer = (depth > view.near) & (depth < nearest)
    nearest[nearer] = depth[nearer]
    found[rows, columns][nearer] = number


def _take_small(
    scene: Scene,
    sides: Float64,
    volumes: Float64,
    unit_from_world: Float64,
    view: _View,
    windows: NDArray[np.int64],
    small: NDArray[np.int64],
    found: NDArray[np.int64],
) -> None:
    """Process small primitives together: the first pixel of each, then the second pixel of each, and so on."""
    first_sphere = len(scene.triangles)
    for i in range(_SMALL * _SMALL):
        column, row = windows[small, 0] + i % _SMALL, windows[small, 2] + i // _SMALL
        within = (column < windows[small, 1]) & (row < windows[small, 3])
        number, column, row = small[within], column[within], row[within]
        direction = view.forward + view.x[column, None] * view.right + view.y[row, None] * view.up
        depth = np.full(len(number), np.inf)
        flat = number < first_sphere
        products = np.einsum("nij,nj->in", sides[number[flat]], direction[flat])
        depth[flat] = _triangle_depth(list(products), volumes[number[flat]])
        curved = unit_from_world[number[~flat] - first_sphere]
        start = view.eye - scene.spheres[number[~flat] - first_sphere, :, 3]
        to = np.einsum("nij,nj->in", curved, direction[~flat])
        depth[~flat] = _sphere_depth(np.einsum("nij,nj->in", curved, start), to)
        depth[~(depth > view.near)] = np.inf
        before = view.nearest[row, column]
        np.minimum.at(view.nearest, (row, column), depth)
        won = (depth == view.nearest[row, column]) & (depth < before)
        found[row[won], column[won]] = number[won]


def _triangle_planes(corners: Float64) -> tuple[Float64, Float64]:
    """Return (T, 3, 3) normals of planes through the eye and each edge, and the (T,) triple product of corners."""
    after = np.roll(corners, -1, axis=1)
    sides = np.cross(corners, after)
    return sides, np.einsum("ni,ni->n", corners[:, 2], sides[:, 0])


def _triangle_depth(along: Sequence[Float64], volume: float | Float64) -> Float64:
    """Return depths, infinite outside the triangle. A ray is inside if it passes all three edges on one side.

    along : dot products of the rays' directions with the three normals of `_triangle_planes`
    """
    total = along[0] + along[1] + along[2]
    inside = (np.minimum.reduce(along) >= 0) | (np.maximum.reduce(along) <= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = volume / total
    return np.where(inside, depth, np.inf)


def _sphere_depth(start: Float64, to: Float64) -> Float64:
    """Return depths, infinite for rays that miss the sphere.

    start, to : (3, ...) eye and directions, in the space of the unit sphere
    """
    a, b, c = (to * to).sum(axis=0), (start * to).sum(axis=0), (start * start).sum(axis=0) - 1.0
    root = b * b - a * c
    with np.errstate(invalid="ignore"):
        root = np.sqrt(root)
        near, far = (-b - root) / a, (-b + root) / a
    return np.where(np.isnan(root), np.inf, np.where(near > 0, near, far))


def _normals(scene: Scene, number: NDArray[np.int64], directions: Float64, t: Float64) -> Float64:
    """Return (N, 3) unit normals at the hits of rays."""
    first_sphere, first_plane = len(scene.triangles), len(scene.triangles) + len(scene.spheres)
    flat, plane = number < first_sphere, number >= first_plane
    normal = np.empty_like(directions)
    normal[flat] = scene.normals[number[flat]]
    normal[plane] = scene.planes[number[plane] - first_plane, :, 2]
    curved = ~flat & ~plane
    which = number[curved] - first_sphere
    unit_from_world = np.linalg.inv(scene.spheres[:, :, :3])[which]
    from_centre = scene.camera.position + t[curved, None] * directions[curved] - scene.spheres[which, :, 3]
    outward = np.einsum("nij,ni->nj", unit_from_world, np.einsum("nij,nj->ni", unit_from_world, from_centre))
    normal[curved] = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    return normal


def _colours(scene: Scene) -> tuple[Float64, NDArray[np.bool_]]:
    """Return the (shapes, 3) linear colour of each shape, and a mask of the lamps."""
    colours = []
    for shape in scene.shapes:
        material = scene.materials[shape.material]
        colour = scene.mean_reflectance(material)
        of_vertices = getattr(shape.geometry, "colours", None)
        if of_vertices is not None:
            colour = colour * of_vertices[:, :3].mean(axis=0)
        light = shape.emission
        if material.emission_texture is not None:
            light = light * scene.textures[material.emission_texture.texture].mean
        shines = light.max() > 0
        colours.append(light / shape.emission.max() if shines else colour + 0.5 * material.mirror)
    return np.array(colours).reshape(-1, 3), np.array([shape.emits for shape in scene.shapes], bool)


def _sky(scene: Scene, directions: Float64) -> Float64:
    if scene.background is not None and not scene.background.transparent:
        return np.broadcast_to(scene.background.radiance, directions.shape).copy()
    if scene.sky is None:
        return np.full_like(directions, _BACKGROUND)
    return scene.sky.radiance(directions)


def _shown(unit: Unit, quantity: Quantity) -> str:
    """Return the symbol of a unit in display form, such as W/(sr m²) for W sr^-1 m^-2."""
    short = {"W sr^-1 m^-2": "W/(sr m²)", "W sr^-1": "W/sr", "W m^-2": "W/m²", "cd m^-2": "cd/m²"}
    written = symbol(unit, quantity)
    return short.get(written, written)


def mimebundle(scene: Scene) -> dict[str, object]:
    """Return Jupyter's view of a scene: text, an image, and HTML with both and tables."""
    png = encode_png(preview(scene, 320))
    return {"text/plain": repr(scene), "image/png": png, "text/html": _html(scene, png)}


def _html(scene: Scene, png: bytes) -> str:
    names = [material.name for material in scene.materials]
    shapes = _table(
        f"{len(scene.shapes):,} shapes",
        ("name", "kind", "primitives", "material", "emission"),
        [
            (s.name, s.kind, f"{s.count:,}", names[s.material], _numbers(s.emission) if s.emits else "")
            for s in scene.shapes[:ROWS]
        ],
        len(scene.shapes),
    )
    materials = _table(
        f"{len(scene.materials):,} materials",
        ("", "name", "reflectance", "more"),
        [
            (
                _Swatch(m.reflectance),
                m.name,
                _numbers(m.reflectance),
                m.described(),
            )
            for m in scene.materials[:ROWS]
        ],
        len(scene.materials),
    )
    lamps = [
        (s.name, "shape", f"{_numbers(s.emission)} {_shown(scene.unit, 'radiance')}")
        for s in scene.shapes
        if s.emits
    ]
    for light in scene.lights:
        bound = light.kind != "directional" and light.falloff == "quadratic"
        unit = _shown(scene.unit, "intensity" if bound else "irradiance")
        lamps.append((light.name, light.kind, f"{_numbers(light.intensity)} {unit}"))
    lights = _table(
        f"{len(lamps):,} light{'s' * (len(lamps) != 1)}", ("name", "kind", "light"), lamps[:ROWS], len(lamps)
    )
    picture = png_html(png, f"Preview of {repr(scene)[1:-1]}")
    style = "display:flex;flex-wrap:wrap;gap:1.5em;align-items:flex-start"
    return (
        f"<div><p><b>{escape(scene.name)}</b> {escape(repr(scene)[len(scene.name) + 7 : -1].lstrip(': '))}</p>"
        f'<div style="{style}"><div>{picture}</div><div>{shapes}</div><div>{materials}{lights}</div></div></div>'
    )


class _Swatch:
    """Small square of a linear colour, for a table."""

    def __init__(self, linear: Float64) -> None:
        self.rgb = (255 * encode_srgb(linear) + 0.5).astype(int).tolist()


def _table(title: str, header: Sequence[str], rows: Iterable[Sequence[str | _Swatch]], total: int) -> str:
    if not total:
        return ""

    def cell(value: str | _Swatch) -> str:
        if isinstance(value, _Swatch):
            colour = "rgb({}, {}, {})".format(*value.rgb)
            return f'<td><span style="background:{colour};display:inline-block;width:1em;height:1em"></span></td>'
        return f'<td style="text-align:left">{escape(value)}</td>'

    head = "".join(f'<th style="text-align:left">{escape(word)}</th>' for word in header)
    body = "".join("<tr>" + "".join(map(cell, row)) + "</tr>" for row in rows)
    if total > ROWS:
        body += f'<tr><td colspan="{len(header)}" style="text-align:left">... {total - ROWS:,} more</td></tr>'
    return f"<table><caption>{escape(title)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _numbers(values: Float64) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
