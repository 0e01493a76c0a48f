"""Connection to the workers of a cluster (Dask distributed): local processes, or workers of a scheduler.

Trust:    a Dask scheduler runs any code that a client sends on all workers, and a client unpickles data from
          workers. So all parts of a cluster trust each other fully, and anybody who can connect can act as the
          cluster's user on every machine. Therefore local processes listen only on the loopback interface. They
          use TLS with a temporary key that is kept only in memory, so other users of the machine cannot connect.
          Without TLS a warning is printed, because anybody who reaches the port can run code.
Cost:     seconds to start a local process, with its own context and shaders.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import math
import os
import signal
import socket
import time
from collections.abc import Iterator
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Self

from glpath.errors import ContextError, GlpathError, UsageError
from glpath.gl.signals import SignalsWait
from glpath.jobs.worker import Sharable, hold, let_go
from glpath.system.arguments import checked
from glpath.system.files import MAX_TEXT_BYTES, read_bytes, reason_of
from glpath.system.log import log
from glpath.system.machine import core_count
from glpath.system.numerals import unsigned
from glpath.system.signals import ENDING
from glpath.system.time_limit import GRACE, check_time, seconds_left

# Prefix of addresses of local processes.
_LOCAL = "local:"
# Maximum number of local processes.
_MAX_LOCAL = 1024
_LOOPBACK = "127.0.0.1"
# Time during which a refused connection is tried again, seconds; a new scheduler listens after a second or two.
_REFUSED_S = 5.0
# Maximum number of attempts to make a client if its thread does not start within Dask's timeout.
_LOOP_STARTS = 3
# Time for which a broken connection may recover, seconds.
_LOST_S = 3.0
# Maximum time for a local process to end its task before it is killed, seconds.
_END_S = 1.0
# Maximum time to wait for a scheduler's answer, seconds.
_ANSWER_S = 30.0
# Signals that child processes do not get. Dask sends SIGTERM to workers that fail to start, so it is not blocked.
_BLOCKED = set(ENDING) - {signal.SIGTERM}
_ENCRYPTED = ("tls://", "wss://", "inproc://")
# Work that errors of the time limit name.
_CONNECTING = "connecting to the cluster"


class Connection:
    """Connection to workers, which are local processes or those of a Dask scheduler.

    address   : "local:N" for N local processes; otherwise an address for `distributed.Client`, "tls://host:port" or
                "tcp://host:port", with Dask's own configuration (TLS, timeouts), or the path of a scheduler file
    dashboard : True to show Dask's dashboard of local processes on a free port of the loopback interface,
                `client.dashboard_link`; it needs the package bokeh. The dashboard has no password, so every user of
                this machine can read it

    Raises UsageError for an invalid address, ContextError if the scheduler does not answer, and GlpathError if the
    package distributed is missing. The log gets a warning if the scheduler does not use TLS; the docstring of this
    module explains the risk.
    """

    @checked
    def __init__(self, address: str | Path, dashboard: bool = False) -> None:
        self.address = os.fspath(address)
        self._local: Any = None
        self._lost_at: float | None = None
        self._quiet = contextlib.ExitStack()
        distributed = _distributed()
        hide_teardown()
        self._quiet.enter_context(quiet(logging.WARNING))
        try:
            if self.address.startswith(_LOCAL):
                signals = SignalsWait(Connection._start_local.__code__)
                signals.begin()
                try:
                    self._start_local(distributed, _count(self.address), dashboard)
                finally:
                    signals.end()
            else:
                self.client = _connected(distributed, self.address)
                _warn_if_open(self.address, self.client.scheduler.address)
        except BaseException:
            self.close()
            raise

    def _start_local(self, distributed: Any, count: int, dashboard: bool) -> None:
        """Start local processes. Signals are deferred until the end: Dask cannot close a half-started cluster."""
        self._local = _local_cluster(distributed, count, dashboard)
        self.client = distributed.Client(self._local, set_as_default=False, direct_to_workers=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the cluster, and end local processes."""
        with quiet():
            with contextlib.suppress(Exception):
                self.client.close(timeout=5)
            if self._local is not None:
                with contextlib.suppress(Exception):
                    self._local.sync(self._end_local_workers, callback_timeout=5)
                with contextlib.suppress(Exception):
                    self._local.close(timeout=10)
        self._quiet.close()

    async def _end_local_workers(self) -> None:
        """End local processes, also within a task, whose result nobody needs; Dask would wait for seconds."""
        await asyncio.gather(*(nanny.close(timeout=_END_S) for nanny in self._local.workers.values()))

    def check(self) -> None:
        """Raise ContextError if the connection to the scheduler has been broken for some seconds.

        The check sends nothing, so it costs no time. Dask itself retries for half a minute, and a call to the
        scheduler would wait as long.
        """
        if self.client.status == "running":
            self._lost_at = None
            return
        now = time.monotonic()
        if self._lost_at is None:
            self._lost_at = now
            self._quiet.enter_context(quiet())  # because Dask logs a traceback for each attempt
        if now - self._lost_at >= _LOST_S or self.client.status == "closed":
            raise self._gone("the connection broke")

    @property
    def connected(self) -> bool:
        """True if the scheduler is connected now."""
        return bool(self.client.status == "running")

    def workers(self) -> list[str]:
        """Return the addresses of the present workers. Raises ContextError if the scheduler does not answer."""
        wait = _patience(_ANSWER_S)
        try:
            return sorted(self.client.nthreads(callback_timeout=wait))
        except Exception as error:
            raise self._gone(str(error) or f"no answer in {wait:.3g} s") from error

    def share(self, shared: Sharable) -> None:
        """Send shared data to each present and future worker. Raises ContextError if the scheduler is gone."""
        try:
            self.client.register_plugin(_sharing(_distributed(), shared), name=shared.token)
        except OSError as error:
            raise self._gone(reason_of(error)) from error

    def _gone(self, reason: str) -> ContextError:
        return ContextError(
            f"cluster {self.address}: the scheduler is gone: {reason.rstrip('.')}.",
            "Start it again; a render that keeps a checkpoint resumes from it.",
        )

    def forget(self, shared: Sharable) -> None:
        """Delete shared data on all workers."""
        self.client.unregister_worker_plugin(shared.token)


