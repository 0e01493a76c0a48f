"""Film: the result of a render, which can be shown, saved and loaded.

Its sums of radiance, which are added when films are merged, and its AOVs are in `glpath.film.sums`. The errors of
the image and of the denoised image are in `glpath.film.film_errors`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glpath.errors import ImageError, UsageError, warn
from glpath.film import denoise as open_image_denoise
from glpath.film import image
from glpath.film.aovs import guides_denoiser
from glpath.film.cryptomatte import Kind
from glpath.film.exr import write_exr
from glpath.film.film_errors import FilmErrors
from glpath.film.image import UInt8, encode_png, png_html, write_jpeg, write_png
from glpath.film.npz_file import FilmParts, read_parts, write_parts
from glpath.film.tonemap import auto_exposure
from glpath.film.tonemap import tonemap as tonemapped
from glpath.system.arguments import checked
from glpath.system.colour import check_exposure
from glpath.system.files import is_stream
from glpath.system.frames import data_frame, data_set
from glpath.system.npz import open_npz
from glpath.system.versions import versions

Float64 = NDArray[np.float64]

WRITABLE = (".png", ".jpg", ".jpeg", ".exr", ".npz")
# Maximum length in pixels of the longer side of the image in a notebook.
_PREVIEW = 1024


@checked
@dataclass(eq=False, repr=False)
class Film(FilmErrors):
    """Sums of radiance over path sets, in batches, and the images made from them.

    radiance_sums : (BATCHES, H, W, 3) float64, in `metadata.unit`, W sr^-1 m^-2 or cd m^-2; linear Rec. 709, row 0
                    at the top
    batch_counts  : (BATCHES,) int64, number of path sets in each sum; one path set is one path for every pixel
    ranges        : path sets in the sums, as half-open (start, stop), in order, neither overlapping nor adjacent
    metadata      : origin and settings of the film
    aov_sums      : (H, W, n) float64 by name, over all path sets, for the names in `metadata.aov_sums`; see `aov`
    shape_counts  : number of samples of each pixel that have hit each shape, if `metadata.counts_shapes`
    """

    #: Function called before a notebook shows the film, to remove an image of it that is already displayed.
    before_shown: Callable[[], None] | None = field(default=None, init=False)

    def _layer(self, name: str) -> NDArray[Any]:
        near = name != "position" or self.metadata.position_origin is None
        return (self if near else replace(self, metadata=replace(self.metadata, position_origin=None))).aov(name)

    @property
    def is_shown_denoised(self) -> bool:
        """True if a notebook shows `denoised`: it is noisy, has guiding AOVs, and the denoiser is installed."""
        there = self.metadata.noisy and guides_denoiser(self.metadata.aovs)
        return there and self.path_sets > 0 and open_image_denoise.can_denoise()

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return `mean`, for `np.asarray(film)` and functions that take arrays."""
        if copy is False:
            raise ValueError("a film holds sums, so that its image as an array is always a copy")
        return self.mean.astype(dtype or np.float64, copy=False)

    def exposure_stops(self, exposure: float | Literal["auto"] | None = None) -> float:
        """Return the exposure of this image as a number of stops.

        exposure : stops; "auto": result of `auto_exposure`; None: exposure of the scene, or else "auto"

        Raises UsageError for another value, or an image without a path set.
        """
        check_exposure(exposure)
        asked = self.metadata.exposure if exposure is None else exposure
        return auto_exposure(self.mean) if asked is None or asked == "auto" else float(asked)

    def to_srgb(
        self,
        *,
        exposure: float | Literal["auto"] | None = None,
        tonemap: str = "srgb",
        denoise: bool = False,
    ) -> UInt8:
        """Return the image as (H, W, 3) uint8 sRGB, row 0 at the top, like a .png of `save`; with alpha (H, W, 4).

        exposure : as for `exposure_stops`
        tonemap  : one of `TONEMAPS`
        denoise  : True to return `denoised` instead of `mean`, with the same exposure

        Raises UsageError for another exposure or operator, or an image without a path set; and the errors of
        `denoised`.
        """
        light, alpha = self.denoised() if denoise else self.mean, self.alpha
        if alpha is None:
            return tonemapped(light, self.exposure_stops(exposure), tonemap)
        colours = light / np.where(alpha > 0, alpha, 1.0)[..., None]  # colours in a PNG are not premultiplied
        opacity = (alpha * 255.0 + 0.5).astype(np.uint8)[..., None]
        return np.concatenate([tonemapped(colours, self.exposure_stops(exposure), tonemap), opacity], axis=2)

    def save(
        self,
        path: str | Path,
        *,
        exposure: float | Literal["auto"] | None = None,
        tonemap: str = "srgb",
        denoise: bool = False,
    ) -> None:
        """Write the film in the format of the suffix. The file appears whole or not at all.

        .png : 8-bit sRGB, as from `to_srgb`; its header contains the stops
        .jpg : the same with quality 95, without alpha: transparent pixels become white; its comment contains the
               metadata
        .exr : float32 radiance, linear Rec. 709; a crop keeps its window in the whole image. AOVs of the film are
               layers with their own names: albedo.R, G, B, normal.X, Y, Z, depth.Z, object_id.X ..., see
               `layer_channels`. With ids, also the Cryptomattes CryptoObject00 to 02 and CryptoMaterial00 to
               02
        .npz : everything, exactly; `Film.load` reads it, to be merged or resumed

        denoise : a .png or .jpg contains `denoised`, and its header has glpath.denoised; an .exr has it as the
                  layer denoised.R, G, B, in addition to the original image. An .npz does not change

        A pipe or a device can be written too; without a suffix, and for "-", standard output, the format is PNG.

        All formats contain the metadata. Raises ImageError if the file cannot be written, UsageError for another
        suffix or operator, or an image without a path set; and the errors of `denoised`.
        """
        path = check_suffix(path)
        suffix = path.suffix.lower() or ".png"
        if suffix in (".png", ".jpg", ".jpeg"):
            stops = self.exposure_stops(exposure)
            text = {"glpath.exposure_stops": f"{stops:g}", "glpath.tonemap": tonemap}
            picture = self.to_srgb(exposure=stops, tonemap=tonemap, denoise=denoise)
            write = write_png if suffix == ".png" else write_jpeg
            write(path, picture, self.provenance(denoised=denoise) | text)
            if suffix != ".png" and picture.shape[2] == 4:
                text_of_white = "a JPEG has no alpha channel, so that its background is white; a .png has one."
                warn(f"{path}: {text_of_white}", late=True)
        elif suffix == ".exr":
            kinds: dict[str, Kind] = {"object_id": "object", "material_id": "material"}
            mattes = [self.cryptomatte(kind) for name, kind in kinds.items() if name in self.metadata.aovs]
            headers = [matte.header() for matte in mattes]
            write_exr(
                path,
                self.mean,
                self.provenance() | {key: text for header in headers for key, text in header.items()},
                window=self.metadata.window,
                full_resolution=self.metadata.full_resolution,
                pixel_aspect=self.metadata.pixel_aspect,
                layers=({"denoised": self.denoised()} if denoise else {})
                | {name: self._layer(name) for name in self.metadata.aovs},
                channels={name: pixels for matte in mattes for name, pixels in matte.channels().items()},
                alpha=self.alpha,
            )
        else:
            write_parts(
                path,
                FilmParts(
                    self.radiance_sums,
                    self.batch_counts,
                    self.ranges,
                    self.metadata,
                    self.aov_sums,
                    self.shape_counts,
                ),
            )

    @classmethod
    def load(cls, path: str | Path) -> Film:
        """Read a film written as .npz. Raises ImageError, also if its parts contradict each other."""
        return cls(*read_parts(path))

    def to_pandas(self) -> Any:
        """Return the render's statistics as a `pandas.DataFrame` of one row, named after the scene.

        `pandas.concat` joins the rows of several films. Columns: integrator, seed, max_depth, path_sets, width and
        height (pixels), elapsed_s, relative_error (of the original image), stop_rule, error_bound, unit, device,
        scene_hash, and each of `metadata.statistics`, such as `paths_cast` and `stage_ms.trace`. Raises GlpathError
        if pandas is missing.
        """
        return stats_frame(self)

    def to_xarray(self) -> Any:
        """Return the image as an `xarray.Dataset`: `radiance` (y, x, channel), linear Rec. 709, and each AOV.

        x and y are pixel indices in the whole image, y from the top; the attributes are the columns of `to_pandas`.
        Raises GlpathError if xarray is missing.
        """
        return film_data_set(self)

    def __repr__(self) -> str:
        m = self.metadata
        error = self.relative_error()
        noise = "" if error is None else f", error about {100 * error:.2g} %"
        depth = "light of all bounces" if m.max_depth is None else f"depth {m.max_depth}"
        return (
            f"<Film of {m.scene}: {m.window[2]} x {m.window[3]} pixels, {self.path_sets} path sets, "
            f"{depth}{noise}, {m.device or 'unknown device'}>"
        )

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """Return Jupyter's view: the image, at most 1024 pixels long, as HTML and PNG, and a line of text."""
        if self.before_shown is not None:
            self.before_shown()
        return self.shown()

    def shown(self) -> dict[str, object]:
        """Return the image by MIME type, as `_repr_mimebundle_` does."""
        bundle: dict[str, object] = {"text/plain": repr(self)}
        if self.path_sets:
            seen = self.denoised().astype(np.float64) if self.is_shown_denoised else self.mean
            png = encode_png(tonemapped(_shrunk(seen, _PREVIEW), self.exposure_stops()))
            bundle |= {"image/png": png, "text/html": png_html(png, self.described())}
        return bundle

    def described(self) -> str:
        """Return a text alternative of the image: the scene, the integrator, path sets and size."""
        m = self.metadata
        width, height = m.window[2:]
        shown = ", denoised" if self.is_shown_denoised else ""
        return f"{m.scene}, by {m.integrator}, {self.path_sets} path sets, {width} x {height} pixels{shown}"

    def provenance(self, *, denoised: bool = False) -> dict[str, str]:
        """Return the provenance and path sets of the film as texts for a file's header.

        denoised : True if the file contains the image `denoised`
        """
        return {
            "Software": f"glpath {self.metadata.versions.get('glpath', '')}".strip(),
            "glpath.path_sets": str(self.path_sets),
            "glpath.ranges": json.dumps(self.ranges),
            **self.metadata.as_strings(),
            **({"glpath.bias": json.dumps(vars(bias))} if (bias := self.bias()) is not None else {}),
            **(
                {"glpath.denoised": f"Open Image Denoise, pyoidn {versions('pyoidn').get('pyoidn', '')}"}
                if denoised
                else {}
            ),
        }


