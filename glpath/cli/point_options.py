"""Options of `measure` and `probes`, which compute light at points; `lightmap` shares their integrators."""

from __future__ import annotations

from typing import Annotated

import typer

from glpath.cli.completion import words
from glpath.integrators.by_name import AUTO, INTEGRATORS
from glpath.integrators.settings import PathSetSettings

#: Names of the integrators whose paths can start at given points instead of at a camera.
POINT_INTEGRATORS = tuple(name for name, kind in INTEGRATORS.items() if issubclass(kind, PathSetSettings))
#: Allowed values of --integrator in commands that compute light at points.
POINT_CHOICES = (AUTO, *POINT_INTEGRATORS)
#: Integrator options that `glpath measure` and `glpath probes` accept.
POINT_OPTIONS = (
    "max_depth", "seed", "sampling", "guide", "ambient", "roulette", "directions", "lookup_depth", "cast",
    "radiosity", "geometry_budget",
)  # fmt: skip
#: Help panel under which these options are listed.
LIGHT_PANEL = "Light"

WhiteSky = Annotated[
    bool,
    typer.Option(
        "--white-sky",
        help="Light a scene that has no light by a white sky, of radiance 1 in its unit from all around.",
        rich_help_panel=LIGHT_PANEL,
    ),
]
PointIntegrator = Annotated[
    str,
    typer.Option(
        metavar="|".join(POINT_CHOICES),
        help="auto: path, or path-buffer for streamed triangles; neither has a bias. path: paths of all bounces, "
        "their rays cast by a BVH. path-buffer: the same with shared directions, cast by scans. gather: from a "
        "radiosity solution.",
        autocompletion=words(POINT_CHOICES),
        rich_help_panel=LIGHT_PANEL,
    ),
]
