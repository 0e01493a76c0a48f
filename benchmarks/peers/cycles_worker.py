"""Cycles in a separate process, in the Python that has `bpy`, which may be another than glpath's.

    python cycles_worker.py SCENE.npz

`cycles_peer.write_scene` or `write_bake` writes SCENE.npz. Then each line of standard input asks for a picture,
{"spp": 64, "seed": 1, "out": "a.exr", "settings": {}}, and each line of standard output is an answer, {"seconds":
1.5, "peak_bytes": 4e8}. A bake writes .npy of (size, size, 3), irradiance over pi, row 0 at the bottom. The first
answer, before any picture, is Blender's version. This file imports nothing of glpath.

Settings for the least time to a given error: the path tracer on all cores with Embree, next event estimation, and
nothing that changes the mean (clamping, light threshold, limits by kind of bounce, denoiser, adaptive sampling).
Geometry and BVH stay between pictures, and the first picture is not timed.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from typing import Any

import numpy as np


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # Blender prints its progress to standard output
    del sys.path[0]  # this folder, whose cycles.py would hide Blender's add-on of that name
    import bpy

    described = np.load(sys.argv[1])
    scene = make_scene(bpy, described)
    image = _add_baked(bpy, scene, described) if "size" in described else None
    print(json.dumps({"version": bpy.app.version_string}), file=answers, flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        scene.cycles.samples, scene.cycles.seed = asked["spp"], asked["seed"]
        scene.render.filepath = asked["out"]
        for name, value in asked["settings"].items():
            setattr(scene.cycles, name, value)
        start = time.perf_counter()
        if image is None:
            bpy.ops.render.render(write_still=True)
        else:
            bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, margin=0, use_clear=True)
        answer = {"seconds": time.perf_counter() - start, "peak_bytes": _peak_bytes()}
        if image is not None:
            pixels = np.empty(4 * image.size[0] * image.size[1], np.float32)
            image.pixels.foreach_get(pixels)
            np.save(asked["out"], pixels.reshape(image.size[1], image.size[0], 4)[..., :3])
        print(json.dumps(answer), file=answers, flush=True)


def _peak_bytes() -> int:
    with open("/proc/self/status") as status:
        return next(1024 * int(line.split()[1]) for line in status if line.startswith("VmHWM:"))


def make_scene(bpy: Any, described: Any) -> Any:
    """Make Blender's scene with only what is described."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for i in range(int(described["shapes"])):
        _add_mesh(bpy, scene, f"shape{i}", described[f"corners{i}"], described[f"light{i}"])
    if "fov" in described:
        _add_camera(bpy, scene, described)
        scene.render.resolution_x, scene.render.resolution_y = map(int, described["resolution"])
    scene.world = None  # a new world would be grey
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.use_persistent_data = True
    render.use_compositing = render.use_sequencer = False
    render.resolution_percentage = 100
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGB"
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "NONE"
    cycles.device = "CPU"
    cycles.pixel_filter_type = "BOX"
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0
    bounces = int(described["bounces"])
    cycles.max_bounces = cycles.diffuse_bounces = bounces
    return scene


def _add_mesh(bpy: Any, scene: Any, name: str, corners: Any, light: Any) -> None:
    """Add a mesh of (n, 3, 3) corners without shared vertices; light: (8,), see `cycles_peer.write_scene`."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners.reshape(-1, 3).tolist(), [], np.arange(3 * len(corners)).reshape(-1, 3).tolist())
    mesh.materials.append(_material(bpy, name, light))
    scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def _add_baked(bpy: Any, scene: Any, described: Any) -> Any:
    """Add one selected mesh of everything to bake; return the picture to bake to.

    It is one mesh because Cycles synchronizes the scene again for each object.
    """
    size = int(described["size"])
    image = bpy.data.images.new("light", size, size, float_buffer=True, is_data=True)
    corners = described["corners"]
    mesh = bpy.data.meshes.new("baked")
    mesh.from_pydata(corners.reshape(-1, 3).tolist(), [], np.arange(3 * len(corners)).reshape(-1, 3).tolist())
    for i, light in enumerate(described["lights"]):
        material = _material(bpy, f"baked{i}", light)
        node = material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        material.node_tree.nodes.active = node
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", described["light_of"].astype(np.int32))
    mesh.uv_layers.new(name="light").data.foreach_set("uv", described["uv"].astype(np.float32).ravel())
    one = bpy.data.objects.new("baked", mesh)
    scene.collection.objects.link(one)
    one.select_set(True)
    bpy.context.view_layer.objects.active = one
    return image


def _material(bpy: Any, name: str, light: Any) -> Any:
    reflectance, two_sided, emission, emits_twice = light[:3], light[3] > 0, light[4:7], light[7] > 0
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    back = nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]

    def black_behind(front: Any) -> Any:
        mix, black = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeBsdfDiffuse")
        black.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
        links.new(back, mix.inputs[0])
        links.new(front, mix.inputs[1])
        links.new(black.outputs[0], mix.inputs[2])
        return mix.outputs[0]

    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*map(float, reflectance), 1.0)
    surface = diffuse.outputs[0] if two_sided else black_behind(diffuse.outputs[0])
    if emission.max() > 0:
        glow, both = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeAddShader")
        glow.inputs["Color"].default_value = (*map(float, emission), 1.0)
        glow.inputs["Strength"].default_value = 1.0
        links.new(surface, both.inputs[0])
        links.new(glow.outputs[0] if emits_twice else black_behind(glow.outputs[0]), both.inputs[1])
        surface = both.outputs[0]
        material.cycles.emission_sampling = "FRONT_BACK" if emits_twice else "FRONT"
    links.new(surface, nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def _add_camera(bpy: Any, scene: Any, described: Any) -> None:
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "VERTICAL"
    data.angle = math.radians(float(described["fov"]))
    data.clip_start, data.clip_end = map(float, described["clip"])
    camera = bpy.data.objects.new("camera", data)
    matrix = type(camera.matrix_world)  # mathutils.Matrix
    camera.matrix_world = matrix(described["world_from_camera"].tolist())
    scene.collection.objects.link(camera)
    scene.camera = camera


if __name__ == "__main__":
    main()
