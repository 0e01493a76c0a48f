"""Shows a .glb in Babylon.js, as three_js.py does in three.js: from its own camera, in linear values.

    pytestmark = babylon_js.marks()

    with babylon_js.viewer() as babylon:
        seen = babylon.picture(tmp_path / "a.glb", 64, 48, lines=LINES)      # (48, 64, 3) float32

`lines` is the script of a page that has a `world` (BABYLON.Scene) and loads 'baked.glb' into it. Needs npm's
`babylonjs` and `babylonjs-loaders` (see npm.py), but no network.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest

from tests.support import browser, npm, three_js

PACKAGES = ("babylonjs", "babylonjs-loaders")

PAGE = b"""<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<script src="/babylonjs/babylon.js"></script>
<script src="/babylonjs-loaders/babylonjs.loaders.min.js"></script>
<script>
const canvas = document.createElement('canvas')
const engine = new BABYLON.Engine(canvas, false)
const AsyncFunction = (async () => {}).constructor

window.picture = async (url, width, height, samples, show, name, lines) => {
  const [w, h] = [width * samples, height * samples]
  engine.setSize(w, h)
  const world = new BABYLON.Scene(engine)
  world.imageProcessingConfiguration.applyByPostProcess = true // materials then write linear light
  await new AsyncFunction('BABYLON', 'world', lines)(BABYLON, world)
  const target = new BABYLON.RenderTargetTexture('seen', { width: w, height: h }, world,
    { type: BABYLON.Constants.TEXTURETYPE_FLOAT, generateMipMaps: false })
  target.activeCamera = world.activeCamera = world.cameras[0]
  target.clearColor = new BABYLON.Color4(0, 0, 0, 0)
  target.renderList = world.meshes
  world.customRenderTargets.push(target)
  await world.whenReadyAsync()
  world.render()
  const pixels = await target.readPixels()
  const bytes = new Uint8Array(pixels.buffer, pixels.byteOffset, pixels.byteLength)
  let text = ''
  for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768))
  world.dispose()
  return btoa(text)
}
window.ready = true
</script>"""


def marks() -> list[pytest.MarkDecorator]:
    """Return marks of evidence that is skipped if the browser or Babylon.js is missing."""
    return browser.marks(
        **{f"npm's {name} (NODE_PATH=FOLDER/node_modules)": npm.package(name) for name in PACKAGES}
    )


@contextlib.contextmanager
def viewer() -> Iterator[three_js.Viewer]:
    """Start a browser with Babylon.js, whose `picture` needs `lines` and shows light."""
    with three_js.viewer(PAGE, PACKAGES) as found:
        yield found
