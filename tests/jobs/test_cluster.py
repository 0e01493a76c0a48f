"""One render by many processes: the bits of one, whatever happens to some of them."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import pickle
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import reduce
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import glpath
from glpath.cli.main import app
from glpath.errors import ContextError, GlpathError, TimeLimitError, UsageError
from glpath.film.batches import BLOCK
from glpath.film.film import Film
from glpath.jobs import cluster as clusters
from glpath.jobs import connection as clusters_connection
from glpath.jobs.chunks import ATTEMPTS, Chunks, ChunksFailedError
from glpath.jobs.cluster import Cluster
from glpath.rendering import RenderJob, run, session
from glpath.rendering.factory import plan_of
from glpath.rendering.resume import AnotherRenderError
from glpath.sensors.sensor import PointSensor
from glpath.system.time_limit import limited
from tests.support import killing
from tests.support.clock import Clock
from tests.support.engines import with_depth
from tests.support.films import same

distributed = pytest.importorskip("distributed")
pytest.importorskip("cryptography")

BOX = "cornell-box-36"
SMALL: dict[str, Any] = {"resolution": (24, 16), "max_depth": 2}


@pytest.fixture(scope="module")
def workers():
    with Cluster("local:2") as cluster:
        yield cluster


@pytest.fixture
def own_workers():
    with Cluster("local:2") as cluster:
        yield cluster


def render_on(cluster: Cluster, job: RenderJob, chunk_seconds: float = 5.0, **options: Any) -> Film:
    cluster.chunk_seconds = chunk_seconds
    return run(job, cluster=cluster, **options)


def job_of(spp: int, **options: Any) -> RenderJob:
    return RenderJob.of(BOX, spp=spp, **with_depth({"resolution": (24, 16), **options}, 2))


# The same bits.


@pytest.mark.parametrize(
    ("spp", "options"),
    [
        (77, {}),
        (64, {"aovs": ("albedo", "normal"), "sampling": "random", "first_path_set": 3}),
        (24, {"integrator": "path-buffer"}),
        (40, {"integrator": "gather"}),
        (40, {"guide": "solution"}),
        (3, {"integrator": "t-buffer"}),
    ],
)
def test_it_has_the_bits_of_one_process(workers, spp, options):
    scene = glpath.load_scene("three-spheres") if options.get("integrator") == "t-buffer" else BOX
    job, loaded = RenderJob.of(scene, spp=spp, **with_depth({"resolution": (24, 16), **options}, 2)), None
    if not isinstance(scene, str):
        loaded = scene
    told = []
    film = render_on(workers, job, scene=loaded, chunk_seconds=0.05, on_progress=told.append)
    assert same(film, run(job, scene=loaded))
    assert film.metadata.stop_rule == "spp"
    assert film.metadata.statistics["chunks"] >= spp // 64
    assert told[-1].done == told[-1].total == spp


def test_points_are_not_asked_what_a_camera_would_see(workers):
    """In front of the box, where a camera amid them would look past it: no warning, which would be a failure."""
    points = np.array([[[0.0, 0.5, 3.0], [0.1, 0.4, 3.0]]])
    sensor = PointSensor.of(points, np.broadcast_to([0.0, 0.0, -1.0], points.shape), independent=True)
    job = RenderJob.of(BOX, sensor=sensor, spp=24, max_depth=3)
    film = render_on(workers, job, chunk_seconds=0.05)
    assert same(film, run(job))
    assert film.mean.any()


def test_points_are_measured_and_texels_baked_by_a_cluster_as_by_one_process(workers):
    workers.chunk_seconds = 5.0
    points: Any = ([[0.0, 0.1, 0.0], [0.2, 0.1, 0.2]], [0.0, 1.0, 0.0])
    measured = glpath.irradiance(BOX, *points, spp=16, max_depth=2, cluster=workers)
    assert same(measured.film, glpath.irradiance(BOX, *points, spp=16, max_depth=2).film)
    assert "worker_s" in measured.film.metadata.statistics
    pytest.importorskip("xatlas")
    baked = glpath.lightmap(BOX, size=32, spp=8, max_depth=2, cluster=workers)
    assert same(baked.film, glpath.lightmap(BOX, size=32, spp=8, max_depth=2).film)


def test_noise_ends_it_where_it_ends_one_process(workers):
    alone = glpath.render(BOX, noise=0.03, **SMALL)
    film = render_on(workers, job_of(1 << 20), noise=0.03, chunk_seconds=0.1)
    assert film.path_sets == alone.path_sets > 32
    assert same(film, alone)
    assert (film.metadata.stop_rule, film.metadata.error_bound) == ("noise", alone.metadata.error_bound)


def alone(ranges: list[tuple[int, int]]) -> Film:
    """Return the film of ranges of path sets that this process renders."""
    films = [run(replace(job_of(1), path_sets=each)) for each in ranges]
    return reduce(Film.merge, films)


def test_a_time_limit_is_of_this_clock(workers):
    began = time.monotonic()
    film = render_on(workers, job_of(1 << 20), time_limit=10.0, chunk_seconds=0.1)
    took = time.monotonic() - began
    assert film.metadata.stop_rule == "time limit"
    assert film.metadata.elapsed_s < took < 30
    assert same(film, alone(film.ranges))


def test_time_limit_ends_a_render_whose_workers_finish_nothing():
    client = SimpleNamespace(submit=lambda *_, **__: Submitted())
    cluster = SimpleNamespace(
        client=client, workers=lambda: ["a"], address="played", connected=True, check=lambda: None
    )
    film = SimpleNamespace(path_sets=0, ranges=())
    clock = SimpleNamespace(film=film, options=SimpleNamespace(noise=None, clean=None))
    render = clusters._Render(cluster, SimpleNamespace(token="0" * 8), clock)
    began = time.monotonic()
    with limited(0.01), pytest.raises(TimeLimitError, match="over while workers render the first path sets"):
        render._fill(Chunks([(0, 64)], 1.0), False)
    assert time.monotonic() - began < 10


def test_first_chunks_of_a_render_with_a_time_limit_are_single_path_sets(workers, monkeypatch):
    sizes = []
    submit = clusters._Render._submit

    def submit_and_count(render, chunk, worker):
        sizes.append(chunk.count)
        submit(render, chunk, worker)

    monkeypatch.setattr(clusters._Render, "_submit", submit_and_count)
    assert same(render_on(workers, job_of(24), time_limit=1000.0), run(job_of(24)))
    assert sizes[:2] == [1, 1]


def test_it_goes_on_with_a_film_and_with_no_other(workers):
    begun = run(job_of(21))
    film = render_on(workers, job_of(50), film=begun, chunk_seconds=0.05)
    assert film is begun
    assert same(film, run(job_of(50)))
    with pytest.raises(AnotherRenderError, match=r"seed is 0 in it, 1 is asked for"):
        render_on(workers, job_of(60, seed=1), film=film)


# What happens to workers.


def pids(cluster: Cluster) -> list[int]:
    return sorted(cluster.client.run(os.getpid).values())


def strike(cluster: Cluster, number: int, after: int) -> tuple[Any, list[int]]:
    """For `on_step`: sends a signal to one worker when so many path sets are merged."""
    victims = pids(cluster)[:1]
    left = list(victims)

    def on_step(film: Film) -> None:
        if film.path_sets >= after and left:
            os.kill(left.pop(), number)

    return on_step, victims


def test_a_worker_that_is_killed_costs_nothing_but_time(own_workers):
    job = job_of(600, max_depth=3)
    on_step, victims = strike(own_workers, signal.SIGKILL, 40)
    film = render_on(own_workers, job, on_step=on_step, chunk_seconds=0.3)
    assert same(film, run(job))
    assert not set(victims) & set(pids(own_workers))  # its nanny has started another


@pytest.mark.evidence
def test_a_worker_that_hangs_is_not_waited_for(own_workers, monkeypatch):
    monkeypatch.setattr(clusters, "_GATHER_S", 3.0)
    job = job_of(600, max_depth=3)
    on_step, victims = strike(own_workers, signal.SIGSTOP, 40)
    try:
        film = render_on(own_workers, job, on_step=on_step, chunk_seconds=0.3)
    finally:
        for victim in victims:
            os.kill(victim, signal.SIGCONT)
    assert same(film, run(job))


class Faulty:
    """A plan whose engine fails at a path set; in a worker's process."""

    def __init__(self, plan: Any, at: int, how: str) -> None:
        self.plan, self.at, self.how = plan, at, how

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "plan":
            raise AttributeError(name)
        return getattr(self.plan, name)

    def prepared(self, scene: Any, say: Any) -> Faulty:
        return self

    def resumed(self, film: Any) -> Faulty:
        return self

    def engine(self, *arguments: Any) -> Any:
        engine, at, how = self.plan.engine(*arguments), self.at, self.how
        trace = engine.trace_path_set

        def trace_path_set(index: int) -> None:
            if index == at and how == "dies":
                os._exit(1)
            if index == at:
                raise {"device": ContextError, "bug": ZeroDivisionError, "user": UsageError}[how](f"at {index}")
            trace(index)

        engine.trace_path_set = trace_path_set
        return engine


