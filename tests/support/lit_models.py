"""A camera and a light for models that have none."""

from __future__ import annotations

CAMERA_AND_LIGHT = {
    "cameras": [
        {"type": "perspective", "name": "Wide", "perspective": {"yfov": 0.5, "aspectRatio": 2.0, "znear": 0.1}},
        {"type": "perspective", "name": "Tall", "perspective": {"yfov": 0.5, "aspectRatio": 0.5, "znear": 0.1}},
    ],
    "extensionsUsed": ["KHR_lights_punctual"],
    "extensions": {
        "KHR_lights_punctual": {
            "lights": [{"type": "point", "name": "Lamp", "intensity": 6, "color": [1, 0.5, 0.25]}]
        }
    },
    "nodes": [
        {"mesh": 0},
        {"camera": 0, "translation": [0, 0, 5], "name": "Wide"},
        {"camera": 1, "translation": [1, 0, 5], "name": "Tall"},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 3, 0], "name": "Lamp"},
    ],
    "scenes": [{"nodes": [0, 1, 2, 3]}],
}
