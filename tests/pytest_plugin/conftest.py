"""What tests of the plugin share."""

from __future__ import annotations

import contextlib
import warnings

# pytester unloads what a run of its own has loaded: a second copy of matplotlib does not know objects of the first.
with contextlib.suppress(ImportError), warnings.catch_warnings():
    warnings.simplefilter("ignore")  # the oldest matplotlib beside the newest pyparsing
    import matplotlib.pyplot  # noqa: F401
