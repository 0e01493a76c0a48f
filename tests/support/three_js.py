"""A .glb as three.js shows it: by its GLTFLoader in headless Chromium, from its own camera, in linear numbers.

    pytestmark = three_js.marks()

    @pytest.fixture(scope="module")
    def three():
        with three_js.viewer() as viewer:       # one browser for the module: 2 s to start
            yield viewer

    def test_it(three, tmp_path):
        seen = three.picture(tmp_path / "a.glb", 64, 48)      # (48, 64, 3) float32

`python -m tests.support.three_js a.glb 256 192 a.png` is the same for the eye.

What is shown is WebGL's frame as floats: no tone mapping, no sRGB, nothing clipped, so that light is in the scene's
units (three.js takes KHR_lights_punctual one to one, as we do). Pixels are means of `samples` x `samples` places.
There are no shadows, no light that bounces, and surfaces that emit light no others.

Needs npm's `three` (see npm.py); nothing is asked of a network.
"""

from __future__ import annotations

import base64
import contextlib
import os
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.peers.page_server import PageHandler
from tests.support import browser, npm

# WebGL without a graphics card.
ARGUMENTS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")

PAGE = b"""<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><script type="importmap">
{"imports": {"three": "/three/build/three.module.js", "three/addons/": "/three/examples/jsm/"}}
</script><script type="module">
import * as THREE from 'three'
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js'
import { EXRLoader } from 'three/addons/loaders/EXRLoader.js'

const canvas = document.createElement('canvas')
const renderer = new THREE.WebGLRenderer({ canvas })
renderer.toneMapping = THREE.NoToneMapping
renderer.getContext().getExtension('EXT_color_buffer_float')

const POSITION = new THREE.ShaderMaterial({
  side: THREE.DoubleSide,
  vertexShader: `varying vec3 world;
    void main() { vec4 at = modelMatrix * vec4(position, 1.0);
                  world = at.xyz; gl_Position = projectionMatrix * viewMatrix * at; }`,
  fragmentShader: 'varying vec3 world; void main() { gl_FragColor = vec4(world, 1.0); }' })

function base(old) {
  return new THREE.MeshBasicMaterial({ color: old.color, map: old.map, vertexColors: old.vertexColors,
    side: old.side, alphaTest: old.alphaTest, transparent: old.transparent, opacity: old.opacity })
}

const AsyncFunction = (async () => {}).constructor

window.picture = async (url, width, height, samples, show, name, lines) => {
  const gltf = await new GLTFLoader().loadAsync(url)
  const cameras = gltf.cameras.filter(each => name === null || each.name === name || each.userData.name === name)
  if (!cameras.length) throw new Error(`no such camera; there are: ${gltf.cameras.map(each => each.name)}`)
  const camera = cameras[0]
  if (camera.isPerspectiveCamera) camera.aspect = width / height
  else camera.left = -(camera.right = camera.top * width / height)
  camera.updateProjectionMatrix()
  gltf.scene.updateMatrixWorld()
  const page = lines && new AsyncFunction('THREE', 'GLTFLoader', 'EXRLoader', `${lines}\nreturn scene`)
  const scene = page ? await page(THREE, GLTFLoader, EXRLoader) : gltf.scene
  if (show !== 'light')
    scene.traverse(one => { if (one.isMesh) one.material = show === 'position' ? POSITION : base(one.material) })
  const [w, h] = [width * samples, height * samples]
  const target = new THREE.WebGLRenderTarget(w, h, { type: THREE.FloatType })
  renderer.setRenderTarget(target)
  renderer.setClearColor(0, 0)
  renderer.render(scene, camera)
  const pixels = new Float32Array(4 * w * h)
  renderer.readRenderTargetPixels(target, 0, 0, w, h, pixels)
  target.dispose()
  const bytes = new Uint8Array(pixels.buffer)
  let text = ''
  for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768))
  return btoa(text)
}
window.ready = true
</script>"""


def marks() -> list[pytest.MarkDecorator]:
    """Evidence, which is skipped where the browser or three.js is not there."""
    return browser.marks(**{"npm's three (NODE_PATH=FOLDER/node_modules)": npm.package("three")})


