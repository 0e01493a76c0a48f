"""Scenes by name: files that ship with glpath, and scenes that functions generate from parameters.

`load_scene` accepts every form of a scene: a file, a name, or a `Scene`.
"""

from __future__ import annotations

import inspect
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_type_hints

import msgspec
from msgspec import Meta

from glpath.errors import SceneError, UsageError, one_warning_per_cause
from glpath.io.completed import aside
from glpath.io.convert import convert
from glpath.io.from_python import AnyScene, is_made_in_python, scene_from_python
from glpath.io.gltf.document import SUFFIXES as GLTF_FORMATS
from glpath.io.load import read_scene_file, scene_from_dict
from glpath.io.models import FORMATS as MODEL_FORMATS
from glpath.io.models import (
    gltf_animations,
    gltf_cameras,
    gltf_variants,
    read_gltf_as_asked,
    read_mesh_model_as_asked,
    scene_of_model,
)
from glpath.io.other_files import refuse_other_file
from glpath.io.polygons import limited_polygons
from glpath.io.shipped.office import office, office_premesh
from glpath.io.shipped.stacked import stacked
from glpath.io.shipped.teapot import teapot
from glpath.io.shipped.terrain import terrain
from glpath.io.surroundings import Surroundings
from glpath.io.up_axis import Up
from glpath.scene import tessellate
from glpath.scene.model import Scene
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.arguments import checked, path_text
from glpath.system.bounded_reading import reading_scene
from glpath.system.files import shipped_folder
from glpath.system.suggestions import similar_names

_Made = TypeVar("_Made")
#: Suffixes of scene files.
SCENE_SUFFIXES = (".toml", *MODEL_FORMATS, ".xml", ".hbjson")


@checked
def load_scene(scene: AnyScene, parameters: Mapping[str, object] | None = None) -> Scene:
    """Return the scene of a file, of a shipped name, or of a Python object.

    Parameters
    ----------
    scene      : one of
                 path of a TOML file, of a scene of Mitsuba 3 (.xml, see `glpath.io.mitsuba`), of a model of
                 honeybee (.hbjson, see `glpath.io.honeybee`), or of a model:
                 glTF (.glb, .gltf), OBJ with its MTL, or one of `glpath.io.meshes.FORMATS`. A path has a folder
                 or such a suffix; `./furnace` is always a file;
                 name of a shipped scene (`shipped_scenes()`);
                 dictionary in the form of the TOML, whose meshes may have numpy arrays `vertices` (V, 3),
                 `faces` (F, 3) or (F, 4) and `uv` (V, 2), or `mesh = trimesh.Trimesh`;
                 `trimesh.Trimesh`, or `trimesh.Scene` with its transforms, materials, textures and colours,
                 and its lights and camera if it has them;
                 `Scene`, which is returned unchanged
    parameters : values by name, as text (`-D key=value`) or of the parameter's type. A generated scene has its own
                 (`scene_parameters`). A glTF file has `camera`, `animation`, `variant`, `time`, `shutter`,
                 `light_factor`, `unit` and `backs`; a TOML file `time`; a honeybee model `overcast`, `ground` and
                 `view`; a Mitsuba scene its `<default>`s. Other files without a camera have `up`, their up axis

    Every scene also has the parameters `environment`, `environment_rotation` (degrees), `environment_exposure`
    (stops) and `background`. `environment` is the file of an environment map (.hdr, .exr) that replaces the sky.
    `background` is "environment", "plain" or "transparent", and is visible behind all shapes.

    If the file has no camera, one that frames everything is added; if it has no light, a studio is added. The up
    axis is then y, or z in formats other than glTF if there is evidence for it. SceneWarnings report these
    additions and the unused parts of a model. A TOML file with a camera gets no added light. By default an image
    has 512 x 512 pixels. An image from a model's own camera has the camera's aspect ratio and 512 pixels on the
    longer side.

    Raises SceneError, which names the file, the location in it, the value found and the values allowed. Warns with
    SceneWarning of triangles without area. `check_scene` checks if the scene shows anything.
    """
    surroundings, own = Surroundings.taken_from(parameters, SourceLocation("load_scene"))
    with one_warning_per_cause(), limited_polygons():
        return _in_surroundings(scene, surroundings, own)


def _in_surroundings(scene: AnyScene, surroundings: Surroundings, own: Mapping[str, object]) -> Scene:
    if not surroundings:
        return _loaded(scene, own)
    with aside("light", "sky") if surroundings.environment is not None else nullcontext():
        return surroundings.around(_loaded(scene, own))