@checked
def read_image(path: str | Path) -> Float64:
    """Read an image, or the mean of a film, as (H, W, 3) float64, linear Rec. 709, row 0 at the top.

    .png : sRGB is decoded; the values are tone-mapped, not radiance; .jpg as well
    .exr : channels R, G, B or Y; other primaries are converted; for a crop, only its own pixels
    .hdr : Radiance's RGBE
    .npz : mean of a film, or the array `radiance`
    .npy : (H, W, 3) or (H, W)

    Raises ImageError for a file that is missing, broken, or of another kind.
    """
    if not holds_film(path):
        return image.read_image(path)
    film = Film.load(path)
    if not film.path_sets:
        raise ImageError(f"{path}: cannot be read as .npz: the film holds no path set.")
    return film.mean


def holds_film(path: str | Path) -> bool:
    """Return True if a file contains a film, by its arrays' names. Raises ImageError if it cannot be read."""
    if Path(path).suffix.lower() != ".npz":
        return False
    with open_npz(path, ".npz") as stored:
        return "radiance_sums" in stored and "radiance" not in stored


def check_suffix(path: str | Path) -> Path:
    """Return `path` if a film can be written to a file with that name; otherwise raise UsageError."""
    path = Path(path)
    if path.suffix.lower() not in WRITABLE and not (is_stream(path) and not path.suffix):
        found = f"the suffix {path.suffix}" if path.suffix else "no suffix"
        raise UsageError(f"{path}: an output cannot have {found}. Allowed: {', '.join(WRITABLE)}.")
    return path


