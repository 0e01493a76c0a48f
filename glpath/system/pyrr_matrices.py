"""Rotation and transform matrices of pyrr, imported without the warnings of Python about its docstrings.

The docstrings have backslashes that begin no escape, so Python gives a SyntaxWarning when it compiles the files. A
user would see it at the first command, and it fails test suites in which warnings are errors.
"""

from __future__ import annotations

import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore", SyntaxWarning)
    warnings.simplefilter("ignore", DeprecationWarning)  # category of the same warning in Python 3.11
    from pyrr import matrix33, matrix44

__all__ = ["matrix33", "matrix44"]
