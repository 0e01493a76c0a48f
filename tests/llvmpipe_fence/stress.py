"""Small renders of all engines, one after another: `python stress.py SECONDS THREADS [without]`.

THREADS : of llvmpipe, really as many: glpath's change of 1 to 0 is left out
without : leaves out the remedy too
"""

from __future__ import annotations

import itertools
import os
import sys
import time

os.environ["LP_NUM_THREADS"] = sys.argv[2]

import glpath
from glpath.gl import context, opening

opening.asks_for_one_thread = lambda threads: False  # type: ignore[assignment]
if "without" in sys.argv:
    context.Context.drawn = lambda self: None  # type: ignore[method-assign]

RENDERS = [
    ("cornell-box-36", {"spp": 256, "max_depth": 3, "resolution": (24, 24)}),
    ("three-spheres", {"spp": 8, "integrator": "t-buffer", "shadows": "cube", "resolution": (48, 32)}),
    ("three-spheres", {"spp": 8, "integrator": "classic", "resolution": (24, 16)}),
    ("room", {"spp": 8, "max_depth": 2, "resolution": (24, 24)}),
]
start, path_sets = time.monotonic(), 0
for scene, options in itertools.cycle(RENDERS):
    path_sets += glpath.render(scene, **options).path_sets
    if time.monotonic() - start > float(sys.argv[1]):
        break
print(path_sets, "path sets", flush=True)
