"""glTF files that others wrote: Debian's assimp-testmodels, good ones and broken ones."""

from __future__ import annotations

import re
import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from glpath.errors import SceneError
from glpath.io.gltf import Model, read_gltf
from glpath.scene.model import Shapes

FOLDER = Path("/usr/share/assimp/models")
VERSION_1 = "version 1|version is '1"
#: Those that are refused, or folders of them, and what the error says.
REFUSED = {
    "glTF/": VERSION_1,
    "glTF2/BoxTextured-glTF-techniqueWebGL/": "KHR_technique_webgl",
    "glTF2/BoxWithInfinites-glTF-Binary/": r"POSITION\[0\]\[0\] is -inf",
    "glTF2/IndexOutOfRange/": r"indices\[\d+\] names vertex",
    "glTF2/MissingBin/": "does not exist",
    "glTF2/RecursiveNodes/": "its own ancestor",
    "glTF2/SchemaFailures/": 'scene is "hello"',
    "glTF2/TestNoRootNode/NoScene.gltf": "no scenes",
    "glTF2/wrongTypes/": "must be|has no `index`|but the file has",
}
#: Nothing is in them.
EMPTY = re.compile(r"SceneWithoutNodes")
#: Points and lines alone.
STROKES = re.compile(r"PrimitiveMode_(00|01|02|03|07|08|09|10)")

pytestmark = [
    pytest.mark.evidence,
    pytest.mark.skipif(not FOLDER.is_dir(), reason="the Debian package assimp-testmodels is not installed"),
]


def read(name: str, time: float | None = None) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if STROKES.search(name):
            warnings.filterwarnings("ignore", message=r".*gltf: has no triangles, so its points and lines")
        return read_gltf(FOLDER / name, time=time)


def test_each_file_is_read_or_refused_for_its_reason() -> None:
    files = sorted(p for p in FOLDER.rglob("*") if p.suffix.lower() in (".gltf", ".glb"))
    assert len(files) >= 50
    for path in files:
        name = str(path.relative_to(FOLDER))
        reason = next((text for start, text in REFUSED.items() if name.startswith(start)), None)
        if "/draco/" in name and find_spec("DracoPy") is None:
            reason = r"glpath\[gltf\]"
        if reason is not None:
            with pytest.raises(SceneError, match=reason) as caught:
                read(name)
            assert path.name in str(caught.value)
        else:
            model = read(name)
            assert bool(model.shapes) != bool(EMPTY.search(name)), name
            assert np.isfinite(Shapes(model.shapes).vertices).all()


def test_the_engine_has_the_same_triangles_with_and_without_draco() -> None:
    pytest.importorskip("DracoPy", reason="needs the extra gltf")
    plain, packed = (
        Shapes(read(name).shapes)
        for name in ("glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb", "glTF2/draco/2CylinderEngine.gltf")
    )
    size = np.linalg.norm(plain.bounds[1] - plain.bounds[0])
    np.testing.assert_allclose(packed.bounds, plain.bounds, atol=1e-3 * size)
    # Draco's rounding leaves some of the smallest triangles without an area.
    assert abs(packed.total("triangle") / plain.total("triangle") - 1) < 1e-3


def test_arrows_point_at_the_markers_of_texture_transforms() -> None:
    """Khronos' TextureTransformTest: the marker "Correct" stands where an arrow points to."""
    model = read("glTF2/textureTransform/TextureTransformTest.gltf")
    of_name = {shape.name: shape for shape in model.shapes}
    markers = of_name["Correct Marker"].world_from_object[:, :, 3]
    for name, marker in zip(("Rotation", "Scale", "All"), markers, strict=True):
        shape = of_name[name]
        x, y = (marker - shape.world_from_object[0, :, 3])[:2]
        slot = model.materials[shape.material].texture
        assert slot is not None
        u, v = slot.uv_transform @ [x + 0.5, y + 0.5, 1]  # of a quad of side 1 about its middle
        np.testing.assert_allclose((u, 1 - v), 7 / 9, atol=0.03)


def test_a_morphing_cube_moves() -> None:
    name = "glTF2/glTF-Sample-Models/AnimatedMorphCube-glTF/AnimatedMorphCube.gltf"
    rest, moved = (Shapes(read(name, time).shapes).bounds for time in (None, 2.0))
    assert not np.allclose(rest, moved, rtol=0.05)


def test_a_skin_of_two_joints_bends() -> None:
    rest, moved = (Shapes(read("glTF2/simple_skin/simple_skin.gltf", time).shapes).bounds for time in (None, 1.0))
    assert moved[1][1] < rest[1][1] - 0.1