@pytest.mark.parametrize(("how", "reason"), [("device", "at 21"), ("bug", "at 21"), ("dies", "worker")])
def test_a_chunk_that_fails_everywhere_is_told_of_and_the_others_are_kept(
    request, monkeypatch, caplog, how, reason
):
    cluster = request.getfixturevalue("own_workers" if how == "dies" else "workers")
    monkeypatch.setattr(session, "plan_of", lambda settings: Faulty(plan_of(settings), 21, how))
    with pytest.raises(ChunksFailedError, match=rf"path sets 16:24 failed on every worker.*{reason}") as caught:
        render_on(cluster, job_of(64), chunk_seconds=0.01)
    film = caught.value.film
    assert film.ranges == ((0, 16), (24, 64))
    assert same(film, run(job_of(16)).merge(run(job_of(40, first_path_set=24))))


#: As Dask's, which comes when a worker has died of a task.
KilledWorker = type("KilledWorker", (Exception,), {})


class Submitted:
    """Stands for a future of a worker that dies of it, or for one that goes on."""

    status = "pending"

    def add_done_callback(self, _):
        pass

    def cancel(self, force):
        pass

    def exception(self, timeout):
        return KilledWorker()


def test_nothing_is_handed_to_the_dead_while_the_scheduler_still_lists_them():
    """Under load it notices seconds late; what never began there would count as tried."""
    given_to = []

    def submit(*_, workers, **__):
        given_to.extend(workers)
        return Submitted()

    client = SimpleNamespace(submit=submit)
    cluster = SimpleNamespace(client=client, workers=lambda: ["a", "b"], address="played", connected=True)
    film = SimpleNamespace(path_sets=0, ranges=())
    render = clusters._Render(cluster, SimpleNamespace(token="0" * 8), SimpleNamespace(film=film))
    chunks = Chunks([(0, 64)], 1.0)
    render._look_around(chunks)
    render._hand_out(chunks)
    assert {"a", "b"} == set(given_to)
    future = next(future for future, task in render._running.items() if task.worker == "a")
    given_to.clear()
    render._take_one(chunks, future, None, 0.0)
    for _ in range(2):
        render._hand_out(chunks)
        render._look_around(chunks)
    assert "a" not in given_to
    assert not [task for task in render._running.values() if task.worker == "a"]


