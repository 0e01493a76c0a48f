"""The pages of the site, put together in one folder, and HTML made of them.

The folder has the pages of `docs/`, those that are made from the code, the notebooks with their results, and
the changelog. A file is written only where it changes, so that Sphinx reads again what is new.
"""

from __future__ import annotations

import json
import re
from fnmatch import fnmatch
from pathlib import Path

from sphinx.cmd.build import main as sphinx_build

from glpath_docs import (
    commands,
    engines,
    environment,
    exit_codes,
    extras,
    file_formats,
    gallery,
    links,
    notebooks,
    python_api,
    records,
    scene_format,
)
from glpath_docs.markdown import toctree

ROOT = Path(__file__).resolve().parents[3]
_HIDDEN = ("_ext", "_static", "__pycache__")


def generated() -> dict[str, str]:
    """The pages that are made from the code, by path."""
    makers = (
        commands,
        scene_format,
        python_api,
        engines,
        file_formats,
        exit_codes,
        environment,
        records,
        extras,
        gallery,
    )
    return {path: text for maker in makers for path, text in maker.pages().items()}


def sources(stored: Path) -> dict[str, bytes]:
    """All files of the site, by path.

    stored : the folder of executed notebooks; it need not exist
    """
    found: dict[str, bytes] = {}
    docs = ROOT / "docs"
    for path in sorted(docs.rglob("*")):
        name = path.relative_to(docs).as_posix()
        if not path.is_file() or name.split("/")[0] in _HIDDEN or name == "conf.py":
            continue
        if path.suffix == ".md":
            found[name] = links.for_site(path.read_text("utf-8"), f"docs/{name}", name).encode()
        else:
            found[name] = path.read_bytes()
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    found["changelog.md"] = links.for_site(changelog, "CHANGELOG.md", "changelog.md").encode()
    for path in sorted((ROOT / "notebooks" / "images").glob("*.png")):
        found[f"{notebooks.FOLDER}/images/{path.name}"] = path.read_bytes()
    for name, text in notebooks.pages(ROOT / "notebooks", stored).items():
        found[name] = _relinked(text, name).encode()
    for name, text in generated().items():
        found[name] = text.encode()
    for name in [name for name in found if name.endswith("/index.md")]:
        found[name] = with_list(found[name].decode()).encode()
    found["index.md"] = without_empty_globs(found["index.md"].decode(), list(found)).encode()
    return found


def with_list(text: str) -> str:
    """The first page of a folder with a list of the folder's pages for the sidebar, in the order of its links."""
    if "{toctree}" in text:
        return text
    linked = re.findall(r"\]\(([\w-]+)\.(?:md|ipynb)\)", text)
    return f"{text}\n{toctree(*dict.fromkeys(linked))}"


def without_empty_globs(text: str, names: list[str]) -> str:
    """A page whose lists ask only for what has pages that no line names: to Sphinx another one is an error."""
    lines = text.splitlines()
    pages = {name.rpartition(".")[0] for name in names if name.endswith((".md", ".ipynb"))} - {*lines, "index"}

    def finds(line: str) -> bool:
        return any(fnmatch(page, line) and page.count("/") == line.count("/") for page in pages)

    kept = [line for line in lines if not line.endswith("*") or " " in line or finds(line)]
    return "\n".join(kept) + "\n"


def _relinked(notebook: str, name: str) -> str:
    book = json.loads(notebook)
    for cell in book["cells"]:
        if cell["cell_type"] == "markdown":
            path = f"notebooks/{name.rpartition('/')[2]}"
            cell["source"] = links.for_site("".join(cell["source"]), path, name)
    return json.dumps(book, indent=1) + "\n"


def write(folder: Path, files: dict[str, bytes]) -> None:
    """Make a folder hold these files and no others."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.relative_to(folder).as_posix() not in files:
            path.unlink()
    for name, content in files.items():
        path = folder / name
        if not path.is_file() or path.read_bytes() != content:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def build(out: Path, work: Path, stored: Path) -> int:
    """Make the site; a warning is an error. The exit code of Sphinx.

    out    : folder of the HTML
    work   : folder of the sources that are put together, and of what Sphinx keeps
    stored : folder of executed notebooks
    """
    write(work / "pages", sources(stored))
    options = ["-b", "html", "-W", "--keep-going", "-q", "-c", str(ROOT / "docs"), "-d", str(work / "doctrees")]
    return sphinx_build([*options, str(work / "pages"), str(out)])
