"""Renders a model with Blender's importer and Cycles, in the Python that has `bpy`, maybe another than glpath's.

    python blender_worker.py < ASKED

ASKED is JSON: {"file", "side", "spp", "max_depth", "folder", "camera", "fov", "clip", "sky"}, the last four as
`model_worker` returns them. These keys are optional:

    exposure    : factor of the light, also for the noise threshold of sampling
    environment : path of a map to use instead of the sky
    denoise     : whether to apply Cycles' denoiser
    height      : height of the picture, if it is not the side
    threshold   : noise threshold of adaptive sampling
    time_limit  : limit in seconds
    seed        : seed of sampling; 0 by default

FOLDER/blender.exr is the picture; the last line of standard output is the result. This file imports nothing of
glpath: file, materials and lights are those that Blender reads.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any


def main() -> None:
    asked = json.load(sys.stdin)
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # Blender prints its progress to standard output
    del sys.path[0]  # this folder, whose cycles.py would hide Blender's add-on of that name
    import bpy

    start = time.perf_counter()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _import(bpy, asked["file"])
    _at_rest(bpy)
    scene = bpy.context.scene
    _look(bpy, scene, asked)
    _settle(scene, asked)
    loaded = time.perf_counter() - start
    start = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    taken = {"load_seconds": loaded, "render_seconds": time.perf_counter() - start}
    print(json.dumps({"status": "rendered", "version": bpy.app.version_string, **taken}), file=answers, flush=True)


def _import(bpy: Any, file: str) -> None:
    """Import a file. Blender has z up: (x, y, z) becomes (x, -z, y)."""
    axes = {"forward_axis": "NEGATIVE_Z", "up_axis": "Y"}
    suffix = Path(file).suffix.lower()
    if suffix in (".gltf", ".glb"):
        # Take candela as W/sr, which is a power of 4 pi W, as glpath does.
        bpy.ops.import_scene.gltf(filepath=file, export_import_convert_lighting_mode="COMPAT")
    elif suffix == ".obj":
        bpy.ops.wm.obj_import(filepath=file, **axes)
    elif suffix == ".ply":
        bpy.ops.wm.ply_import(filepath=file, **axes)
    else:
        bpy.ops.wm.stl_import(filepath=file, **axes)


def _at_rest(bpy: Any) -> None:
    for each in [*bpy.data.objects, *bpy.data.shape_keys, *bpy.data.materials]:
        each.animation_data_clear()
    for each in bpy.data.objects:
        if each.type == "ARMATURE":
            each.data.pose_position = "POSE"
    # Remove shapes that the importer adds to show bones; meshes without a material become white.
    for each in list(bpy.data.objects):
        if each.name.startswith("Icosphere") and each.users_collection[0].name.startswith("glTF_not"):
            bpy.data.objects.remove(each)
    for each in bpy.data.objects:
        if each.type == "MESH" and not any(slot.material for slot in each.material_slots):
            material = bpy.data.materials.new("white")
            material.use_nodes = True
            shader = material.node_tree.nodes["Principled BSDF"]
            shader.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
            shader.inputs["Roughness"].default_value = 1.0
            each.data.materials.append(material)


def _look(bpy: Any, scene: Any, asked: dict[str, Any]) -> None:
    """Set the camera and the surrounding light."""
    data = bpy.data.cameras.new("view")
    data.sensor_fit = "VERTICAL"
    data.angle = math.radians(asked["fov"])
    data.clip_start, data.clip_end = asked["clip"]
    camera = bpy.data.objects.new("view", data)
    matrix = type(camera.matrix_world)  # mathutils.Matrix
    turned = matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
    camera.matrix_world = turned @ matrix(asked["camera"])
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.world = None
    if asked["sky"] is not None or "environment" in asked:
        scene.world = bpy.data.worlds.new("sky")
        scene.world.use_nodes = True
        background = scene.world.node_tree.nodes["Background"]
        background.inputs["Strength"].default_value = 1.0
        if "environment" in asked:
            picture = scene.world.node_tree.nodes.new("ShaderNodeTexEnvironment")
            picture.image = bpy.data.images.load(asked["environment"])
            scene.world.node_tree.links.new(picture.outputs["Color"], background.inputs["Color"])
        else:
            background.inputs["Color"].default_value = (*asked["sky"], 1.0)


def _settle(scene: Any, asked: dict[str, Any]) -> None:
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.use_compositing = render.use_sequencer = False
    render.resolution_x, render.resolution_y = asked["side"], asked.get("height", asked["side"])
    render.resolution_percentage = 100
    render.filepath = str(Path(asked["folder"], "blender.exr"))
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGB"
    render.image_settings.color_depth = "32"
    cycles.device = "CPU"
    cycles.samples = asked["spp"]
    cycles.pixel_filter_type = "BOX"
    cycles.use_denoising, cycles.use_adaptive_sampling = asked.get("denoise", False), "threshold" in asked
    cycles.adaptive_threshold = asked.get("threshold", 0.0)
    cycles.film_exposure = asked.get("exposure", 1.0)
    cycles.time_limit = asked.get("time_limit", 0.0)
    cycles.seed = asked.get("seed", 0)
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    bounces = asked["max_depth"] - 1
    for name in ("max", "diffuse", "glossy", "transmission", "volume"):
        setattr(cycles, f"{name}_bounces", bounces)
    cycles.transparent_max_bounces = 32


if __name__ == "__main__":
    main()
