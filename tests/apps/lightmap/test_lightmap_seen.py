"""Baked scenes as others see them: three.js and Babylon.js from the scene's camera, and the Khronos validator."""

from __future__ import annotations

import functools
import io
import json
import re
import subprocess
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_dilation

import glpath
from benchmarks.peers import other_python
from glpath.film.image import read_image
from glpath.system.colour import encode_srgb
from tests.support import babylon_js, three_js
from tests.support.gltf_files import ReadGlb
from tests.support.gltf_validator import judged
from tests.support.repository import ROOT

pytest.importorskip("xatlas")


@pytest.fixture(scope="module")
def baked() -> glpath.Lightmap:
    return glpath.lightmap("cornell-box", size=256, spp=48)


@pytest.fixture(scope="module")
def three() -> Iterator[three_js.Viewer]:
    with three_js.viewer() as viewer:
        yield viewer


#: A plugin of three.js's GLTFLoader for MOZ_lightmap, of which the one of three.js itself is not in a release yet.
MOZ = """
const loader = new GLTFLoader()
loader.register(parser => ({
  name: 'MOZ_lightmap',
  async loadMaterial(index) {
    const { [this.name]: light } = parser.json.materials[index].extensions
    const material = await parser.loadMaterial(index)
    await parser.assignTexture(material, 'lightMap', light)
    material.lightMapIntensity = light.intensity
    return material
  }
}))
const { scene } = await loader.loadAsync('baked.glb')
"""


@functools.cache
def our_own() -> np.ndarray:
    """(128, 128, 3): the picture, with all bounces as the lightmap has them."""
    return glpath.render("cornell-box", spp=48, resolution=(128, 128), max_depth=64, roulette=4).mean


def lines_of_the_page(word: str) -> str:
    """Those in JavaScript that have a word."""
    pages = "".join(path.read_text("utf-8") for path in sorted((ROOT / "docs/howto").glob("lightmap-*.md")))
    (lines,) = (block for block in re.findall(r"```js\n(.*?)```", pages, re.DOTALL) if word in block)
    return lines


def page_of_the_notebook() -> str:
    """The page of HTML that notebook 09 writes."""
    book = json.loads((ROOT / "notebooks" / "09_lightmap.ipynb").read_text("utf-8"))
    (cell,) = (text for each in book["cells"] if (text := "".join(each["source"])).startswith("page = "))
    return cell.split('"""')[1]


def check_it_is_our_own(seen: np.ndarray) -> None:
    """That a picture (128, 128, 3), radiance, of the box is that of our own."""
    own = our_own()
    lamp = binary_dilation(own.max(axis=2) > 2, iterations=2)
    assert lamp.sum() < 1500
    seen, own = (np.where(lamp[..., None], 0, image) for image in (seen, own))
    print(lamp.sum(), seen.mean(axis=(0, 1)) / own.mean(axis=(0, 1)) - 1, seen.mean() / own.mean() - 1)
    assert abs(seen.mean() / own.mean() - 1) < 0.01
    blocks = [image.reshape(16, 8, 16, 8, 3).mean(axis=(1, 3)) for image in (seen, own)]
    assert np.abs(blocks[0] - blocks[1]).mean() < 0.02 * own.mean()


@pytest.mark.evidence
def test_blender_shows_kept_materials_in_their_light(baked: glpath.Lightmap, tmp_path: Path) -> None:
    """By the lines of the guide, which put the .exr on the second texture coordinates of the .glb."""
    interpreter = other_python.python()
    try:
        other_python.find_package("bpy", interpreter)
    except glpath.GlpathError as error:
        pytest.skip(str(error))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", glpath.SceneWarning)
        baked.save(tmp_path / "kept.glb", materials="keep")
    page = (ROOT / "docs/howto/lightmap-engines.md").read_text("utf-8")
    (code,) = re.findall(r"```python\n(import bpy\n.*?)```", page, re.DOTALL)
    camera = glpath.load_scene("cornell-box").camera
    right, up, forward = camera.frame()
    pose = np.vstack([np.stack([right, up, -forward, camera.position], axis=1), [0, 0, 0, 1]])
    asked = {
        "file": str(tmp_path / "kept.glb"),
        "light": str(tmp_path / "kept-0.lightmap.exr"),
        "code": code,
        "picture": str(tmp_path / "seen.exr"),
        "camera": pose.tolist(),
        "fov": camera.fov,
        "side": 128,
    }
    worker = ROOT / "tests/support/lightmap_in_blender.py"
    done = subprocess.run(
        [interpreter, str(worker)], input=json.dumps(asked), text=True, capture_output=True, timeout=900
    )
    assert done.returncode == 0, done.stderr[-2000:]
    check_it_is_our_own(read_image(tmp_path / "seen.exr")[..., :3])


