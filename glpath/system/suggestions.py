"""Names that a user gives: patterns of names, names similar to an unknown one, short lists of allowed names.

Files may define any number of names of any length. Errors about them stay quick and short.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from fnmatch import fnmatchcase
from heapq import nsmallest

# Maximum length of names that are compared, and their maximum number; one comparison takes up to a millisecond.
_MAX_COMPARED_LENGTH, _MAX_COMPARED = 120, 500
# Maximum number of names in a list, and of letters of each.
_MAX_LISTED, _MAX_LISTED_LENGTH = 20, 120


def name_fits(name: str, pattern: str) -> bool:
    """Return True if a name fits a pattern, in which * stands for any letters and all else for itself."""
    return fnmatchcase(name, re.sub(r"[\[?]", r"[\g<0>]", pattern))


def similar_names(name: str, names: Iterable[str], count: int = 1, cutoff: float = 0.6) -> list[str]:
    """Return up to `count` names that are similar to `name`, most similar first.

    cutoff : minimum similarity from 0 to 1, see `difflib.get_close_matches`

    Long names are left out. Of very many names, those whose lengths are nearest to the length of `name` are
    compared.
    """
    if len(name) > _MAX_COMPARED_LENGTH:
        return []
    short = (each for each in names if len(each) <= _MAX_COMPARED_LENGTH)
    compared = nsmallest(_MAX_COMPARED, short, key=lambda each: abs(len(each) - len(name)))
    return difflib.get_close_matches(name, compared, count, cutoff)


def listed_names(names: Iterable[str]) -> str:
    """Return names with commas: the first twenty, each shortened if it is long, and the number of others."""
    every = list(names)
    listed = [
        each if len(each) <= _MAX_LISTED_LENGTH else each[: _MAX_LISTED_LENGTH - 4] + " ..."
        for each in every[:_MAX_LISTED]
    ]
    more = len(every) - len(listed)
    return ", ".join(listed) + (f", ... ({more:,} more)" if more else "")
