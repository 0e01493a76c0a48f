"""JSON that glpath writes and reads, by the types that the code writes it from."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any, get_type_hints

import msgspec

from glpath.cli.records import EndRecord, ProgressRecord, RenderStats
from glpath.integrators.by_name import INTEGRATORS
from glpath.rendering.job import JobFile
from glpath_docs.markdown import block, code, directive, table
from glpath_docs.scene_format import default, kind

#: By anchor: what it is, the type, and how one gets it.
RECORDS: dict[str, tuple[str, Any, str]] = {
    "stats": ("`--stats FILE` of a render", RenderStats, "glpath render cornell-box -o box.png --stats stats.json"),
    "progress-lines": (
        "A line of `--progress json`",
        ProgressRecord,
        "glpath render cornell-box -o box.png --progress json",
    ),
    "progress-end": (
        "The last line of `--progress json`",
        EndRecord,
        "glpath render cornell-box -o box.png --progress json",
    ),
    "job-files": ("A job file", JobFile, "glpath render --job part-0.json -o part-0.npz"),
}


def pages() -> dict[str, str]:
    """The page of all records, by path."""
    text = [
        "# JSON for programs\n",
        "Keys may be added in a later version; a key that is there keeps its meaning.\n",
    ]
    for name, (title, of, example) in RECORDS.items():
        text += [f"({name})=\n## {title}\n", *_record(name, of, example)]
    return {"reference/json.md": "\n".join(text)}


def schema(of: Any) -> dict[str, Any]:
    """The JSON schema of a record."""
    found = msgspec.json.schema(of)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def _record(name: str, of: Any, example: str) -> list[str]:
    found = schema(of)
    definitions = found["$defs"]
    order = list(get_type_hints(of))
    first = found["$ref"].rpartition("/")[2]
    text = [block("sh", example)]
    for title in sorted(definitions, key=lambda each: each != first):
        part = definitions[title]
        text.append(f"(scene-{title.lower()})=\n### {title}\n")
        text.append(part.get("description", "") + "\n")
        keys = sorted(part["properties"], key=order.index) if title == first else part["properties"]
        rows = [
            (code(key), kind(value), _meaning(value, definitions))
            for key, value in ((key, part["properties"][key]) for key in keys)
        ]
        text.append(table(("key", "value", "meaning"), rows))
    if name == "job-files":
        text += ["The key `integrator` has a `name` and the settings of that integrator:\n", _settings()]
    text.append(
        directive("admonition", "JSON schema", block("json", json.dumps(found, indent=1)), **{"class": "dropdown"})
    )
    return text


def _meaning(value: Mapping[str, Any], definitions: Mapping[str, Any]) -> str:
    """What a key says: its own text, that of what it holds, or its default."""
    held = definitions.get(str(value.get("$ref", "")).rpartition("/")[2], {})
    said = value.get("description") or held.get("description", "")
    return f"{said} Default: {default(value)}.".strip() if "default" in value else str(said)


def _settings() -> str:
    rows = []
    for name, settings in INTEGRATORS.items():
        rows += [(code(name), code(field.name), code(field.default)) for field in dataclasses.fields(settings)]
    return table(("integrator", "setting", "default"), rows)
