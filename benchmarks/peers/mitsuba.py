"""Mitsuba 3 as a peer: same scene, camera, depth and pixel filter, for checks and timing.

Mitsuba is the `reference` extra, and is imported only inside functions, so that other code does not need it. Its
LLVM variant is the fast one on a CPU. Dr.Jit loads libLLVM, and crashes with LLVM 14 and 15 of Debian 12, so
`find_llvm` looks for 16 or newer.

Poor at:  ambient light at the last depth, which Mitsuba's path integrator lacks.
Source:   Jakob et al. 2022, Mitsuba 3 renderer, https://mitsuba-renderer.org
"""

from __future__ import annotations

import importlib
import os
import re
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError, SceneError
from glpath.io.export.mitsuba import MitsubaScene, Sampler, described, integrator
from glpath.io.export.mitsuba_surfaces import Plugin
from glpath.scene.geometry import Mesh
from glpath.scene.model import Float64, Scene, Shapes
from glpath.scene.triangulate import path_traceable

Variant = Literal["llvm_ad_rgb", "scalar_rgb"]

OLDEST_LLVM = 16
LIBRARY_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/usr/lib/llvm-*/lib",
)


def find_llvm(folders: Iterable[str] = LIBRARY_FOLDERS) -> str | None:
    """Return the libLLVM for Dr.Jit: DRJIT_LIBLLVM_PATH if set, else the newest from version 16 on, else None.

    folders : folders to search; glob patterns are allowed
    """
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        return named
    found: list[tuple[int, str]] = []
    for pattern in folders:
        # The first number in libLLVM-19.so, libLLVM.so.19.1 and libLLVM-15.so.1 is the major version.
        for path in Path("/").glob(f"{pattern.lstrip('/')}/libLLVM[-.]*so*"):
            version = re.match(r"libLLVM(?:-|\.so\.)(\d+)", path.name)
            if version and int(version[1]) >= OLDEST_LLVM:
                found.append((int(version[1]), str(path)))
    return max(found)[1] if found else None


def best_variant() -> tuple[Variant, str]:
    """Return the fastest variant that works here, and a note for the reader ('' if it is the LLVM one)."""
    if find_llvm():
        return "llvm_ad_rgb", ""
    return "scalar_rgb", (
        f"Mitsuba runs as scalar_rgb, many times slower than llvm_ad_rgb: no libLLVM >= {OLDEST_LLVM} found. "
        "Install one (Debian: apt install libllvm19) or set DRJIT_LIBLLVM_PATH."
    )


def load_mitsuba(variant: str | None = None) -> Any:
    """Import `mitsuba` and set `variant` (default: `best_variant`). Raises GlpathError if it cannot be imported."""
    variant = variant or best_variant()[0]
    if variant.startswith("llvm"):
        llvm = find_llvm()
        if llvm is None:
            raise GlpathError(
                f"Mitsuba's variant {variant} needs libLLVM >= {OLDEST_LLVM}, and none was found.",
                "apt install libllvm19, or set DRJIT_LIBLLVM_PATH to the library, or take variant scalar_rgb.",
            )
        os.environ["DRJIT_LIBLLVM_PATH"] = llvm  # Dr.Jit reads it only when it first starts LLVM
    try:
        import mitsuba
    except ImportError as error:
        raise GlpathError(
            f"Mitsuba 3 cannot be imported ({error}); it is needed only as a peer and a reference.",
            "pip install glpath[reference]",
        ) from error
    if variant not in mitsuba.variants():
        raise GlpathError(
            f"Mitsuba {mitsuba.__version__} has no variant {variant!r}; it has {', '.join(mitsuba.variants())}."
        )
    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)  # `samples_rendered` reports rounded sample counts instead
    return mitsuba