def test_an_error_without_words_is_a_chunk_that_failed(caplog):
    """Under load a finished part can take too long to fetch: a TimeoutError, which says nothing."""
    client = SimpleNamespace(submit=lambda *_, **__: Submitted())
    cluster = SimpleNamespace(client=client, workers=lambda: ["a"], address="played", connected=True)
    film = SimpleNamespace(path_sets=0, ranges=())
    render = clusters._Render(cluster, SimpleNamespace(token="0" * 8), SimpleNamespace(film=film))
    chunks = Chunks([(0, 8)], 1.0)
    render._look_around(chunks)
    render._hand_out(chunks)
    render._take_one(chunks, next(iter(render._running)), TimeoutError(), 0.0)
    assert "TimeoutError" in caplog.text
    assert not chunks.failed
    render._hand_out(chunks)
    assert len(render._running) == 1


def test_result_that_arrives_after_the_render_is_ignored():
    render = clusters._Render(SimpleNamespace(), SimpleNamespace(token="0" * 8), SimpleNamespace())
    render._gatherers.shutdown()
    render._gather_later(Submitted())


def test_a_mistake_of_the_user_is_not_tried_again(workers, monkeypatch):
    monkeypatch.setattr(session, "plan_of", lambda settings: Faulty(plan_of(settings), 21, "user"))
    with pytest.raises(UsageError, match="at 21"):
        render_on(workers, job_of(64), chunk_seconds=0.01)