def _loaded(scene: AnyScene, parameters: Mapping[str, object]) -> Scene:
    """Return the scene with its own sky and background, before `Surroundings` replaces them."""
    if isinstance(scene, Scene):
        return _without_parameters(scene, scene.name, parameters)
    if is_made_in_python(scene):
        with reading_scene("the scene", own_data=True):
            made = scene_from_python(scene)
        return _without_parameters(made, made.name, parameters)
    if not isinstance(scene, str | os.PathLike):
        raise SceneError(
            f"load_scene: found {type(scene).__name__}, where a scene is needed.",
            "A file or the name of a shipped scene, a Scene, a dictionary as TOML has it, or trimesh's.",
        )
    text = scene if isinstance(scene, str) else path_text("scene", scene)
    if isinstance(scene, str) and text in GENERATED:
        with reading_scene(text, own_data=True):
            return _made(GENERATED[text], SourceLocation(text), parameters)
    path = Path(text)
    if isinstance(scene, str) and text in _scene_files():
        path = _scene_files()[text]
    elif isinstance(scene, str) and not _looks_like_a_path(text):
        raise _no_such_scene(text)
    refuse_other_file(path)
    with reading_scene(path.name):
        return _read(path, text, parameters)


def _read(path: Path, text: str, parameters: Mapping[str, object]) -> Scene:
    """Return the scene of a file; `text` is its path or name as given."""
    if path.suffix.lower() in GLTF_FORMATS:
        return scene_of_model(_made(read_gltf_as_asked, SourceLocation(text), parameters, path))
    if path.suffix.lower() in MODEL_FORMATS:
        return _made(read_mesh_model_as_asked, SourceLocation(text), parameters, path)
    if path.suffix.lower() == ".xml":
        from glpath.io.mitsuba import read_mitsuba  # late, because it imports exporters, which import this module

        return read_mitsuba(path, parameters)
    if path.suffix.lower() == ".hbjson":
        from glpath.io.honeybee import read_honeybee  # late, because few scenes need it

        return _made(read_honeybee, SourceLocation(text), parameters, path)
    return _made(_read_as_asked, SourceLocation(text), parameters, path)


def shipped_scenes() -> dict[str, str]:
    """Return the one-line description of every scene that ships with glpath, by name."""
    described = {
        name: tomllib.loads(path.read_text("utf-8"))["description"] for name, path in _scene_files().items()
    }
    described |= {name: (make.__doc__ or "").splitlines()[0].rstrip(".") for name, make in GENERATED.items()}
    return dict(sorted(described.items()))


@checked
def scene_parameters(name: str, given: Mapping[str, object] | None = None) -> dict[str, tuple[object, str]]:
    """Return default and description of each parameter of a generated scene or of a file; empty for other scenes.

    A default of None means that the parameter must be given.

    given : values of some parameters
    """
    if name in GENERATED:
        return _parameters_of(GENERATED[name])
    if name.lower().endswith(".xml"):
        from glpath.io.mitsuba import read_document

        document = read_document(Path(name), given or {}, complete=False)
        listed: dict[str, tuple[object, str]] = {
            key: (value, "must be given" if value is None else "as the file has it")
            for key, value in document.defaults.items()
        }
        own_up = {} if document.has_sensor else _parameters_of(read_mesh_model_as_asked)
        return own_up | listed
    if name.lower().endswith(GLTF_FORMATS):
        return _parameters_of(read_gltf_as_asked)
    if name.lower().endswith(MODEL_FORMATS):
        return _parameters_of(read_mesh_model_as_asked)
    if name.lower().endswith(".hbjson"):
        from glpath.io.honeybee import read_honeybee

        return _parameters_of(read_honeybee)
    is_toml = name in _scene_files() or name.lower().endswith(".toml")
    return _parameters_of(_read_as_asked) if is_toml else {}


@checked
def scene_cameras(name: str) -> tuple[str, ...]:
    """Return the camera names of a glTF file, from which the parameter `camera` chooses; empty for other scenes."""
    return gltf_cameras(Path(name)) if name.lower().endswith(GLTF_FORMATS) else ()


@checked
def scene_animations(name: str) -> tuple[tuple[str, float], ...]:
    """Return names and lengths in seconds of a glTF file's animations, for `animation`; empty for other scenes."""
    return gltf_animations(Path(name)) if name.lower().endswith(GLTF_FORMATS) else ()


@checked
def scene_variants(name: str) -> tuple[str, ...]:
    """Return the names of a glTF file's material variants, for `variant`; empty for other scenes."""
    return gltf_variants(Path(name)) if name.lower().endswith(GLTF_FORMATS) else ()


def _read_as_asked(
    path: Path,
    *,
    time: Annotated[
        float, Meta(ge=0, description="seconds from 0, by which the camera's shutter opens later than in the file")
    ] = 0.0,
    up: Up = "guess",
) -> Scene:
    """Return the scene of a TOML file with the parameters that users give; see `load_scene`."""
    return read_scene_file(path, time, up)


def _parameters_of(make: Callable[..., object]) -> dict[str, tuple[object, str]]:
    hints = get_type_hints(make, include_extras=True)
    return {
        key: (p.default, hints[key].__metadata__[0].description)
        for key, p in inspect.signature(make).parameters.items()
        if p.kind is p.KEYWORD_ONLY
    }


