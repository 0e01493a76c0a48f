"""The OpenGL context: one per process, created at the first request, on the best available device.

`devices` and `opening` choose that device.

A process has only one, because GL names its objects by small numbers, which mean other objects in another context.
If Python collects an object of one context while another is current, the object with that number in the other
context would be deleted. moderngl does not guard against it. Use two processes for two devices. No display is ever
terminated (eglTerminate), because EGL shares one per device within the process.

Threads. A context is current in one thread at a time, and only that thread can release it. A thread gets it by one
of two calls:

    with open_context() as context: ...    # waits its turn, and releases the context at the end
    context = get_context()                # for manual drawing: this thread keeps it until `leave`, or its end

Renders use the first call: once to create the engine, then for each step of half a second. So a live view can draw
during a render in another thread. Between the frames of `render_frames`, and outside of all calls, the context is
free. Only one render at a time uses the device (`rendering`), because each fills its memory.

The second call is for single-threaded programs and for exploring. It waits for running renders. Afterwards other
threads that request the context are refused, because they might wait forever. In a notebook they wait for the end
of the cell instead, and the next cell gets the context again. GL objects that Python collects in a thread without
the context are deleted by the next thread that has it (`opening.CollectingContext`). An exception, even Ctrl-C,
leaves the `with` block as usual.

Each device may be tried in a separate process first, because a broken driver can end the process that queries it.
Renders in a notebook's kernel try devices in this manner.

Costs:    about 20 ms on llvmpipe, up to a second on a hardware device, plus a Python start if the device is tried
          first; nothing when cached.
Poor at:  fork (see `Context.check`); speed-up by threads, because they take turns: start processes instead.
Source:   EGL 1.5, 3.7.3.
"""

from __future__ import annotations

import ctypes
import os
import threading
import weakref
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field

from glpath.errors import ContextError

try:
    import moderngl
except ImportError as missing:  # not every system and processor has a wheel
    raise ContextError(
        f"OpenGL cannot be reached: moderngl cannot be imported ({missing}).",
        "pip install moderngl, for which some systems need a compiler; `glpath doctor` lists what else is missing. "
        "info, validate, diff, export, radiosity and viewfactors need no OpenGL.",
    ) from missing

from glpath.gl.devices import DeviceInfo, chosen
from glpath.gl.fences import HeldFences
from glpath.gl.opening import CollectingContext, Opened, no_gpu, open_best
from glpath.gl.program import forget_programs
from glpath.gl.signals import SignalsWait
from glpath.gl.turns import Turns
from glpath.system.arguments import checked
from glpath.system.heartbeat import heartbeat
from glpath.system.interactive import around_cells, in_cell


class _Kept:
    """Token of a thread that keeps the context. When the thread ends, it is freed, and releases the context."""


