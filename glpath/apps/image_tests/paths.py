"""Paths of the files of a test."""

from __future__ import annotations

import os
import re
import sys
import zlib
from pathlib import Path

import pytest

from glpath.apps.image_tests.settings import chosen, is_from_command_line

# Maximum length of a name before its suffix, because file systems allow 255 bytes.
_LONGEST = 120

# Pattern of test ids that convert to a file name without loss: classes, then only characters without case. File
# systems of macOS and Windows do not distinguish Test_a and test_A. The pattern is compiled with the first image.
_PLAIN = r"(\w+\.)*[a-z0-9_]+(\[[a-z0-9_+=][a-z0-9_.+=-]*(?<!-)\])?"


def baseline_folder(config: pytest.Config, test_file: Path, given: str | None = None) -> Path:
    """Return the folder for the baselines of a test file: `baseline/<its name>/` beside it.

    given : folder given by the test; None: that of --glpath-baseline-path or the ini-file. A relative folder
            replaces `baseline`; an absolute one contains the test file's path relative to pytest's rootdir

    With `--glpath-platform`, a folder of that name follows `baseline`.
    """
    root = Path(given or chosen(config, "baseline-path") or "baseline")
    platform = chosen(config, "platform") or ""
    platform = sys.platform if platform == "auto" else platform
    if not root.is_absolute():
        return test_file.parent / root / platform / test_file.stem
    return root / platform / _inside(config.rootpath, test_file.parent) / test_file.stem


def new_baseline(config: pytest.Config, baseline: Path) -> Path | None:
    """Return the path for a new baseline by `--glpath-new-path`; None without that option.

    A relative path is relative to pytest's start folder; in the ini-file, to pytest's rootdir.
    """
    given = chosen(config, "new-path")
    if given is None:
        return None
    from_here = is_from_command_line(config, "new-path")
    root = (config.invocation_params.dir if from_here else config.rootpath) / given
    return Path(os.path.abspath(root)) / _inside(config.rootpath, baseline.parent) / baseline.name


def results_root(config: pytest.Config) -> Path:
    """Return the folder for the images of failures and the report.

    A relative path is relative to pytest's start folder; in the ini-file, to pytest's rootdir.
    """
    given = chosen(config, "results-path") or "glpath-results"
    from_here = is_from_command_line(config, "results-path")
    return Path(os.path.abspath((config.invocation_params.dir if from_here else config.rootpath) / given))


def results_folder(config: pytest.Config, test_file: Path, stem: str) -> Path:
    """Return the folder for the results of one image."""
    return results_root(config) / _inside(config.rootpath, test_file.parent) / test_file.stem / stem


def id_in_file(nodeid: str) -> str:
    """Return the part of a test's id after its file: classes, name and parameters."""
    return ".".join(nodeid.split("::")[1:])


def baseline_name(test: str, name: str = "") -> str:
    """Return the stem of a baseline's file: the test's class, name and parameters, and the image's own name.

    Unsuitable characters become "-". A checksum is appended if another test could get the same name by this
    replacement, by shortening, or by capital letters.
    """
    plain = re.sub(r"[^A-Za-z0-9_.=+-]+", "-", test.replace("[", "-").removesuffix("]")).strip("-")
    if not re.fullmatch(_PLAIN, test, re.ASCII) or len(plain) > _LONGEST:
        plain = f"{plain[:_LONGEST]}-{zlib.crc32(test.encode()):08x}"
    return f"{plain}.{name}" if name else plain


def _inside(root: Path, folder: Path) -> Path:
    """Return `folder` relative to `root`, or relative to its drive or root folder if it is not inside `root`."""
    try:
        return folder.relative_to(root)
    except ValueError:
        return folder.relative_to(folder.anchor)
