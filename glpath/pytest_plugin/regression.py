"""The fixture's work: make the picture, find its baseline, compare, keep what a person needs to see.

A baseline is a PNG where the picture is 8-bit sRGB, else an EXR with the noise in it and a PNG to look at. It is
replaced by a file written whole beside it and moved, after the new picture is there: a render that fails, or a full
disk, leaves the old one.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from glpath.compare import (
    Mode,
    Picture,
    Verdict,
    compare,
    default_mode,
    difference_image,
    flip_picture,
    max_difference_pair,
    read_limits,
    read_picture,
)
from glpath.compare.masks import Ignore, mask_of, masked, padded
from glpath.errors import GlpathError, ImageError, UsageError
from glpath.film.image import read_exr_channels, write_png
from glpath.pytest_plugin.figures import FigureSettings
from glpath.pytest_plugin.paths import baseline_folder, baseline_name, id_in_file, new_baseline, results_folder
from glpath.pytest_plugin.settings import Settings
from glpath.pytest_plugin.subjects import Subject, picture_of
from glpath.system.private_interfaces import is_xfail

# Severity of what could not be compared at all: in a report it stands first.
_INCOMPARABLE = 1e9

_MARKER = "render_regression"
_MARKED = ("mode", "limits", "baseline_path", "ignore", "style", "backend", "savefig_kwargs", "remove_text")

# Header keys of the PNG beside an EXR, and of a baseline's test.
PREVIEW = "glpath.preview"
_TEST, _NAME = "glpath.test", "glpath.picture"


class RenderRegression:
    """The fixture `render_regression`: call it with a picture, and it fails the test or does not.

    figures : matplotlib's, as they came, to be closed after the test
    """

    def __init__(self, item: pytest.Item, settings: Settings, records: list[dict[str, Any]]) -> None:
        self.figures: list[Any] = []
        self._item = item
        self._settings = settings
        self._records = records
        self._names: dict[str, str] = {}

    def __repr__(self) -> str:
        return f"<render_regression of {self._item.name}>"

    def __call__(
        self,
        subject: Subject,
        *,
        name: str = "",
        mode: Mode | None = None,
        limits: Mapping[str, float] | None = None,
        ignore: Ignore | None = None,
        savefig_kwargs: Mapping[str, Any] | None = None,
        remove_text: bool | None = None,
        **render_options: Any,
    ) -> Verdict | None:
        """Compare a picture with its baseline, and fail the test where it differs.

        Parameters
        ----------
        subject : a scene (the name of a shipped one, a file, also one beside the test, or a `Scene`), which is
                  rendered; a `Film`; an array (H, W), (H, W, 3) or (H, W, 4) with alpha, radiance in linear Rec.
                  709, or sRGB where it is uint8 or uint16; an image of Pillow; a figure of matplotlib; the path
                  or the bytes of an image file; or a function without parameters that returns one of these
        name    : of the picture, where a test has several
        mode    : "exact", "fuzzy", "stat" or "flip"; by default what the marker `render_regression` of the test,
                  class or module says, else what `glpath_mode` says, else "stat" for path-traced films and
                  "fuzzy" for all else
        limits  : of the mode, for example {"tolerance": 0.01}; see `glpath.compare`. Those that are not given come
                  from the marker, else from `glpath_limits`
        ignore  : what is not compared: rectangles [(x, y, width, height), ...] in pixels, y from the top; or a
                  picture as large, white there, or its file beside the test. By default what the marker says
        savefig_kwargs : of matplotlib's `Figure.savefig`, such as {"dpi": 100}; by default those of the marker
        remove_text : take titles and the labels of ticks from a figure; by default as the marker says. The marker
                  also has `style` and `backend` of matplotlib, which hold while the test runs
        render_options : of `glpath.render`, where a scene is rendered. The seed is 0 unless it is among them; a
                  fixed one lets "stat" see small changes

        Returns the verdict, None where a baseline was written instead.
        """
        __tracebackhide__ = True
        try:
            marked = self._marked()
            stem = self._stem(name)
            folder = self._item.path.parent
            figures = self._figure_settings(marked, savefig_kwargs, remove_text)
            picture = picture_of(subject, folder, self._settings.device, render_options, self.figures, figures)
            if ignore is not None:
                marked["ignore"] = ignore
            made = {_TEST: id_in_file(self._item.nodeid), _NAME: name}
            picture = replace(picture, provenance={**picture.provenance, **made})
            return self._check(picture, stem, marked, mode, dict(limits or {}))
        except GlpathError as error:
            reason = f"glpath: {error}"
        # Not while the other is handled: pytest would show both.
        pytest.fail(reason)

    @contextlib.contextmanager
    def styled(self) -> Iterator[None]:
        """Within, matplotlib has the style and the backend of the marker, or of the run."""
        try:
            settings = self._figure_settings(self._marked(), None, None)
        except UsageError:  # which the call reports
            settings = FigureSettings()
        reason = ""
        with contextlib.ExitStack() as until_done:
            try:
                until_done.enter_context(settings.around())
            except GlpathError as error:
                reason = f"glpath: {error}"
            if not reason:
                yield
        if reason:
            pytest.fail(reason, pytrace=False)

    def _figure_settings(
        self, marked: Mapping[str, Any], savefig_kwargs: Mapping[str, Any] | None, remove_text: bool | None
    ) -> FigureSettings:
        """The call says more than the marker, the marker more than the options of the run."""
        return FigureSettings(
            marked["style"] if marked["style"] is not None else self._settings.style,
            marked["backend"] or self._settings.backend,
            {**(marked["savefig_kwargs"] or {}), **(savefig_kwargs or {})},
            bool(marked["remove_text"] if remove_text is None else remove_text),
        )

    def _marked(self) -> dict[str, Any]:
        """The settings of the markers of the test, its class and its module; the nearest wins."""
        found: dict[str, Any] = dict.fromkeys(_MARKED) | {"limits": {}}
        for marker in reversed(list(self._item.iter_markers(_MARKER))):
            unknown = [repr(value) for value in marker.args] + [key for key in marker.kwargs if key not in found]
            if unknown:
                raise UsageError(
                    f"the marker {_MARKER}: has no {', '.join(unknown)}. Allowed: {', '.join(found)}, by name."
                )
            given = {key: value for key, value in marker.kwargs.items() if value is not None}
            # Limits belong to a mode, and go with it.
            limits = {} if given.get("mode", found["mode"]) != found["mode"] and found["mode"] else found["limits"]
            found |= {**given, "limits": {**limits, **given.get("limits", {})}}
        return found

    def _stem(self, name: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9_.+=-]{0,80}", name):
            raise UsageError(f"name: found {name[:100]!r}, expected up to 80 letters, digits and . _ - + = only.")
        # File systems of macOS and Windows take names for one that differ in case alone.
        before = self._names.get(name.lower())
        if before is not None:
            which = f"picture {name!r}" if name else "picture without a name"
            raise UsageError(
                f"render_regression: a second {which} in {self._item.nodeid}."
                if before == name
                else f"render_regression: {before!r} and {name!r} in {self._item.nodeid} differ in case alone.",
                'Name each: render_regression(..., name="left").',
            )
        self._names[name.lower()] = name
        return baseline_name(id_in_file(self._item.nodeid), name)

    def _check(
        self, picture: Picture, stem: str, marked: Mapping[str, Any], mode: str | None, limits: dict[str, float]
    ) -> Verdict | None:
        __tracebackhide__ = True
        config = self._item.config
        baseline = _existing(baseline_folder(config, self._item.path, marked["baseline_path"]), stem, picture)
        missing = not os.path.exists(baseline)
        results = results_folder(config, self._item.path, stem)
        # A test that is expected to fail has a baseline that it does not meet, and keeps it.
        update = "none" if is_xfail(self._item) else self._settings.update
        record: dict[str, Any] = {
            "test": self._item.nodeid,
            "file": str(self._item.path),
            "picture": stem,
            "baseline": str(baseline),
            "outcome": "missing" if missing else "failed",
            "mode": mode or "",
            "severity": _INCOMPARABLE,
            "summary": "there is no baseline" if missing else "",
            "made_otherwise": [],
            "measured": {},
            "limits": {},
            "ignored": 0.0,
            "files": {},
            "commands": {},
        }
        self._records.append(record)
        reference: Picture | None = None
        verdict: Verdict | None = None
        write = update == "all" or (missing and update != "none")
        try:
            if not (missing or write):
                reference = _load(baseline, picture, record)
            mode, limits = self._mode_and_limits(picture, reference or picture, marked, mode, limits)
            record["mode"] = mode
            if reference is not None:
                verdict = _verdict(*self._masked(picture, reference, marked, record), mode, limits, record)
                if verdict is not None and verdict.passed:
                    record["outcome"] = "passed"
                    if self._settings.keep == "all":
                        shown = self._masked(picture, reference, marked, record)
                        record["files"] = _keep(results, picture, reference, shown, record)
                    else:
                        _forget(results)
                    return verdict
            if write or update == "failed":
                record["baseline"] = str(_write_baseline(baseline, picture, mode, limits))
                record |= {"outcome": "written" if missing else "updated"}
                if verdict is None:
                    record |= {"severity": 0.0, "summary": ""}
                _forget(results)
                return verdict
        except UsageError as error:
            record |= {"outcome": "failed", "severity": _INCOMPARABLE, "summary": str(error)}
            raise
        compared = None if reference is None else self._masked(picture, reference, marked, record)
        record["files"] = _keep(results, picture, reference, compared, record)
        if (new := new_baseline(config, baseline)) is not None:
            record["files_new"] = str(_write_baseline(new, picture, mode, limits))
        if missing:
            headline = f"there is no baseline {shown_path(baseline)}"
        else:
            headline = f"{stem} differs from its baseline" + (f" ({verdict.mode})" if verdict else "")
        return self._fail(record, results, limits, headline)

    def _masked(
        self, picture: Picture, reference: Picture, marked: Mapping[str, Any], record: dict[str, Any]
    ) -> tuple[Picture, Picture]:
        """Both without what is ignored; as they are where their sizes differ."""
        if marked["ignore"] is None or picture.mean.shape != reference.mean.shape:
            return picture, reference
        mask = mask_of(marked["ignore"], picture.mean.shape, self._item.path.parent)
        record["ignored"] = float(mask.mean())
        return masked(picture, mask), masked(reference, mask)

    def _mode_and_limits(
        self,
        picture: Picture,
        reference: Picture,
        marked: Mapping[str, Any],
        mode: str | None,
        limits: Mapping[str, float],
    ) -> tuple[str, dict[str, float]]:
        """The call says more than the marker, the marker more than the options of the run."""
        of_the_run = {name: read_limits(name, texts) for name, texts in self._settings.limits.items()}
        known = marked["limits"] if mode is None or marked["mode"] in (None, mode) else {}
        mode = mode or marked["mode"] or self._settings.mode or default_mode(picture, reference)
        return mode, {**of_the_run.get(mode, {}), **known, **limits}

    def _fail(self, record: dict[str, Any], results: Path, limits: Mapping[str, float], headline: str) -> NoReturn:
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
        if "files_new" in record:
            lines.append(f"  new         {shown_path(record['files_new'])}")
        record["commands"] = self._commands(record, results, limits)
        lines += [f"  {name:<10}  {command}" for name, command in record["commands"].items()]
        pytest.fail("\n".join(lines))

    def _commands(self, record: Mapping[str, Any], results: Path, limits: Mapping[str, float]) -> dict[str, str]:
        commands, missing = {}, record["outcome"] == "missing"
        if not missing:
            given = "".join(f" --limit {name}={value:g}" for name, value in limits.items())
            result = next(filter(Path.exists, (results / "result.exr", results / "result.png")), results)
            files = f"{shlex.quote(shown_path(result))} {shlex.quote(shown_path(record['baseline']))}"
            commands["again"] = f"glpath diff --mode {record['mode']}{given} {files}"
        wanted = "missing" if missing else "failed"
        # Ids count from pytest's rootdir, but a path on its command line from here.
        test = "::".join([shown_path(self._item.path), *record["test"].split("::")[1:]])
        commands["accept"] = f"pytest --glpath-update {wanted} {shlex.quote(test)}"
        return commands


def shown_path(path: str | Path) -> str:
    """A path, relative to here where that is below."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith(os.pardir) else relative


