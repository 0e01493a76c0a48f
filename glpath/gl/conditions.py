"""Evaluation of #ifdef, #ifndef and defined() in shaders, to find the lines that the preprocessor will keep."""

from __future__ import annotations

import re
from collections.abc import Iterable

_CONDITION = re.compile(r"^\s*#\s*(?P<word>ifdef|ifndef|if|elif|else|endif|define)\b\s*(?P<rest>[^/]*)")
_DEFINED = re.compile(r"(?P<negated>!\s*)?defined\s*\(?\s*(?P<name>\w+)\s*\)?\s*$")


class Conditions:
    """State of a shader's conditions, followed line by line. Lines under an #if of another form count as kept.

    defined : names that are defined before the first line
    """

    def __init__(self, defined: Iterable[str]) -> None:
        self._names = set(defined)
        # For each enclosing condition: True if the current branch is kept, and True if any branch so far was kept.
        # None: unknown.
        self._branches: list[tuple[bool | None, bool | None]] = []

    @property
    def kept(self) -> bool:
        """True if the preprocessor may keep the line that was followed last."""
        return all(branch is not False for branch, _ in self._branches)

    def follow(self, line: str) -> None:
        found = _CONDITION.match(line)
        if found is None:
            return
        word, rest = found["word"], found["rest"].strip()
        if word in ("ifdef", "ifndef"):
            kept: bool | None = (rest in self._names) == (word == "ifdef")
            self._branches.append((kept, kept))
        elif word == "if":
            kept = self._value(rest)
            self._branches.append((kept, kept))
        elif word in ("elif", "else"):
            _, before = self._branches.pop()
            kept = _both(_negated(before), self._value(rest) if word == "elif" else True)
            self._branches.append((kept, _negated(_both(_negated(before), _negated(kept)))))
        elif word == "endif":
            self._branches.pop()
        elif word == "define" and self.kept and rest:
            self._names.add(re.split(r"\W", rest, maxsplit=1)[0])

    def _value(self, expression: str) -> bool | None:
        """Return the value of `defined(NAME)` terms with !, && and ||; None if other terms leave it unknown."""
        either: bool | None = False
        for part in expression.split("||"):
            every: bool | None = True
            for term in part.split("&&"):
                asked = _DEFINED.match(term.strip())
                known = None if asked is None else (asked["name"] in self._names) != bool(asked["negated"])
                every = _both(every, known)
            either = _negated(_both(_negated(either), _negated(every)))
        return either


def _negated(value: bool | None) -> bool | None:
    return None if value is None else not value


def _both(a: bool | None, b: bool | None) -> bool | None:
    if a is False or b is False:
        return False
    return None if a is None or b is None else True
