"""Write the table of shader variants into docs/developing.md: python .ci/variants.py [--check]."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from glpath.gl.variants import VALUES, VARIANTS  # noqa: E402

BEGIN, END = "<!-- variants: .ci/variants.py writes this table -->\n", "<!-- end of variants -->\n"
_ASKED = re.compile(r"^\s*#\s*(?:ifdef|ifndef)\s+(\w+)|defined\s*\(?\s*(\w+)", re.MULTILINE)


def asked_for() -> dict[str, set[str]]:
    """Which shader files ask for each name."""
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / "shaders").rglob("*.*")):
        for groups in _ASKED.findall(path.read_text()):
            found.setdefault(groups[0] or groups[1], set()).add(path.relative_to(ROOT / "shaders").as_posix())
    return found


def table() -> str:
    """The tables in Markdown."""
    files = asked_for()
    rows = ["| variant | meaning | set by | read by |", "|---|---|---|---|"]
    for name, variant in VARIANTS.items():
        read = sorted({Path(file).parent.as_posix() for file in files.get(name, ())})
        set_by = variant.set_by if variant.set_by == "shaders" else f"`glpath.{variant.set_by}`"
        rows.append(f"| `{name}` | {variant.meaning} | {set_by} | {', '.join(read)} |")
    rows += ["", "| value | meaning |", "|---|---|"]
    rows += [f"| `{name}` | {meaning} |" for name, meaning in VALUES.items()]
    return "\n".join(rows) + "\n"


def main() -> int:
    """Write it, or with --check say whether it is the one that stands there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    page = ROOT / "docs" / "developing.md"
    text = page.read_text()
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    made = f"{text[:begin]}{table()}{text[end:]}"
    if parser.parse_args().check:
        return int(made != text)
    page.write_text(made)
    return 0


if __name__ == "__main__":
    sys.exit(main())
