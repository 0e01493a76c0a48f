"""Shows models in <model-viewer> without options, in headless Chromium with a software renderer.

Needs Chromium and npm's package @google/model-viewer (`npm install @google/model-viewer`), in `node_modules` of the
working folder or in a folder that NODE_PATH names. It needs no network: a server on the loopback has the page, the
package and the models, and receives the pictures from the page.
"""

from __future__ import annotations

import base64
import functools
import json
import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from benchmarks.peers.page_server import PageHandler
from glpath.errors import GlpathError

_PACKAGE = "@google/model-viewer"
_SCRIPT = "dist/model-viewer.min.js"
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_ARGUMENTS = (
    "--headless=new",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--no-proxy-server",
)
# Limits in seconds: for a model, and for the browser's start.
_PATIENCE, _START = 300.0, 60.0

_PAGE = """<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<style>body { margin: 0 } model-viewer { width: SIDEpx; height: SIDEpx }</style>
<script type="module">
import '/package/SCRIPT'
const of = customElements.get('model-viewer')
of.minimumRenderScale = 1
const frame = () => new Promise(done => requestAnimationFrame(done))
async function shown(url) {
  const viewer = document.createElement('model-viewer')
  document.body.replaceChildren(viewer)
  const start = performance.now()
  const loaded = new Promise((done, failed) => {
    viewer.addEventListener('load', done)
    viewer.addEventListener('error', event => failed(event.detail?.sourceError ?? event.detail?.type))
  })
  viewer.loading = 'eager'
  viewer.src = url
  await loaded
  for (let i = 0; i < 3; i++) await frame()
  const picture = viewer.toDataURL('image/png')
  return { seconds: (performance.now() - start) / 1000, picture }
}
for (const [number, url] of MODELS.entries()) {
  let answer
  try { answer = await shown(url) } catch (error) { answer = { error: String(error) } }
  await fetch(`/shown/${number}`, { method: 'POST', body: JSON.stringify(answer) })
}
</script>"""


@dataclass(frozen=True)
class Shown:
    """png : picture with an alpha channel, because the background is transparent; empty if it failed
    seconds : time from setting the model's address to its picture, without the browser's start
    """

    png: bytes = b""
    seconds: float = float("nan")
    error: str = ""


@dataclass
class _Answers:
    """The pictures that the browser has sent, by the number of the model."""

    found: dict[int, Shown] = field(default_factory=dict)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def add(self, number: int, body: bytes) -> None:
        answer = json.loads(body)
        png = base64.b64decode(str(answer.get("picture", "")).partition(",")[2])
        shown = Shown(png, float(answer.get("seconds", "nan")), str(answer.get("error", "")))
        with self.changed:
            self.found[number] = shown
            self.changed.notify_all()

    def wait_for(self, count: int, seconds: float) -> bool:
        with self.changed:
            return self.changed.wait_for(lambda: len(self.found) >= count, seconds)


def package() -> Path:
    """Return the folder of npm's package. Raises GlpathError with the command that installs it."""
    named = [Path(each) for each in os.environ.get("NODE_PATH", "").split(os.pathsep) if each]
    for folder in (*named, Path("node_modules")):
        if (folder / _PACKAGE / _SCRIPT).is_file():
            return (folder / _PACKAGE).resolve()
    raise GlpathError(
        f"npm's package {_PACKAGE} is neither in node_modules nor where NODE_PATH says.",
        f"npm install --prefix FOLDER {_PACKAGE}, and NODE_PATH=FOLDER/node_modules.",
    )


def browser() -> str:
    """Return the path of a browser. Raises GlpathError if there is none."""
    found = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if found is None:
        raise GlpathError("Chromium is not installed.", "apt install chromium")
    return found


def shown_by_model_viewer(models: Sequence[Path], side: int) -> list[Shown]:
    """Show glTF files at `side` x `side` pixels. Raises GlpathError if the browser or the package is missing."""
    program, folder, answers = browser(), package(), _Answers()
    addresses = [f"/models/{number}/{quote(path.name)}" for number, path in enumerate(models)]
    page = _PAGE.replace("SIDE", str(side)).replace("SCRIPT", _SCRIPT).replace("MODELS", json.dumps(addresses))
    handler = functools.partial(_Handler, page=page.encode(), package=folder, models=models, answers=answers)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, tempfile.TemporaryDirectory() as profile:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        command = [
            program,
            *_ARGUMENTS,
            *(["--no-sandbox"] if os.geteuid() == 0 else []),  # Chromium's sandbox does not work as root
            f"--user-data-dir={profile}",
            f"--window-size={side + 100},{side + 200}",
            f"http://127.0.0.1:{server.server_address[1]}/",
        ]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            for count in range(1, len(models) + 1):
                if not answers.wait_for(count, _PATIENCE + (_START if count == 1 else 0.0)):
                    break
        finally:
            process.terminate()
            process.wait()
            server.shutdown()
    silent = Shown(error=f"no picture within {_PATIENCE:g} s")
    return [answers.found.get(number, silent) for number in range(len(models))]


class _Handler(PageHandler):
    """Serves the page, /package/..., and the files beside each model, /models/NUMBER/...; gets /shown/NUMBER."""

    def __init__(self, *given: Any, page: bytes, package: Path, models: Sequence[Path], answers: _Answers) -> None:
        self.package, self.models, self.answers = package, models, answers
        super().__init__(*given, page=page)

    def do_POST(self) -> None:  # noqa: N802 - a name of http.server
        self.answers.add(int(self.path.rpartition("/")[2]), self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(204)
        self.end_headers()

    def translate_path(self, path: str) -> str:
        kind, _, rest = unquote(path.partition("?")[0]).lstrip("/").partition("/")
        if kind == "models":
            number, _, rest = rest.partition("/")
            folder = self.models[int(number)].parent
        elif kind == "package":
            folder = self.package
        else:
            return os.devnull
        found = (folder / rest).resolve()
        return str(found) if found.is_relative_to(folder.resolve()) else os.devnull
