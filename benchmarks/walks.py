"""Six walks through the documentation, from the README's first line to a result: the pages to read and to run.

The assumed reader reads everything: the README from its first line to the end of one section, then each further
page from its first line to the end of one. Code counts like words, at 200 words a minute.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORDS_A_MINUTE = 200
MAX_MINUTES = 5

#: LM-63 file of a lamp: candela by the angle from straight down.
LAMP = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 5 1 1 2 0 0 0\n1 1 100\n0 22.5 45 67.5 90\n0\n1000 920 700 380 0\n"

#: Patterns of shell lines that are not run, and the reasons.
SKIPPED = {r"^make\b": "sets up a checkout; the walk has the wheel"}
#: Patterns of further lines that are run only if the machine belongs to the walk, and the reasons.
SYSTEM = {r"^apt-get\b": "changes the machine"}
#: Patterns of programs that wait for a person, and unattended replacements.
REPLACED = {r"^jupyter lab (\S+)": r"jupyter execute \1", r"^apt-get install": "apt-get install -y"}

#: A block of code of a page: its language and its text.
FENCE = re.compile(r"^```(?P<kind>[\w-]*)[^\n]*\n(?P<text>.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Reading:
    """A page, and the part of it that is read.

    page  : path in the repository
    until : last section that is read
    run   : sections whose blocks are run, in order
    """

    page: str
    until: str
    run: tuple[str, ...]

    @property
    def text(self) -> str:
        """Return the page from its first line to the end of `until`."""
        whole = (ROOT / self.page).read_text("utf-8")
        found = re.search(rf"^## {re.escape(self.until)}$.*?(?=^## |\Z)", whole, re.MULTILINE | re.DOTALL)
        if found is None:
            raise LookupError(f"{self.page}: has no section {self.until!r}")
        return whole[: found.end()]

    def blocks(self) -> Iterator[tuple[str, str, str]]:
        """Yield (language, text, words before it) of each block to run."""
        for title in self.run:
            section = self.text.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
            if not section:
                raise LookupError(f"{self.page}: has no section {title!r} before the end of {self.until!r}")
            for found in FENCE.finditer(section):
                yield found["kind"], found["text"], section[: found.start()]


@dataclass(frozen=True)
class Walk:
    """A walk of one reader.

    name     : name of its row
    reader   : description of the reader
    readings : pages, with the README first
    brought  : files that the reader already has
    result   : file that is the result
    """

    name: str
    reader: str
    readings: tuple[Reading, ...]
    result: str
    brought: tuple[str, ...] = ()

    @property
    def lines(self) -> int:
        """Return the number of lines to read."""
        return sum(reading.text.count("\n") for reading in self.readings)

    @property
    def words(self) -> int:
        """Return the number of words to read."""
        return sum(words_of(reading.text) for reading in self.readings)

    @property
    def reading_min(self) -> float:
        """Return the minutes of reading."""
        return self.words / WORDS_A_MINUTE


def words_of(text: str) -> int:
    """Count the words of a page as shown, with code and tables, but without link targets and table rules."""
    shown = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"^```.*$", "", text, flags=re.MULTILINE))
    return sum(any(c.isalnum() for c in word) for word in shown.split())


def commands_of(block: str, not_run: Iterable[str]) -> Iterator[str]:
    """Yield the commands of a shell block, without comments and without matches of the patterns `not_run`."""
    for line in re.sub(r"\\\n", " ", block).splitlines():
        command = re.sub(r"(^|\s)#.*", "", line).strip()
        if command and not any(re.search(pattern, command) for pattern in not_run):
            yield command


def lines_of(block: str, system: bool = False) -> Iterator[str]:
    """Yield a block's commands as a walk runs them; a script for a scheduler yields none.

    system : include commands that install packages of the system
    """
    if any(line.startswith("#SBATCH") for line in block.splitlines()):
        return
    for command in commands_of(block, SKIPPED if system else {**SKIPPED, **SYSTEM}):
        for pattern, instead in REPLACED.items():
            command = re.sub(pattern, instead, command)
        yield command


def file_of(kind: str, text: str, before: str) -> str:
    """Return the file name for a block of a scene or of Python: the name in the text, else a fixed one."""
    if kind == "toml":
        return str(re.findall(r"`([\w-]+\.toml)`", before)[-1])
    return "test_walk.py" if re.search(r"^def test_", text, re.MULTILINE) else "walk.py"


WALKS = (
    Walk(
        "three.js",
        "a developer of pages bakes a lightmap",
        (
            Reading("README.md", "A lightmap for three.js", ("Install", "A lightmap for three.js")),
            Reading("docs/howto/lightmap-threejs.md", "Example", ("Example",)),
        ),
        "baked-0.lightmap.exr",
    ),
    Walk(
        "lighting",
        "a lighting engineer measures lux",
        (
            Reading("README.md", "Lux of an OBJ with an IES lamp", ("Install", "Lux of an OBJ with an IES lamp")),
            Reading("docs/howto/lux.md", "Example", ("Example",)),
        ),
        "lux.csv",
        ("room.obj", "lamp.ies"),
    ),
    Walk(
        "heat",
        "a physicist goes from a model to temperatures",
        (
            Reading("README.md", "View factors of an STL", ("Install", "View factors of an STL")),
            Reading(
                "docs/howto/view-factors.md",
                "From the matrix to temperatures",
                ("Example", "From the matrix to temperatures"),
            ),
        ),
        "F.csv",
        ("hall.stl",),
    ),
    Walk(
        "CI",
        "a developer has CI compare a plot",
        (
            Reading("README.md", "Image tests in CI", ("Install", "Image tests in CI")),
            Reading("docs/howto/image-tests.md", "Example", ("Example",)),
        ),
        "baseline",
    ),
    Walk(
        "the paper",
        "a student of the path-buffer follows one pixel",
        (
            Reading("README.md", "Install", ("Install",)),
            Reading("docs/explanation/path-buffer.md", "One path set", ("Try it",)),
        ),
        "path-buffer.png",
        ("notebooks/02_path_buffer.ipynb",),
    ),
    Walk(
        "a farm",
        "an operator splits a render and merges it",
        (
            Reading("README.md", "Long renders", ("Install", "Long renders")),
            Reading("docs/howto/shards.md", "Example", ("Example",)),
            Reading("docs/howto/slurm.md", "Example", ()),
        ),
        "all.png",
    ),
)