def _existing(folder: Path, stem: str, picture: Picture) -> Path:
    exr, png = folder / f"{stem}.exr", folder / f"{stem}.png"
    if os.path.exists(exr):
        return exr
    if os.path.exists(png):
        with contextlib.suppress(ImageError):
            if PREVIEW in read_picture(png).provenance:
                return exr
        return png
    return png if picture.eight_bit else exr


def _load(baseline: Path, picture: Picture, record: dict[str, Any]) -> Picture | None:
    """None for what cannot be read: a failure like any other, which an update may end; the record says why.

    Raises UsageError for the baseline of another test, whose name makes the same file name: with a picture's name
    behind it, or on file systems that do not know upper from lower case.
    """
    try:
        reference = read_picture(baseline) if baseline.suffix == ".png" else Picture.load(baseline)
    except ImageError as error:
        record["summary"] = str(error)
        return None
    ours, theirs = ((p.provenance.get(_TEST), p.provenance.get(_NAME, "")) for p in (picture, reference))
    stems = [baseline_name(test or "", name).lower() for test, name in (ours, theirs)]
    if theirs[0] is not None and theirs != ours and stems[0] == stems[1]:
        tests = [f"{test}, picture {name!r}" if name else test for test, name in (theirs, ours)]
        raise UsageError(
            f"{shown_path(baseline)}: is the baseline of {tests[0]}; {tests[1]} has the same file name.",
            "Rename one of them.",
        )
    return reference


