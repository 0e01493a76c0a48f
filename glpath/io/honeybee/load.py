"""Assembly of a scene from an HBJSON file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from glpath.errors import warn
from glpath.io.completed import NO_CAMERA, RESOLUTION, is_aside
from glpath.io.honeybee.model import (
    Aperture,
    BoundaryCondition,
    Door,
    Face,
    Face3D,
    Mesh3D,
    Model,
    Room,
    Shade,
    Shaded,
    ShadeMesh,
    View,
    read_model_file,
)
from glpath.io.honeybee.modifiers import CONTEXT, Modifiers
from glpath.io.polygons import polygon_errors_at, polygon_normal, split_faces, triangulated, warn_of_crossing
from glpath.io.values import LARGEST
from glpath.scene.camera import Camera
from glpath.scene.camera_check import check_camera
from glpath.scene.geometry import IDENTITY, Float64
from glpath.scene.model import Environment, Mesh, Scene, Shape, Shapes, Sky
from glpath.scene.source_location import SourceLocation, shown
from glpath.scene.tessellate import with_area
from glpath.sky.cie import cie_sky
from glpath.system.arguments import checked
from glpath.system.suggestions import listed_names
from glpath.system.units import EFFICACY

_UP = np.array([0.0, 0.0, 1.0])
# Maximum area by which the openings of a face may overlap each other or its edges, as a fraction of the face's
# area.
_MISSING = 1e-2
# Distance of the eye from the corner of a room's floor, as a fraction of the distance from corner to centre.
_FROM_CORNER = 0.08
# Height of the eye, as a fraction of the room's height.
_EYE = 0.6
# Height of the target, as a fraction of the room's height.
_TARGET = 0.45
# Field of view, degrees.
_FOV = 75.0
# Minimum width and height of a view in degrees. The aspect ratio of smaller views may be NaN.
_MIN_VIEW = 1e-3


def read_honeybee(
    path: Path,
    *,
    overcast: Annotated[
        float,
        Meta(
            ge=0,
            le=LARGEST,
            description="0 to 1e15 lx, illuminance of open ground by a CIE overcast sky; 0: none",
        ),
    ] = 0.0,
    ground: Annotated[
        float, Meta(ge=0, le=1, description="a number from 0 to 1, the reflectance of the ground below that sky")
    ] = 0.2,
    view: Annotated[
        str, Meta(description="the name of one of the file's views; without it the first in perspective")
    ] = "",
) -> Scene:
    """Read the scene of an HBJSON file; see `glpath.io.honeybee`.

    Raises SceneError with the name of the object that is wrong. Warns if a sky or a view is set because the file
    has none.
    """
    model = read_model_file(path)
    location = SourceLocation(str(path))
    if model.units != "Meters":
        warn(
            f"{path}: its units are {shown(model.units)}, and so are positions and distances here. Spacings and "
            'margins by EN 12464-1 need metres: model.convert_to_units("Meters") of honeybee.'
        )
    reader = _Reader(location, Modifiers(location, model.radiance))
    reader.read(model)
    if not reader.shapes:
        raise location.error("has no faces and no shades, so there is nothing to see.")
    notes = []
    camera = _camera(model, view, location)
    if camera is None:
        camera = _camera_inside(model.rooms or [], Shapes(reader.shapes))
        pose = f"position {shown(camera.position.round(3))}, target {shown(camera.target.round(3))}"
        notes += [] if is_aside("camera") else [f"no view in perspective, so one was set: {pose}"]
    sky: Sky | Environment | None = None
    if overcast > 0:
        sky = overcast_sky(overcast, ground)
    elif not any(light.any() for light in reader.modifiers.emission):
        sky = Sky(np.ones(3), np.full(3, 1 / 3), _UP, assumed=True)
        notes += [] if is_aside("light") else ["no light, so an overcast sky lights it; -D overcast=10000 sets lx"]
    if notes:
        warn(f"{path}: has {', and '.join(notes)}.")
    check_camera(camera, location)
    return Scene(
        name=path.stem,
        camera=camera,
        shapes=Shapes(reader.shapes),
        materials=tuple(reader.modifiers.materials),
        source=str(path),
        sky=sky,
    )


def overcast_sky(illuminance: float, ground: float) -> Environment:
    """Return a CIE overcast sky in W, z up, above a diffuse ground.

    illuminance : illuminance of open ground, lx
    ground      : reflectance of the ground, which is seen below the horizon
    """
    irradiance = illuminance / EFFICACY
    sky = cie_sky(1, _UP, None, illuminance=irradiance)
    image = sky.image.copy()
    image[len(image) // 2 :] = ground * irradiance / (np.pi * sky.scale)
    return replace(sky, image=image)


@dataclass
class _Reader:
    """Reader that makes one shape for each object.

    paired : names of objects that are the other side of an object already read, by type
    """

    location: SourceLocation
    modifiers: Modifiers
    shapes: list[Shape] = field(default_factory=list)
    paired: dict[type, set[str]] = field(default_factory=lambda: {Face: set(), Aperture: set(), Door: set()})

    def read(self, model: Model) -> None:
        for room in model.rooms or ():
            radiance = room.properties.radiance
            room_set = None if radiance is None else radiance.modifier_set
            for face in room.faces:
                self._face(face, room_set)
            self._attached(room, room_set)
        for face in model.orphaned_faces or ():
            self._face(face, None)
        for aperture in model.orphaned_apertures or ():
            self._aperture(aperture, None, "Wall")
        for door in model.orphaned_doors or ():
            self._door(door, None, "Wall")
        for shade in model.orphaned_shade or ():
            self._shade(shade, self._of_orphan(shade))
        for mesh in model.shade_meshes or ():
            self._add(mesh.identifier, mesh.modifier or self._of_orphan(mesh), self._mesh(mesh))

    def _of_orphan(self, shade: Shade | ShadeMesh) -> str:
        if shade.is_detached:
            return CONTEXT
        return self.modifiers.of_shade(None, indoors=False, user=shade.identifier)

    def _face(self, face: Face, room_set: str | None) -> None:
        openings = [*(face.apertures or ()), *(face.doors or ())]
        if self._is_first(face, face.boundary_condition):
            holes = [opening.geometry.boundary for opening in openings]
            mesh = self._polygon(face.identifier, face.geometry, holes)
            self._add(face.identifier, self.modifiers.of_face(face, room_set), mesh)
        for aperture in face.apertures or ():
            self._aperture(aperture, room_set, face.face_type)
        for door in face.doors or ():
            self._door(door, room_set, face.face_type)
        self._attached(face, room_set)

    def _aperture(self, aperture: Aperture, room_set: str | None, face_type: str) -> None:
        if self._is_first(aperture, aperture.boundary_condition):
            name = self.modifiers.of_aperture(aperture, room_set, face_type)
            self._add(aperture.identifier, name, self._polygon(aperture.identifier, aperture.geometry))
            self._geometry_of_state(aperture)
        self._attached(aperture, room_set)

    def _door(self, door: Door, room_set: str | None, face_type: str) -> None:
        if self._is_first(door, door.boundary_condition):
            name = self.modifiers.of_door(door, room_set, face_type)
            self._add(door.identifier, name, self._polygon(door.identifier, door.geometry))
            self._geometry_of_state(door)
        self._attached(door, room_set)

    def _attached(self, parent: Shaded, room_set: str | None) -> None:
        for indoors, attached in ((True, parent.indoor_shade), (False, parent.outdoor_shade)):
            for shade in attached or ():
                self._shade(shade, self.modifiers.of_shade(room_set, indoors=indoors, user=shade.identifier))

    def _shade(self, shade: Shade, default: str) -> None:
        self._add(shade.identifier, shade.modifier or default, self._polygon(shade.identifier, shade.geometry))
        self._geometry_of_state(shade)

    def _geometry_of_state(self, item: Aperture | Door | Shade) -> None:
        """Add each shade of the first state of `item`. The default modifier is that of a shade outdoors."""
        for shade in item.state.geometry or ():
            modifier = shade.modifier
            if modifier is None:
                modifier = self.modifiers.of_shade(None, indoors=False, user=shade.identifier)
                warn(f'{self.location}: "{shade.identifier}" has no modifier, so it has {modifier}.')
            self._add(shade.identifier, modifier, self._polygon(shade.identifier, shade.geometry))

    def _is_first(self, item: Face | Aperture | Door, boundary: BoundaryCondition) -> bool:
        """Return False if the item is the other side of an item already read, because two rooms share a wall."""
        if boundary.type != "Surface":
            return True
        paired = self.paired[type(item)]
        if item.identifier in paired:
            return False
        paired.update(boundary.boundary_condition_objects[:1])
        return True

    def _add(self, name: str, modifier: str, mesh: Mesh | None) -> None:
        number = self.modifiers.number(modifier, name)
        if number is None or mesh is None:
            return
        mesh = with_area(mesh, IDENTITY, name, self.location)
        self.shapes.append(Shape(name, mesh, number, emission=self.modifiers.emission[number]))

    def _polygon(self, name: str, geometry: Face3D, openings: Sequence[Any] = ()) -> Mesh | None:
        """Return a polygon with holes as a mesh; None if it has no area.

        Raises SceneError if openings overlap or lie outside.
        """
        rings = [np.array(ring, np.float64) for ring in (geometry.boundary, *(geometry.holes or ()), *openings)]
        for ring in rings:
            self._check(name, ring)
        boundary, *holes = rings
        with polygon_errors_at(self.location):
            vertices, faces, missing = triangulated(boundary, holes)
            crossed = triangulated(boundary)[2] if holes else missing
        area = 0.5 * float(np.linalg.norm(polygon_normal(boundary)))
        if abs(missing) > _MISSING * area or abs(crossed) > _MISSING * area:
            fault = f"{len(holes)} holes, apertures and doors that overlap each other or its edges"
            raise self.location.error(
                f'"{name}" has {fault if holes else "a boundary that crosses itself"}, by an area of '
                f"{max(abs(missing), abs(crossed)):.3g}.",
                "Check the model by honeybee: model.check_all().",
            )
        return Mesh(vertices, faces) if len(faces) else None

    def _mesh(self, shade: ShadeMesh) -> Mesh | None:
        """Return the triangles of a shade; None if it has no faces. Raises SceneError."""
        geometry: Mesh3D = shade.geometry
        if not geometry.faces:
            return None
        vertices = np.array(geometry.vertices, np.float64).reshape(-1, 3)
        self._check(shade.identifier, vertices)
        last = max(max(face) for face in geometry.faces)
        if last >= len(vertices):
            raise self.location.error(
                f'"{shade.identifier}" names vertex {last}, but has {len(vertices)} (0 to {len(vertices) - 1}).'
            )
        with polygon_errors_at(self.location):
            faces, crossing = split_faces(vertices, geometry.faces)
        warn_of_crossing(f'{self.location} "{shade.identifier}"', crossing)
        return Mesh(vertices, faces)

    def _check(self, name: str, points: Float64) -> None:
        if not np.all(np.abs(points) <= LARGEST):
            raise self.location.error(
                f'"{name}" reaches beyond {LARGEST:g} units, where 32 bit numbers end.', "Choose a larger unit."
            )


def _camera(model: Model, name: str, location: SourceLocation) -> Camera | None:
    """Return the camera of a view by name, otherwise of the first perspective view. Raises SceneError."""
    views = model.radiance.views or []
    chosen = [each for each in views if each.identifier == name] if name else views
    if name and not chosen:
        known = listed_names(each.identifier for each in views) or "no views"
        raise location.error(f'has no view "{name}". It has: {known}.')
    if name and not chosen[0].view_type.endswith("v"):
        raise location.error(f'the view "{name}" is of the type {chosen[0].view_type}, but only v is read.')
    seen = next((each for each in chosen if each.view_type.endswith("v")), None)
    return None if seen is None else _camera_of(seen, location)


def _camera_of(view: View, location: SourceLocation) -> Camera:
    if not (_MIN_VIEW <= view.h_size < 180 and _MIN_VIEW <= view.v_size < 180):
        raise location.error(
            f'the view "{view.identifier}" has the sizes {view.h_size:g} and {view.v_size:g}, but they must be '
            f"at least {_MIN_VIEW:g} and less than 180 degrees."
        )
    aspect = np.tan(np.radians(view.h_size / 2)) / np.tan(np.radians(view.v_size / 2))
    longest = max(RESOLUTION)
    size = (longest, max(1, round(longest / aspect))) if aspect > 1 else (max(1, round(longest * aspect)), longest)
    position, direction = np.array(view.position), np.array(view.direction)
    up = np.array(view.up_vector)
    if view.fore_clip or view.aft_clip:
        warn(f'{location}: the fore_clip and aft_clip of the view "{view.identifier}" are not used.')
    centre = 0.5 - (view.shift or 0.0), 0.5 + (view.lift or 0.0)
    return Camera(position, position + direction, up, view.v_size, size, principal_point=centre)


def _camera_inside(rooms: Sequence[Room], shapes: Shapes) -> Camera:
    """Return a camera in a corner of the largest room; without rooms, outside all shapes."""
    lower, upper = (np.asarray(bound) for bound in shapes.bounds)
    floors = [(np.array(face.geometry.boundary), room) for room in rooms for face in room.faces]
    floors = [(ring, room) for ring, room in floors if np.ptp(ring[:, 2]) < 1e-6 * np.ptp(ring)]
    if not floors:
        middle, size = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
        return Camera(middle + size * np.array([-0.7, -1.0, 0.6]), middle, _UP, 40.0, RESOLUTION)
    floor, room = max(floors, key=lambda pair: float(np.ptp(pair[0][:, 0]) * np.ptp(pair[0][:, 1])))
    heights = [point[2] for face in room.faces for point in face.geometry.boundary]
    middle = floor.mean(axis=0)
    corner = floor[int(np.argmax(np.linalg.norm(floor - middle, axis=1)))]
    eye, target = corner + _FROM_CORNER * (middle - corner), middle.copy()
    for point, share in ((eye, _EYE), (target, _TARGET)):
        point[2] = min(heights) + share * (max(heights) - min(heights))
    return replace(NO_CAMERA, position=eye, target=target, up=_UP, fov=_FOV)


@checked
def sensor_points(path: str | Path, grid: str | None = None) -> tuple[Float64, Float64]:
    """Return the positions (N, 3) and directions (N, 3) of a file's sensors, in the units of the file.

    grid : identifier or display name of one grid; None for all grids in sequence

    Raises SceneError if the file has no such grid, or no grid at all.
    """
    grids = read_model_file(Path(path)).radiance.sensor_grids or []
    location = SourceLocation(str(path))
    if not grids:
        raise location.error("has no sensor grids.", "Lay a grid in a plane, or name points of your own.")
    chosen = [each for each in grids if grid is None or grid in (each.identifier, each.display_name)]
    if not chosen:
        names = listed_names(each.identifier for each in grids)
        raise location.error(f'has no sensor grid "{grid}". It has: {names}.', "Write FILE.hbjson#GRID.")
    sensors = [sensor for each in chosen for sensor in each.sensors]
    table = np.array([(*sensor.pos, *sensor.dir) for sensor in sensors], np.float64).reshape(-1, 6)
    if not len(table):
        raise location.error(f'has no sensors in "{chosen[0].identifier}".')
    dark = np.flatnonzero(~table[:, 3:].any(axis=1))
    if len(dark):
        raise location.error(f"sensor {dark[0]} has the direction 0, 0, 0, which looks nowhere.")
    return table[:, :3], table[:, 3:]