def _shrunk(image: Float64, longest: int) -> Float64:
    """Return the image with equal blocks of pixels averaged, so that no side is longer than `longest` pixels."""
    n = -(-max(image.shape[:2]) // longest)
    height, width = (max(1, side // n) for side in image.shape[:2])
    rows, columns = min(n, image.shape[0]), min(n, image.shape[1])
    trimmed = image[: height * rows, : width * columns]
    shrunk: Float64 = trimmed.reshape(height, rows, width, columns, 3).mean(axis=(1, 3))
    return shrunk


# Name and labels of the last dimension of AOVs with 3 or 2 values per pixel.
_AXES = {3: ("channel", ("red", "green", "blue")), 2: ("coordinate", ("u", "v"))}


_VECTORS = ("normal", "position")


def stats_frame(film: FilmErrors) -> Any:
    """Return a `pandas.DataFrame` of one row: see `Film.to_pandas`."""
    labels = [film.metadata.scene]
    return data_frame({name: [value] for name, value in _stats(film).items()}, "scene", labels)


def film_data_set(film: FilmErrors) -> Any:
    """Return an `xarray.Dataset`: see `Film.to_xarray`."""
    x, y, width, height = film.metadata.window
    variables: dict[str, Any] = {"radiance": (("y", "x", "channel"), film.mean)}
    for name in film.metadata.aovs:
        values = film.aov(name)
        if values.ndim == 2:
            variables[name] = (("y", "x"), values)
        elif name in _VECTORS:
            variables[name] = (("y", "x", "axis"), values)
        else:
            variables[name] = (("y", "x", _AXES[values.shape[2]][0]), values)
    coordinates: dict[str, Any] = {
        "x": range(x, x + width),
        "y": range(y, y + height),
        "axis": ["x", "y", "z"],
        **{name: list(labels) for name, labels in _AXES.values()},
    }
    used = {each for dimensions, _ in variables.values() for each in dimensions}
    # NetCDF and zarr store only numbers and texts.
    attributes = {
        name: value if isinstance(value, str) else float(value)
        for name, value in _stats(film).items()
        if value is not None
    }
    coordinates = {name: values for name, values in coordinates.items() if name in used}
    return data_set(variables, coordinates, {"scene": film.metadata.scene, **attributes})


def _stats(film: FilmErrors) -> dict[str, Any]:
    """Return a film's statistics as a mapping from names to numbers, texts or None."""
    m = film.metadata
    return {
        "integrator": m.integrator,
        "seed": m.seed,
        "max_depth": m.max_depth,
        "path_sets": film.path_sets,
        "width": m.window[2],
        "height": m.window[3],
        "elapsed_s": m.elapsed_s,
        "relative_error": film.relative_error(),
        "stop_rule": m.stop_rule,
        "error_bound": m.error_bound,
        "unit": m.unit,
        "device": m.device,
        "scene_hash": m.scene_hash,
        **dict(_flat(m.statistics)),
    }


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (name, value) pairs: an entry of a nested table has a dotted name, and a list becomes JSON text."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value if isinstance(value, int | float | str) else json.dumps(value)