def comparable(scene: Scene) -> tuple[Scene, list[str]]:
    """Return the scene as triangles that every program here supports, and notes on what was changed for that.

    Microfacets scatter light once, as in the other programs. Spheres become glpath's triangles, so that all
    programs have the same ones. They are shaded flat, because only glpath compensates the light that smooth normals
    lose. Raises one SceneError for everything that a peer does not support.
    """
    scene = path_traceable(scene)
    if any(m.roughness is not None and m.multiple_scattering for m in scene.materials):
        scene = replace(scene, materials=tuple(replace(m, multiple_scattering=False) for m in scene.materials))
    used = sorted({shape.material for shape in scene.shapes})
    of_materials = {
        "textures": [scene.materials[i].name for i in used if scene.materials[i].texture is not None],
        "highlights": [scene.materials[i].name for i in used if np.any(scene.materials[i].specular > 0)],
        "punctual lights": [light.name for light in scene.lights],
    }
    found = [f"{what} ({', '.join(names[:3])})" for what, names in of_materials.items() if names]
    found += ["a sky"] * (scene.sky is not None) + ["ambient light"] * bool(np.any(scene.ambient > 0))
    if found:
        raise SceneError(
            f"{scene.source or scene.name}: has {', '.join(found)}, which the comparison with other programs does "
            "not translate; it knows diffuse surfaces of one colour, lit by shapes that emit.",
            "Leave them out, or take cornell-box-36, room or office.",
        )
    if not any(shape.emits for shape in scene.shapes):
        raise SceneError(
            f"{scene.source or scene.name}: no shape emits, so that there is no light to compare.",
            "Give a shape an emission.",
        )
    if not np.any(scene.shapes.vertex_normals):
        return scene, []
    flat = Shapes(
        replace(shape, geometry=replace(shape.geometry, normals=None))
        for shape in scene.shapes
        if isinstance(shape.geometry, Mesh)
    )
    return replace(scene, shapes=flat), ["shaded flat by all programs, without the normals of vertices"]


def to_mitsuba(
    scene: Scene,
    max_depth: int,
    *,
    sampler: Sampler = "multijitter",
    spp: int = 64,
    variant: str | None = None,
) -> Any:
    """Return a `mitsuba.Scene` with the same pixels as `scene`; see `glpath.io.export.mitsuba`.

    Raises SceneError if that is impossible; `in_memory` also accepts scenes for which `glpath.export` warns.
    """
    load_mitsuba(variant)
    translated = described(scene, max_depth, sampler=sampler, spp=spp, instances=False)
    if translated.differences:
        raise SceneError(
            f"{scene.source or scene.name}: has no counterpart in Mitsuba: {'; '.join(translated.differences)}.",
            "Metal (metallic 1), solid glass (transmission 1, not thin), diffuse surfaces and mirrors have.",
        )
    return in_memory(translated)


def in_memory(translated: MitsubaScene) -> Any:
    """Make a `mitsuba.Scene` of the current variant from plugins, without files."""
    mi: Any = importlib.import_module("mitsuba")
    made: dict[str, Any] = {}
    for name, value in translated.plugins.items():
        made[name] = value if name == "type" else _made(mi, value, made)
    return mi.load_dict(made)


def mitsuba_cornell_box(
    max_depth: int = 3, *, sampler: Sampler = "multijitter", spp: int = 64, variant: str | None = None
) -> Any:
    """Return `mi.cornell_box()` as shipped (256 x 256), but with a box filter and our depth."""
    mi = load_mitsuba(variant)
    box = mi.cornell_box()
    box["integrator"] = integrator(max_depth)
    box["sensor"]["film"]["rfilter"] = {"type": "box"}
    box["sensor"]["sampler"] = {"type": sampler, "sample_count": spp}
    return mi.load_dict(box)


def render_mitsuba(
    scene: Scene,
    spp: int,
    max_depth: int,
    *,
    seed: int = 0,
    sampler: Sampler = "multijitter",
    variant: str | None = None,
) -> Float64:
    """Return radiance (H, W, 3) float64, row 0 at the top, linear Rec. 709, by Mitsuba's path integrator.

    spp : samples per pixel; multijitter may take a few more, see `samples_rendered`
    """
    peer = to_mitsuba(scene, max_depth, sampler=sampler, spp=spp, variant=variant)
    return render_peer(peer, spp, seed)


def render_peer(peer: Any, spp: int, seed: int = 0) -> Float64:
    """Return radiance (H, W, 3) float64 of a `mitsuba.Scene`, after waiting until it is computed."""
    mi: Any = importlib.import_module("mitsuba")  # has the variant with which `peer` was made
    return np.array(mi.render(peer, spp=spp, seed=seed), dtype=np.float64)


def time_aovs(peer: Any, spp: int, seed: int = 0) -> tuple[float, Float64, Float64]:
    """Return seconds, albedo and shading normal (H, W, 3) float64 of a `mitsuba.Scene`, for a denoiser; warm.

    They are not rendered with the picture: an `aov` integrator around the path tracer doubles the time of all
    samples, while these need only a few.
    """
    mi: Any = importlib.import_module("mitsuba")
    import drjit

    integrator = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})

    def render(seed: int) -> Float64:
        return np.array(mi.render(peer, integrator=integrator, spp=spp, seed=seed), dtype=np.float64)

    render(seed + 1)
    drjit.sync_thread()
    start = time.perf_counter()
    image = render(seed)
    drjit.sync_thread()
    return time.perf_counter() - start, image[..., :3], image[..., 3:6]


