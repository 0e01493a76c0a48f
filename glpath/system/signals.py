"""Signals by which people and schedulers end a program that may want to save something first."""

from __future__ import annotations

import signal

#: Those that schedulers send before they end a program for good; Windows has no SIGUSR1.
OF_SCHEDULERS = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGUSR1") if hasattr(signal, name))
ENDING = (signal.SIGINT, *OF_SCHEDULERS)
