"""Signals with which users and schedulers end a program, which may save its state first."""

from __future__ import annotations

import signal


def _existing(*names: str) -> tuple[signal.Signals, ...]:
    """Return the signals that this system has; Windows has only SIGTERM."""
    return tuple(signal.Signals[name] for name in names if hasattr(signal, name))


#: Signals before the end of the process: from schedulers (SIGTERM, SIGUSR1 and SIGUSR2), a closed terminal
#: (SIGHUP), a limit of processor time (SIGXCPU) and Ctrl-\ (SIGQUIT).
TERMINATING = _existing("SIGTERM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGXCPU")
ENDING = (signal.SIGINT, *TERMINATING)
#: Signals that repeat without a second request: the kernel and the shell both send SIGHUP; SIGXCPU comes every
#: second.
REPEATED = _existing("SIGHUP", "SIGXCPU")
#: Names of TERMINATING, for help texts.
TERMINATING_TEXT = ", ".join(number.name for number in TERMINATING)


def is_interruption(error: BaseException | None) -> bool:
    """Return True for a KeyboardInterrupt, and for an exception that was raised from one or while handling one.

    Python itself raises RuntimeError from whatever leaves `__set_name__`, as while a module is imported.
    """
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


class SignalRecord:
    """First signal of a command, whichever code handles it.

    held : True if further signals wait, so that they do not break into cleaning up and saving
    """

    first: int | None = None
    held = False

    def record(self, number: int) -> None:
        """Record a signal; later ones change nothing."""
        if self.first is None:
            self.first = number


#: Records of the running commands: none in a Python program, one in the command line. Code that keeps signals from
#: a command's handler records them here, because other handlers may lie between the two.
RECORDS: list[SignalRecord] = []