@dataclass
class Context:
    """The process's moderngl context and the description of its device.

    `with context:` makes it current in this thread until the end of the block, unless the thread keeps it longer.
    Blocks may be nested. A thread waits for its turn; see the top of this module.

    gl   : the moderngl context; an object that Python collects frees its memory on the device
    info : description of the device
    pid  : id of the process that created it
    """

    gl: CollectingContext
    info: DeviceInfo
    pid: int
    _opened: Opened = field(repr=False)
    _destroyed: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        self._turns = Turns(_kept_elsewhere)
        self._here = threading.local()
        self._renders = threading.RLock()
        llvmpipe = self.info.renderer.startswith("llvmpipe")
        self._fences = HeldFences(self._opened.loader.load_opengl_function) if llvmpipe else None
        self._signals = SignalsWait(Context.__exit__.__code__)
        # In a notebook: the thread that holds the context while its cells run, and the number of cells that run,
        # one inside another.
        self._cell_thread: int | None = None
        self._cells = 0
        self._watches_cells = False

    def check(self) -> None:
        """Raise ContextError after a fork, or if the context was released.

        The driver's threads, locks and connection to the device do not survive a fork; the calls would hang or
        crash.

        Raises
        ------
        ContextError : with the call to use instead
        """
        if os.getpid() != self.pid:
            raise ContextError(
                f"OpenGL context made in process {self.pid}, used in its fork {os.getpid()}",
                'Start the child with spawn (multiprocessing.get_context("spawn")), '
                "or create the context after the fork.",
            )
        if self._destroyed:
            raise ContextError(
                f"OpenGL context on {self.info.renderer}: it was released", "get_context() makes another one."
            )

    def __enter__(self) -> Context:
        self.check()
        before = self._turns.depth
        if not before:
            self._signals.begin()
        try:
            self._turns.enter()
            self.check()  # another thread may have released the context meanwhile
            if not before:
                self._make_current()
            elif self.gl.objects:
                self.gl.gc()
        except BaseException:
            if self._turns.depth > before:
                self.__exit__()
            elif not before:
                self._signals.end()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        if os.getpid() != self.pid:
            return  # this process is a fork that was made within the block
        outermost = self._turns.depth == 1
        try:
            if self._turns.last and not self._destroyed:
                self._make_free()
        finally:
            self._turns.exit()
            if outermost:
                self._signals.end()

    def use(self) -> None:
        """Make the context current in this thread, which keeps it until it calls `leave` or ends.

        In a notebook the thread has the context while a cell runs. Raises ContextError like `check`, and if another
        thread keeps the context.
        """
        self.check()
        if in_cell():
            with self:
                self._keep_in_cells()
            return
        # Wait for a running render, because its next step would otherwise be refused the context.
        with self.rendering(), self:
            if not self._turns.kept:
                self._here.kept = kept = _Kept()
                weakref.finalize(kept, self._let_go).atexit = False
                self._turns.keep()

    def leave(self) -> None:
        """Give up the kept context, so that other threads may use it.

        Inside a `with` block they may use it after the block. Does nothing in a thread that does not keep it.
        """
        if self._turns.mine and self._cells:
            self._cell_thread, self._cells = None, 0
            self.__exit__()
        self._let_go()

    def rendering(self) -> AbstractContextManager[object]:
        """Return the lock that a render holds from the creation of its engine to its last step.

        So only one render runs at a time. The context itself is acquired step by step.
        """
        # A thread that has the context must not wait for a render that waits for the context.
        return nullcontext() if self._turns.mine else self._renders

    def drawn(self) -> None:
        """Record progress and hold a fence; called after every draw and dispatch, see `heartbeat` and `fences`."""
        heartbeat.beat()
        if self._fences is not None:
            self._fences.hold()

    def function(self, name: str, *arguments: type) -> Callable[..., None]:
        """Return a GL function without result that moderngl does not offer; `arguments` are its ctypes types."""
        return ctypes.CFUNCTYPE(None, *arguments)(self._opened.loader.load_opengl_function(name))

    def _make_current(self) -> None:
        self._opened.loader.__enter__()
        self.gl.holder = threading.get_ident()
        self.gl.gc()

    def _make_free(self) -> None:
        self.gl.holder = None
        self._opened.loader.__exit__(None, None, None)

    def _keep_in_cells(self) -> None:
        """Keep the context until the current cell ends, and get it again in each later cell.

        Other threads wait for the end of a cell.
        """
        if self._cells or self._turns.kept:
            return
        self.__enter__()
        self._cell_thread, self._cells = threading.get_ident(), 1
        if not self._watches_cells:
            self._watches_cells = True
            around_cells(self._begin_cell, self._end_cell)

    def _begin_cell(self) -> None:
        if self._cell_thread == threading.get_ident() and os.getpid() == self.pid and not self._destroyed:
            if not self._cells:
                self.__enter__()
            self._cells += 1

    def _end_cell(self) -> None:
        if self._cells and self._cell_thread == threading.get_ident() and os.getpid() == self.pid:
            self._cells -= 1
            if not self._cells:
                self.__exit__()

    def _let_go(self) -> None:
        if os.getpid() != self.pid or not (self._turns.mine and self._turns.kept):
            return
        try:
            if not self._turns.depth and not self._destroyed:
                self._make_free()
        finally:
            self._turns.drop()

    def _destroy(self) -> None:
        self._destroyed = True
        self._opened.destroy()


