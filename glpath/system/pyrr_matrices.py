"""Rotation and transform matrices of pyrr, imported without the warnings of Python about its docstrings.

The docstrings have backslashes that begin no escape, so Python gives a SyntaxWarning when it compiles the files. A
user would see it at the first command, and it fails test suites in which warnings are errors.
"""

from __future__ import annotations

from glpath.errors import warning_filter

# The category is DeprecationWarning in Python 3.11, and SyntaxWarning in later versions.
with warning_filter("ignore", SyntaxWarning), warning_filter("ignore", DeprecationWarning):
    from pyrr import matrix33, matrix44

__all__ = ["matrix33", "matrix44"]
