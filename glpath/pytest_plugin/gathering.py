"""What a whole pytest run has compared, on the controller as well as on the workers of pytest-xdist."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

# Outcomes of a comparison that the summary counts one by one, and what it calls them.
_SAID = {"written": "baseline written", "updated": "baseline replaced"}


class Gathering:
    """Gathers records from test reports, finds unused baselines, has the report written and prints the summary.

    records   : one per comparison, see `glpath.pytest_plugin.regression`
    collected : file of tests to the ids of what was collected from it
    partly    : files of which not all was selected: their baselines may be of tests that did not run
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
                named = self.config.invocation_params.dir / argument.split("::")[0]
                self.partly.add(str(Path(os.path.abspath(named))))

    def pytest_deselected(self, items: list[pytest.Item]) -> None:
        self.partly.update(str(item.path) for item in items)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.records += getattr(report, "glpath", [])
        if report.when == "call" and report.passed:
            self.passed.add(report.nodeid)
        elif not report.passed:
            self.others.add(report.nodeid)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        told = getattr(node, "workeroutput", {}).get("glpath", {})
        self.collected.update(told.get("collected", {}))
        self.partly.update(told.get("partly", ()))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self) -> None:
        output = getattr(self.config, "workeroutput", None)
        if output is not None:
            output["glpath"] = {"collected": self.collected, "partly": sorted(self.partly)}
        elif not self.config.option.collectonly:
            self._finish()

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self.lines:
            terminalreporter.section("glpath")
            for line in self.lines:
                terminalreporter.write_line(line)

    def _finish(self) -> None:
        unused = self._unused()
        asked = self.config.getoption("--glpath-report")
        if not (self.records or unused or asked):
            return
        # Not before: a run without pictures is to load nothing more.
        from glpath.errors import GlpathError
        from glpath.pytest_plugin.regression import Settings, shown_path
        from glpath.pytest_plugin.report import write_report

        results = Settings.of(self.config).results
        failures = [record for record in self.records if record["outcome"] in ("failed", "missing")]
        if self.records:
            self.lines.append(f"{_count(len(self.records), 'picture')} compared, {len(failures)} failed")
        for outcome, words in _SAID.items():
            files = [record["baseline"] for record in self.records if record["outcome"] == outcome]
            self.lines += [f"{words}: {shown_path(file)}" for file in sorted(files)]
        for file in unused:
            self.lines.append(f"no test uses this baseline: {shown_path(file)}")
        # A report of an earlier run that is left standing would speak of failures that are gone.
        if asked or failures or (results / "report.html").exists():
            try:
                path = write_report(results, asked or "html", self.records, [str(file) for file in unused])
                self.lines.append(f"report: {shown_path(path)}")
            except GlpathError as error:
                self.lines.append(f"the report is not written: {error}")

    def _unused(self) -> list[Path]:
        """Baselines of files whose tests all ran, which none of them asked for.

        A test that did not pass may have ended before it came to its picture: its baselines are not counted.
        """
        from glpath.pytest_plugin.places import baseline_folder, baseline_name

        used = {record["baseline"] for record in self.records}
        found: list[Path] = []
        for test_file, ids in self.collected.items():
            if test_file in self.partly or not set(ids) <= self.passed | self.others:
                continue
            folder = baseline_folder(self.config, Path(test_file))
            unsure = [baseline_name(nodeid) for nodeid in ids if nodeid in self.others]
            for file in sorted(folder.glob("*.exr")):
                if str(file) not in used and not any(file.stem.startswith(name) for name in unsure):
                    found.append(file)
        return found


def _count(n: int, word: str) -> str:
    return f"{n} {word}" if n == 1 else f"{n} {word}s"
