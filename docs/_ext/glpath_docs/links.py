"""Links of pages and notebooks to files of the repository, as the site has them.

On a page in `docs/` a link to `../notebooks/x.ipynb` works where one reads the repository. The site has the
notebook and the changelog as pages, and of other files the path alone.
"""

from __future__ import annotations

import re
from posixpath import normpath
from posixpath import relpath as posix_relpath

from glpath_docs import notebooks

_LINK = re.compile(r"(?P<image>!?)\[(?P<label>[^\]]*)\]\((?P<target>[^)\s]+)\)")
_FENCE = re.compile(r"^(```|~~~).*?^\1[ \t]*$", re.MULTILINE | re.DOTALL)
_ELSEWHERE = re.compile(r"[a-z]+:|#|/|\{")


def for_site(text: str, path: str, at: str) -> str:
    """Markdown with the links of the site.

    path : of the page in the repository, such as docs/howto/files.md
    at   : of the page in the site, such as howto/files.md
    """
    parts, end = [], 0
    for fence in _FENCE.finditer(text):
        parts += [_relinked(text[end : fence.start()], path, at), fence[0]]
        end = fence.end()
    return "".join([*parts, _relinked(text[end:], path, at)])


def _relinked(prose: str, path: str, at: str) -> str:
    def link(found: re.Match[str]) -> str:
        target, _, section = found["target"].partition("#")
        if not target or _ELSEWHERE.match(found["target"]):
            return found[0]
        file = normpath(f"{path.rpartition('/')[0]}/{target}")
        there = place(file)
        if there is None:
            return f"{found['label']} (`{file}`)" if file not in found["label"] else found["label"]
        back = posix_relpath(there, at.rpartition("/")[0] or ".")
        return f"{found['image']}[{found['label']}]({back}{'#' * bool(section)}{section})"

    return _LINK.sub(link, prose)


def place(file: str) -> str | None:
    """Where the site has a file of the repository; None where it has not."""
    if file.startswith("docs/"):
        return file.removeprefix("docs/")
    if file.startswith("notebooks/") and file.endswith(".ipynb"):
        return f"{notebooks.FOLDER}/{file.removeprefix('notebooks/')}"
    if file.startswith("notebooks/images/"):
        return f"{notebooks.FOLDER}/images/{file.removeprefix('notebooks/images/')}"
    return {"CHANGELOG.md": "changelog.md", "README.md": "index.md"}.get(file)
