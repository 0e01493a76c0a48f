"""Allowed values for films and their images. This module needs no numpy, because command line help lists them."""

from __future__ import annotations

#: Tone curves, see `glpath.film.tonemap.TONEMAPS`.
TONEMAP_NAMES = ("srgb", "reinhard", "aces")

#: Values of `stop_rule`, the reason why a render ended. The render is complete if the reason is in RULES.
SPP, TIME_LIMIT, NOISE, CLEAN, INTERRUPTED_RULE = "spp", "time limit", "noise", "clean", "interrupted"
RULES = (SPP, TIME_LIMIT, NOISE, CLEAN)
