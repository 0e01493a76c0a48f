"""Parts of a program that its shaders include: a scene, a BVH, a radiosity solution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import moderngl


class Part(Protocol):
    """Object on the device with a shader file that reads it.

    uniforms, textures : values by their names in GLSL
    generated, defines : see `glpath.gl.program.load_program`
    """

    @property
    def uniforms(self) -> Mapping[str, object]: ...

    @property
    def textures(self) -> Mapping[str, moderngl.Texture]: ...

    @property
    def generated(self) -> Mapping[str, str]: ...

    @property
    def defines(self) -> Mapping[str, object]: ...


@dataclass
class ProgramParts:
    """Combined includes, defines, textures and uniforms of a program's parts; itself a part."""

    uniforms: dict[str, object] = field(default_factory=dict)
    textures: dict[str, moderngl.Texture] = field(default_factory=dict)
    generated: dict[str, str] = field(default_factory=dict)
    defines: dict[str, object] = field(default_factory=dict)

    @classmethod
    def of(cls, *parts: Part) -> ProgramParts:
        made = cls()
        for part in parts:
            made.add(part)
        return made

    def add(self, part: Part) -> None:
        self.uniforms |= part.uniforms
        self.textures |= part.textures
        self.generated |= part.generated
        self.defines |= part.defines
