"""Light between diffuse surfaces, on the CPU: shafts and visibility [SC], form factors, radiosity. No GL."""

from glpath.radiosity.blockers import Blockers
from glpath.radiosity.clusters import cluster
from glpath.radiosity.ends import Emitter, Receivers, facing
from glpath.radiosity.options import PAPER, Options, Statistics
from glpath.radiosity.shaft import Place, Shaft, Strategy, candidate_list
from glpath.radiosity.solution import RadiositySolution
from glpath.radiosity.solve import RadiosityInterrupted, RadiosityProgress, solve_radiosity
from glpath.radiosity.visibility import Visibility, visible

__all__ = [
    "PAPER",
    "Blockers",
    "Emitter",
    "Options",
    "Place",
    "RadiosityInterrupted",
    "RadiosityProgress",
    "RadiositySolution",
    "Receivers",
    "Shaft",
    "Statistics",
    "Strategy",
    "Visibility",
    "candidate_list",
    "cluster",
    "facing",
    "solve_radiosity",
    "visible",
]