def samples_rendered(peer: Any, spp: int) -> int:
    """Return the samples per pixel that Mitsuba takes for `spp`: multijitter rounds 32 up to 35 = 5 x 7 strata."""
    sampler = peer.sensors()[0].sampler().clone()
    sampler.set_sample_count(spp)
    return int(sampler.sample_count())


@dataclass(frozen=True)
class PeerTiming:
    """Mitsuba's time for a picture, without kernel compilation.

    spp     : samples per pixel that were taken, which may exceed the number that was given
    seconds : (repeats,) float64 wall time of each picture, warm
    images  : (repeats, H, W, 3) float64, one per repeat, with different seeds
    """

    spp: int
    seconds: NDArray[np.float64]
    images: NDArray[np.float64]

    @property
    def ms_per_sample(self) -> float:
        """Return milliseconds per sample of all pixels in the fastest repeat, because other load only adds time."""
        return 1e3 * float(self.seconds.min()) / self.spp


def time_to_render(
    scene: Scene | Any,
    spp: int,
    max_depth: int,
    *,
    repeats: int = 3,
    seed: int = 1,
    sampler: Sampler = "multijitter",
    variant: str | None = None,
    warm: bool = False,
) -> PeerTiming:
    """Time `repeats` pictures of `scene` (ours, or a `mitsuba.Scene`, whose depth and sampler are then used).

    Unless it is `warm`, one picture of the same spp is rendered first, to compile the kernel, which depends on spp.
    """
    peer = (
        to_mitsuba(scene, max_depth, sampler=sampler, spp=spp, variant=variant)
        if isinstance(scene, Scene)
        else scene
    )
    import drjit

    if not warm:
        render_peer(peer, spp, seed + repeats)
    seconds, images = [], []
    for i in range(repeats):
        drjit.sync_thread()
        start = time.perf_counter()
        image = render_peer(peer, spp, seed + i)
        drjit.sync_thread()
        seconds.append(time.perf_counter() - start)
        images.append(image)
    return PeerTiming(samples_rendered(peer, spp), np.array(seconds), np.stack(images))


def _made(mi: Any, value: Any, known: dict[str, Any]) -> Any:
    """Return a value as a Mitsuba plugin or parameter. known: plugins that references name."""
    if isinstance(value, np.ndarray):
        return mi.ScalarTransform4f(value)
    if not isinstance(value, dict) or value["type"] == "rgb":
        return value
    if value["type"] == "ref":
        return known[value["id"]]
    if value["type"] == "mesh":
        return _mesh(mi, value, known)
    parameters = {name: _made(mi, each, known) for name, each in value.items() if name not in ("image", "name")}
    if "image" in value:
        image = mi.Bitmap(np.array(value["image"]))  # a copy, because Mitsuba does not accept read-only arrays
        image.set_srgb_gamma(value["image"].dtype == np.uint8)  # as for a PNG
        parameters["bitmap"] = image
    elif "name" in value:
        parameters["name"] = value["name"]
    return mi.load_dict(parameters)


def _mesh(mi: Any, plugin: Plugin, known: dict[str, Any]) -> Any:
    mesh: Mesh = plugin["mesh"]
    properties = mi.Properties()
    for name, value in plugin.items():
        if name not in ("type", "name", "mesh"):
            properties[name] = _made(mi, value, known)
    made = mi.Mesh(
        plugin["name"],
        vertex_count=len(mesh.vertices),
        face_count=len(mesh.faces),
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uv is not None,
        props=properties,
    )
    if mesh.colours is not None:
        made.add_attribute("vertex_color", 3, np.zeros(3 * len(mesh.vertices), np.float32))
    arrays = {
        "vertex_positions": mesh.vertices,
        "vertex_normals": mesh.normals,
        "vertex_texcoords": mesh.uv,
        "vertex_color": None if mesh.colours is None else mesh.colours[:, :3],
    }
    parameters = mi.traverse(made)
    for name, array in arrays.items():
        if array is not None:
            parameters[name] = np.ascontiguousarray(array, np.float32).ravel()
    parameters["faces"] = np.ascontiguousarray(mesh.faces, np.uint32).ravel()
    parameters.update()
    return made
