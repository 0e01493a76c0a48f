"""Who can stand between two surfaces, on the CPU: shafts and visibility [SC]. No GL."""

from glpath.radiosity.blockers import Blockers
from glpath.radiosity.clusters import cluster
from glpath.radiosity.ends import Emitter, Receivers, facing
from glpath.radiosity.options import PAPER, Options, Statistics
from glpath.radiosity.shaft import Place, Shaft, Strategy, candidate_list
from glpath.radiosity.visibility import Visibility, visible

__all__ = [
    "PAPER",
    "Blockers",
    "Emitter",
    "Options",
    "Place",
    "Receivers",
    "Shaft",
    "Statistics",
    "Strategy",
    "Visibility",
    "candidate_list",
    "cluster",
    "facing",
    "visible",
]
