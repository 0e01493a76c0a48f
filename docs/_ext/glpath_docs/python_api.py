"""The public Python API by task, from the docstrings.

Docstrings are written to be read in an editor: what a parameter is stands beside its name, in columns.
`docstring` makes fields of the columns, as autodoc knows them.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from glpath_docs.markdown import code, table


@dataclass(frozen=True)
class Task:
    """One page of the API.

    page    : name of its file
    title   : what one wants
    about   : when this is the right page
    modules : public names by the module from which one imports them, in the order of the page; () is all of them
    """

    page: str
    title: str
    about: str
    modules: dict[str, tuple[str, ...]]


#: All that is public, once. A test holds it complete.
TASKS = (
    Task(
        "render",
        "Render pictures",
        "Pictures of a scene, and of the frames of an animation.",
        {
            "glpath": (
                "render",
                "render_frames",
                "render_views",
                "Views",
                "camera",
                "Film",
                "Progress",
                "RenderInterrupted",
                "__version__",
            )
        },
    ),
    Task(
        "scenes",
        "Load and make scenes",
        "A scene from a file, a model or a dictionary, and its parts.",
        {
            "glpath": ("load_scene", "export", "Scene"),
            "glpath.scene": (
                "Camera",
                "CameraKey",
                "Shape",
                "Material",
                "Texture",
                "Light",
                "Sky",
                "Environment",
                "Portal",
                "Background",
                "Motion",
                "check_scene",
                "check_camera",
                "path_traceable",
            ),
        },
    ),
    Task(
        "light",
        "Light in numbers",
        "Lux and W/m2 at points, daylight through the year, light probes and lightmaps.",
        {
            "glpath": (
                "irradiance",
                "Irradiance",
                "daylight_coefficients",
                "DaylightCoefficients",
                "daylight_year",
                "DaylightYear",
                "texels",
                "Texels",
                "lightmap",
                "Lightmap",
                "probes",
                "Probes",
            ),
            "glpath.apps.measure.points": ("plane_grid", "Points", "Grid"),
            "glpath.apps.measure.tables": ("read_points", "save_csv", "save_npz"),
            "glpath.apps.daylight.visibility": ("visible",),
        },
    ),
    Task(
        "terrain",
        "Terrain",
        "Sky view factors and sun hours of height fields.",
        {"glpath": ("horizon", "Horizon", "HeightField", "load_height_field", "load_point_cloud")},
    ),
    Task(
        "exchange",
        "View factors and radiosity",
        "The exchange of light or heat between diffuse surfaces.",
        {
            "glpath": (
                "view_factors",
                "ViewFactors",
                "ViewFactorProgress",
                "solve_radiosity",
                "RadiositySolution",
                "RadiosityProgress",
                "RadiosityInterrupted",
            ),
            "glpath.radiosity": ("picture_of",),
        },
    ),
    Task(
        "pictures",
        "Read, write and compare pictures",
        "Files of pictures, tone mapping, and how far two differ.",
        {
            "glpath": ("read_image", "relative_mse", "element_error", "ElementError"),
            "glpath.film.image": (),
            "glpath.film.exr": (),
            "glpath.film.tonemap": (),
            "glpath.system.colour": (),
            "glpath.compare": (),
        },
    ),
    Task(
        "jobs",
        "Split and merge renders",
        "A render as a value: JSON, for other machines.",
        {"glpath.rendering": ("RenderJob", "run")},
    ),
    Task("notebooks", "Look around in Jupyter", "A live view of a scene, and of shafts.", {"glpath.notebook": ()}),
    Task(
        "buffers",
        "Use the papers' structures",
        "The path-buffer, the T-buffer, the shadow-buffer and shafts alone.",
        {
            "glpath.buffers": (),
            "glpath.gl": (),
            "glpath.radiosity": (
                "PAPER",
                "Containment",
                "Emitter",
                "Occluders",
                "Receivers",
                "Shaft",
                "ShaftOptions",
                "Statistics",
                "Strategy",
                "Visibility",
                "candidate_list",
                "cluster",
                "facing",
                "visible",
            ),
        },
    ),
    Task(
        "errors",
        "Handle errors",
        "What is raised, and what is warned of.",
        {
            "glpath": (
                "GlpathError",
                "UsageError",
                "SceneError",
                "ImageError",
                "ContextError",
                "ShaderError",
                "SceneWarning",
                "StrictError",
                "TimeLimitError",
            )
        },
    ),
)

#: What users import from; the public names of each are its `__all__`.
PUBLIC = tuple(dict.fromkeys(("glpath", *(module for task in TASKS for module in task.modules))))

# A name or several, a space, a colon: prose has no space there.
_ROW = re.compile(r"^(?P<indent> *)(?P<name>[\w.*\"][^:`]{0,70}?) +: (?P<text>\S.*)$")
_REMARK = re.compile(r"^(?P<name>Costs?|Poor at|Limits|Sources?|Raises|Warns|Units|Frame): +(?P<text>\S.*)$")
_FOLDER = "reference/python"


def names_of(task: Task) -> Iterator[tuple[str, str]]:
    """(module, name) of what a page has."""
    for module, names in task.modules.items():
        yield from ((module, name) for name in names or importlib.import_module(module).__all__)


def pages() -> dict[str, str]:
    """By path: a page of each task, and the list of them."""
    return {f"{_FOLDER}/index.md": _index(), **{f"{_FOLDER}/{task.page}.md": page(task) for task in TASKS}}


def _index() -> str:
    rows = [(f"[{task.title}]({task.page}.md)", task.about) for task in TASKS]
    text = [
        "# Python\n",
        "These names are public; all others may change. Each module lists its own in `__all__`.\n",
    ]
    return "\n".join([*text, table(("task", "what it is for"), rows)])


def page(task: Task) -> str:
    """Each name with its docstring, functions and classes as autodoc shows them."""
    found = [(module, name, getattr(importlib.import_module(module), name)) for module, name in names_of(task)]
    text = [f"# {task.title}\n", task.about + "\n"]
    text.append(
        table(
            ("name", "what it is"),
            [(f"{{py:obj}}`{module}.{name}`", first_sentence(value)) for module, name, value in found],
        )
    )
    for module, name, value in found:
        text += [f"## {code(name)}\n", entry(module, name, value)]
    return "\n".join(text)


def first_sentence(value: Any) -> str:
    """Of a docstring, for a list; of a constant, its value."""
    if not _is_code(value):
        shown = repr(value).removeprefix("typing.")
        return code(shown) if len(shown) < 60 else type(value).__name__
    text = " ".join((value.__doc__ or "").strip().split("\n\n")[0].split())
    return re.split(r"(?<=[.:;]) ", text)[0].rstrip(":;")


def _is_code(value: Any) -> bool:
    """Whether it is a class or a function, not a constant or a type that stands for others."""
    return isinstance(value, type) or inspect.isroutine(value)


def entry(module: str, name: str, value: Any) -> str:
    """A name for autodoc."""
    if isinstance(value, type):
        lines = [f".. autoclass:: {module}.{name}", "   :members:", "   :show-inheritance:"]
        if issubclass(value, Exception):
            lines = [f".. autoexception:: {module}.{name}", "   :members:", "   :show-inheritance:"]
    elif _is_code(value):
        lines = [f".. autofunction:: {module}.{name}"]
    else:
        lines = [f".. py:data:: {module}.{name}", f"   :value: {value!r}"[:200]]
    return "\n".join(["```{eval-rst}", *lines, "```"]) + "\n"


def docstring(what: str, lines: Sequence[str]) -> list[str]:
    """A docstring of this package as reStructuredText: columns become fields, code and remarks are marked.

    what : as autodoc calls it: "function", "method", "class", ...
    """
    field = "ivar" if what in ("class", "exception") else "param"
    out: list[str] = []
    at = 0
    while at < len(lines):
        line = lines[at]
        at += 1
        if at < len(lines) and re.fullmatch(r"-{3,}", lines[at]) and line.strip():
            at += 1
            if line in ("Parameters", "Attributes"):
                field = "param" if line == "Parameters" else "ivar"
            else:
                out += ["", f".. rubric:: {line}", ""]
            continue
        found = _ROW.match(line) or _REMARK.match(line)
        if line.startswith(">>>"):
            out += [""] if out and out[-1] else []
            out.append(line)
            while at < len(lines) and lines[at].strip():
                out.append(lines[at])
                at += 1
        elif found is not None and not (found.groupdict().get("indent") or ""):
            text = [found["text"]]
            while at < len(lines) and lines[at].startswith("  "):
                text.append(lines[at].strip())
                at += 1
            marked = inline(" ".join(text))
            if _ROW.match(line):
                if out and out[-1] and not out[-1].startswith(":"):
                    out.append("")
                # Of several names in one field all but the last would be its type.
                out += [f":{field} {name.strip()}: {marked}" for name in found["name"].split(",")]
            else:
                out += ["", f"**{found['name']}:** {marked}", ""]
        elif line.startswith("    ") and (not out or not out[-1].strip()):
            block = [line]
            while at < len(lines) and (lines[at].startswith("    ") or not lines[at].strip()):
                block.append(lines[at])
                at += 1
            out += [".. code-block:: text", "", *block, ""]
        else:
            if line and out and out[-1].startswith(":"):
                out.append("")
            out.append(inline(line))
    return [*out, ""]


def inline(text: str) -> str:
    """One line: single backticks are code, and what reStructuredText would take for marks means itself."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(
        f"`{part}`" if len(part) > 2 and part.startswith("`") else re.sub(r"([*|`\\]|_(?=\W|$))", r"\\\1", part)
        for part in parts
    )
