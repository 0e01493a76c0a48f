"""A cluster that speaks TLS, as Dask's own configuration has it: `--cluster tls://...` and no option of ours."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import glpath
from glpath.film.film import Film
from tests.support import killing
from tests.support.films import same

pytest.importorskip("distributed")

pytestmark = pytest.mark.evidence


def certificate(folder: Path) -> dict[str, str]:
    """Make a certificate that vouches for itself; the environment by which Dask takes it for all parts."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("needs openssl")
    key, cert = folder / "key.pem", folder / "cert.pem"
    made = [openssl, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=glpath-test"]
    subprocess.run([*made, "-keyout", str(key), "-out", str(cert)], check=True, capture_output=True)
    tls = "DASK_DISTRIBUTED__COMM__TLS__"
    environment = {"DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "True", f"{tls}CA_FILE": str(cert)}
    for part in ("SCHEDULER", "WORKER", "CLIENT"):
        environment |= {f"{tls}{part}__CERT": str(cert), f"{tls}{part}__KEY": str(key)}
    return environment


def plain() -> dict[str, str]:
    """The environment without any of Dask's."""
    return {name: value for name, value in os.environ.items() if not name.startswith("DASK_")}


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, dict[str, str]]]:
    """The address of a scheduler with one worker, and the environment that reaches it."""
    folder = tmp_path_factory.mktemp("tls")
    environment = plain() | certificate(folder)
    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    commands = [
        [*dask, "scheduler", "--protocol", "tls", "--host", "127.0.0.1", "--port", "0", *common],
        [*dask, "worker", "--nthreads", "1", *common],
    ]
    processes = []
    with (folder / "log").open("w") as log:
        try:
            for command in commands:
                processes.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=folder))
                until = time.monotonic() + 60
                while not file.exists() and time.monotonic() < until:
                    time.sleep(0.1)
            address = json.loads(file.read_text())["address"]
            assert address.startswith("tls://")
            yield address, environment
        finally:
            for process in reversed(processes):
                process.terminate()
                process.wait(timeout=60)


def render(address: str, out: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "glpath", "render", *killing.SMALL, "--spp", "20", "-o", str(out)]
    return subprocess.run(
        [*command, "--cluster", address], env=environment, capture_output=True, text=True, timeout=300
    )


def test_a_render_over_tls_has_the_bits_of_one_process(cluster: tuple[str, dict[str, str]], tmp_path: Path) -> None:
    address, environment = cluster
    done = render(address, tmp_path / "a.npz", environment)
    assert done.returncode == 0, done.stderr
    assert same(
        Film.load(tmp_path / "a.npz"), glpath.render("cornell-box-36", spp=20, resolution=(24, 16), max_depth=2)
    )


def test_who_has_no_certificate_is_told_so(cluster: tuple[str, dict[str, str]], tmp_path: Path) -> None:
    address, _ = cluster
    done = render(address, tmp_path / "a.npz", plain())
    assert done.returncode == 1, done.stderr
    assert f"cluster {address}: TLS needs certificates, and Dask knows of none" in done.stderr
    assert not list(tmp_path.iterdir())
