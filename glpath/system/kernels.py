"""Functions that numba compiles for this CPU, once: later runs find them in the cache (`kernel_cache`).

What is compiled is named while it is, since it takes seconds; see `announced`.
"""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import FunctionType
from typing import Any

import numba

from glpath.system.kernel_cache import NUMBA, KernelCache
from glpath.system.private_interfaces import (
    NUMBA_OPTIONS,
    NUMBA_WITHOUT_PYTHON,
    numba_cache,
    set_numba_cache,
)
from glpath.system.time_limit import check_time

_njit: Any = numba.njit  # whose types know neither of all options
log = logging.getLogger("glpath")

# NUMBA_DISABLE_JIT leaves plain functions, for debuggers.
_PLAIN = bool(getattr(numba.config, "DISABLE_JIT", False))

#: The names of the kernels that this process compiles, the others being plain functions; None for all.
#: Set before any is made.
only: frozenset[str] | None = None

Report = Callable[[str], None]


# Neither makes arrays: to compile `np.empty` alone takes seconds, and without arrays that come and go no references
# are counted, which is atomic and takes longer than what is done in inner loops. Python makes all room there is.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", **NUMBA_OPTIONS}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile for the CPU on first use, cached on disk, without Python's lock, so that threads run side by side.

    It works in arrays that it is given, and makes none.
    """
    plain = _PLAIN or (only is not None and function.__name__ not in only)
    return function if plain else _kept(_for_types(_njit(**_OPTIONS)(function)))


def inner_kernel(function: Callable[..., Any]) -> Any:
    """As `kernel`, for what kernels call: it is compiled as a part of them alone. From Python it runs as Python."""
    if _PLAIN:
        return function
    return _as_python(_for_types(_njit(**_OPTIONS, **NUMBA_WITHOUT_PYTHON)(function)))


def outer(inner: Any) -> Any:
    """An inner kernel as a kernel, for Python to call: compiled once more, alone."""
    return kernel(getattr(inner, "py_func", inner))


def inner_sum(function: Callable[..., Any]) -> Any:
    """As `inner_kernel`, for a loop whose terms do not depend on each other: it adds them up in any order, many
    at a time, so that the last bits of the sum depend on the processor."""
    if _PLAIN:
        return function
    return _as_python(_for_types(_njit(**_OPTIONS, **NUMBA_WITHOUT_PYTHON, fastmath={"reassoc"})(function)))


def kernel_part(function: Callable[..., Any]) -> Any:
    """As `inner_kernel`, for what is called once: it is compiled as if it stood there."""
    return function if _PLAIN else _as_python(_njit(**_OPTIONS, inline="always")(function))


def _as_python(dispatcher: Any) -> Any:
    """Without numba's wrapper for Python a call from there would jump to address 0."""
    kind = type(dispatcher)

    class Inner(kind):  # type: ignore[misc, valid-type]
        def __call__(self, *arguments: Any) -> Any:
            return self.py_func(*arguments)

    dispatcher.__class__ = Inner
    return dispatcher


def _for_types(dispatcher: Any) -> Any:
    """The function, compiled once for all integers: numba would compile it for each literal that it is called with,
    and for the literal that a variable begins with."""
    compile_now = dispatcher.compile

    def compile_types(signature: Any) -> Any:
        plain = tuple(map(NUMBA.types.unliteral, signature)) if isinstance(signature, tuple) else signature
        return compile_now(plain)

    dispatcher.compile = compile_types
    return dispatcher


