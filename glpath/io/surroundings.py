"""Surroundings of a scene from any kind of file: an environment map as its sky, and a background.

Every scene has these parameters (`load_scene`); `glpath.io.lights` reads a scene file's own sky. An environment
replaces that sky, and the light that is added if a scene has none. Other lights of the file stay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import msgspec
from msgspec import Meta

from glpath.errors import UsageError
from glpath.io.convert import convert
from glpath.io.lights import environment_map
from glpath.io.plain_background import with_plain_background
from glpath.scene.background import Background
from glpath.scene.choices import BackgroundKind
from glpath.scene.model import Scene
from glpath.scene.source_location import SourceLocation


@dataclass(frozen=True)
class Surroundings:
    """Parameters that every scene has.

    Raises UsageError for a rotation or an exposure without an environment.
    """

    environment: Annotated[
        Path | None, Meta(description="an environment map (.hdr, .exr), which lights the scene instead of its sky")
    ] = None
    environment_rotation: Annotated[
        float | None,
        Meta(description="degrees by which the environment is rotated, counter-clockwise seen from above"),
    ] = None
    environment_exposure: Annotated[
        Annotated[float, Meta(ge=-100, le=100)] | None,
        Meta(description="stops from -100 to 100 by which the environment is brightened"),
    ] = None
    background: Annotated[
        BackgroundKind | None,
        Meta(
            description="environment, plain or transparent, what the camera sees behind all shapes: the sky; a "
            "grey, as bright as a white ground in that light; or nothing, an alpha channel in .png and .exr"
        ),
    ] = None

    def __post_init__(self) -> None:
        for name in ("environment_rotation", "environment_exposure"):
            if getattr(self, name) is not None and self.environment is None:
                raise UsageError(
                    f"{name}: of an environment, but no environment is given.",
                    'Name the file: environment="studio.hdr".',
                )

    def __bool__(self) -> bool:
        return self != Surroundings()

    @classmethod
    def taken_from(
        cls, parameters: Mapping[str, object] | None, location: SourceLocation
    ) -> tuple[Surroundings, dict[str, Any]]:
        """Split parameters, whose values may be text, into surroundings and the other parameters.

        Raises SceneError.
        """
        hints = get_type_hints(cls, include_extras=True)
        values: dict[str, Any] = {}
        others: dict[str, Any] = {}
        for name, value in (parameters or {}).items():
            if name not in hints:
                others[name] = value
            elif name == "environment" and value is not None:
                values[name] = Path(str(value))
            elif value is not None:
                try:
                    values[name] = convert(value, hints[name], strict=False)
                except msgspec.ValidationError as error:
                    description = hints[name].__metadata__[0].description
                    raise location.field(name).wrong(value, description) from error
        return cls(**values), others

    def around(self, scene: Scene) -> Scene:
        """Return a copy of the scene with these surroundings.

        Raises SceneError if the file `environment` is no environment map.
        """
        own = scene.background
        if self.environment is not None:
            location = SourceLocation(scene.source or scene.name)
            up = scene.camera.up if scene.sky is None else scene.sky.up  # need not be a unit vector
            scale = 2.0 ** (self.environment_exposure or 0.0)
            sky = environment_map(
                self.environment, scale, self.environment_rotation or 0.0, up, location.field("environment")
            )
            studios = scene.sky is not None and scene.sky.assumed
            exposure = None if studios else scene.exposure
            scene = replace(scene, sky=sky, background=None, exposure=exposure)
        ground = None if own is None else own.ground
        if self.background == "environment":
            return replace(scene, background=None)
        if self.background == "transparent":
            return replace(scene, background=Background(transparent=True))
        return with_plain_background(scene, ground) if self.background == "plain" else scene


#: Names of the fields of `Surroundings`.
SURROUNDINGS = tuple(field.name for field in fields(Surroundings))