def _sharing(distributed: Any, shared: Sharable) -> Any:
    class Sharing(distributed.WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: object) -> None:
            hide_teardown()
            hold(shared)

        def teardown(self, worker: object) -> None:
            let_go(shared.token)

    return Sharing()


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise GlpathError(
            "cluster: needs the package distributed, which is not installed.",
            "pip install 'glpath[cluster]', on all machines.",
        ) from error
    except Exception as error:  # Dask reads its configuration when it is imported
        raise GlpathError(f"cluster: Dask cannot be imported: {reason_of(error)}.") from error
    return distributed


def _count(address: str) -> int:
    count = unsigned(address.removeprefix(_LOCAL))
    if count is None or not 1 <= count <= _MAX_LOCAL:
        raise UsageError(
            f"cluster {address}: expected a number of processes from 1 to {_MAX_LOCAL}, as in local:4."
        )
    return count


def _local_cluster(distributed: Any, count: int, dashboard: bool) -> Any:
    cores = core_count()
    share = cores // count
    # Divide the cores among the processes, because llvmpipe would use all cores in each of them. With 0 threads,
    # llvmpipe renders in the calling thread. 1 is avoided, because a single llvmpipe thread has a race.
    threads = {"LP_NUM_THREADS": str(share if share > 1 else 0)} if count > 1 else {}
    import dask

    # The scheduler does not repeat tasks of lost workers, because glpath.jobs.chunks does, with limits of its own.
    settings: dict[str, Any] = {"distributed.scheduler.allowed-failures": 0}
    if not dashboard:
        # Schedulers and workers always listen for HTTP. Without routes they answer no request.
        settings |= {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
    try:
        with dask.config.set(settings), _safe_path(), _signals_blocked():
            return distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                memory_limit=None,
                host=_LOOPBACK,
                protocol="tls://",
                security=_temporary_security(distributed),
                dashboard_address=f"{_LOOPBACK}:0" if dashboard else None,
                # Without an address, Dask would try a fixed port first.
                scheduler_kwargs={"dashboard": dashboard, "dashboard_address": f"{_LOOPBACK}:0"},
                silence_logs=logging.ERROR,
                env={name: value for name, value in threads.items() if name not in os.environ},
            )
    except RuntimeError as error:
        raise ContextError(f"cluster {_LOCAL}{count}: the processes do not start: {error}.") from error


