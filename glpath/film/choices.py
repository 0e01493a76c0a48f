"""Words to choose from, of films and their pictures. Without numpy, as the command line lists them in its help."""

from __future__ import annotations

#: Tone curves, see `glpath.film.image.TONEMAPS`.
TONEMAP_NAMES = ("srgb", "reinhard", "aces")

#: Ends of a render, as `stop_rule` names them; by one of RULES it is complete.
SPP, TIME_LIMIT, NOISE, CLEAN, INTERRUPTED_RULE = "spp", "time limit", "noise", "clean", "interrupted"
RULES = (SPP, TIME_LIMIT, NOISE, CLEAN)