def _verdict(
    picture: Picture, reference: Picture, mode: str, limits: Mapping[str, float], record: dict[str, Any]
) -> Verdict | None:
    """None for pictures that cannot be compared, such as those of two sizes. The record has it all."""
    record["made_otherwise"] = picture.differences_in_making(reference)
    try:
        verdict = compare(picture, reference, mode, **limits)
    except ImageError as error:
        record["summary"] = str(error)
        if picture.mean.shape != reference.mean.shape:
            same = tuple(map(min, picture.mean.shape[:2], reference.mean.shape[:2]))
            a, b = (side.mean[: same[0], : same[1]] for side in (picture, reference))
            off = int(np.count_nonzero((a.astype(np.float32) != b.astype(np.float32)).any(axis=2)))
            record["summary"] += (
                f"\nof the {same[1]} x {same[0]} pixels that both have at the upper left, {off} differ"
            )
        return None
    record |= {
        "severity": verdict.severity,
        "summary": verdict.summary,
        "measured": dict(verdict.measured),
        "limits": dict(verdict.limits),
    }
    return verdict


def _write_baseline(path: Path, picture: Picture, mode: str, limits: Mapping[str, float]) -> Path:
    """Write it beside `path`, as .png or .exr, and return where. What is only looked at comes first: should it
    fail, the old baseline, which counts, is still whole.

    A picture too noisy to pass compared with itself never becomes a baseline: UsageError.
    """
    verdict = compare(picture, picture, mode, **limits)
    if not verdict.passed:
        raise UsageError(f"{path.stem}: cannot be a baseline: {verdict.summary}.")
    if picture.eight_bit:
        picture.save_8_bit(path.with_suffix(".png"))
        path.with_suffix(".exr").unlink(missing_ok=True)
        return path.with_suffix(".png")
    picture.save_png(path.with_suffix(".png"), {PREVIEW: "the .exr beside it counts"})
    picture.save(path.with_suffix(".exr"))
    return path.with_suffix(".exr")


