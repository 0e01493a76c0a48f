"""Radiosity of diffuse surfaces on the CPU, without OpenGL: shafts and visibility [SC], form factors, solvers."""

from glpath.radiosity.picture import picture_of
from glpath.radiosity.shafts.clusters import cluster
from glpath.radiosity.shafts.ends import Emitter, Receivers, facing
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.options import PAPER, ShaftOptions, Statistics
from glpath.radiosity.shafts.shaft import Containment, Shaft, Strategy, candidate_list
from glpath.radiosity.shafts.visibility import Visibility, visible
from glpath.radiosity.solution import RadiositySolution
from glpath.radiosity.solvers.solve import RadiosityInterrupted, RadiosityProgress, solve_radiosity

__all__ = [
    "PAPER",
    "Containment",
    "Emitter",
    "Occluders",
    "RadiosityInterrupted",
    "RadiosityProgress",
    "RadiositySolution",
    "Receivers",
    "Shaft",
    "ShaftOptions",
    "Statistics",
    "Strategy",
    "Visibility",
    "candidate_list",
    "cluster",
    "facing",
    "picture_of",
    "solve_radiosity",
    "visible",
]