class TestInThree:
    pytestmark = three_js.marks()

    def test_the_baked_box_is_our_own_picture(
        self, baked: glpath.Lightmap, three: three_js.Viewer, tmp_path: Path
    ) -> None:
        baked.save(tmp_path / "a.glb")
        stops = ReadGlb.of(tmp_path / "a.glb").json["extras"]["exposure_stops"]
        seen = three.picture(tmp_path / "a.glb", 128, 128)
        own = our_own() * 2.0**stops
        # Where the edge of the lamp crosses a pixel, the mean of what is cut is not the cut of the mean.
        lamp = binary_dilation(own.max(axis=2) > 3, iterations=2)
        assert lamp.sum() < 500
        seen, own = (np.where(lamp[..., None], 0, np.clip(image, 0, 1)) for image in (seen, own))
        print(seen.mean(axis=(0, 1)) / own.mean(axis=(0, 1)) - 1, seen.mean() / own.mean() - 1)
        assert abs(seen.mean() / own.mean() - 1) < 0.01
        # By blocks, so that noise is no matter: the same place has the same light.
        blocks = [image.reshape(16, 8, 16, 8, 3).mean(axis=(1, 3)) for image in (seen, own)]
        assert np.median(np.abs(blocks[0] - blocks[1])) < 0.01
        assert np.abs(blocks[0] - blocks[1]).mean() < 0.02

    def test_the_lines_of_the_page_show_kept_materials_in_their_light(
        self, baked: glpath.Lightmap, three: three_js.Viewer, tmp_path: Path
    ) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", glpath.SceneWarning)
            baked.save(tmp_path / "kept.glb", materials="keep")
        seen = three.picture(tmp_path / "kept.glb", 128, 128, lines=lines_of_the_page("GLTFLoader"))
        check_it_is_our_own(seen)

    def test_the_page_of_the_notebook_shows_the_baked_room(self, baked: glpath.Lightmap, tmp_path: Path) -> None:
        """As a reader opens it, but with three.js from a folder."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", glpath.SceneWarning)
            baked.save(tmp_path / "baked.glb", materials="keep")
        page, changes = page_of_the_notebook(), 0
        for there, here in (
            (r"https://cdn\.jsdelivr\.net/npm/three@[\d.]+/", "/three/"),
            (r"'baked", "'/models/baked"),
            (r"renderer\.render\(scene, camera\)", "renderer.render(scene, camera); window.ready = true"),
            (r"antialias: true", "antialias: true, preserveDrawingBuffer: true"),
        ):
            page, count = re.subn(there, here, page)
            changes += count > 0
        assert changes == 4
        files = {path.name: path for path in tmp_path.iterdir()}
        with three_js.viewer(page.encode(), models=files) as viewer:
            image = Image.open(io.BytesIO(viewer.driver.get_screenshot_as_png())).convert("RGB")
            assert viewer.complaints() == []
        # The picture is as high as the page, and has the camera's height of field: a square in the middle is ours.
        side, left = image.height, (image.width - image.height) // 2
        seen = np.asarray(image.crop((left, 0, left + side, side)).resize((128, 128), Image.Resampling.BOX)) / 255
        own = encode_srgb(np.clip(our_own(), 0, 1))
        print(seen.mean(axis=(0, 1)), own.mean(axis=(0, 1)), np.abs(seen - own).mean())
        assert np.abs(seen - own).mean() < 0.04

    def test_light_in_the_file_is_shown_by_a_loader_of_moz_lightmap(
        self, baked: glpath.Lightmap, three: three_js.Viewer, tmp_path: Path
    ) -> None:
        """Of an index of a texture, its texCoord and an intensity, as Hubs's loader and three.js's have it."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", glpath.SceneWarning)
            baked.save(tmp_path / "kept.glb", materials="keep", moz=True)
        check_it_is_our_own(three.picture(tmp_path / "kept.glb", 128, 128, lines=MOZ))

    def test_a_baked_room_is_our_own_picture(self, three: three_js.Viewer, tmp_path: Path) -> None:
        """As floats: what is cut at 1 of noisy texels and of noisy pixels differs by some percent."""
        room = glpath.lightmap("room", size=512, spp=16)
        assert room.steps().max() < 0.02
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", glpath.SceneWarning)
            room.save(tmp_path / "kept.glb", materials="keep")
        seen = three.picture(tmp_path / "kept.glb", 96, 96, lines=lines_of_the_page("GLTFLoader"))
        film = glpath.render("room", spp=128, resolution=(96, 96), max_depth=64, roulette=4)
        lamp = binary_dilation(film.mean.max(axis=2) > 8, iterations=2)
        assert lamp.sum() < 400
        seen, own = (np.where(lamp[..., None], 0, image) for image in (seen, film.mean))
        blocks = [image.reshape(12, 8, 12, 8, 3).mean(axis=(1, 3, 4)) for image in (seen, own)]
        off = blocks[0] / blocks[1] - 1
        print(seen.mean(axis=(0, 1)) / own.mean(axis=(0, 1)) - 1, seen.mean() / own.mean() - 1, np.median(off))
        print(np.quantile(off, [0.05, 0.25, 0.75, 0.95]), lamp.sum(), film.relative_error())
        assert abs(seen.mean() / own.mean() - 1) < 0.01
        assert abs(np.median(off)) < 0.015
        assert np.quantile(np.abs(off), 0.8) < 0.12


class TestInBabylon:
    pytestmark = babylon_js.marks()

    def test_the_lines_of_the_page_show_kept_materials_in_their_light(
        self, baked: glpath.Lightmap, tmp_path: Path
    ) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", glpath.SceneWarning)
            baked.save(tmp_path / "kept.glb", materials="keep")
        with babylon_js.viewer() as babylon:
            lines = lines_of_the_page("BABYLON")
            check_it_is_our_own(babylon.picture(tmp_path / "kept.glb", 128, 128, lines=lines))
            assert babylon.complaints() == []


@pytest.mark.evidence
def test_the_validator_finds_nothing(baked: glpath.Lightmap, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", glpath.SceneWarning)
        baked.save(tmp_path / "a.glb")
        baked.save(tmp_path / "b.glb", materials="keep")
        baked.save(tmp_path / "c.glb", materials="keep", moz=True)
    assert judged(tmp_path / "a.glb") == []
    assert judged(tmp_path / "b.glb") == []
    # An extension of Mozilla's is none that it knows: what it cannot find in that, the tests of MOZ_lightmap do.
    assert judged(tmp_path / "c.glb") == []
