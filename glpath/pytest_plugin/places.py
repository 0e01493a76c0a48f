"""Where the files of a test are."""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path

import pytest

# Beyond this many characters a name is cut: file systems allow 255 bytes, and a suffix comes to it.
_LONGEST = 120


def baseline_folder(config: pytest.Config, test_file: Path) -> Path:
    """The folder of the baselines of a file of tests: `baseline/<its name>/` beside it.

    --glpath-baseline-path: a relative one takes the place of `baseline`; under an absolute one stands the path that
    the file has in pytest's rootdir.
    """
    root = Path(config.getoption("--glpath-baseline-path") or "baseline")
    if not root.is_absolute():
        return test_file.parent / root / test_file.stem
    return root / _inside(config.rootpath, test_file.parent) / test_file.stem


def results_root(config: pytest.Config) -> Path:
    """Where pictures of failures and the report go; a relative option counts from where pytest began."""
    given = config.getoption("--glpath-results-path")
    if given is None:
        return config.rootpath / "glpath-results"
    return Path(os.path.abspath(config.invocation_params.dir / given))


def results_folder(config: pytest.Config, test_file: Path, stem: str) -> Path:
    """The folder of one picture's results."""
    return results_root(config) / _inside(config.rootpath, test_file.parent) / test_file.stem / stem


def baseline_name(nodeid: str, name: str = "") -> str:
    """The stem of a baseline's file: the test's class, name and parameters, and the picture's own name.

    Signs that a file name had better not have become "-"; where parameters have such, a checksum keeps apart what
    would look alike.
    """
    test = ".".join(nodeid.split("::")[1:])
    plain = re.sub(r"[^\w.=+-]+", "-", test.replace("[", "-").removesuffix("]")).strip("-")
    unusual = re.search(r"[^\w.=+\[\]-]", test) is not None
    if unusual or len(plain) > _LONGEST:
        plain = f"{plain[:_LONGEST]}-{zlib.crc32(test.encode()):08x}"
    return f"{plain}.{name}" if name else plain


def _inside(root: Path, folder: Path) -> Path:
    """`folder` as seen from `root`; of one that is not in it, all of its path but the beginning."""
    try:
        return folder.relative_to(root)
    except ValueError:
        return folder.relative_to(folder.anchor)
