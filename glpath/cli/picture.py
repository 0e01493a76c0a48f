"""The options of `glpath render` and `merge` that say how a film becomes a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from glpath.cli.completion import words
from glpath.cli.values import check_choice
from glpath.cli.values import exposure as read_exposure
from glpath.film.denoise import require_denoiser
from glpath.film.image import TONEMAPS
from glpath.system.files import Save

if TYPE_CHECKING:
    from glpath.film.film import Film

#: The panel of the help.
IMAGE = "Image"

ExposureOption = Annotated[
    str | None,
    typer.Option(
        metavar="STOPS|auto",
        help="Brightness of a .png: 1 doubles it; default as the scene says, or else auto: log-average "
        "luminance to middle grey.",
        show_default=False,
        rich_help_panel=IMAGE,
    ),
]
TonemapOption = Annotated[
    str,
    typer.Option(
        metavar="|".join(TONEMAPS),
        help="Tone curve of a .png.",
        rich_help_panel=IMAGE,
        autocompletion=words(TONEMAPS),
    ),
]
DenoiseOption = Annotated[
    bool,
    typer.Option(
        "--denoise",
        help="Denoise .png and .exr by Open Image Denoise (pip install 'glpath[denoise]'), with the AOVs "
        "albedo and normal. An .exr has the picture before it as the layer noisy, an .npz holds that alone.",
        rich_help_panel=IMAGE,
    ),
]


@dataclass(frozen=True)
class Picture:
    """How a film is shown.

    exposure : stops, "auto", or None: as the film's scene says
    tonemap  : of `glpath.film.image.TONEMAPS`
    denoise  : whether it is
    """

    exposure: float | Literal["auto"] | None
    tonemap: str
    denoise: bool

    @classmethod
    def of_options(cls, exposure: str | None, tonemap: str, denoise: bool) -> Picture:
        """Raises UsageError, and GlpathError where the denoiser is missing."""
        check_choice("--tonemap", tonemap, tuple(TONEMAPS))
        if denoise:
            require_denoiser()
        return cls(read_exposure(exposure), tonemap, denoise)

    def save(self, film: Film, path: Path, stops: float) -> None:
        """Write one output, with so many stops of exposure. Raises ImageError."""
        film.save(path, exposure=stops, tonemap=self.tonemap, denoise=self.denoise)

    def saves(self, film: Film, out: Sequence[Path], stops: float) -> Mapping[Path, Save]:
        """What writes each of the outputs, for `save_all`."""
        return {path: lambda at: self.save(film, at, stops) for path in out}
