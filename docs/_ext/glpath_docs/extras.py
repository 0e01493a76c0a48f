"""The extras of pip, from pyproject.toml."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from glpath_docs.markdown import block, code, table

_PROJECT = Path(__file__).resolve().parents[3] / "pyproject.toml"

#: What each brings. A test holds it to what pyproject.toml has.
MEANINGS = {
    "denoise": "Open Image Denoise: pictures are clean with a fraction of the path sets",
    "jupyter": "pictures and a live view in notebooks",
    "bake": "xatlas, which unfolds surfaces for `glpath lightmap`",
    "cluster": "Dask: `--cluster` shares a render among processes and machines",
    "video": "ffmpeg: `glpath render --frames` writes .mp4, .mov and .mkv",
    "gltf": "glTF files whose geometry or textures are compressed (Draco, meshopt)",
    "ktx2": "glTF files whose textures are KTX 2; its decoder is an alpha version",
    "frames": "pandas and xarray: `to_pandas()` and `to_xarray()` of results",
    "mesh": "PyVista: `to_pyvista()` of results",
    "sky": "pvlib: the sun of a site and time, clear days, and weather files",
    "terrain": "rasterio and laspy: GeoTIFF, LAS and LAZ files of terrain for `glpath horizon`",
    "flip": "the measure FLIP of `glpath diff --mode flip` and of image tests",
    "lod": "simpler meshes for `--bounce-lod`",
    "figures": "the figures of `python -m benchmarks figure`",
}
#: Of who works on glpath in a checkout.
FOR_DEVELOPERS = {
    "docs": "this site: `make docs`",
    "test": "the tests: `make test`",
    "reference": "Mitsuba and Embree, to compare with: `make evidence`",
    "peers": "Blender's Cycles, Radiance and pyviewfactor, to compare with",
    "browser": "JupyterLab in a browser, to test the live view",
}


def pages() -> dict[str, str]:
    """The page of extras, by path."""
    project = tomllib.loads(_PROJECT.read_text("utf-8"))["project"]
    text = [
        "# Extras\n",
        "An extra brings what only some tasks need. Several go in one pair of brackets:\n",
        block("sh", 'pip install "glpath[denoise,jupyter]"'),
        _table(project, MEANINGS),
        "## For work on glpath itself\n",
        _table(project, FOR_DEVELOPERS),
        "## What glpath always needs\n",
        f"Python {project['requires-python'].removeprefix('>=')} or newer, and:\n",
        ", ".join(code(each) for each in project["dependencies"]) + "\n",
    ]
    return {"reference/extras.md": "\n".join(text)}


def _table(project: dict[str, Any], meanings: dict[str, str]) -> str:
    extras = project["optional-dependencies"]
    rows = [
        (code(name), meaning, ", ".join(code(each) for each in extras[name])) for name, meaning in meanings.items()
    ]
    return table(("extra", "what it brings", "packages"), rows)
