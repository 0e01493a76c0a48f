"""Objects of an HBJSON file that affect light. Other contents are ignored."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from glpath.errors import SceneError
from glpath.io.convert import convert
from glpath.scene.source_location import SourceLocation
from glpath.system.files import read_bytes, reason_of
from glpath.system.numerals import unsigned
from glpath.system.vectors import LARGEST

Point = tuple[float, float, float]
_Offset = Annotated[float, Meta(ge=-LARGEST, le=LARGEST)]
Ring = Annotated[list[Point], Meta(min_length=3)]


def _in_file(name: str) -> str:
    """Return the file's key for a field; a key that would end in _shade gets a plural s."""
    return f"{name}s" if name.endswith("_shade") else name


class Face3D(Struct):
    """Planar polygon. Its boundary is counter-clockwise, seen from its front."""

    boundary: Ring
    holes: list[Ring] | None = None


class Mesh3D(Struct):
    vertices: list[Point]
    faces: list[Annotated[list[Annotated[int, Meta(ge=0, le=2**31 - 1)]], Meta(min_length=3, max_length=4)]]


class StateShade(Struct):
    """Shade that exists in one state only."""

    identifier: str
    geometry: Face3D
    modifier: str | None = None


class State(Struct):
    """State of an aperture, door or shade: its modifier, None for its usual one, and further geometry."""

    modifier: str | None = None
    geometry: list[StateShade] | None = msgspec.field(default=None, name="shades")


class Radiance(Struct):
    """Names of a modifier or of a room's modifier set; states, which only members of a dynamic group have."""

    modifier: str | None = None
    modifier_set: str | None = None
    dynamic_group_identifier: str | None = None
    states: list[State] | None = None


class Properties(Struct):
    radiance: Radiance | None = None


class BoundaryCondition(Struct):
    """Other side of a face; for "Surface", the names of the adjacent face, its parent and its room."""

    type: str
    boundary_condition_objects: tuple[str, ...] = ()


class Named(Struct, kw_only=True):
    """Fields that all objects have."""

    identifier: str
    properties: Properties = msgspec.field(default_factory=Properties)

    @property
    def state(self) -> State:
        """First state of the object; an empty one if it belongs to no dynamic group."""
        radiance = self.properties.radiance
        if radiance is None or radiance.dynamic_group_identifier is None or not radiance.states:
            return State()
        return radiance.states[0]

    @property
    def modifier(self) -> str | None:
        """Name of the object's own modifier in its first state; None if it has none."""
        usual = None if self.properties.radiance is None else self.properties.radiance.modifier
        return self.state.modifier or usual


class Shade(Named, kw_only=True):
    geometry: Face3D
    is_detached: bool = False


class ShadeMesh(Named, kw_only=True):
    geometry: Mesh3D
    is_detached: bool = True


class Shaded(Named, kw_only=True, rename=_in_file):
    indoor_shade: list[Shade] | None = None
    outdoor_shade: list[Shade] | None = None


class Opening(Shaded, kw_only=True):
    """Fields that apertures and doors have."""

    geometry: Face3D
    boundary_condition: BoundaryCondition


class Aperture(Opening, kw_only=True):
    is_operable: bool = False


class Door(Opening, kw_only=True):
    is_glass: bool = False


class Face(Shaded, kw_only=True):
    geometry: Face3D
    face_type: Literal["Wall", "Floor", "RoofCeiling", "AirBoundary"]
    boundary_condition: BoundaryCondition
    apertures: list[Aperture] | None = None
    doors: list[Door] | None = None


class Room(Shaded, kw_only=True):
    faces: list[Face]


class Sensor(Struct):
    pos: Point
    dir: Point


class SensorGrid(Struct):
    identifier: str
    sensors: list[Sensor]
    display_name: str | None = None


class View(Struct):
    """View of Radiance; type v is perspective; sizes in degrees.

    shift, lift         : offset of the image to the right and up, in image widths and heights
    fore_clip, aft_clip : distances within which, and beyond which, nothing is visible; 0 or None for none
    """

    identifier: str
    position: Point
    direction: Point
    up_vector: Point
    view_type: str = "v"
    h_size: float = 60.0
    v_size: float = 60.0
    shift: _Offset | None = None
    lift: _Offset | None = None
    fore_clip: float | None = None
    aft_clip: float | None = None


class ModifierSet(Struct):
    """Names of modifiers for each type of object, by keys such as interior_modifier."""

    identifier: str
    wall_set: dict[str, Any] | None = None
    floor_set: dict[str, Any] | None = None
    roof_ceiling_set: dict[str, Any] | None = None
    aperture_set: dict[str, Any] | None = None
    door_set: dict[str, Any] | None = None
    shade_set: dict[str, Any] | None = None
    air_boundary_modifier: str | None = None


class ModelRadiance(Struct):
    """Radiance properties of a model.

    global_modifier_set : name of the set for rooms without one; a table stands for honeybee's default set
    """

    global_modifier_set: Any = None
    modifiers: list[dict[str, Any]] | None = None
    modifier_sets: list[ModifierSet] | None = None
    sensor_grids: list[SensorGrid] | None = None
    views: list[View] | None = None


class ModelProperties(Struct):
    radiance: ModelRadiance | None = None


class Model(Struct, kw_only=True, rename=_in_file):
    """Whole HBJSON file."""

    identifier: str
    type: Literal["Model"]
    rooms: list[Room] | None = None
    orphaned_faces: list[Face] | None = None
    orphaned_apertures: list[Aperture] | None = None
    orphaned_doors: list[Door] | None = None
    orphaned_shade: list[Shade] | None = None
    shade_meshes: list[ShadeMesh] | None = None
    units: str = "Meters"
    properties: ModelProperties = msgspec.field(default_factory=ModelProperties)

    @property
    def radiance(self) -> ModelRadiance:
        return self.properties.radiance or ModelRadiance()


def read_model_file(path: Path) -> Model:
    """Read the objects of a file. Raises SceneError with the name of the object that is wrong."""
    location = SourceLocation(str(path))
    try:
        data = msgspec.json.decode(read_bytes(path).removeprefix(codecs.BOM_UTF8))
    except OSError as error:
        raise location.error(f"cannot be read: {reason_of(error)}.") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise location.error(f"is no JSON: {error}.", "Write it by honeybee: model.to_hbjson().") from error
    try:
        return convert(data, Model)  # type: ignore[no-any-return]
    except msgspec.ValidationError as error:
        raise _named(error, data, location) from error


def _named(error: msgspec.ValidationError, data: Any, location: SourceLocation) -> SceneError:
    """Return the error with the path to the wrong value and the name of the object around it."""
    text, _, path = str(error).partition(" - at `$")
    name = ""
    for key in path.rstrip("`").replace("]", "").replace("[", ".").split(".")[1:]:
        if isinstance(data, dict):
            name = data.get("identifier", name)
            location, data = location.field(key), data.get(key)
        elif isinstance(data, list) and (number := unsigned(key)) is not None:
            location, data = location.item(number), data[number]
    if isinstance(data, dict):
        name = data.get("identifier", name)
    of = f'of "{name}" ' if isinstance(name, str) and name else ""
    return location.error(f"{of}cannot be read: {text}.", "Write the file anew by honeybee: model.to_hbjson().")