def _kept_elsewhere(thread: int) -> ContextError:
    names = {one.ident: one.name for one in threading.enumerate()}
    return ContextError(
        f"OpenGL context: thread {names.get(thread, thread)!r} keeps it since it called get_context(), and "
        f"{threading.current_thread().name!r} asks for it",
        "There, call get_context().leave() when nothing is drawn by hand any more; or have it for a while only:\n"
        "with glpath.gl.context.open_context() as context: ...",
    )


_lock = threading.RLock()
_context: Context | None = None


@checked
def open_context(
    backend: str = "auto", device: int | None = None, require_gpu: bool = False, *, probe_first: bool = False
) -> Context:
    """Return the context of this process, created at the first call, for use in `with`:

        with open_context() as context: ...

    Parameters
    ----------
    backend     : auto, egl or osmesa; auto takes GLPATH_BACKEND, or else the best backend
    device      : index of the EGL device in the list of `glpath devices`; None takes GLPATH_DEVICE, or the best
                  device
    require_gpu : refuse a software renderer instead of falling back to it
    probe_first : try each device in a separate process before this one, if this process must not end

    Raises
    ------
    ContextError : no such backend or device, no OpenGL 4.3, or software although a GPU is required. Also a device
                   other than this process's current one, or a forked process. In `with`: another thread keeps the
                   context
    """
    global _context
    with _lock:
        if _context is None:
            opened = open_best(*chosen(backend, device), require_gpu, probe_first)
            _context = Context(opened.gl, opened.info, os.getpid(), opened)
        else:
            _context.check()
            _refuse_another(_context.info, backend, device)
            if require_gpu and not _context.info.hardware:
                raise no_gpu([str(_context.info)])
        return _context


@checked
def get_context(
    backend: str = "auto", device: int | None = None, require_gpu: bool = False, *, probe_first: bool = False
) -> Context:
    """Return the context of `open_context`, current in this thread from now on: see `Context.use`."""
    context = open_context(backend, device, require_gpu, probe_first=probe_first)
    context.use()
    return context


def context_of(gl: moderngl.Context) -> Context:
    """Return the process's context, whose moderngl context is `gl`."""
    assert _context is not None, "there is no context"
    assert _context.gl is gl, "the process has one context"
    return _context


def release_context() -> None:
    """Destroy the process's context, so that the next `get_context` may take another device.

    Waits for other threads as `open_context` does. Objects created in the old context must not be used or released
    afterwards, because their numbers may name objects of the next context.
    """
    global _context
    context = _context
    if context is None:
        return
    with context:
        forget_programs(context.gl)
        context.leave()
        context._destroy()
    with _lock:
        if _context is context:
            _context = None


def _forget_after_fork() -> None:
    # A child process that ends, or collects an object of its parent, must not call into the dead driver.
    global _lock
    _lock = threading.RLock()
    if _context is not None:
        _context.gl.gc_mode = None


if hasattr(os, "register_at_fork"):  # Windows does not fork
    os.register_at_fork(after_in_child=_forget_after_fork)


def _refuse_another(info: DeviceInfo, backend: str, device: int | None) -> None:
    if backend == "auto" and device is None:
        return
    backend, device = chosen(backend, device)
    if backend != info.backend or device not in (None, info.index):
        asked = backend if device is None else f"{backend} device {device}"
        raise ContextError(
            f"{asked}: this process renders on {info.backend} device {info.index} already ({info.renderer})",
            "A process has one OpenGL context: start another process for another device,\n"
            "or end this one with glpath.gl.context.release_context() when all its renders are done.",
        )
