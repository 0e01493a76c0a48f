"""Loads compiled packages that runs of pytester use, before they start.

pytester unloads the modules that a run has loaded. A compiled package is then loaded a second time: matplotlib does
not recognize the objects of the first copy, and a process with OpenEXR or FLIP may crash much later.
"""

from __future__ import annotations

import contextlib
import importlib
import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # the oldest matplotlib beside the newest pyparsing
    for name in (
        "OpenEXR",
        "PIL.AvifImagePlugin",
        "PIL.Image",
        "PIL.JpegImagePlugin",
        "PIL.PngImagePlugin",
        "PIL.WebPImagePlugin",
        "flip_evaluator",
        "glcontext",
        "glcontext.egl",
        "imageio.v3",
        "matplotlib.pyplot",
        "mmap",
        "moderngl",
        "numba",
        "pyoidn",
        "scipy.ndimage",
        "scipy.stats",
    ):
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
