"""Reader of glTF 2.0 models, .gltf and .glb."""

from glpath.io.gltf.lights import ModelCamera
from glpath.io.gltf.load import Model, read_gltf

__all__ = ["Model", "ModelCamera", "read_gltf"]
