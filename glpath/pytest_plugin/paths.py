"""Where the files of a test are."""

from __future__ import annotations

import os
import re
import sys
import zlib
from pathlib import Path

import pytest

from glpath.pytest_plugin.settings import chosen, is_from_command_line

# Beyond this many characters a name is cut: file systems allow 255 bytes, and a suffix comes to it.
_LONGEST = 120

# A test's id, of which the file name is made without a loss: classes, then what has no letter of two cases. File
# systems of macOS and Windows take Test_a and test_A for one name.
_PLAIN = r"(\w+\.)*[a-z0-9_]+(\[[a-z0-9_+=][a-z0-9_.+=-]*(?<!-)\])?"  # not compiled before the first picture


def baseline_folder(config: pytest.Config, test_file: Path, given: str | None = None) -> Path:
    """The folder of the baselines of a file of tests: `baseline/<its name>/` beside it.

    given : by the test itself, else by --glpath-baseline-path or the ini-file: a relative one replaces
            `baseline`; under an absolute one stands the path that the file has in pytest's rootdir

    With `--glpath-platform` a folder of that name comes after `baseline`.
    """
    root = Path(given or chosen(config, "baseline-path") or "baseline")
    platform = chosen(config, "platform") or ""
    platform = sys.platform if platform == "auto" else platform
    if not root.is_absolute():
        return test_file.parent / root / platform / test_file.stem
    return root / platform / _inside(config.rootpath, test_file.parent) / test_file.stem


def new_baseline(config: pytest.Config, baseline: Path) -> Path | None:
    """Where `--glpath-new-path` wants a new baseline for that one; None where it is not given.

    A relative path counts from where pytest began, the ini-file's from pytest's rootdir.
    """
    given = chosen(config, "new-path")
    if given is None:
        return None
    from_here = is_from_command_line(config, "new-path")
    root = (config.invocation_params.dir if from_here else config.rootpath) / given
    return Path(os.path.abspath(root)) / _inside(config.rootpath, baseline.parent) / baseline.name


def results_root(config: pytest.Config) -> Path:
    """Where pictures of failures and the report go. A relative path counts from where pytest began, the ini-file's
    from pytest's rootdir."""
    given = chosen(config, "results-path") or "glpath-results"
    from_here = is_from_command_line(config, "results-path")
    return Path(os.path.abspath((config.invocation_params.dir if from_here else config.rootpath) / given))


def results_folder(config: pytest.Config, test_file: Path, stem: str) -> Path:
    """The folder of one picture's results."""
    return results_root(config) / _inside(config.rootpath, test_file.parent) / test_file.stem / stem


def id_in_file(nodeid: str) -> str:
    """The part of a test's id after its file: classes, name and parameters."""
    return ".".join(nodeid.split("::")[1:])


def baseline_name(test: str, name: str = "") -> str:
    """The stem of a baseline's file: the test's class, name and parameters, and the picture's own name.

    Signs that a file name had better not have become "-". Where that, a cut or capital letters in parameters could
    make two tests look alike, a checksum keeps them apart.
    """
    plain = re.sub(r"[^A-Za-z0-9_.=+-]+", "-", test.replace("[", "-").removesuffix("]")).strip("-")
    if not re.fullmatch(_PLAIN, test, re.ASCII) or len(plain) > _LONGEST:
        plain = f"{plain[:_LONGEST]}-{zlib.crc32(test.encode()):08x}"
    return f"{plain}.{name}" if name else plain


def _inside(root: Path, folder: Path) -> Path:
    """`folder` as seen from `root`; of one that is not in it, all of its path but the beginning."""
    try:
        return folder.relative_to(root)
    except ValueError:
        return folder.relative_to(folder.anchor)
