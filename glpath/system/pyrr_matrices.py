"""pyrr's matrices of rotations and transforms, without what Python 3.12 and newer say of its docstrings.

They have backslashes that begin no escape, which is a SyntaxWarning when a file is compiled: for a user at the
first command, and an error in a test suite whose warnings are errors.
"""

from __future__ import annotations

import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore", SyntaxWarning)
    warnings.simplefilter("ignore", DeprecationWarning)  # as Python 3.11 calls it
    from pyrr import matrix33, matrix44

__all__ = ["matrix33", "matrix44"]
