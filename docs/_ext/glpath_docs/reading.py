"""How much is read from the README's first line to a result: the directive `reading`, counted at each build."""

from __future__ import annotations

from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from benchmarks.walks import ROOT, WALKS
from glpath_docs.markdown import code, table

_HEADS = ("walk", "who", "what is read", "lines", "words", "minutes", "result")


def reading_table() -> str:
    """A row for each walk, as Markdown."""
    rows = []
    for walk in WALKS:
        pages = ", ".join(f"{Path(each.page).name} to the end of *{each.until}*" for each in walk.readings)
        minutes = f"{walk.reading_min:.1f}"
        rows.append((walk.name, walk.reader, pages, walk.lines, walk.words, minutes, code(walk.result)))
    return table(_HEADS, rows)


class ReadingTable(SphinxDirective):
    """```{reading}``` without content."""

    def run(self) -> list[nodes.Node]:
        for page in {each.page for walk in WALKS for each in walk.readings}:
            self.env.note_dependency(str(ROOT / page))
        return self.parse_text_to_nodes(reading_table())


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("reading", ReadingTable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