@checked
def parameters_from_options(options: Sequence[str]) -> dict[str, str]:
    """Return options of `-D`, such as `["radiance=2", "shape=sphere"]`, as a dictionary. Raises UsageError."""
    parameters = {}
    for option in options:
        key, equals, value = option.partition("=")
        if not (key.strip() and equals):
            raise UsageError(f"-D {option}: not of the form key=value.", "For example -D reflectance=0.8.")
        parameters[key.strip()] = value.strip()
    return parameters


def furnace(
    *,
    reflectance: Annotated[
        float, Meta(ge=0, le=1, description="a number from 0 to 1, the reflectance of the walls")
    ] = 0.5,
    radiance: Annotated[
        float, Meta(ge=0, description="a number from 0, the radiance of the walls, W sr^-1 m^-2")
    ] = 1.0,
    shape: Annotated[Literal["box", "sphere"], Meta(description="box or sphere")] = "box",
    subdivisions: Annotated[
        int, Meta(ge=0, le=8, description="a whole number from 0 to 8, how often each triangle is split in four")
    ] = 2,
    resolution: Annotated[
        int, Meta(ge=1, le=4096, description="a whole number from 1 to 4096, the pixels per side")
    ] = 64,
) -> Scene:
    """Closed room with the same radiance everywhere (white furnace test).

    Every wall emits `radiance` to the inside and reflects `reflectance`. The radiance at every point, in every
    direction, is therefore radiance * (1 + reflectance + reflectance² + ...). A maximum depth of d truncates this
    series after reflectance^d. It is the same for every closed shape. The camera is inside and off-centre.
    """
    emission = {"radiance": radiance}
    if shape == "sphere":
        wall: dict[str, Any] = {"type": "sphere", "radius": 1.0, "subdivisions": subdivisions}
    else:
        vertices, faces = tessellate.box((-1, -1, -1), (1, 1, 1))
        for _ in range(subdivisions):
            vertices, faces = tessellate.subdivide(vertices, faces)
        wall = {"type": "mesh", "vertices": vertices, "faces": faces}
    return scene_from_dict(
        {
            "camera": {"position": [0.3, -0.2, 0.4], "target": [-0.5, 0.1, -0.6], "fov": 60},
            "film": {"resolution": [resolution, resolution]},
            "materials": {"wall": {"reflectance": reflectance}},
            "shapes": [{**wall, "name": "wall", "material": "wall", "emission": emission, "flip_normals": True}],
        },
        source="furnace",
    )


GENERATED: dict[str, Callable[..., Scene]] = {
    "furnace": furnace,
    "office": office,
    "office-premesh": office_premesh,
    "stacked": stacked,
    "teapot": teapot,
    "terrain": terrain,
}


def _made(
    make: Callable[..., _Made], location: SourceLocation, parameters: Mapping[str, object], *given: Path
) -> _Made:
    """Call `make` with `given` and with parameters. Text is converted to the types in the signature of `make`."""
    known = _parameters_of(make)
    hints = get_type_hints(make, include_extras=True)
    values = {}
    for key, value in parameters.items():
        if key not in known:
            near = similar_names(key, known, 1)
            raise location.error(
                f"has no parameter `{key}`. Allowed: " + ", ".join(f"{k}={v[0]}" for k, v in known.items()) + ".",
                f"Did you mean `{near[0]}`?" if near else "",
            )
        try:
            values[key] = convert(value, hints[key], strict=False)
        except msgspec.ValidationError as error:
            default = known[key][0]
            remedy = "Leave it out for the default." if default in ("", None) else f"The default is {default}."
            raise location.field(key).wrong(value, known[key][1], remedy) from error
    return make(*given, **values)


def _without_parameters(scene: Scene, name: str, parameters: Mapping[str, object] | None) -> Scene:
    if parameters:
        raise SceneError(
            f"{name}: has no parameters, but was given {', '.join(parameters)}.",
            "Parameters are for files and generated scenes. Change the scene itself, or load it from its file.",
        )
    return scene


def _scene_files() -> dict[str, Path]:
    folder = shipped_folder("scenes")
    return {path.stem: path for path in sorted(folder.glob("*.toml"))} if folder else {}


def _looks_like_a_path(text: str) -> bool:
    return text.lower().endswith(SCENE_SUFFIXES) or "/" in text or os.sep in text or os.path.isfile(text)


def _no_such_scene(name: str) -> SceneError:
    names = list(shipped_scenes())
    near = similar_names(name, names, len(names), 0)
    ordered = near + [other for other in names if other not in near]
    return SceneError(
        f"{shown(name)} is neither a shipped scene nor a file. Shipped: {', '.join(ordered)}.",
        f"A file of your own has the suffix .toml or a folder, such as ./{name}.toml.",
    )
