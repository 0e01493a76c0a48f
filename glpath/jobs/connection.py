"""The workers of a cluster (Dask distributed): processes of this machine, or those of a scheduler, also by TLS.

Cost:     seconds to start a process of this machine, with a context and shaders of its own.
"""

from __future__ import annotations

import contextlib
import logging
import os
from types import TracebackType
from typing import Any

from glpath.errors import ContextError, GlpathError, UsageError
from glpath.files import reason_of
from glpath.jobs.worker import Shared, hold, let_go
from glpath.machine import core_count

# Of a machine that is this one.
_LOCAL = "local:"
_MAX_LOCAL = 1024


class Cluster:
    """Workers: processes of this machine, or those of a Dask scheduler.

    address : "local:N" for N processes here; else what `distributed.Client` connects to, "tcp://host:port",
              "tls://host:port", with Dask's own configuration (TLS, timeouts), or the path of a scheduler file

    Raises UsageError for another address, ContextError where nobody answers; GlpathError where distributed is
    missing.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._local: Any = None
        distributed = _distributed()
        if address.startswith(_LOCAL):
            self._local = _local_cluster(distributed, _count(address))
            self.client = distributed.Client(self._local, set_as_default=False, direct_to_workers=True)
        else:
            self.client = _connected(distributed, address)

    def __enter__(self) -> Cluster:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the cluster; processes of this machine end."""
        with quiet():
            with contextlib.suppress(Exception):
                self.client.close(timeout=5)
            if self._local is not None:
                with contextlib.suppress(Exception):
                    self._local.close(timeout=10)

    def workers(self) -> list[str]:
        """The addresses of those that there are now."""
        return sorted(self.client.nthreads())

    def share(self, shared: Shared) -> None:
        """Hand all that a render needs to each worker, and to each that comes later."""
        self.client.register_plugin(_sharing(_distributed(), shared), name=shared.token)

    def forget(self, shared: Shared) -> None:
        """The render is over."""
        self.client.unregister_worker_plugin(shared.token)


def _sharing(distributed: Any, shared: Shared) -> Any:
    class Sharing(distributed.WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: object) -> None:
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
    return distributed


def _count(address: str) -> int:
    text = address.removeprefix(_LOCAL)
    if not (text.isascii() and text.isdigit() and 1 <= int(text) <= _MAX_LOCAL):
        raise UsageError(
            f"cluster {address}: expected a number of processes from 1 to {_MAX_LOCAL}, as in local:4."
        )
    return int(text)


def _local_cluster(distributed: Any, count: int) -> Any:
    cores = core_count()
    share = cores // count
    # llvmpipe takes all cores otherwise, for each process; it has a race with a single thread beside its own.
    threads = {"LP_NUM_THREADS": str(share if share > 1 else 0)} if count > 1 else {}
    import dask

    try:
        # Who dies with its worker is tried again by `chunks`, which knows more than the scheduler.
        with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
            return distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                memory_limit=None,
                dashboard_address=":0",  # a port that is free: others may have clusters here, too
                silence_logs=logging.ERROR,
                env={name: value for name, value in threads.items() if name not in os.environ},
            )
    except RuntimeError as error:
        raise ContextError(f"cluster {_LOCAL}{count}: the processes do not start: {error}.") from error


def _connected(distributed: Any, address: str) -> Any:
    kind = {"scheduler_file": address} if os.path.exists(address) else {"address": address}
    if "address" in kind and "://" not in address:
        raise UsageError(
            f"cluster {address}: is neither local:N, nor an address such as tcp://scheduler:8786, nor a "
            "scheduler's file."
        )
    _check_encryption(distributed, address)
    try:
        return distributed.Client(**kind, set_as_default=False, direct_to_workers=True)
    except (OSError, ValueError, TimeoutError) as error:
        reason = str(error).splitlines()[0] if str(error) else "timed out"
        raise ContextError(
            f"cluster {address}: no scheduler answers: {reason}.",
            "Start one (dask scheduler) and workers (dask worker tcp://HOST:8786 --nthreads 1), and name it here.",
        ) from error


def _check_encryption(distributed: Any, address: str) -> None:
    """Raise ContextError where Dask's configuration has not what the address needs: a client finds out late."""
    names = "distributed.comm.tls in its configuration, or DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
    names += "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY."
    try:
        found = distributed.Security().get_connection_args("client")
    except (OSError, TypeError, ValueError) as error:
        raise ContextError(
            f"cluster {address}: Dask's certificates cannot be used: {reason_of(error)}.", f"See {names}"
        ) from error
    if address.startswith("tls://") and found.get("ssl_context") is None:
        raise ContextError(f"cluster {address}: TLS needs certificates, and Dask knows of none.", f"Set {names}")
    if address.startswith("tcp://") and found.get("require_encryption"):
        raise ContextError(
            f"cluster {address}: Dask's configuration (distributed.comm.require-encryption) refuses what is not "
            "encrypted.",
            "Start the scheduler with --protocol tls, and name it as tls://HOST:PORT.",
        )


@contextlib.contextmanager
def quiet() -> Any:
    """What distributed logs of connections that break, which is what is expected here."""
    logger = logging.getLogger("distributed")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)