def test_a_worker_of_another_version_is_refused(workers, monkeypatch):
    monkeypatch.setattr(clusters, "this_version", lambda: "0.0.1")
    with pytest.raises(UsageError, match=r"a worker has glpath .*, who asks has 0\.0\.1"):
        render_on(workers, job_of(8))


def test_a_scheduler_by_its_address_and_workers_that_come_later():
    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=True, dashboard_address=":0", memory_limit=None
    ) as other:
        threading.Timer(2.0, lambda: other.scale(1)).start()
        with Cluster(other.scheduler_address) as cluster:
            film = render_on(cluster, job_of(16))
    assert same(film, run(job_of(16)))


@pytest.mark.parametrize(
    ("address", "error", "said"),
    [
        ("local:0", UsageError, "expected a number of processes from 1 to 1024"),
        ("local:many", UsageError, "expected a number of processes"),
        ("somewhere", UsageError, "is neither local:N, nor an address"),
        ("gopher://a:1", ContextError, "no scheduler answers"),
        ("tls://127.0.0.1:1", ContextError, "TLS needs certificates, and Dask knows of none"),
    ],
)
def test_an_address_that_cannot_be(address, error, said):
    with pytest.raises(error, match=said):
        Cluster(address)


def test_a_scheduler_file_may_be_a_path(tmp_path, monkeypatch):
    """A path and its text have the same errors, and leave the log of Dask as it was."""

    def refuse(distributed, address):
        raise ContextError(f"no scheduler answers at {address}")

    levels = {name: logging.getLogger(name).level for name in clusters_connection._dask_loggers()}
    for connected, words in (
        (clusters_connection._connected, "is neither local:N"),
        (refuse, "no scheduler answers"),
    ):
        monkeypatch.setattr(clusters_connection, "_connected", connected)
        errors = []
        for address in (tmp_path / "none.json", str(tmp_path / "none.json")):
            with pytest.raises(GlpathError, match=words) as caught:
                Cluster(address)
            errors.append(str(caught.value))
        assert errors[0] == errors[1]
    assert {name: logging.getLogger(name).level for name in levels} == levels


@pytest.mark.parametrize("address", [5, None, "", ["tcp://127.0.0.1:1"], {"a": 1}])
def test_a_scheduler_file_whose_address_is_no_text_is_refused(address, tmp_path):
    (tmp_path / "s.json").write_text(json.dumps({"address": address}))
    with pytest.raises(UsageError, match="is not the file of a scheduler"):
        Cluster(tmp_path / "s.json")


@pytest.mark.parametrize(
    "options", [{"address": 4}, {"address": b"local:1"}, {"dashboard": "no"}, {"chunk_seconds": "5"}]
)
def test_wrong_arguments_of_a_cluster_are_named(options):
    with pytest.raises(UsageError, match=next(iter(options))):
        Cluster(**{"address": "local:1", **options})


def test_what_dask_s_configuration_refuses_is_said_at_once(tmp_path):
    dask = pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.comm.require-encryption": True}),
        pytest.raises(ContextError, match="refuses what is not encrypted"),
    ):
        Cluster("tcp://127.0.0.1:1")
    tls = {name: str(tmp_path / "none.pem") for name in ("ca-file", "client.cert", "client.key")}
    with (
        dask.config.set({f"distributed.comm.tls.{name}": path for name, path in tls.items()}),
        pytest.raises(ContextError, match="Dask's certificates cannot be used: No such file"),
    ):
        Cluster("tls://127.0.0.1:1")


# Who may connect.


def run_code(address: str, security: Any) -> int:
    """What an attacker does: a client of one's own, which has a function run by a worker; its process id."""
    with distributed.Client(address, security=security, set_as_default=False, timeout=2) as client:
        return client.submit(os.getpid).result(timeout=5)


def addresses(cluster: Cluster) -> list[str]:
    """Where the scheduler, the workers and the processes that watch over them listen."""
    info = cluster.client.scheduler_info()
    workers = info["workers"]
    return [cluster.client.scheduler.address, *workers, *(worker["nanny"] for worker in workers.values())]


def test_code_is_run_for_those_who_have_the_certificate(workers):
    assert run_code(workers.client.scheduler.address, workers.client.security) in pids(workers)


