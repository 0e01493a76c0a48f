"""The fixture's work: make the picture, find its baseline, compare, keep what a person needs to see.

A baseline is replaced by a file written whole beside it and moved, after the new picture is there: a render that
fails, or a full disk, leaves the old one.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from glpath.compare import Mode, Picture, Verdict, compare, difference_image, flip_picture
from glpath.errors import GlpathError, ImageError, UsageError
from glpath.film import Film
from glpath.image import tonemap, write_png
from glpath.pytest_plugin.places import baseline_folder, baseline_name, results_folder
from glpath.pytest_plugin.settings import Settings
from glpath.scene import AnyScene, Scene
from glpath.scene.formats.from_python import is_made_in_python

Subject = AnyScene | Film | ArrayLike | Callable[[], Any]

# Severity of what could not be compared at all: in a report it stands first.
_INCOMPARABLE = 1e9


class RenderRegression:
    """What the fixture `render_regression` is: call it with a picture, and it fails the test or does not."""

    def __init__(self, item: pytest.Item, settings: Settings, records: list[dict[str, Any]]) -> None:
        self._item = item
        self._settings = settings
        self._records = records
        self._stems: set[str] = set()

    def __call__(
        self,
        subject: Subject,
        *,
        name: str = "",
        mode: Mode | None = None,
        limits: Mapping[str, float] | None = None,
        **render_options: Any,
    ) -> Verdict | None:
        """Compare a picture with its baseline, and fail the test where it differs.

        Parameters
        ----------
        subject : a scene (the name of a shipped one, a file, also one beside the test, or a `Scene`), which is
                  rendered; a `Film`; an array (H, W), (H, W, 3) or (H, W, 4), radiance in linear Rec. 709, or sRGB
                  where it is uint8; or a function without parameters that returns one of these
        name    : of the picture, where a test has several
        mode    : "exact", "fuzzy", "stat" or "flip"; by itself "stat" for path-traced films, "fuzzy" for all else
        limits  : of the mode, for example {"tolerance": 0.01}; see `glpath.compare`
        render_options : of `glpath.render`, where a scene is rendered. The seed is 0 unless it is among them; a
                  fixed one lets "stat" see small changes

        Returns the verdict, None where a baseline was written instead.
        """
        __tracebackhide__ = True
        try:
            stem = self._stem(name)
            picture = self._picture(subject, render_options)
            return self._check(picture, stem, mode, dict(limits or {}))
        except GlpathError as error:
            pytest.fail(f"glpath: {error}", pytrace=False)

    def _stem(self, name: str) -> str:
        if not re.fullmatch(r"[\w.+=-]*", name):
            raise UsageError(f"name: found {name!r}, expected letters, digits and . _ - + = only.")
        stem = baseline_name(self._item.nodeid, name)
        if stem in self._stems:
            raise UsageError(
                f"render_regression: a second picture {name!r} in {self._item.nodeid}."
                if name
                else f"render_regression: a second picture without a name in {self._item.nodeid}.",
                'Name each: render_regression(..., name="left").',
            )
        self._stems.add(stem)
        return stem

    def _picture(self, subject: Subject, options: Mapping[str, Any]) -> Picture:
        while callable(subject):
            subject = subject()
        if isinstance(subject, str | Path | Scene) or is_made_in_python(subject):
            from glpath.rendering import render

            beside = self._item.path.parent / subject if isinstance(subject, str | Path) else None
            scene: Any = beside if beside is not None and beside.is_file() else subject
            subject = render(scene, **{**self._settings.device, **options})
        elif options:
            raise UsageError(
                f"render_regression: {', '.join(options)}: options of a render, but this is a picture already.",
                "Render with them, or hand in the scene.",
            )
        if isinstance(subject, Film):
            return Picture.of_film(subject)
        return Picture.of_array(_as_array(subject))

    def _check(self, picture: Picture, stem: str, mode: Mode | None, limits: dict[str, float]) -> Verdict | None:
        __tracebackhide__ = True
        config = self._item.config
        baseline = baseline_folder(config, self._item.path) / f"{stem}.exr"
        results = results_folder(config, self._item.path, stem)
        update = self._settings.update
        record: dict[str, Any] = {
            "test": self._item.nodeid,
            "picture": stem,
            "baseline": str(baseline),
            "outcome": "failed",
            "mode": mode or "",
            "severity": 0.0,
            "summary": "",
            "made_otherwise": [],
            "measured": {},
            "limits": {},
            "files": {},
        }
        self._records.append(record)
        if not baseline.exists():
            if update == "none":
                record |= {"outcome": "missing", "severity": _INCOMPARABLE, "summary": "there is no baseline"}
                record["files"] = _keep(results, picture, None, record)
                self._fail(record, results, limits, f"there is no baseline {shown_path(baseline)}")
            _write_baseline(baseline, picture, mode, limits)
            record |= {"outcome": "written"}
            return None
        if update == "all":
            _write_baseline(baseline, picture, mode, limits)
            record |= {"outcome": "updated"}
            return None

        reference: Picture | None = None
        verdict: Verdict | None = None
        try:
            reference = Picture.load(baseline)
            record["made_otherwise"] = picture.differences_in_making(reference)
            verdict = compare(picture, reference, mode, **limits)
            record |= {
                "mode": verdict.mode,
                "severity": verdict.severity,
                "summary": verdict.summary,
                "measured": dict(verdict.measured),
                "limits": dict(verdict.limits),
            }
        except GlpathError as error:
            record |= {"severity": _INCOMPARABLE, "summary": str(error)}
            if not isinstance(error, ImageError):
                raise
            # A broken baseline, or one of another size: a failure like any other, which an update may end.
        if verdict is not None and verdict.passed:
            record["outcome"] = "passed"
            _forget(results)
            return verdict
        if update == "failed":
            _write_baseline(baseline, picture, mode, limits)
            record["outcome"] = "updated"
            _forget(results)
            return verdict
        record["files"] = _keep(results, picture, reference, record)
        self._fail(
            record, results, limits, f"{stem} differs from its baseline" + (f" ({verdict.mode})" if verdict else "")
        )
        return verdict

    def _fail(self, record: Mapping[str, Any], results: Path, limits: Mapping[str, float], headline: str) -> None:
        """Fail the test with all that a person needs to look, to repeat it and to accept it."""
        __tracebackhide__ = True
        lines = [f"glpath: {headline}"]
        missing = record["outcome"] == "missing"
        lines += [f"  {line}" for line in record["summary"].splitlines()[missing:]]
        lines += [f"  made otherwise: {text}" for text in record["made_otherwise"]]
        if not missing:
            lines.append(f"  baseline    {shown_path(record['baseline'])}")
        for kind in ("result", "difference", "flip"):
            if kind in record["files"]:
                lines.append(f"  {kind:<10}  {shown_path(record['files'][kind])}")
        if record["mode"] and not missing:
            given = "".join(f" --limit {name}={value:g}" for name, value in limits.items())
            files = (
                f"{shlex.quote(shown_path(results / 'result.exr'))} {shlex.quote(shown_path(record['baseline']))}"
            )
            lines.append(f"  again       glpath diff --mode {record['mode']}{given} {files}")
        wanted = "missing" if missing else "failed"
        # Ids count from pytest's rootdir, but a path on its command line from here.
        test = "::".join([shown_path(self._item.path), *record["test"].split("::")[1:]])
        lines.append(f"  accept      pytest --glpath-update {wanted} {shlex.quote(test)}")
        pytest.fail("\n".join(lines), pytrace=False)


def shown_path(path: str | Path) -> str:
    """A path as short as it can be said from here."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith(os.pardir) else relative


