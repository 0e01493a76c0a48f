"""Collection of all comparisons of a pytest run, on the controller and on workers of pytest-xdist."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from glpath.apps.image_tests.paths import baseline_folder, baseline_name, id_in_file, results_root
from glpath.apps.image_tests.settings import chosen

# Outcomes that the summary lists individually, with their texts.
_REPORTED = {"written": "baseline written", "updated": "baseline replaced", "missing": "baseline missing"}


class Gathering:
    """Collects records from test reports, finds unused baselines, starts the report, and prints the summary.

    records   : one per comparison, see `glpath.apps.image_tests.regression`
    collected : ids of the collected tests by test file
    partly    : test files that were not selected completely, whose baselines may belong to tests that did not run
    passed    : ids of the tests that passed
    others    : ids of the tests that failed or were skipped
    lines     : lines of the summary
    """

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.records: list[dict[str, Any]] = []
        self.collected: dict[str, list[str]] = {}
        self.partly: set[str] = set()
        self.passed: set[str] = set()
        self.others: set[str] = set()
        self.lines: list[str] = []

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        for item in items:
            self.collected.setdefault(str(item.path), []).append(item.nodeid)
        for argument in map(str, self.config.args):
            if "::" in argument:
                named = os.path.abspath(self.config.invocation_params.dir / argument.split("::")[0])
                # A name that is no collected file, as with --pyargs, may stand for any of the files.
                self.partly.update([named] if named in self.collected else self.collected)
        if self.config.getoption("lf", False):  # --lf removes tests without `pytest_deselected`
            self.partly.update(self.collected)

    def pytest_deselected(self, items: list[pytest.Item]) -> None:
        self.partly.update(str(item.path) for item in items)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if str(report.outcome) != "rerun":  # pytest-rerunfailures will repeat the test
            self.records += getattr(report, "glpath", [])
        if report.when == "call" and report.passed:
            self.passed.add(report.nodeid)
        elif not report.passed:
            self.others.add(report.nodeid)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        output = getattr(node, "workeroutput", {}).get("glpath", {})
        self.collected.update(output.get("collected", {}))
        self.partly.update(output.get("partly", ()))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        output = getattr(self.config, "workeroutput", None)
        if output is not None:
            output["glpath"] = {"collected": self.collected, "partly": sorted(self.partly)}
        elif not self.config.option.collectonly:
            unused = self._unused()
            self._finish(unused)
            if unused and chosen(self.config, "unused") == "fail" and session.exitstatus == pytest.ExitCode.OK:
                session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self.lines:
            terminalreporter.section("glpath")
            for line in self.lines:
                terminalreporter.write_line(line)

    def _finish(self, unused: list[Path]) -> None:
        asked = chosen(self.config, "report")
        if not (self.records or unused or asked):
            return
        # Imported here, because a run without images must not load more modules.
        from glpath.apps.image_tests.regression import shown_path
        from glpath.apps.image_tests.report import write_report
        from glpath.errors import GlpathError

        results = results_root(self.config)
        failures = [record for record in self.records if record["outcome"] in ("failed", "missing")]
        expected = sum(record["outcome"] == "xfailed" for record in self.records)
        if self.records:
            stored = sum(record["outcome"] == "written" for record in self.records)
            counts = [f"{_count(stored, 'picture')} stored"] if stored else []
            if compared := len(self.records) - stored:
                counts += [f"{_count(compared, 'picture')} compared, {len(failures)} failed"]
                counts += [f"{expected} expected to"] if expected else []
            self.lines.append(", ".join(counts))
        for outcome, words in _REPORTED.items():
            files = [record["baseline"] for record in self.records if record["outcome"] == outcome]
            self.lines += [f"{words}: {shown_path(file)}" for file in sorted(files)]
        self.lines += list(self._report_unused(unused))
        shows_all = chosen(self.config, "keep") == "all"
        kinds = {asked} if asked else {"html"} if failures or shows_all else set()
        if os.path.exists(results / "report.html"):
            kinds.add("html")  # an old report would show failures that no longer exist
        for kind in sorted(kinds):
            try:
                path = write_report(results, kind, self.records, [str(file) for file in unused])
                self.lines.append(f"report: {shown_path(path)}")
            except GlpathError as error:
                self.lines.append(f"the report is not written: {error}")

    def _report_unused(self, unused: list[Path]) -> Iterator[str]:
        """Yield a line for each unused baseline; delete the baselines too if the option `unused` is "delete"."""
        from glpath.apps.image_tests.regression import delete_baseline, is_baseline, shown_path

        delete = chosen(self.config, "unused") == "delete"
        for file in unused:
            if is_baseline(file) is None:
                yield f"no test uses this file, which is no picture: {shown_path(file)}; delete it by hand"
                continue
            try:
                if delete:
                    delete_baseline(file)
                yield f"{'unused baseline deleted' if delete else 'no test uses this baseline'}: {shown_path(file)}"
            except OSError as error:
                yield f"{shown_path(file)}: cannot be deleted: {error.strerror}"
        if unused and not delete:
            yield "to delete what no test uses: pytest --glpath-unused delete"

    def _unused(self) -> list[Path]:
        """Return baselines that no test requested, of test files whose tests all ran, and of missing test files.

        A test that did not pass may have ended before its image, so its baselines are not included.
        """
        used = {record["baseline"].rpartition(".")[0] for record in self.records}
        folders: dict[Path, list[str]] = {}  # by folder, start of names that tests that did not pass may have used
        for test_file, ids in self.collected.items():
            used_folders = {baseline_folder(self.config, Path(test_file))}
            used_folders |= {
                Path(record["baseline"]).parent for record in self.records if record["file"] == test_file
            }
            unsure = [baseline_name(id_in_file(nodeid)) for nodeid in ids if nodeid in self.others]
            complete = test_file not in self.partly and set(ids) <= self.passed | self.others
            for folder in used_folders:
                folders[folder] = unsure if complete else [""]
        # A folder is named after its test file. If that file is missing, all baselines in the folder are unused.
        for test_file in self.collected:
            root = baseline_folder(self.config, Path(test_file)).parent
            for folder in root.iterdir() if os.path.isdir(root) else ():
                test_of_folder = Path(test_file).with_name(f"{folder.name}.py")
                if os.path.isdir(folder) and not os.path.exists(test_of_folder):
                    folders.setdefault(folder, [])
        found: dict[str, Path] = {}
        for folder, unsure in folders.items():
            # The .exr comes first and stands for the pair, because the .png beside it is for viewing.
            for file in sorted((*folder.glob("*.exr"), *folder.glob("*.png"))):
                stem = str(file).rpartition(".")[0]
                if stem not in used and not any(file.name.startswith(name) for name in unsure):
                    found.setdefault(stem, file)
        if not found:
            return []
        from glpath.apps.image_tests.regression import is_baseline

        return [file for _, file in sorted(found.items()) if is_baseline(file) is not False]


def _count(n: int, word: str) -> str:
    return f"{n} {word}" if n == 1 else f"{n} {word}s"