@contextlib.contextmanager
def _safe_path() -> Iterator[None]:
    """Context in which child processes import no modules of the current folder, unless the variable is set already.

    Child processes start by `python -c`. They get `sys.path` of this process, but only after their first imports.
    Workers that Dask starts later, after others have died, are not covered in a Python program, because a variable
    that stayed set would also change the programs that the user starts.
    """
    if "PYTHONSAFEPATH" in os.environ:
        yield
        return
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        os.environ.pop("PYTHONSAFEPATH", None)


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """Context in which child processes are started without the signals that a terminal sends to a whole command.

    Child processes inherit the mask of blocked signals, and so does the resource tracker of `multiprocessing`,
    which SIGHUP would end. Starting the tracker unblocks SIGINT, so the signals are blocked again afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _BLOCKED)
    try:
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, _BLOCKED)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _temporary_security(distributed: Any) -> Any:
    """Return a key and certificate that exist only in memory; all processes of one cluster must have them."""
    try:
        return distributed.Security.temporary()
    except ImportError as error:
        raise GlpathError(
            "cluster: processes of this machine speak TLS, which needs the package cryptography.",
            "pip install 'glpath[cluster]'.",
        ) from error


def _connected(distributed: Any, address: str) -> Any:
    # "tls://host:8786" could also be a file, whose content names another scheduler.
    is_address = "://" in address
    if not is_address and not os.path.exists(address):
        raise UsageError(
            f"cluster {address}: is neither local:N, nor an address such as tls://scheduler:8786, nor a "
            "scheduler's file."
        )
    kind = {"address" if is_address else "scheduler_file": address}
    named = address if is_address else _address_in(address)
    _check_encryption(distributed, address, named)
    try:
        _wait_while_refused(named)
        return _client(distributed, kind)
    except (OSError, ValueError, TimeoutError) as error:
        check_time(_CONNECTING)
        reason = str(error).splitlines()[0] if str(error) else "timed out"
        raise ContextError(
            f"cluster {address}: no scheduler answers: {reason}.",
            "Start one (dask scheduler --protocol tls) and workers (dask worker tls://HOST:8786 --nthreads 1), "
            "and name it here.",
        ) from error


def _client(distributed: Any, kind: dict[str, str]) -> Any:
    for attempt in range(_LOOP_STARTS):
        check_time(_CONNECTING)
        try:
            return distributed.Client(**kind, **_client_timeout(), set_as_default=False, direct_to_workers=True)
        except AssertionError:  # Dask's error if its thread did not start within 10 s on an overloaded machine
            log.debug("the thread of Dask's event loop did not start, attempt %d", attempt + 1)
    raise TimeoutError("the thread of Dask's event loop does not start; is this machine overloaded?")


def _client_timeout() -> dict[str, float]:
    """Return the time for which a client waits for its scheduler: Dask's own, or less within a time limit."""
    if seconds_left() == math.inf:
        return {}
    import dask
    from dask.utils import parse_timedelta

    return {"timeout": _patience(parse_timedelta(dask.config.get("distributed.comm.timeouts.connect")))}


def _patience(longest: float) -> float:
    """Return `longest`, or the seconds until the time limit and its grace are over if they are fewer."""
    return min(longest, max(0.0, seconds_left()) + GRACE)