def _as_array(subject: object) -> ArrayLike:
    try:
        array = np.asarray(subject)
    except (ValueError, TypeError):
        array = None
    if array is None or array.dtype.kind not in "biuf":
        raise UsageError(
            f"render_regression: found {type(subject).__name__}, expected a scene, a Film, an array or a function "
            "that returns one of these."
        )
    return array


def _write_baseline(path: Path, picture: Picture, mode: Mode | None, limits: Mapping[str, float]) -> None:
    """The PNG first: should it fail, the old baseline, which counts, is still whole.

    What does not even pass beside itself, as it is too noisy, never becomes a baseline: UsageError.
    """
    verdict = compare(picture, picture, mode, **limits)
    if not verdict.passed:
        raise UsageError(f"{path.stem}: cannot be a baseline: {verdict.summary}.")
    write_png(path.with_suffix(".png"), tonemap(picture.mean))
    picture.save(path)


def _keep(folder: Path, picture: Picture, reference: Picture | None, record: dict[str, Any]) -> dict[str, str]:
    """Write what there is to see into the folder of this picture's results; kind to path.

    Where the system refuses, the summary of the record says so: the difference is what the test fails by.
    """
    shown = {"result": tonemap(picture.mean)}
    if reference is not None:
        shown["reference"] = tonemap(reference.mean)
        if reference.mean.shape == picture.mean.shape:
            shown["difference"], _ = difference_image(picture.mean, reference.mean)
            with contextlib.suppress(UsageError):  # flip-evaluator is optional; the report says where it is missing
                shown["flip"] = flip_picture(picture.mean, reference.mean)
    files = {}
    try:
        _forget(folder)
        picture.save(folder / "result.exr")
        for kind, image in shown.items():
            path = folder / f"{kind}.png"
            write_png(path, image)
            files[kind] = str(path)
    except (ImageError, OSError) as error:
        record["summary"] += f"\nthe pictures are not kept: {error}"
    return files


def _forget(folder: Path) -> None:
    """Remove what `_keep` of an earlier run has left, and nothing else."""
    for kind in ("result", "reference", "difference", "flip"):
        for suffix in (".png", ".exr"):
            (folder / f"{kind}{suffix}").unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # it was not there, or holds something of somebody else
        folder.rmdir()
