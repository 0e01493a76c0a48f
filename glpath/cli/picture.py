"""Options of `glpath render` and `merge` for the conversion of a film to a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from glpath.cli.completion import words
from glpath.cli.values import check_choice
from glpath.cli.values import exposure as read_exposure
from glpath.errors import UsageError
from glpath.film.choices import TONEMAP_NAMES
from glpath.system.outputs import Save

if TYPE_CHECKING:
    from glpath.film.film import Film

#: Help panel under which these options are listed.
IMAGE = "Image"

ExposureOption = Annotated[
    str | None,
    typer.Option(
        metavar="STOPS|auto",
        help="Brightness of a .png or .jpg: 1 doubles it; default as the scene says, or else auto: log-average "
        "luminance to middle grey.",
        show_default=False,
        rich_help_panel=IMAGE,
    ),
]
TonemapOption = Annotated[
    str,
    typer.Option(
        metavar="|".join(TONEMAP_NAMES),
        help="Tone curve of a .png or .jpg.",
        rich_help_panel=IMAGE,
        autocompletion=words(TONEMAP_NAMES),
    ),
]
DenoiseOption = Annotated[
    bool | None,
    typer.Option(
        "--denoise/--no-denoise",
        help="Denoise a .png or .jpg by Open Image Denoise, with the AOVs albedo and normal; an .exr has the "
        "result as the layer denoised, an .npz holds the noisy film and these AOVs. By default where the denoiser "
        "is installed (pip install 'glpath[denoise]') and the film has noise.",
        show_default=False,
        rich_help_panel=IMAGE,
    ),
]
#: Tone curve of 8-bit pictures by default.
TONEMAP = "srgb"
#: Note for a picture that is noisy because the denoiser is missing.
NO_DENOISER = "not denoised: with pip install 'glpath[denoise]' a picture is clean sooner"
#: Suffixes of pictures of 8 bits, which get an exposure and a tone curve.
EIGHT_BIT = (".png", ".jpg", ".jpeg")
_FOR_EYES = (*EIGHT_BIT, ".exr", "")
# Maximum 8-bit value that looks black.
_BLACK = 6
# Minimum 8-bit value that looks white.
_WHITE = 254
# Fraction of black pixels, or of white ones, from which on a picture counts as nearly all black or white.
_NEARLY_ALL = 0.985


@dataclass(frozen=True)
class Picture:
    """Conversion of a film to a picture.

    exposure : stops, "auto", or None for that of the film's scene
    tonemap  : one of `TONEMAP_NAMES`
    denoise  : True or False; None: denoise if possible, see `of_film`
    missing  : True if the picture stays noisy because the denoiser is missing
    """

    exposure: float | Literal["auto"] | None
    tonemap: str
    denoise: bool | None
    missing: bool = False

    @classmethod
    def of_options(cls, exposure: str | None, tonemap: str, denoise: bool | None, out: Sequence[Path]) -> Picture:
        """Return the conversion for the options. Raises UsageError, and GlpathError if the denoiser is missing.

        out : outputs of the command; the exposure and the tone curve need a picture of 8 bits among them
        """
        from glpath.film.denoise import require_denoiser

        check_choice("--tonemap", tonemap, TONEMAP_NAMES)
        stops = read_exposure(exposure)
        if not any(path.suffix.lower() in (*EIGHT_BIT, "") for path in out):
            unused = f"--exposure {exposure}" if exposure is not None else f"--tonemap {tonemap}"
            if exposure is not None or tonemap != TONEMAP:
                raise UsageError(
                    f"{unused}: an .exr or .npz holds the light itself.", "Write a .png besides, or leave it out."
                )
        if denoise:
            require_denoiser()
        return cls(stops, tonemap, denoise)

    def of_film(self, denoisable: bool, out: Sequence[Path]) -> Picture:
        """Return the conversion with `denoise` decided: 8-bit pictures are denoised if possible.

        denoisable : True if the film has noise and will have the AOVs that the denoiser needs
        """
        from glpath.film.denoise import can_denoise

        if self.denoise is not None:
            return self
        wanted = denoisable and any(path.suffix.lower() in _FOR_EYES for path in out)
        there = wanted and can_denoise()
        return replace(self, denoise=there, missing=wanted and not there)

    def verdict(self, film: Film, stops: float) -> str | None:
        """Return a line with a remedy if the picture is nearly black or white; None otherwise."""
        import numpy as np

        from glpath.film.tonemap import tonemap

        seen = tonemap(film.mean, stops, self.tonemap)
        if film.alpha is not None:
            seen = seen[film.alpha > 0.0]
            if not len(seen):
                return "nothing is in the picture: see `glpath info` for the bounds, or give --camera-position"
        asked = film.metadata.exposure if self.exposure is None else self.exposure
        auto = "" if asked is None or asked == "auto" else " --exposure auto,"
        if np.mean(seen.max(axis=-1) <= _BLACK) >= _NEARLY_ALL:
            lit = bool(film.mean.any())
            light = "--exposure STOPS brightens it" if lit else "--environment FILE.hdr lights it"
            return f"the picture is nearly all black:{auto} {light}, and --camera-position looks from elsewhere"
        if np.mean(seen.min(axis=-1) >= _WHITE) >= _NEARLY_ALL:
            return f"the picture is nearly all white:{auto} --exposure -2 darkens it, --background plain is a grey"
        return None

    def save(self, film: Film, path: Path, stops: float) -> None:
        """Write one output with an exposure of `stops`. Raises ImageError."""
        film.save(path, exposure=stops, tonemap=self.tonemap, denoise=bool(self.denoise))

    def saves(self, film: Film, out: Sequence[Path], stops: float) -> Mapping[Path, Save]:
        """Return, for each output, the function that writes it. `save_all` calls the functions."""
        return {path: lambda at: self.save(film, at, stops) for path in out}
