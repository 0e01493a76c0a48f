"""Pictures of a Mitsuba file by Mitsuba itself, in a process of its own: python -m benchmarks.peers.mitsuba_file.

Standard input is a JSON object, the keyword arguments of `render_file`; the pictures go into `output`, as .npy.
Film, pixel filter, sampler and integrator are replaced, so that both programs estimate the same pixels.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

VARIANT = "scalar_rgb"
#: A plugin that is Sionna's.
RADIO_MATERIAL = "itu-radio-material"


def render_file(
    path: str,
    output: str,
    parameters: dict[str, str],
    size: tuple[int, int],
    camera: dict[str, Any],
    samples: int,
    batches: int,
    depth: int,
    first_seed: int,
) -> None:
    """Write (batches, H, W, 3) float64 radiance, each batch of its own seed.

    camera  : of a file without a sensor: position, target, up, and fov in degrees, which is vertical
    samples : per pixel, of each batch
    depth   : bounces, of which 1 is direct light only
    """
    import mitsuba

    mi: Any = mitsuba
    mi.set_variant(VARIANT)
    mi.set_log_level(mi.LogLevel.Error)
    config = mi.parser.ParserConfig(VARIANT)
    config.unused_parameters = config.unused_properties = mi.LogLevel.Debug
    state = mi.parser.parse_file(config, path, **parameters)
    mi.file_resolver().prepend(str(Path(path).parent))
    mi.parser.transform_all(config, state)
    hides, has_medium = False, False
    for node in state.nodes:
        kind = node.props.plugin_name()
        if node.type == mi.ObjectType.Film:
            node.props["width"], node.props["height"] = size
        elif node.type == mi.ObjectType.ReconstructionFilter:
            node.props.set_plugin_name("box")
        elif node.type == mi.ObjectType.Integrator:
            hides |= bool(node.props.get("hide_emitters", False))
            node.props.set_plugin_name("path")  # one that every variant has; the picture is another's
        elif node.type == mi.ObjectType.Medium:
            has_medium = True
        elif kind == RADIO_MATERIAL:
            _preview(mi, node.props)
    scene = mi.parser.instantiate(config, state)
    scene = scene[0] if isinstance(scene, list | tuple) else scene
    extra: dict[str, Any] = {}
    if not scene.emitters():
        extra["sky"] = {"type": "constant"}
    if extra:
        shapes = {f"shape{number}": shape for number, shape in enumerate(scene.shapes())}
        sensors = {f"sensor{number}": sensor for number, sensor in enumerate(scene.sensors())}
        scene = mi.load_dict({"type": "scene", **shapes, **sensors, **extra})
    sensor = scene.sensors()[0] if scene.sensors() else _sensor(mi, camera, size)
    integrator = mi.load_dict(
        {
            "type": "volpath" if has_medium else "path",
            "max_depth": depth + 1,
            "hide_emitters": hides,
        }
    )
    pictures = [
        np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=samples, seed=first_seed + batch))
        for batch in range(batches)
    ]
    np.save(output, np.stack(pictures).astype(np.float64)[..., :3])


def _preview(mi: Any, properties: Any) -> None:
    """Replace a radio material by the diffuse surface that Sionna shows."""
    from glpath.io.mitsuba.radio_materials import RADIO_COLOURS

    colour = properties.get("color", RADIO_COLOURS[str(properties["type"])])
    for key in list(properties.keys()):
        del properties[key]
    reflectance = {"type": "rgb", "value": [float(each) for each in colour]}
    properties.set_plugin_name("twosided")
    properties["shown"] = mi.load_dict({"type": "diffuse", "reflectance": reflectance})


def _sensor(mi: Any, camera: dict[str, Any], size: tuple[int, int]) -> Any:
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    look_at = mi.ScalarTransform4f().look_at(camera["position"], camera["target"], camera["up"])
    return mi.load_dict(
        {
            "type": "perspective",
            "to_world": look_at,
            "fov": camera["fov"],
            "fov_axis": "y",
            "film": film,
        }
    )


if __name__ == "__main__":
    render_file(**json.load(sys.stdin))