def test_nobody_without_the_certificate_can_run_code_on_a_local_cluster(workers, caplog):
    caplog.set_level("CRITICAL", "distributed")
    scheduler = workers.client.scheduler.address
    assert scheduler.startswith("tls://")
    with pytest.raises(OSError, match=r"(?i)timed out|closed|certificate"):
        run_code(scheduler, distributed.Security.temporary())  # somebody else's
    with pytest.raises(OSError, match=r"(?i)timed out|closed"):
        run_code(scheduler.replace("tls://", "tcp://"), distributed.Security(require_encryption=False))
    # Each that listens ends the handshake of whoever has no certificate, before it reads a word.
    for address in addresses(workers):
        host, port = address.removeprefix("tls://").split(":")
        nobody = ssl.create_default_context()
        nobody.check_hostname, nobody.verify_mode = False, ssl.CERT_NONE
        with socket.create_connection((host, int(port)), timeout=5) as plain, pytest.raises((OSError, EOFError)):
            read_by_tls(nobody, plain)


def read_by_tls(context: ssl.SSLContext, plain: socket.socket) -> None:
    """Raise what ends a connection; by TLS 1.3 it ends with the first read."""
    with context.wrap_socket(plain) as connection:
        if not connection.recv(1):
            raise EOFError


def test_a_local_cluster_listens_on_the_loopback_interface_alone(workers):
    listening = [entry for pid in [os.getpid(), *family(os.getpid())] for entry in listeners(pid)]
    assert len(listening) >= len(addresses(workers))
    assert {host for host, _ in listening} == {"127.0.0.1"}
    for host, port in listening:  # who listens for HTTP has nothing to tell
        with contextlib.suppress(OSError), socket.create_connection((host, port), timeout=5) as connection:
            connection.sendall(b"GET /info/main/workers.html HTTP/1.0\r\n\r\n")
            connection.settimeout(5)
            assert connection.recv(4096).split(b"\r\n")[0] in (b"", b"HTTP/1.1 404 Not Found")


def family(pid: int) -> list[int]:
    """The processes that a process has started, and those of these."""
    children = [
        int(c) for task in Path(f"/proc/{pid}/task").iterdir() for c in (task / "children").read_text().split()
    ]
    return [*children, *(grandchild for child in children for grandchild in family(child))]


def listeners(pid: int) -> list[tuple[str, int]]:
    """The IPv4 and IPv6 addresses at which a process listens."""
    found = []
    inodes = set()
    for file in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            if (name := os.readlink(file)).startswith("socket:["):
                inodes.add(name[8:-1])
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in inodes:
                host, port = fields[1].split(":")
                packed = b"".join(bytes.fromhex(host[i : i + 8])[::-1] for i in range(0, len(host), 8))
                name = socket.inet_ntop(socket.AF_INET if table == "tcp" else socket.AF_INET6, packed)
                found.append((name, int(port, 16)))
    return found


def test_signals_of_a_terminal_do_not_reach_local_workers(workers):
    """Otherwise each prints a traceback of its own."""
    numbers = {signal.SIGINT, signal.SIGHUP, signal.SIGQUIT}
    masks = workers.client.run(signal.pthread_sigmask, signal.SIG_BLOCK, [])
    assert [numbers <= mask for mask in masks.values()] == [True, True]
    assert not numbers & signal.pthread_sigmask(signal.SIG_BLOCK, [])


TRACKER = """
from multiprocessing import resource_tracker
from pathlib import Path
from glpath.jobs.connection import _signals_blocked
with _signals_blocked():
    print(Path(f"/proc/{resource_tracker._resource_tracker._pid}/status").read_text())
"""


def test_hangup_of_a_terminal_does_not_reach_the_tracker_of_processes():
    """Otherwise `multiprocessing` prints a KeyError when it ends."""
    done = subprocess.run([sys.executable, "-c", TRACKER], capture_output=True, text=True, check=True)
    blocked = next(line.split()[1] for line in done.stdout.splitlines() if line.startswith("SigBlk:"))
    assert int(blocked, 16) >> (signal.SIGHUP - 1) & 1


STARTS = """
import os
import sibling
from glpath.jobs.cluster import Cluster
if __name__ == "__main__":
    with Cluster("local:1") as cluster:
        assert [*cluster.client.run(sibling.double, 21).values()] == [42]
    assert "PYTHONSAFEPATH" not in os.environ
"""


