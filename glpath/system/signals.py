"""Signals by which people and schedulers end a program that may want to save something first."""

from __future__ import annotations

import signal


def _existing(*names: str) -> tuple[signal.Signals, ...]:
    """Return the signals that this system has: Windows has SIGTERM alone."""
    return tuple(signal.Signals[name] for name in names if hasattr(signal, name))


#: Signals that end the program for good soon: of schedulers (SIGTERM, SIGUSR1 and SIGUSR2), of a terminal that is
#: closed (SIGHUP), of a limit of processor time (SIGXCPU) and of Ctrl-\ (SIGQUIT).
TERMINATING = _existing("SIGTERM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGXCPU")
ENDING = (signal.SIGINT, *TERMINATING)
#: Those that come again without anybody's impatience: SIGHUP of the kernel and the shell, SIGXCPU once a second.
REPEATED = _existing("SIGHUP", "SIGXCPU")
#: TERMINATING in words, for help texts.
TERMINATING_TEXT = ", ".join(number.name for number in TERMINATING)