def _keep(
    folder: Path,
    picture: Picture,
    reference: Picture | None,
    compared: tuple[Picture, Picture] | None,
    record: dict[str, Any],
) -> dict[str, str]:
    """Write what there is to see into the folder of this picture's results; kind to path.

    compared : both without what is ignored; of two sizes they are padded with black to one

    Where the system refuses, the summary of the record has the reason: the difference is what the test fails by.
    """
    files: dict[str, str] = {}
    try:
        _forget(folder)
        if not picture.eight_bit:
            picture.save(folder / "result.exr")
        for kind, side in (("result", picture), ("reference", reference)):
            if side is not None:
                side.save_png(folder / f"{kind}.png")
                files[kind] = str(folder / f"{kind}.png")
        if compared is not None:
            height, width = (max(side.mean.shape[axis] for side in compared) for axis in (0, 1))
            if compared[0].mean.shape != compared[1].mean.shape:
                compared = padded(compared[0], (height, width)), padded(compared[1], (height, width))
            a, b = (side.mean for side in max_difference_pair(*compared))
            shown = {"difference": difference_image(a, b)[0]}
            with contextlib.suppress(UsageError):  # flip-evaluator is optional; the report says where it is missing
                shown["flip"] = flip_picture(a, b)
            for kind, image in shown.items():
                write_png(folder / f"{kind}.png", image)
                files[kind] = str(folder / f"{kind}.png")
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


def is_baseline(file: Path) -> bool | None:
    """Whether glpath has written it: a baseline, or the picture to look at beside one. None for unreadable
    pictures."""
    try:
        if file.suffix == ".exr":
            return Picture.is_baseline(read_exr_channels(file)[1])
        provenance = read_picture(file).provenance
    except ImageError:
        return None
    return PREVIEW in provenance or Picture.is_baseline(provenance)


def delete_baseline(file: Path) -> None:
    """Delete it, and the picture to look at beside it."""
    for path in (file, file.with_suffix(".png")):
        if os.path.exists(path) and is_baseline(path):
            path.unlink()
    with contextlib.suppress(OSError):  # it holds more
        file.parent.rmdir()