def test_local_workers_import_modules_of_the_script_but_not_of_the_current_folder(tmp_path):
    folder, current = tmp_path / "script", tmp_path / "current"
    folder.mkdir()
    current.mkdir()
    (folder / "starts.py").write_text(STARTS)
    (folder / "sibling.py").write_text("def double(number):\n    return 2 * number\n")
    (current / "multiprocessing.py").write_text("print('planted')\n")
    paths = os.pathsep.join(path for path in sys.path if path and Path(path) != current)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [sys.executable, str(folder / "starts.py")],
        cwd=current,
        env=environment | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
    )
    assert "planted" not in done.stdout + done.stderr
    assert done.returncode == 0, done.stderr


def test_signal_waits_until_a_local_cluster_has_started_and_closes_it(monkeypatch):
    calls = []

    def start(*options):
        signal.raise_signal(signal.SIGINT)
        calls.append("started")
        return SimpleNamespace(close=lambda timeout: calls.append("closed"))

    monkeypatch.setattr(clusters_connection, "_local_cluster", start)
    dask = SimpleNamespace(Client=lambda *options, **more: SimpleNamespace(close=lambda timeout: None))
    monkeypatch.setattr(clusters_connection, "_distributed", lambda: dask)
    with pytest.raises(KeyboardInterrupt):
        Cluster("local:2")
    assert calls == ["started", "closed"]


def test_a_scheduler_without_encryption_is_warned_of(caplog):
    with open_scheduler() as scheduler, Cluster(scheduler):
        pass
    assert "anybody who reaches its port can run code as you" in caplog.text


