"""Defines of shaders: the variants of a program, and the numbers in its text.

A variant leaves out features that a scene lacks, or selects the purpose of a program. `defined` makes the defines
of variants; `load_program` refuses undeclared names. docs/explanation/developing.md has the table, which
`.ci/tables.py` writes.
"""

from __future__ import annotations

from typing import NamedTuple

from glpath.film.aovs import GROUPS
from glpath.gl.material_texels import MATERIAL_VARIANTS


class Variant(NamedTuple):
    """Variant of a shader.

    meaning : condition for the variant
    set_by  : module of glpath that sets it; "shaders" if a shader defines it itself
    """

    meaning: str
    set_by: str


_SCENE, _TEXTURES, _CAMERA = "gl.device_scene", "gl.texture_images", "gl.camera"
_LIGHTS, _RAYS, _STAGES = "gl.lights", "integrators.ray_paths", "integrators.path_buffer_stages"
_THIN = "gl.thin_dielectrics"
_SCANS, _WHITTED, _T_BUFFER = "buffers.path_buffer", "integrators.whitted", "buffers.t_buffer"

VARIANTS: dict[str, Variant] = {
    # Contents of a scene.
    "HAS_SPHERES": Variant("the scene has spheres", _SCENE),
    "HAS_ELLIPSOIDS": Variant("the scene has ellipsoids", _SCENE),
    "HAS_TRIANGLES": Variant("the scene has triangles", _SCENE),
    "HAS_PLANES": Variant("the scene has endless planes", _SCENE),
    **{name: Variant(each.meaning, "gl.material_texels") for name, each in MATERIAL_VARIANTS.items()},
    "HAS_THIN_DIELECTRICS": Variant("a material is thin glass, which paths go straight through", _THIN),
    "HAS_VARYING_THIN_DIELECTRICS": Variant("and it has textures, colours or normals to shade with", _THIN),
    "HAS_EXACT_LAYERS": Variant("HAS_FRESNEL, HAS_METAL_INDICES or HAS_BECKMANN", "shaders"),
    "HAS_LOBES": Variant("a material has lobes: HAS_MICROFACETS or HAS_MIRRORS", "shaders"),
    "HAS_ALPHA": Variant("a material that is used is masked, blended or culled", _SCENE),
    "HAS_CULLING": Variant("the back of a material that is used is not there", _SCENE),
    "HAS_NORMALS": Variant("there are normals to shade with", _SCENE),
    "HAS_VERTEX_NORMALS": Variant("of vertices", _SCENE),
    "HAS_NORMAL_MAPS": Variant("of normal maps", _TEXTURES),
    "HAS_UV": Variant("vertices have texture coordinates, or a texture or tangents need some", _SCENE),
    "HAS_VERTEX_COLOURS": Variant("vertices have colours", _SCENE),
    "HAS_COLOURED_LIGHT": Variant("vertex colours shine", _SCENE),
    "HAS_TRIANGLE_DENSITIES": Variant("lamps' triangles have densities of their own", _SCENE),
    "HAS_ENVIRONMENT": Variant("the sky is an image", _SCENE),
    "HAS_SUN": Variant("and has the sun's disc besides", _SCENE),
    "HAS_BACKGROUND": Variant("the eye sees another background than the sky", _SCENE),
    "HAS_GROUND": Variant("and a ground there, which catches shadows", "integrators.ground"),
    "HAS_DIRECTIONAL_LIGHTS": Variant("there are directional lights", _SCENE),
    "HAS_PROFILES": Variant("a point light has an IES profile", _SCENE),
    "HAS_INSTANCES": Variant("meshes are there once, with a list of instances", _SCENE),
    "STREAMED": Variant("some triangles are streamed", _SCENE),
    "HAS_TEXTURES": Variant("a material that is used has a texture", _TEXTURES),
    "HAS_SURFACE_TEXTURES": Variant("of roughness and metal", _TEXTURES),
    "HAS_COAT_TEXTURES": Variant("of the clearcoat and its roughness", _TEXTURES),
    "HAS_COAT_NORMALS": Variant("a clearcoat has other normals than its base", _TEXTURES),
    "HAS_SPECULAR_TEXTURES": Variant("of the strength and colour of a dielectric's reflection", _TEXTURES),
    "HAS_IRIDESCENCE_TEXTURES": Variant("of thin films and their thickness", _TEXTURES),
    "HAS_DIFFUSE_TRANSMISSION_TEXTURES": Variant("of what diffuse surfaces let through", _TEXTURES),
    "HAS_SHEEN_TEXTURES": Variant("of the colour of sheen", _TEXTURES),
    "HAS_SHEEN_ROUGHNESS_TEXTURES": Variant("of its roughness", _TEXTURES),
    "HAS_ANISOTROPY_TEXTURES": Variant("of tangents and anisotropy", _TEXTURES),
    "HAS_EMISSION_TEXTURES": Variant("of emission", _TEXTURES),
    "HAS_TRANSMISSION_TEXTURES": Variant("of transmission", _TEXTURES),
    "HAS_UV1": Variant("a texture has the second set of coordinates", _TEXTURES),
    "HAS_WRAPS": Variant("a texture does otherwise than repeat", _TEXTURES),
    "HAS_BYTE_IMAGES": Variant("an image has eight bits", _TEXTURES),
    "HAS_FLOAT_IMAGES": Variant("an image has floats", _TEXTURES),
    "HAS_SRGB_NUMBERS": Variant("numbers, as of roughness, are in an image whose bytes are sRGB's", _TEXTURES),
    "HAS_POSITIONAL_LIGHTS": Variant("light comes from positions", _LIGHTS),
    "HAS_DISTANT_LIGHTS": Variant("light comes from infinitely far", _LIGHTS),
    "HAS_SKY": Variant("rays that hit nothing see light", _LIGHTS),
    # Starts of paths.
    "EYE_ORTHOGRAPHIC": Variant("the camera is orthographic", _CAMERA),
    "EYE_PANORAMA": Variant("the camera sees all around", _CAMERA),
    "EYE_LENS": Variant("every pixel has a point of the lens of its own", _CAMERA),
    "START_POINTS": Variant("paths start at points, not at a camera", "integrators.start_points"),
    "START_SHADING": Variant("points have normals to shade with", "integrators.start_points"),
    "START_VERTEX": Variant("the first vertex of a path is made here", "shaders"),
    # Paths with per-path rays.
    "LANE_STRIDE": Variant("pixels share random numbers; so far apart", "gl.lanes"),
    "HAS_FAR_NODES": Variant("the BVH has more nodes than 20 bits count", "gl.ray_bvh"),
    "COMPUTE": Variant("a compute shader instead of a fragment shader", _RAYS),
    "ASKED": Variant(
        "parallel rays go through a part of a scene, where they are not blocked yet", "gl.streamed_rays"
    ),
    "GATHER": Variant("paths end by looking up a radiosity solution", _RAYS),
    "CONTROL_VARIATE": Variant("a radiosity solution stands in for paths, some of which correct it", _RAYS),
    "GUIDED": Variant("directions are chosen by guides", "integrators.path_guide"),
    "GUIDES_SHARED": Variant("elements share guides", "integrators.path_guide"),
    "ALL_LIGHT": Variant("what is looked up has direct light in it, for guides", "integrators.path_guide"),
    "PARTS": Variant("parts of the lights that no tree chooses among; a vertex looks at a sample of each", _RAYS),
    "LIGHT_TREE": Variant("a tree of lights chooses for each vertex; of how many samples", "gl.light_draws"),
    "PORTALS": Variant("light samples of the sky go through portals; how many", "gl.light_draws"),
    "LAMP_RECTANGLES": Variant("rectangular lamps are sampled by solid angle; how many", "gl.light_draws"),
    "LIT_FROM": Variant("a path knows where it was lit last, for densities that go by that", "shaders"),
    "OWN_LIGHT_SAMPLES": Variant("paths draw light samples of their own", "gl.light_draws"),
    "EMITTER_SILHOUETTES": Variant("emitter silhouettes are antialiased apart", _RAYS),
    # The path-buffer.
    "PACKED": Variant("depth and triangle share a float", _SCANS),
    "NEAREST": Variant("the first of two scans: the depth alone", _SCANS),
    "AT_NEAREST": Variant("the second of two scans: the triangle at that depth", _SCANS),
    "OCCLUSION": Variant("a scan finds whether anything is hit, not what", _SCANS),
    "LISTED": Variant("what is drawn is triangles of many cells; the others are in compute", "gl.small_triangles"),
    "SKIPS_NEAR": Variant("paths meet no simpler shape near their start", _SCANS),
    "FROM_PATHS": Variant("bounds of the paths; else of the grid", _SCANS),
    "WHOLE_SPHERE": Variant("directions are of the whole sphere, as in the paper", _STAGES),
    "LAST_VERTEX": Variant("paths end here", _STAGES),
    "TO_SUMS": Variant("and their light goes to the sums", _STAGES),
    "STREAMED_CHUNK": Variant("what is drawn is a chunk of streamed triangles", "gl.geometry_stream"),
    "OF_PATHS": Variant("records are of what paths have hit; else of an eye", "gl.geometry_stream"),
    # Shadow-buffers.
    "FULL_CUBE": Variant("the light sample sees all around", "buffers.hemicube_shadow_buffer"),
    "SHADOW_CUBE": Variant("a cube; else a sphere", "buffers.shadow_buffer"),
    "SHADOW_IDENTITY": Variant("the paper's rule: by the object", "buffers.shadow_buffer"),
    "SHADOW_BUFFERS": Variant("lights have shadow-buffers; else shadow rays", _WHITTED),
    # The ray tracer of the T-buffer.
    "KIND_SPHERE": Variant("what is drawn is spheres", _T_BUFFER),
    "KIND_ELLIPSOID": Variant("what is drawn is ellipsoids", _T_BUFFER),
    "KIND_TRIANGLE": Variant("what is drawn is triangles", _T_BUFFER),
    "KIND_PLANE": Variant("what is drawn is endless planes", _T_BUFFER),
    "SQUARES": Variant("rectangles are drawn as points", _T_BUFFER),
    "SECOND": Variant("the second of two passes: the lowest number at the same distance", _T_BUFFER),
    "COUNT_TESTS": Variant("intersection tests are counted", _T_BUFFER),
    "BY_BVH": Variant("rays that leave a surface go by a BVH", _WHITTED),
    "LIGHT_SAMPLES": Variant("surfaces and the sky shine; how many samples a path set has", _WHITTED),
    "STREAM_SHADOWS": Variant("streamed triangles block shadow rays, a bit each", "integrators.stream_shadows"),
    "REFLECTIONS": Variant("rays are reflected", _WHITTED),
    # The film.
    "FOLLOWS_MIRRORS": Variant("albedo and normal of mirrors are those of what they show", "integrators.aovs"),
    "SPLIT_LIGHT": Variant("direct light is summed apart", "gl.sums"),
    **{
        name: Variant(f"{group.meaning}; the number of their first output", "film.aovs")
        for name, group in GROUPS.items()
    },
    # The device.
    "TEXELS_ARE_IMAGES": Variant("texels are read as images: llvmpipe", "gl.program"),
}

