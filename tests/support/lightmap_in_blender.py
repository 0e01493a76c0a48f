"""Renders a baked .glb and its light in Blender; run by the Python that has `bpy`.

    python lightmap_in_blender.py < ASKED

ASKED is JSON: {"file", "light", "code", "picture", "camera", "fov", "side"}: the .glb, the .exr, the lines of the
guide that put the one on the other, where the picture goes, and the camera's pose (4 x 4), OpenGL's, and degrees.
"""

from __future__ import annotations

import json
import math
import os
import sys
from typing import Any


def main() -> None:
    asked = json.load(sys.stdin)
    os.dup2(2, 1)
    del sys.path[0]
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=asked["file"])
    for light in [each for each in bpy.data.objects if each.type == "LIGHT"]:
        bpy.data.objects.remove(light)
    exec(asked["code"].replace("//room-0.lightmap.exr", asked["light"]), {})
    _render(bpy, asked)


def _render(bpy: Any, asked: dict[str, Any]) -> None:
    scene = bpy.context.scene
    data = bpy.data.cameras.new("view")
    data.sensor_fit, data.angle = "VERTICAL", math.radians(asked["fov"])
    data.clip_start, data.clip_end = 1e-3, 1e5
    camera = bpy.data.objects.new("view", data)
    matrix = type(camera.matrix_world)
    turned = matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
    camera.matrix_world = turned @ matrix(asked["camera"])
    scene.collection.objects.link(camera)
    scene.camera = camera
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = asked["side"]
    render.resolution_percentage = 100
    render.filepath = asked["picture"]
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    cycles.device, cycles.samples, cycles.pixel_filter_type = "CPU", 16, "BOX"
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.max_bounces = 0
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
