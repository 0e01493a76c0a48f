"""The gallery: pictures with the command that makes each, and how long it took; `make gallery` renders them."""

from __future__ import annotations

from pathlib import Path

from benchmarks.gallery_command import IMAGES, PICTURES
from glpath_docs.markdown import block
from glpath_docs.results import MissingResultError, result, source

_ROOT = Path(__file__).resolve().parents[3]


def pages() -> dict[str, str]:
    """The page, by path. Raises MissingResultError for a picture that its command did not make."""
    found = result("gallery")
    rows = {row["name"]: row for row in found["rows"]}
    text = [
        "# Gallery\n",
        f"The command below a picture has made it. Times include the start of the program. {source(found)}.\n",
    ]
    for picture in PICTURES:
        row = rows.get(picture.name)
        file = IMAGES / f"{picture.name}.webp"
        if row is None or row["command"] != picture.command or not (_ROOT / file).is_file():
            raise MissingResultError(
                f"gallery: {picture.name} was not made by its command; `make gallery` makes it"
            )
        text += [
            f"## {picture.title}\n",
            f"![{picture.about}]({file.relative_to('docs').as_posix()})\n",
            block("sh", picture.command),
            f"{picture.about}. {row['width']} x {row['height']} pixels in {row['wall_s']:.1f} s, "
            f"processor time {row['processor_s']:.1f} s.\n",
        ]
    return {"gallery.md": "\n".join(text)}