def _address_in(path: str) -> str:
    """Return the address in a scheduler file. Raises UsageError for any other file, ContextError if unreadable."""
    if not os.path.isfile(path):
        raise UsageError(f"cluster {path}: is not a file.", "Name the file of dask scheduler --scheduler-file.")
    try:
        address = json.loads(read_bytes(path, MAX_TEXT_BYTES))["address"]
        if not (isinstance(address, str) and address):
            raise ValueError
        return address
    except OSError as error:
        raise ContextError(f"cluster {path}: cannot be read: {reason_of(error)}.") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(
            f"cluster {path}: is not the file of a scheduler.", "Name the file of dask scheduler --scheduler-file."
        ) from error


def _wait_while_refused(address: str) -> None:
    """Wait while an address refuses connections. Raises ConnectionRefusedError after some seconds.

    Dask itself would retry for half a minute. Other errors are left to Dask.
    """
    host, _, text = address.partition("://")[2].rpartition(":")
    port = unsigned(text)
    until = time.monotonic() + _REFUSED_S
    while host and port is not None:
        try:
            socket.create_connection((host.strip("[]"), port), timeout=_patience(_REFUSED_S)).close()
            return
        except ConnectionRefusedError:
            check_time(_CONNECTING)
            if time.monotonic() > until:
                raise
            time.sleep(0.2)
        except (OSError, OverflowError):
            return


def _warn_if_open(address: str, scheduler: str) -> None:
    if not scheduler.startswith(_ENCRYPTED):
        log.warning(
            "cluster %s: %s has neither encryption nor a password: anybody who reaches its port can run code as "
            "you, here and on every worker. Start the scheduler with --protocol tls and certificates, or keep it "
            "on a network that you trust as a whole.",
            address,
            scheduler,
        )


def _check_encryption(distributed: Any, address: str, scheduler: str) -> None:
    """Raise ContextError if Dask's TLS configuration does not fit the address, before a client would fail.

    address   : address or scheduler file that the user has named, for messages
    scheduler : address of the scheduler, which may come from the scheduler file
    """
    names = "distributed.comm.tls in its configuration, or DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
    names += "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY."
    try:
        found = distributed.Security().get_connection_args("client")
    except (OSError, TypeError, ValueError) as error:
        raise ContextError(
            f"cluster {address}: Dask's certificates cannot be used: {reason_of(error)}.", f"See {names}"
        ) from error
    if scheduler.startswith("tls://") and found.get("ssl_context") is None:
        raise ContextError(f"cluster {address}: TLS needs certificates, and Dask knows of none.", f"Set {names}")
    if scheduler.startswith("tcp://") and found.get("require_encryption"):
        raise ContextError(
            f"cluster {address}: Dask's configuration (distributed.comm.require-encryption) refuses what is not "
            "encrypted.",
            "Start the scheduler with --protocol tls, and name it as tls://HOST:PORT.",
        )


@contextlib.contextmanager
def quiet(level: int = logging.CRITICAL) -> Any:
    """Context that hides log messages of distributed below `level`; broken connections are expected here."""
    # Some loggers of distributed have levels of their own.
    before = {name: logging.getLogger(name).level for name in _dask_loggers()}
    for name in before:
        logging.getLogger(name).setLevel(max(level, before[name]))
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def hide_teardown() -> None:
    """Hide tracebacks that Dask's threads in this process log while a cluster ends.

    They are the cancellation of a task, a connection that the other side has closed, and the removal of shared data
    that a restarted worker does not have.
    """
    for name in _dask_loggers():
        logging.getLogger(name).addFilter(_is_no_teardown)  # a filter that is added twice counts once


def _dask_loggers() -> set[str]:
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] == "distributed"]
    return {"distributed", *names}


def _is_no_teardown(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, KeyError):
        return "failed to teardown" not in record.getMessage()
    return type(error).__name__ not in ("CancelledError", "CommClosedError")
