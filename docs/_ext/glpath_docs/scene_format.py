"""The scene format, from the JSON schema that `glpath schema` prints."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from glpath.io import scene_schema
from glpath_docs.markdown import code, table

#: Where a part of the format stands: by task, in the order in which a scene is written. A test holds it complete.
TASKS: dict[str, tuple[str, ...]] = {
    "The file": ("SceneFile", "Asset"),
    "The camera and the picture": ("Camera", "Orthographic", "Panorama", "CameraKey", "Film"),
    "Shapes": ("Quad", "Box", "Sphere", "Mesh", "Plane", "Patches", "Displacement", "Stream"),
    "Placing and moving shapes": ("Step", "Rotation", "Key"),
    "Materials and textures": ("Diffuse", "Principled", "Phong", "Glazing", "Image", "Checker"),
    "Light": ("Emission", "PointLight", "SpotLight", "DirectionalLight", "Sky", "Portal"),
}


def pages() -> dict[str, str]:
    """The page of the format, by path."""
    return {"reference/scene-format.md": page(scene_schema())}


def page(schema: Mapping[str, Any]) -> str:
    """All of the format, by task."""
    text = [
        "# The scene format\n",
        "A scene is a TOML file, or a dictionary of the same form in Python. `glpath schema` prints this format as "
        "JSON schema, with which editors check and complete a file. `glpath validate` reports what is wrong.\n",
    ]
    definitions = schema["$defs"]
    for task, names in TASKS.items():
        text.append(f"## {task}\n")
        for name in names:
            text += _definition(name, definitions[name])
    return "\n".join(text)


def _definition(name: str, found: Mapping[str, Any]) -> Iterator[str]:
    required = found.get("required", ())
    yield f"({anchor(name)})=\n### {name}\n"
    yield found.get("description", "").strip() + "\n"
    rows = [
        (
            code(key),
            kind(value),
            "required" if key in required else default(value),
            value.get("description", ""),
        )
        for key, value in found["properties"].items()
    ]
    yield table(("key", "value", "default", "meaning"), rows)


def anchor(name: str) -> str:
    """Of a part of the format."""
    return f"scene-{name.lower()}"


def default(value: Mapping[str, Any]) -> str:
    """What a key has where a file leaves it out."""
    if "default" not in value:
        return ""
    return code(json.dumps(value["default"]))


def kind(value: Mapping[str, Any]) -> str:
    """A JSON schema of one value, in words."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        return f"[{name}](#{anchor(name)})"
    if "enum" in value:
        return ", ".join(code(f'"{each}"') for each in value["enum"])
    if "const" in value:
        return code(json.dumps(value["const"]))
    if "anyOf" in value:
        return " or ".join(dict.fromkeys(kind(each) for each in value["anyOf"]))
    if value.get("type") == "array":
        return _array(value)
    if value.get("type") == "object":
        inner = value.get("additionalProperties")
        return f"by name: {kind(inner)}" if isinstance(inner, Mapping) else "table"
    named = str(value.get("type", "any"))
    return {"integer": "whole number"}.get(named, named) + _bounds(value)


def _array(value: Mapping[str, Any]) -> str:
    least, most = value.get("minItems"), value.get("maxItems")
    if "prefixItems" in value:
        return "[" + ", ".join(kind(each) for each in value["prefixItems"]) + "]"
    items = kind(value["items"]) if isinstance(value.get("items"), Mapping) else "value"
    if least is not None and least == most:
        return f"{least} x {items}"
    return f"list of {items}" + (f", {least} or more" if least else "")


def _bounds(value: Mapping[str, Any]) -> str:
    low, high = value.get("minimum"), value.get("maximum")
    above, below = value.get("exclusiveMinimum"), value.get("exclusiveMaximum")
    parts = [
        f"{low:g} or more" if low is not None and high is None else "",
        f"{low:g} to {high:g}" if low is not None and high is not None else "",
        f"{high:g} or less" if low is None and high is not None else "",
        f"above {above:g}" if above is not None else "",
        f"below {below:g}" if below is not None else "",
    ]
    said = ", ".join(each for each in parts if each)
    return f" ({said})" if said else ""