class Viewer:
    def __init__(self, driver: Any, url: str, files: dict[str, Path]) -> None:
        self.driver, self.url, self._files = driver, url, files

    def picture(
        self,
        glb: str | Path,
        width: int,
        height: int,
        *,
        show: str = "light",
        camera: str | None = None,
        samples: int = 4,
        lines: str | None = None,
    ) -> np.ndarray:
        """(height, width, 3) float32, row 0 at the top: the file from its first camera, or the one of that name.

        show : "light"; "base colour", of all materials, unlit; "position", in the world, NaN where no surface is
               (with samples = 1, at the centres of pixels)
        lines : of a page that make a `scene` of 'baked.glb' and files beside it that are called alike, which are
                this file and those beside it; from the first camera of the file
        """
        assert show in ("light", "base colour", "position")
        number, glb = len(self._files), Path(glb)
        name = f"{number}.glb"
        self._files[name] = glb
        if lines is not None:
            for each in glb.parent.glob(f"{glb.stem}[-.]*"):
                self._files[f"{number}/baked{each.name.removeprefix(glb.stem)}"] = each
            lines = lines.replace("'baked", f"'/models/{number}/baked")
        answer = self.driver.execute_async_script(
            "const given = [...arguments], done = given.pop();"
            "window.picture(...given).then(done, error => done({ error: String(error) }))",
            f"/models/{name}",
            width,
            height,
            samples,
            show,
            camera,
            lines,
        )
        assert isinstance(answer, str), f"{glb}: three.js: {answer}"
        pixels = np.frombuffer(base64.b64decode(answer), "<f4").reshape(height, samples, width, samples, 4)[
            ::-1, ::-1
        ]
        if show == "position":
            pixels = np.where(pixels[..., 3:] > 0, pixels, np.nan)
        return pixels.mean(axis=(1, 3))[..., :3]

    def complaints(self) -> list[str]:
        """What the browser's console says of errors and warnings since the last call."""
        return [
            each["message"] for each in self.driver.get_log("browser") if each["level"] in ("SEVERE", "WARNING")
        ]


class _Handler(PageHandler):
    """Of a page, /models/... and the folders of packages, /three/... and others."""

    def __init__(self, *arguments: Any, page: bytes, files: dict[str, Path], folders: dict[str, Path]) -> None:
        self.files, self.folders = files, folders
        super().__init__(*arguments, page=page)

    def translate_path(self, path: str) -> str:
        kind, _, rest = path.lstrip("/").partition("/")
        if kind == "models":
            return str(self.files.get(rest, Path(os.devnull)))
        if kind not in self.folders:
            return os.devnull
        self.directory = str(self.folders[kind])
        return super().translate_path(rest)


@contextlib.contextmanager
def viewer(
    page: bytes = PAGE, packages: Sequence[str] = ("three",), models: Mapping[str, Path] | None = None
) -> Iterator[Viewer]:
    """A browser with three.js in it, and a server of its files on the loopback.

    page, packages : of another program, of which these are npm's
    models         : files that the page asks for as it loads, by the name that follows /models/
    """
    files: dict[str, Path] = dict(models or {})
    folders = {name: folder for name in packages if (folder := npm.package(name))}
    handler = partial(_Handler, page=page, files=files, folders=folders)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            with browser.chrome(*ARGUMENTS) as driver:
                url = f"http://127.0.0.1:{server.server_port}/"
                driver.get(url)
                driver.execute_async_script(
                    "const done = arguments[0];"
                    "const look = () => window.ready ? done() : setTimeout(look, 20); look()"
                )
                yield Viewer(driver, url, files)
        finally:
            server.shutdown()


def picture(glb: str | Path, width: int, height: int, **options: Any) -> np.ndarray:
    """A single picture, in a browser of its own. See `Viewer.picture`."""
    with viewer() as three:
        return three.picture(glb, width, height, **options)


if __name__ == "__main__":
    from PIL import Image

    from glpath.system.colour import encode_srgb

    shown = picture(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
    Image.fromarray((encode_srgb(np.clip(shown, 0, 1)) * 255 + 0.5).astype(np.uint8)).save(sys.argv[4])
