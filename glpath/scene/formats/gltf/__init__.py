"""glTF 2.0 models, .gltf and .glb."""

from glpath.scene.formats.gltf.lights import ModelCamera
from glpath.scene.formats.gltf.load import Model, read_gltf

__all__ = ["Model", "ModelCamera", "read_gltf"]