#: Numbers and words in a program's text: sizes of arrays, formats of texels.
VALUES: dict[str, str] = {
    "AOV_QUANTA": "quanta of albedo and normal in 1",
    **{f"{name}_1": "the number of the second output" for name, group in GROUPS.items() if len(group.sums) > 1},
    "BOUNCES": "bounces that have numbers of a sequence",
    "BRANCHES": "paths that a pixel's path divides into at its first vertex",
    "BYTES_SHIFT": "the logarithm of the width of the texture of bytes",
    "DEPTH_LEVELS": "steps of the depth in a packed float",
    "DEPTH_SCALE": "from a distance to the depth that is tested",
    "EYE_FORMAT": "of the texture of what the eye sees",
    "GUIDE_LEVELS": "levels of a guide's tree",
    "GUIDE_NODES": "nodes of a guide's tree",
    "GUIDE_POINTS": "points on the elements of a guide",
    "GUIDE_RAYS": "rays from a guide through each of its cells",
    "ID_BITS": "bits of a triangle's number in a packed float",
    "LANES": "fragments of a vector, across and up",
    "GROUND_LIGHTS": "directions of a path set that light comes to the ground from",
    "LIGHTS": "light samples of a path set",
    "LIGHT_ROWS": "texels of a light sample",
    "NOTHING_FOUND": "what a cell holds where nothing was found",
    "SUBSAMPLES": "samples of a pixel in which a lamp ends",
    "RECTANGLES_WIDTH": "rectangles in a row of their table",
    "SHADOW_TAPS": "cells across that a lookup asks",
    "SQUARES_WIDTH": "squares in a row of their table",
    "VIEWS": "directions of a scan at most",
}


def defined(**variants: bool) -> dict[str, object]:
    """Return the defines of the variants that are true."""
    unknown = variants.keys() - VARIANTS.keys()
    assert not unknown, f"{sorted(unknown)}: not in the table of variants"
    return {name: 1 for name, there in variants.items() if there}


def check_declared(defines: dict[str, object]) -> None:
    """Refuse undeclared names, and variants set to false, because #ifdef ignores the value."""
    unknown = defines.keys() - VARIANTS.keys() - VALUES.keys()
    assert not unknown, f"{sorted(unknown)}: neither a variant nor a value"
    absent = [name for name, value in defines.items() if value is False or value is None]
    assert not absent, f"{absent}: defined, but false"
