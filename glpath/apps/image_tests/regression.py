"""Work of the fixture: make the image, find its baseline, compare, and store images for viewing.

A baseline is a PNG if the image is 8-bit sRGB, otherwise an EXR that includes the noise, with a PNG for viewing. A
new baseline is written completely beside the old one and then moved, after the new image exists. So a failed render
or a full disk keeps the old baseline.
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

from glpath.apps.image_tests.figures import FigureSettings
from glpath.apps.image_tests.paths import baseline_folder, baseline_name, id_in_file, new_baseline, results_folder
from glpath.apps.image_tests.settings import Settings
from glpath.apps.image_tests.subjects import Subject, picture_of
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
from glpath.film.exr import read_exr_channels
from glpath.film.image import write_png
from glpath.system.arguments import checked
from glpath.system.private_interfaces import is_xfail

# Severity of images that could not be compared; it puts them first in a report.
_INCOMPARABLE = 1e9

_MARKER = "render_regression"
_MARKED = ("mode", "limits", "baseline_path", "ignore", "style", "backend", "savefig_kwargs", "remove_text")

# Header key of the PNG beside an EXR.
PREVIEW = "glpath.preview"
# Key under which a baseline's header names its test.
_TEST = "glpath.test"
# Key under which a baseline's header stores the image's name.
_NAME = "glpath.picture"


class RenderRegression:
    """Fixture `render_regression`: calling it with an image fails the test if the image differs from its baseline.

    figures : matplotlib figures to be closed after the test
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
        """Compare an image with its baseline, and fail the test if they differ.

        Parameters
        ----------
        subject : scene (name of a shipped one, file, also beside the test, or `Scene`), which is rendered; `Film`;
                  array (H, W), (H, W, 3) or (H, W, 4) with alpha, radiance in linear Rec. 709, or sRGB for uint8
                  and uint16; Pillow image; matplotlib figure; path or bytes of an image file; or a function without
                  parameters that returns one of these
        name    : name of the image, if a test has several
        mode    : "exact", "fuzzy", "stat" or "flip". Default: mode of the marker `render_regression` of the test,
                  class or module; otherwise `glpath_mode`; otherwise "stat" for path-traced films and "fuzzy" for
                  all other images
        limits  : limits of the mode, for example {"tolerance": 0.01}; see `glpath.compare`. Missing limits come
                  from the marker, otherwise from `glpath_limits`
        ignore  : parts that are not compared: rectangles [(x, y, width, height), ...] in pixels, y from the top; or
                  an image of the same size, white there, or its file beside the test. Default: that of the marker
        savefig_kwargs : arguments of matplotlib's `Figure.savefig`, such as {"dpi": 100}; default: those of the
                         marker
        remove_text : True to remove titles and tick labels from a figure; default: that of the marker. The marker
                      also has `style` and `backend` of matplotlib, which apply while the test runs
        render_options : options of `glpath.render`, if a scene is rendered. The seed is 0 if it is not given; a
                         fixed seed lets "stat" detect small changes

        Returns the verdict, or None if a baseline was written instead.
        """
        __tracebackhide__ = True
        try:
            given = _given(
                mode=mode, limits=limits, ignore=ignore, savefig_kwargs=savefig_kwargs, remove_text=remove_text
            )
            marked = self._marked()
            stem = self._stem(name)
            folder = self._item.path.parent
            figures = self._figure_settings(marked, given.get("savefig_kwargs"), given.get("remove_text"))
            picture = picture_of(subject, folder, self._settings.device, render_options, self.figures, figures)
            if ignore is not None:
                marked["ignore"] = ignore
            made = {_TEST: id_in_file(self._item.nodeid), _NAME: name}
            picture = replace(picture, provenance={**picture.provenance, **made})
            return self._check(picture, stem, marked, given.get("mode"), given.get("limits", {}))
        except GlpathError as error:
            reason = f"glpath: {error}"
        # Outside the handler, because pytest would show both exceptions.
        pytest.fail(reason)

    @contextlib.contextmanager
    def styled(self) -> Iterator[None]:
        """Context in which matplotlib uses the style and backend of the marker, or of the run."""
        try:
            settings = self._figure_settings(self._marked(), None, None)
        except UsageError:  # the call of the fixture reports the error
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
        """Return the settings: the call overrides the marker, and the marker the options of the run."""
        return FigureSettings(
            marked["style"] if marked["style"] is not None else self._settings.style,
            marked["backend"] or self._settings.backend,
            {**(marked["savefig_kwargs"] or {}), **(savefig_kwargs or {})},
            bool(marked["remove_text"] if remove_text is None else remove_text),
        )

    def _marked(self) -> dict[str, Any]:
        """Return the settings of the markers of the test, its class and its module; the nearest wins."""
        found: dict[str, Any] = dict.fromkeys(_MARKED) | {"limits": {}}
        for marker in reversed(list(self._item.iter_markers(_MARKER))):
            unknown = [repr(value) for value in marker.args] + [key for key in marker.kwargs if key not in found]
            if unknown:
                raise UsageError(
                    f"the marker {_MARKER}: has no {', '.join(unknown)}. Allowed: {', '.join(found)}, by name."
                )
            given = _given(**marker.kwargs)
            # Limits belong to a mode, and are dropped if the mode changes.
            limits = {} if given.get("mode", found["mode"]) != found["mode"] and found["mode"] else found["limits"]
            found |= {**given, "limits": {**limits, **given.get("limits", {})}}
        return found

    @checked
    def _stem(self, name: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9_.+=-]{0,80}", name):
            raise UsageError(f"name: found {name[:100]!r}, expected up to 80 letters, digits and . _ - + = only.")
        # File systems of macOS and Windows do not distinguish names that differ only in case.
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
        # The baseline of a test that is expected to fail differs from its image, and is kept.
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
        """Return both images without ignored parts; unchanged if their sizes differ."""
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
        """Return the mode and its limits: the call overrides the marker, and the marker the options of the run."""
        of_the_run = {name: read_limits(name, texts) for name, texts in self._settings.limits.items()}
        known = marked["limits"] if mode is None or marked["mode"] in (None, mode) else {}
        mode = mode or marked["mode"] or self._settings.mode or default_mode(picture, reference)
        return mode, {**of_the_run.get(mode, {}), **known, **limits}

    def _fail(self, record: dict[str, Any], results: Path, limits: Mapping[str, float], headline: str) -> NoReturn:
        """Fail the test with a message that has the files to view, and commands to repeat and accept the result."""
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
        # Ids are relative to pytest's rootdir, but paths on its command line to the current folder.
        test = "::".join([shown_path(self._item.path), *record["test"].split("::")[1:]])
        commands["accept"] = f"pytest --glpath-update {wanted} {shlex.quote(test)}"
        return commands


