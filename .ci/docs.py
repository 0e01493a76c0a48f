"""Make the site: `python .ci/docs.py [OUT]`, out/docs by default. A warning is an error."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "_ext")]

from glpath_docs.site import build  # noqa: E402


def main() -> int:
    """Make the site and say where its first page is."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "out" / "docs"
    failed = build(out, ROOT / "out" / "site", ROOT / "out" / "notebooks")
    if not failed:
        print(out / "index.html")
    return failed


if __name__ == "__main__":
    sys.exit(main())