@contextlib.contextmanager
def open_scheduler() -> Iterator[str]:
    """A scheduler without encryption, in a process of its own, and its address."""
    command = [sys.executable, "-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scheduler.json"
        process = subprocess.Popen([*command, "--scheduler-file", str(file)], stderr=subprocess.DEVNULL)
        try:
            until = time.monotonic() + 60
            while not file.exists() and time.monotonic() < until:
                time.sleep(0.05)
            yield json.loads(file.read_text())["address"]
        finally:
            process.kill()
            process.wait()


# A scheduler that is gone.


def test_a_scheduler_that_dies_is_noticed_in_seconds(capfd):
    with open_scheduler() as address, Cluster(address) as cluster:
        began: list[float] = []
        pid = cluster.client.run_on_scheduler(os.getpid)
        threading.Timer(1.0, lambda: began.append(time.monotonic()) or os.kill(pid, signal.SIGKILL)).start()
        with pytest.raises(ContextError, match="the scheduler is gone: the connection broke"):
            render_on(cluster, job_of(16))
        assert time.monotonic() - began[0] < 20  # Dask's own word comes after 30 s; an idle machine takes 4
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("failures", [1, 99])
def test_an_overloaded_machine_starts_the_client_late_or_says_so(failures, monkeypatch):
    made = []

    def client(**kind):
        made.append(kind)
        if len(made) <= failures:
            raise AssertionError  # as distributed.utils.LoopRunner does after 10 s without its thread
        return SimpleNamespace(scheduler=SimpleNamespace(address="tls://x"))

    asked = SimpleNamespace(Client=client, Security=distributed.Security)
    if failures == 1:
        assert clusters_connection._connected(asked, "inproc://a").scheduler
        assert len(made) == 2
    else:
        with pytest.raises(ContextError, match="does not start; is this machine overloaded"):
            clusters_connection._connected(asked, "inproc://a")


def test_an_address_is_never_taken_for_a_file(tmp_path, monkeypatch):
    """A path such as inproc:/a would name a scheduler whose pickles run code."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "inproc:").mkdir()
    (tmp_path / "inproc:" / "a").write_text(json.dumps({"address": "inproc://other"}))
    asked = SimpleNamespace(Client=lambda **kind: kind, Security=distributed.Security)
    assert clusters_connection._connected(asked, "inproc://a")["address"] == "inproc://a"
    path = str(Path("inproc:", "a"))
    assert clusters_connection._connected(asked, path)["scheduler_file"] == path


def test_time_limit_ends_the_wait_for_a_scheduler(monkeypatch):
    clock, made = Clock(monkeypatch), []

    def client(**kind):
        made.append(kind["timeout"])
        clock.ahead += made[-1] + 0.01
        raise TimeoutError

    asked = SimpleNamespace(Client=client, Security=distributed.Security)
    with limited(2.0), pytest.raises(TimeLimitError, match="time_limit=2: over while connecting to the cluster"):
        clusters_connection._connected(asked, "inproc://a")
    assert made == [pytest.approx(3.0)]  # the limit, and a second more for required work


def test_time_limit_ends_the_attempts_at_a_refused_connection(monkeypatch):
    clock = Clock(monkeypatch)
    with limited(2.0):
        clock.ahead = 3.1
        with pytest.raises(TimeLimitError, match="over while connecting to the cluster"):
            clusters_connection._wait_while_refused("tcp://127.0.0.1:1")


def test_scheduler_that_does_not_answer_before_the_time_limit_does_not_fail_the_render(monkeypatch):
    clock, waits = Clock(monkeypatch), []

    def nthreads(callback_timeout):
        waits.append(callback_timeout)
        clock.ahead += callback_timeout
        raise TimeoutError

    connection = clusters_connection.Connection.__new__(clusters_connection.Connection)
    connection.client, connection.address = SimpleNamespace(nthreads=nthreads, status="running"), "played"
    render = clusters._Render(connection, SimpleNamespace(token="0" * 8), SimpleNamespace())
    with limited(2.0):
        render._look_around(Chunks([(0, 8)], 1.0))
    assert waits == [pytest.approx(3.0)]
    with pytest.raises(ContextError, match="the scheduler is gone"):
        render._look_around(Chunks([(0, 8)], 1.0))
    assert waits[1] == clusters_connection._ANSWER_S


def test_an_address_where_nobody_listens_is_refused_in_seconds():
    began = time.monotonic()
    with pytest.raises(ContextError, match=r"no scheduler answers: .*refused"):
        Cluster("tcp://127.0.0.1:1")
    assert time.monotonic() - began < 15


# The command line.


def test_the_command_line_renders_on_a_cluster_and_goes_on(tmp_path):
    out, stats = tmp_path / "a.npz", tmp_path / "s.json"
    command = ["render", *killing.SMALL, "-o", str(out), "--resume", "--cluster", "local:2"]
    for spp in (20, 40):
        done = CliRunner().invoke(app, [*command, "--spp", str(spp), "--stats", str(stats)])
        assert done.exit_code == 0, done.output
    assert same(Film.load(out), run(job_of(40)))
    found = json.loads(stats.read_text())
    assert (found["path_sets"], found["path_sets_before"]) == (40, 20)
    assert found["counts"]["worker_s"] > 0


def test_a_scheduler_that_ends_it_finds_a_checkpoint(tmp_path):
    out = tmp_path / "a.npz"
    arguments = ("-o", out, "--spp", 10**6, "--checkpoint", "1i", "--resume", "--cluster", "local:2")
    code, told = killing.struck(signal.SIGTERM, *arguments)
    assert code == 75, told
    film = Film.load(out)
    assert film.path_sets > 0
    assert same(film, alone(film.ranges))


# What is handed out.


@given(
    missing=st.lists(st.tuples(st.integers(1, 9), st.integers(1, 90)), min_size=1, max_size=4),
    speeds=st.lists(st.floats(1e-4, 20), min_size=1, max_size=8),
    failures=st.sets(st.integers(0, 40), max_size=20),
    workers=st.integers(1, 9),
    every=st.integers(1, 4),
)
def test_each_path_set_is_handed_out_once(missing, speeds, failures, workers, every):
    ranges, at = [], 0
    for gap, length in missing:
        ranges.append((at + gap, at + gap + length))
        at += gap + length
    looks = []
    chunks = Chunks(ranges, 1.0, lambda count: bool(looks.append(count)) or count % (every * BLOCK) == 0)
    done, number = [], 0
    while (chunk := chunks.next(workers)) is not None:
        number += 1
        if number in failures:
            chunks.fail(chunk)
            continue
        assert chunks.done(chunk, speeds[number % len(speeds)] * chunk.count)
        assert not chunks.done(chunk, 1.0)  # a second copy
        done.append(chunk.path_sets)
    assert chunks.over
    done += [chunk.path_sets for chunk in chunks.failed]
    assert sorted(i for a, b in done for i in range(a, b)) == [i for a, b in ranges for i in range(a, b)]
    assert all(chunk.attempts == ATTEMPTS for chunk in chunks.failed)


def test_chunks_become_as_long_as_they_should_and_shrink_at_the_end():
    chunks, sizes = Chunks([(0, 4000)], 5.0), []
    while (chunk := chunks.next(4)) is not None:
        sizes.append(chunk.count)
        chunks.done(chunk, 0.01 * chunk.count)
    assert sizes[0] == BLOCK
    assert max(sizes) == sizes[1] == 496  # an eighth of what is left; five seconds would be 500
    assert sizes[-1] < BLOCK
    assert all(a >= b for a, b in pairwise(sizes[1:]))


def test_local_workers_end_within_a_task() -> None:
    with clusters_connection.Connection("local:1") as connection:
        task = connection.client.submit(time.sleep, 60, pure=False)
        while not connection.client.processing()[connection.workers()[0]]:
            time.sleep(0.05)
        began = time.monotonic()
        task.cancel(force=True)
    assert time.monotonic() - began < 3  # Dask itself waits four seconds


def test_chunks_shrink_with_the_time_that_is_left(monkeypatch):
    clock, ahead = Clock(monkeypatch), []
    chunks = Chunks([(0, 1_000_000)], 5.0, first=1)
    with limited(16.0):
        while clock.ahead < 16.0:  # one worker renders the chunks in order, and always has one in reserve
            ahead.append(chunks.next(1))
            if len(ahead) == 2:
                clock.ahead += 0.01 * ahead[0].count
                chunks.done(ahead[0], 0.01 * ahead.pop(0).count)
    assert clock.ahead < 16.3


def test_chunks_are_longer_where_merging_would_be_late():
    chunks = Chunks([(0, 1_000_000)], 5.0)
    first = chunks.next(100)
    assert first is not None
    chunks.take_cost(0.5)
    chunks.done(first, 0.1 * first.count)
    second = chunks.next(100)
    assert second is not None
    assert second.count == 1000  # 100 s, of which 100 workers' films take half to merge


def test_slow_path_sets_are_handed_out_one_by_one():
    chunks = Chunks([(0, 100)], 5.0)
    first = chunks.next(2)
    assert first is not None
    chunks.done(first, 40.0 * first.count)
    second = chunks.next(2)
    assert second is not None
    assert second.path_sets == (8, 9)


def test_a_film_travels_without_its_empty_batches():
    film = run(job_of(8, resolution=(64, 64), aovs=("albedo",)))
    sent = pickle.dumps(film)
    assert len(sent) < 64 * 64 * 3 * 8 * 2.2  # one batch of eight, and the AOV
    assert same(pickle.loads(sent), film)


def test_a_film_that_has_all_batches_travels_as_it_is():
    film = run(job_of(64, resolution=(16, 16)))
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(film, protocol=5, buffer_callback=buffers.append)
    assert any(np.shares_memory(np.frombuffer(b.raw(), np.uint8), film.radiance_sums) for b in buffers)
    for raw in ([bytearray(b.raw()) for b in buffers], [bytes(b.raw()) for b in buffers]):
        there = pickle.loads(head, buffers=raw)
        assert same(there, film)
        assert there.radiance_sums.flags.writeable


def test_including_a_film_of_another_render_changes_nothing():
    film, other = run(job_of(8)), run(job_of(8, first_path_set=8, seed=1))
    before = film.radiance_sums.copy()
    with pytest.raises(UsageError, match="seed"):
        film.include(other)
    with pytest.raises(UsageError, match="twice"):
        film.include(run(job_of(8)))
    assert np.array_equal(film.radiance_sums, before)
    assert film.path_sets == 8


def test_gather_whose_bias_no_device_can_measure_is_an_error_if_strict(monkeypatch: pytest.MonkeyPatch) -> None:
    options, plan, scene, clock = MagicMock(), MagicMock(), MagicMock(source="room.toml"), MagicMock()
    options.context.side_effect = ContextError("no device.")
    monkeypatch.setattr(clusters, "sensor_in", MagicMock())
    monkeypatch.setattr(clusters, "metadata_of", MagicMock())
    monkeypatch.setattr(clusters, "describe_plan", MagicMock())
    film = glpath.render(BOX, spp=1, **SMALL)
    clock.film, clock.statistics = film, {}
    asked = plan, MagicMock(), scene, MagicMock(), options, clock
    assert clusters._with_small_bias(*asked) is plan.without_bias.return_value
    assert clock.statistics == {}
    plan.without_bias.return_value = None
    assert clusters._with_small_bias(*asked) is plan
    film.metadata = replace(film.metadata, statistics=film.metadata.statistics | clock.statistics)
    (warned,) = session.remarks_of(plan_of(RenderJob.of(BOX, integrator="gather").integrator), film)
    assert "cannot be measured here: no device; " in warned