@checked
def _given(
    *,
    mode: Mode | None = None,
    limits: Mapping[str, float] | None = None,
    baseline_path: str | Path | None = None,
    ignore: Ignore | None = None,
    style: Any = None,
    backend: str | None = None,
    savefig_kwargs: Mapping[str, Any] | None = None,
    remove_text: bool | None = None,
) -> dict[str, Any]:
    """Return the settings of a call or a marker that are not None. Raises UsageError for one of a wrong type."""
    return {key: value for key, value in locals().items() if value is not None}


def shown_path(path: str | Path) -> str:
    """Return a path, relative to the current folder if it is below."""
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
    """Return the baseline, or None if it cannot be read; the record then has the reason.

    An unreadable baseline is a failure that an update may fix. Raises UsageError if the baseline belongs to another
    test with the same file name. That happens if an image's name is appended, or if the file system ignores case.
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
    """Compare a picture with its reference, record the verdict, and return it.

    Returns None if the pictures cannot be compared, for example because their sizes differ.
    """
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
    """Write a baseline as .png or .exr at `path`, and return its path.

    The image for viewing is written first: if that fails, the old baseline is still complete. Raises UsageError if
    the image is too noisy to pass a comparison with itself.
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
    """Write the images for viewing into the folder of this image's results; return paths by kind.

    compared : both images without ignored parts; images of different sizes are padded with black

    An error of the system is added to the record's summary and not raised, because the test must report the
    difference.
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
            with contextlib.suppress(UsageError):  # flip-evaluator is optional; the report shows if it is missing
                shown["flip"] = flip_picture(a, b)
            for kind, image in shown.items():
                write_png(folder / f"{kind}.png", image)
                files[kind] = str(folder / f"{kind}.png")
    except (ImageError, OSError) as error:
        record["summary"] += f"\nthe pictures are not kept: {error}"
    return files


def _forget(folder: Path) -> None:
    """Remove the files that `_keep` wrote in an earlier run, and nothing else."""
    for kind in ("result", "reference", "difference", "flip"):
        for suffix in (".png", ".exr"):
            (folder / f"{kind}{suffix}").unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # the folder is missing or holds other files
        folder.rmdir()


def is_baseline(file: Path) -> bool | None:
    """Return True if glpath has written the file, as a baseline or as the PNG for viewing beside one.

    Returns None for unreadable images.
    """
    try:
        if file.suffix == ".exr":
            return Picture.is_baseline(read_exr_channels(file)[1])
        provenance = read_picture(file).provenance
    except ImageError:
        return None
    return PREVIEW in provenance or Picture.is_baseline(provenance)


def delete_baseline(file: Path) -> None:
    """Delete a baseline and the PNG for viewing beside it."""
    for path in (file, file.with_suffix(".png")):
        if os.path.exists(path) and is_baseline(path):
            path.unlink()
    with contextlib.suppress(OSError):  # the folder is not empty
        file.parent.rmdir()
