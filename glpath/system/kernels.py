"""Functions compiled for this CPU by numba; later runs find them in the cache (`kernel_cache`).

Compilation takes seconds, so the name of the kernel is reported; see `announced`.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import FunctionType
from typing import Any

from glpath.system.bounded_reading import without_bounds
from glpath.system.kernel_cache import NUMBA, KernelCache
from glpath.system.log import compilations
from glpath.system.private_interfaces import (
    NUMBA_OPTIONS,
    NUMBA_WITHOUT_PYTHON,
    import_numba,
    numba_cache,
    set_numba_cache,
)
from glpath.system.time_limit import check_time

numba = import_numba()
_njit: Any = numba.njit  # numba's type annotations lack some of the options used here

# With NUMBA_DISABLE_JIT functions are not compiled, so that debuggers can enter them.
_PLAIN = bool(getattr(numba.config, "DISABLE_JIT", False))

#: Names of the kernels that this process compiles; the others stay plain functions. None: all are compiled. It must
#: be set before the first kernel is decorated.
only: frozenset[str] | None = None

Report = Callable[[str], None]


# Kernels allocate no arrays, because compiling `np.empty` alone takes seconds. Callers allocate them in Python.
# Kernels then need no reference counts, whose atomic operations are slower than the work of inner loops.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", **NUMBA_OPTIONS}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function for the CPU on first use, and cache it on disk.

    Kernels release Python's global lock, so threads run in parallel. A kernel uses the arrays it is given and
    allocates none.
    """
    plain = _PLAIN or (only is not None and function.__name__ not in only)
    return function if plain else _kept(_for_types(_njit(**_OPTIONS)(function)))


def inner_kernel(function: Callable[..., Any]) -> Any:
    """Compile a function as a part of each kernel that calls it. Called from Python, it runs uncompiled."""
    if _PLAIN:
        return function
    return _as_python(_for_types(_njit(**_OPTIONS, **NUMBA_WITHOUT_PYTHON)(function)))


def outer(inner: Any) -> Any:
    """Compile the function of an inner kernel a second time, as a kernel that Python can call."""
    return kernel(getattr(inner, "py_func", inner))


def inner_sum(function: Callable[..., Any]) -> Any:
    """Compile an inner kernel that may add the terms of a sum in any order.

    The kernel adds many terms at a time, so the last bits of the sum depend on the processor.
    """
    if _PLAIN:
        return function
    return _as_python(_for_types(_njit(**_OPTIONS, **NUMBA_WITHOUT_PYTHON, fastmath={"reassoc"})(function)))


def kernel_part(function: Callable[..., Any]) -> Any:
    """Compile an inner kernel that only one line calls, and inline it there."""
    return function if _PLAIN else _as_python(_njit(**_OPTIONS, inline="always")(function))


def _as_python(dispatcher: Any) -> Any:
    """Make calls from Python run the uncompiled function.

    Inner kernels have no wrapper for Python, so a call of the compiled function would jump to address 0.
    """
    kind = type(dispatcher)

    class Inner(kind):  # type: ignore[misc, valid-type]
        def __call__(self, *arguments: Any) -> Any:
            return self.py_func(*arguments)

    dispatcher.__class__ = Inner
    return dispatcher


def _for_types(dispatcher: Any) -> Any:
    """Make numba compile a function for the arguments' types alone, so that all integers share one compilation.

    Numba would otherwise compile the function again for each literal argument and each literal initial value.
    """
    compile_now = dispatcher.compile

    def compile_types(signature: Any) -> Any:
        plain = tuple(map(NUMBA.types.unliteral, signature)) if isinstance(signature, tuple) else signature
        return compile_now(plain)

    dispatcher.compile = compile_types
    return dispatcher


class _Compilations:
    """State of this process's compilations, guarded by numba's compiler lock.

    running  : True while a kernel is compiled; functions compiled meanwhile belong to that kernel
    expected : names of the kernels that are not compiled yet; empty if unknown
    done     : number of kernels whose compilation began, or that another process compiled
    report   : function that gets a text for each kernel; None: the log gets it
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
        # Count kernels that another process has compiled, so that the numbers in the reports reach the total.
        self.done += name in self.expected

    def _next(self) -> str:
        return f" {self.done + 1}/{max(len(self.expected), self.done + 1)}" if self.expected else ""

    def _report(self, text: str) -> None:
        if self.report is not None:
            self.report(text)
        else:
            compilations.warning("%s", text)


_compilations = _Compilations()


def waiting(kernels: Iterable[Any]) -> list[Any]:
    """Return the kernels that are compiled neither in this process nor in the cache."""
    made = [k for k in kernels if not isinstance(k, FunctionType)]
    return [k for k in made if not (k.signatures or _holds_any(numba_cache(k)))]


def _holds_any(cache: Any) -> bool:
    return isinstance(cache, KernelCache) and cache.holds_any()


def cache_folder(kernel: Any) -> Path | None:
    """Return the cache folder of a kernel; None if it is not writable, or if other users can write to it."""
    cache = None if isinstance(kernel, FunctionType) else numba_cache(kernel)
    return cache.folder if isinstance(cache, KernelCache) and not cache.refusal() else None


@contextmanager
def announced(expected: Iterable[Any], report: Report | None = None) -> Iterator[None]:
    """Context in which compilations are reported as `compiling kernels: cast_groups 3/12`.

    expected : kernels that are not compiled yet
    report   : function that gets the text; None: the log gets it
    """
    before = _compilations.expected, _compilations.done, _compilations.report
    names = frozenset(k.__name__ for k in expected)
    _compilations.expected, _compilations.done, _compilations.report = names, 0, report
    try:
        yield
    finally:
        _compilations.expected, _compilations.done, _compilations.report = before


class _Outermost(NUMBA.event.Listener):  # type: ignore[misc, name-defined]
    """Listener that reports each kernel that is compiled, but neither its parts nor kernels from the cache."""

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
    """Listener that ends a compilation between two compiler passes if a time limit is over."""

    def on_start(self, event: Any) -> None:
        check_time("compiling kernels")

    def on_end(self, event: Any) -> None:
        pass


NUMBA.event.register("numba:run_pass", _InTime())


@contextmanager
def _running() -> Iterator[None]:
    """Context in which a kernel and all kernels that it calls are compiled."""
    # The compiler's objects are all in use, so searching them for cyclic garbage would waste a twelfth of the time.
    collects = gc.isenabled()
    gc.disable()
    _compilations.running = True
    try:
        with without_bounds():
            yield
    finally:
        _compilations.running = False
        if collects:
            gc.enable()


def _kept(dispatcher: Any) -> Any:
    """Return the function with a cache on disk; only one process at a time compiles it."""
    cache = None
    # Numba raises if neither the folder of the file nor the user's cache is writable.
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
