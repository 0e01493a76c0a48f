"""Programs that run beside the tests, and stand still while a test measures time."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Self


class Beside:
    """A Python program in the background, of the lowest priority.

    seconds : that it ran, without those in which it stood still
    enough  : seconds after which it may stand still for good, as it would only take time from the tests
    """

    def __init__(self, arguments: list[str], log: Path, enough: float = math.inf, **environment: str) -> None:
        self._log = log
        self.enough = enough
        with log.open("wb") as file:
            self.process = subprocess.Popen(
                ["nice", "-n", "19", sys.executable, "-X", "faulthandler", *arguments],
                env=os.environ | environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
            )
        self._since: float | None = time.monotonic()
        self._before = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.end()

    @property
    def seconds(self) -> float:
        return self._before + (time.monotonic() - self._since if self._since is not None else 0.0)

    def stand_still(self) -> None:
        if self._since is None:
            return
        self._before, self._since = self.seconds, None
        self.process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        if self._since is not None or self.seconds >= self.enough:
            return
        self._since = time.monotonic()
        self.process.send_signal(signal.SIGCONT)

    def wait(self, seconds: float) -> bool:
        """Until it ran for so long: whether it still does then."""
        while self.seconds < seconds and self.process.poll() is None:
            time.sleep(0.1)
        return self.process.poll() is None

    def end(self) -> str:
        """What it wrote, once it has ended."""
        self.process.kill()
        self.process.wait()
        return self._log.read_text(errors="replace")


#: Those that run now; started by the first test that is `beside` others, before all tests.
running: dict[str, Beside] = {}