class _Compilations:
    """Compilations of this process, guarded by the lock of numba's compiler.

    running  : a kernel is being made, and all that is compiled is part of it
    expected : names of the kernels that are not compiled yet; empty where that is not known
    done     : how many of them were begun, or came from another process
    report   : what hears of each; None for a line of the log
    """

    def __init__(self) -> None:
        self.running = False
        self.expected: frozenset[str] = frozenset()
        self.done = 0
        self.report: Report | None = None

    def begin(self, name: str) -> None:
        self._report(f"compiling kernels: {name.strip('_')}{self._next()}")
        self.done += 1

    def wait(self, name: str) -> None:
        self._report(f"waiting for {name.strip('_')}{self._next()}, which another process compiles")

    def loaded(self, name: str) -> None:
        # Were it not counted, the last would not seem to be the last.
        self.done += name in self.expected

    def _next(self) -> str:
        return f" {self.done + 1}/{max(len(self.expected), self.done + 1)}" if self.expected else ""

    def _report(self, text: str) -> None:
        if self.report is not None:
            self.report(text)
        else:
            # A warning, since that is what logging shows by default.
            log.warning("%s", text)


_compilations = _Compilations()


def waiting(kernels: Iterable[Any]) -> list[Any]:
    """The kernels that are not compiled yet, neither in this process nor in the cache."""
    made = [k for k in kernels if not isinstance(k, FunctionType)]
    return [k for k in made if not (k.signatures or _holds_any(numba_cache(k)))]


def _holds_any(cache: Any) -> bool:
    return isinstance(cache, KernelCache) and cache.holds_any()


def cache_folder(kernel: Any) -> Path | None:
    """Where a kernel is kept; None where no folder can be written to, or by other users, too."""
    cache = None if isinstance(kernel, FunctionType) else numba_cache(kernel)
    return cache.folder if isinstance(cache, KernelCache) and not cache.refusal() else None


@contextmanager
def announced(expected: Iterable[Any], report: Report | None = None) -> Iterator[None]:
    """While it lasts, kernels that are compiled are reported as `compiling kernels: cast_groups 3/12`.

    expected : those that are not compiled yet
    report   : gets the text; without it, the log does
    """
    before = _compilations.expected, _compilations.done, _compilations.report
    names = frozenset(k.__name__ for k in expected)
    _compilations.expected, _compilations.done, _compilations.report = names, 0, report
    try:
        yield
    finally:
        _compilations.expected, _compilations.done, _compilations.report = before


class _Outermost(NUMBA.event.Listener):  # type: ignore[misc, name-defined]
    """Reports the kernel that is compiled, not the functions in it. Loading is not compiling."""

    def on_start(self, event: Any) -> None:
        if not self._depth and _compilations.running:
            _compilations.begin(event.data["dispatcher"].py_func.__name__)
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1

    def __init__(self) -> None:
        self._depth = 0


NUMBA.event.register("numba:compile", _Outermost())


class _InTime(NUMBA.event.Listener):  # type: ignore[misc, name-defined]
    """Ends a compilation between two of its passes where a time limit is over."""

    def on_start(self, event: Any) -> None:
        check_time("compiling kernels")

    def on_end(self, event: Any) -> None:
        pass


NUMBA.event.register("numba:run_pass", _InTime())


@contextmanager
def _running() -> Iterator[None]:
    """While a kernel is compiled, with all kernels that it calls."""
    # All that the compiler makes is in use, and to look for cyclic garbage in it takes a twelfth of the time.
    collects = gc.isenabled()
    gc.disable()
    _compilations.running = True
    try:
        yield
    finally:
        _compilations.running = False
        if collects:
            gc.enable()


def _kept(dispatcher: Any) -> Any:
    """The function, with a cache, and compiled by one process at a time."""
    cache = None
    # Numba raises where neither the folder of the file nor the user's cache can be written to.
    with suppress(RuntimeError):
        cache = KernelCache(dispatcher.py_func, _compilations.wait, _compilations.loaded)
        set_numba_cache(dispatcher, cache)
    compile_now = dispatcher.compile

    def compile_alone(signature: Any) -> Any:
        with NUMBA.compiler_lock, ExitStack() as alone:
            if not _compilations.running:
                alone.enter_context(_running())
            if cache is not None:
                cache.alone = alone
            try:
                return compile_now(signature)
            finally:
                if cache is not None:
                    cache.alone = None

    dispatcher.compile = compile_alone
    return dispatcher
