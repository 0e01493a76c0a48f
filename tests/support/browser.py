"""Headless Chromium, driven by Selenium, for tests of pages in a browser.

Needs Debian's chromium and chromium-driver and the extra `browser`; `make evidence` installs them. A module has

    pytestmark = browser.marks("jupyterlab")      # evidence; skipped with a reason if a part is missing

and a fixture that yields from `with browser.chrome() as driver`.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
SECONDS = 90


def marks(*modules: str, **needed: object) -> list[pytest.MarkDecorator]:
    """Return marks of evidence that needs the browser, these Python modules, and named things (false: missing)."""
    modules = ("selenium", *modules)
    found: dict[str, object] = {"chromium": CHROMIUM, "chromedriver": DRIVER}
    found |= {name: importlib.util.find_spec(name) for name in modules} | needed
    missing = [name for name, one in found.items() if not one]
    return [
        pytest.mark.evidence,
        pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}; `make evidence` does"),
        # Selenium leaves the sockets of answers to the garbage collector.
        pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
    ]


@contextlib.contextmanager
def chrome(*arguments: str, window: tuple[int, int] = (1200, 1000)) -> Iterator[Any]:
    """Start a separate browser with Chromium's `arguments`, without network access."""
    from selenium import webdriver

    os.environ["NO_PROXY"] = ",".join(filter(None, [os.environ.get("NO_PROXY"), "localhost", "127.0.0.1"]))
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for argument in (
        "--headless=new",
        "--disable-dev-shm-usage",
        "--no-proxy-server",
        f"--window-size={window[0]},{window[1]}",
        *(["--no-sandbox"] if os.geteuid() == 0 else []),  # Chromium's sandbox does not work as root
        *arguments,
    ):
        options.add_argument(argument)
    with webdriver.Chrome(options, webdriver.ChromeService(str(DRIVER))) as driver:
        driver.set_script_timeout(SECONDS)
        yield driver
