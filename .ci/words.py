"""Words that the house does not use: `python .ci/words.py [FOLDER ...]` lists them with the word to use.

Identifiers are split at underscores and capitals. Prose is comments, docstrings and messages. Python is read by its
tokenizer, GLSL by regular expressions. `.ci/prose.py` looks for the same words in the documentation.
"""

from __future__ import annotations

import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
READ = ("glpath", "shaders")

#: Of identifiers and of prose: what the field says instead.
WORDS = {
    "place": "position, texel, slot, uv, location (of an error), containment; instead of (in place of)",
    "places": "positions, texels, samples; instances",
    "way": "direction, sign, route, method",
    "ways": "directions, signs, methods",
    "told": "reported, given, text",
    "tells": "reports, shows",
    "said": "reported, given, text",
    "met": "hit",
    "dull": "diffuse",
    "varnish": "clearcoat",
    "brush": "tangent",
    "brushes": "tangents",
    "pane": "thin dielectric",
    "keeper": "checkpoint",
    "dearer": "guiding weight",
    "matter": "bsdf; is relevant",
    "departure": "BsdfSample",
    "course": "path id, direction code",
    "flight": "ray record",
    "brightest": "max_radiance, maximum",
    "grain": "variance, noise",
    "blocker": "occluder",
    "blockers": "occluders",
    "frosted": "rough transmission",
    "whoever": "the caller, the subclass, the next pass",
}
#: Of identifiers alone; in prose they are plain English.
IDENTIFIERS = {"least": "min", "most": "max", "shades": "occluders", "reach": "extent, radius, margin"}
#: Parts of identifiers, and phrases.
PHRASES = {
    "lamp_edges": "emitter silhouettes",
    "going_on": "resume, progress",
    "light point": "light sample",
    "without extent": "punctual",
    "hierarchy of boxes": "BVH",
    "own rays": "per-path rays",
    "lit_lobes": "bsdf_eval",
    "share_beside": "mis_weight",
    "light_share": "mis_weight_light",
    "leave_by": "bsdf_sample",
    "goes on": "continues, resumes",
    "gone on": "continued, resumed",
    "go on": "continue, resume",
    "going on": "continuing, resuming",
    "says so": "is reported, prints a warning",
    "one go": "an uninterrupted render",
    "by itself": "by default",
    "stands between": "occludes",
    "by chance": "because it is stochastic, stochastically",
    "under way": "running, unfinished",
    "keeps nobody out": "leaves no stale lock",
}
#: Of the documentation alone.
IN_DOCUMENTS = {
    "beside mitsuba": "compared with Mitsuba",
    "beside cycles": "compared with Cycles",
    "beside embree": "compared with Embree",
    "beside radiance": "compared with Radiance",
    "is told": "is reported",
    "are told": "are reported",
    "at rest": "static",
    "wanted of": "the target of",
    "and the like": "name them, or `such as`",
}
#: Plain English, and terms.
ALLOWED = re.compile(r"\bin[- ]place\b(?! of)|\bplace value\b|\bin the last place\b", re.IGNORECASE)


class Finding(NamedTuple):
    line: int
    word: str
    instead: str


def _parts(identifier: str) -> list[str]:
    return [part.lower() for part in re.findall(r"[a-z]+|[A-Z][a-z]+|[A-Z]+(?![a-z])", identifier)]


def _in_identifier(name: str, line: int) -> Iterator[Finding]:
    for part in _parts(name):
        if instead := WORDS.get(part) or IDENTIFIERS.get(part):
            yield Finding(line, part, instead)
    for phrase in (each for each in PHRASES if "_" in each and each in name.lower()):
        yield Finding(line, phrase, PHRASES[phrase])


def in_prose(text: str, line: int, phrases: dict[str, str] = PHRASES) -> Iterator[Finding]:
    """The findings of a text that begins at a line."""
    text = ALLOWED.sub(lambda m: " " * len(m[0]), text)
    for match in re.finditer(r"[A-Za-z]\w*", text):
        at, word = line + text.count("\n", 0, match.start()), match[0]
        if "_" in word or re.search(r"[a-z][A-Z]", word):
            yield from _in_identifier(word, at)
        elif instead := WORDS.get(word.lower()):
            yield Finding(at, word.lower(), instead)
    flat = re.sub(r"\s", " ", text.lower())
    for phrase in (each for each in phrases if " " in each):
        for match in re.finditer(rf"\b{phrase}\b", flat):
            yield Finding(line + text.count("\n", 0, match.start()), phrase, phrases[phrase])


def in_python(text: str) -> Iterator[Finding]:
    """The findings of a module."""
    strings = {tokenize.STRING, tokenize.COMMENT, getattr(tokenize, "FSTRING_MIDDLE", tokenize.COMMENT)}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NAME:
            yield from _in_identifier(token.string, token.start[0])
        elif token.type in strings:
            yield from in_prose(token.string, token.start[0])


def in_glsl(text: str) -> Iterator[Finding]:
    """The findings of a shader."""
    for number, line in enumerate(text.splitlines(), 1):
        code, _, comment = line.partition("//")
        for name in re.findall(r"[A-Za-z_]\w*", code):
            yield from _in_identifier(name, number)
        yield from in_prose(comment, number)


def findings(folders: tuple[str, ...] = READ) -> Iterator[tuple[Path, Finding]]:
    """Of all modules and shaders in these folders, their names included."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*")):
            if not path.is_file():
                continue
            if path.suffix == ".py":
                yield from ((path, each) for each in in_python(path.read_text()))
            elif path.suffix in (".glsl", ".vert", ".frag", ".comp", ".geom"):
                yield from ((path, each) for each in in_glsl(path.read_text()))
            yield from ((path, each) for each in _in_identifier(path.stem, 1))


def counts() -> dict[str, int]:
    """How often each word that is used is used."""
    return dict(Counter(each.word for _, each in findings()).most_common())


def main(folders: list[str]) -> int:
    found = list(findings(tuple(folders) or READ))
    for path, each in found:
        print(f"{path.relative_to(ROOT)}:{each.line}: {each.word!r}: use {each.instead}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
