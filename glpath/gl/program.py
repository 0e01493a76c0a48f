"""Shader programs from files: includes are flattened, and errors name the right file and line.

Shaders lie in `shaders/` (beside the package in a checkout, inside it when installed). `.vert`, `.frag` and `.comp`
are whole programs. `.glsl` is included by a line `#include "name.glsl"`, each file once, unless an #ifdef removes
the line. Data that Python and GLSL share (layouts, constants) are declared in Python and inserted as text at
`#include <NAME>`, for NAME in the `generated` mapping.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from weakref import WeakKeyDictionary, WeakValueDictionary

import moderngl

from glpath.errors import ShaderError
from glpath.gl import llvmpipe
from glpath.gl.conditions import Conditions
from glpath.gl.constants import constants_glsl
from glpath.gl.signals import SignalsWait
from glpath.gl.variants import check_declared
from glpath.system.machine import return_memory
from glpath.system.time_limit import check_time

GLSL_VERSION = "#version 430 core"

_IMAGE_2D, _UNSIGNED_INT_IMAGE_2D = 0x904D, 0x9063

_INCLUDE = re.compile(r'^\s*#include\s+(?:"(?P<file>[^"]+)"|<(?P<generated>[^>]+)>)\s*$')
# Pattern of a preprocessor line, or of a line that a rewrite may change (see `glpath.gl.llvmpipe`).
_SPECIAL = re.compile(r"^\s*(?:#|uniform\b|(?:UINT_)?TEXELS\b)")
_LOCATION = re.compile(r"^(?P<file>\d+)[:(](?P<line>\d+)", re.MULTILINE)


def shader_folder() -> Path:
    """Return the folder of the shader files: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "shaders", package.parent / "shaders"):
        if folder.is_dir():
            return folder
    raise ShaderError(
        f"{package}: the shaders of glpath are missing; looked in {package / 'shaders'}",
        "Install glpath again: pip install --force-reinstall glpath",
    )


#: Maximum number of programs that a context caches. An engine has 3 to 12 and keeps them during its life; llvmpipe
#: takes some 5 MB for each.
MAX_PROGRAMS = 32


class _Compiled:
    """Recently used programs of a context, by the digest of their whole text.

    Compiling takes longer than many renders of a test suite. Programs depend on the contents of scenes (kinds of
    primitives, lights, materials, cameras), so many different scenes have many programs.
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[str, Program] = OrderedDict()
        self._alive: WeakValueDictionary[str, Program] = WeakValueDictionary()

    def __len__(self) -> int:
        return len(self._alive)

    def get(self, sources: Mapping[str, Source], compile_them: Callable[[], Program]) -> Program:
        key = hashlib.sha256("\0".join(source.text for source in sources.values()).encode()).hexdigest()
        program = self._alive.get(key)
        if program is None:
            program = self._alive[key] = compile_them()
        self._kept[key] = program
        self._kept.move_to_end(key)
        if len(self._kept) > MAX_PROGRAMS:
            self._kept.popitem(last=False)
            return_memory()
        return program


_compiled: WeakKeyDictionary[moderngl.Context, _Compiled] = WeakKeyDictionary()


def forget_programs(gl: moderngl.Context) -> None:
    """Forget all programs of a context, because they would keep the context alive."""
    _compiled.pop(gl, None)


class Source:
    """One flattened shader and the table that maps its lines to files."""

    def __init__(
        self,
        name: str,
        generated: Mapping[str, str],
        defines: Mapping[str, object],
        rewrites: Sequence[Callable[[str], str]] = (),
    ) -> None:
        self.name = name
        self.files: list[str] = []
        self._generated = generated
        self._rewrites = rewrites
        self._seen: set[str] = set()
        self._conditions = Conditions(defines)
        self._folder = shader_folder()
        #: The files that were read, with their time stamps and sizes.
        self.read: dict[Path, tuple[int, int]] = {}
        body = self._flatten(name, "")
        head = "".join(f"#define {key} {value}\n" for key, value in _mentioned(defines, body).items())
        self.text = f"{GLSL_VERSION}\n{head}{body}"

    def _flatten(self, name: str, included_from: str) -> str:
        path = self._folder / name
        try:
            self.read[path] = _stamp(path)
            text = path.read_text()
        except (FileNotFoundError, IsADirectoryError):
            prefix = f"{included_from}: " if included_from else ""
            raise ShaderError(f"{prefix}no shader file {name} in {self._folder}") from None
        self._seen.add(name)
        return self._lines(name, text)

    def _lines(self, name: str, text: str) -> str:
        number = len(self.files)
        self.files.append(name)
        out = [f"#line 1 {number}"]
        for i, line, special in _runs(text):
            if not special:
                out.append(line)
                continue
            self._conditions.follow(line)
            match = _INCLUDE.match(line)
            if match and not self._conditions.kept:
                out.append("")
                continue
            if not match:
                rewritten = line
                for rewrite in self._rewrites:
                    rewritten = rewrite(rewritten)
                out.append(rewritten)
                if rewritten is not line:
                    out.append(f"#line {i + 1} {number}")
                continue
            if match["generated"]:
                key = match["generated"]
                if key not in self._generated:
                    raise ShaderError(f"shaders/{name}:{i}: nothing generated is named {key}")
                if key not in self._seen:
                    self._seen.add(key)
                    out.append(self._lines(f"<{key}>", self._generated[key]))
            elif match["file"] not in self._seen:
                out.append(self._flatten(match["file"], f"shaders/{name}:{i}"))
            out.append(f"#line {i + 1} {number}")
        return "\n".join(out) + "\n"

    def explain(self, log: str) -> str:
        """Return the driver's log with file numbers replaced by file names."""

        def named(match: re.Match[str]) -> str:
            number = int(match["file"])
            if number >= len(self.files):
                return match[0]
            return f"shaders/{self.files[number]}:{match['line']}"

        return _LOCATION.sub(named, log)


def _mentioned(defines: Mapping[str, object], text: str) -> dict[str, object]:
    """Return the defines that a text mentions, directly or by other defines, so unused ones change no program."""
    kept: dict[str, object] = {}
    searched = [text]
    while searched:
        part = searched.pop()
        found = {key: value for key, value in defines.items() if key not in kept and key in part}
        kept |= found
        searched += [str(value) for value in found.values()]
    return {key: value for key, value in defines.items() if key in kept}


def _stamp(path: Path) -> tuple[int, int]:
    """Return modification time and size of a file, which change when it is rewritten."""
    status = os.stat(path)
    return status.st_mtime_ns, status.st_size


@lru_cache(maxsize=512)
def _runs(text: str) -> tuple[tuple[int, str, bool], ...]:
    """Split the text into its few special lines and the text between them: (first line, text, special)."""
    runs: list[tuple[int, str, bool]] = []
    plain: list[str] = []
    for i, line in enumerate(text.splitlines(), start=1):
        if not _SPECIAL.match(line):
            plain.append(line)
            continue
        if plain:
            runs.append((i - len(plain), "\n".join(plain), False))
            plain = []
        runs.append((i, line, True))
    if plain:
        runs.append((0, "\n".join(plain), False))
    return tuple(runs)


class Program:
    """Linked program whose samplers and images have fixed units, in the order of their names.

    gl       : the moderngl program or compute shader
    samplers : name -> texture unit
    images   : name -> image unit, see texels.glsl
    """

    def __init__(self, gl: moderngl.Program | moderngl.ComputeShader, label: str) -> None:
        self.gl = gl
        self.label = label
        self.samplers: dict[str, int] = {}
        self.images: dict[str, int] = {}
        self._uniforms: dict[str, moderngl.Uniform] = {}
        self._values: dict[str, object] = {}
        for spelt in sorted(gl):
            member, name = gl[spelt], llvmpipe.uniform_name(spelt)
            if not isinstance(member, moderngl.Uniform):
                continue
            if member.gl_type in (_IMAGE_2D, _UNSIGNED_INT_IMAGE_2D):  # type: ignore[attr-defined]
                unit = self.images[name] = len(self.images)
                # moderngl sets the unit only for images of floats; the GL call is the same for all.
                member.gl_type, member.fmt = _IMAGE_2D, "1i"  # type: ignore[attr-defined]
                member.value = unit
                continue
            # GL_SAMPLER_2D, GL_SAMPLER_2D_ARRAY, GL_INT_SAMPLER_2D, GL_UNSIGNED_INT_SAMPLER_2D
            if member.gl_type in (0x8B5E, 0x8DC1, 0x8DCA, 0x8DD2):  # type: ignore[attr-defined]
                self.samplers[name] = len(self.samplers)
                member.value = self.samplers[name]
            else:
                self._uniforms[name] = member

    def set(self, uniforms: Mapping[str, object]) -> None:
        """Set those of the given uniforms that this program uses: numbers, tuples for vectors, bytes for an array.

        All uniforms of the program must be given, because a family of passes shares one mapping and programs are
        shared too. A missing one would be 0, or have the value of an earlier draw.
        """
        missing = self._uniforms.keys() - uniforms.keys()
        assert not missing, f"{self.label}: no value for the uniforms {sorted(missing)}"
        for name, value in uniforms.items():
            uniform = self._uniforms.get(name)
            # Most uniforms keep their value between path sets, and a comparison costs less than a GL call.
            if uniform is None or self._values.get(name) == value:
                continue
            if isinstance(value, bytes):
                uniform.write(value)
            else:
                uniform.value = value
            self._values[name] = value


def load_program(
    gl: moderngl.Context,
    *,
    vertex: str = "",
    fragment: str = "",
    compute: str = "",
    generated: Mapping[str, str] | None = None,
    defines: Mapping[str, object] | None = None,
) -> Program:
    """Compile and link shader files (names relative to the shader folder).

    Parameters
    ----------
    vertex, fragment : file names of a drawing program; or `compute` alone
    generated        : text for `#include <NAME>`: layouts declared in Python
    defines          : name -> value, inserted as #define lines before everything; see `glpath.gl.variants`

    A program is compiled once in a context. Later calls share it as long as someone uses it or it is among the last
    `MAX_PROGRAMS` requests.

    Raises
    ------
    ShaderError : with the driver's log, in which each position is a file and line of the shader folder
    """
    stages = {"vertex_shader": vertex, "fragment_shader": fragment, "compute_shader": compute}
    stages = {stage: name for stage, name in stages.items() if name}
    given = dict(defines or {})
    check_declared(given)
    generated = {"CONSTANTS": constants_glsl(), **(generated or {})}
    inputs: int | None = None
    if llvmpipe.is_spoken(gl):
        inputs = int(gl.info["GL_MAX_FRAGMENT_INPUT_COMPONENTS"]) if vertex == llvmpipe.FULLSCREEN else 0
    sources = _flattened(stages, generated, given, inputs)
    return _compiled.setdefault(gl, _Compiled()).get(sources, lambda: _compile(gl, sources))


#: Flattened shaders of recent requests. The key holds all inputs of `_flattened` except the contents of files.
_sources: OrderedDict[Hashable, dict[str, Source]] = OrderedDict()
#: Maximum number of entries in `_sources`.
_MAX_SOURCES = 128


def _flattened(
    stages: Mapping[str, str], generated: Mapping[str, str], defines: Mapping[str, object], inputs: int | None
) -> dict[str, Source]:
    """Return the shaders of a program by stage, cached because a render of the same scene requests the same ones.

    inputs : see `_for_llvmpipe`; None if shaders are not rewritten for llvmpipe
    """
    # The order of the defines is part of the key, because the #define lines have the same order.
    texts = tuple((name, str(value)) for name, value in defines.items())
    key = (shader_folder(), inputs, tuple(stages.items()), tuple(generated.items()), texts)
    sources = _sources.get(key)
    if sources is None or not all(_is_fresh(source) for source in sources.values()):
        if inputs is None:
            sources = {stage: Source(name, generated, defines) for stage, name in stages.items()}
        else:
            sources = _for_llvmpipe(stages, generated, defines, inputs)
        _sources[key] = sources
        if len(_sources) > _MAX_SOURCES:
            _sources.popitem(last=False)
    _sources.move_to_end(key)
    return sources


def _is_fresh(source: Source) -> bool:
    try:
        return all(_stamp(path) == stamp for path, stamp in source.read.items())
    except FileNotFoundError:
        return False


def _for_llvmpipe(
    stages: Mapping[str, str], generated: Mapping[str, str], defines: Mapping[str, object], inputs: int
) -> dict[str, Source]:
    """Flatten and rewrite shaders for llvmpipe.

    inputs : maximum components of flat inputs by which the vertex shader may pass on uniforms
    """
    handed = llvmpipe.HandedOn(defines, inputs)
    rewrites = {
        "fragment_shader": (llvmpipe.image_texels, handed.fragment),
        "compute_shader": (llvmpipe.image_texels, llvmpipe.fetch_at_start),
    }
    images = {**defines, "TEXELS_ARE_IMAGES": 1}
    # The vertex shader does not read textures as images, because OpenGL guarantees no images to a vertex shader.
    sources = {
        stage: Source(name, generated, images if stage in rewrites else defines, rewrites.get(stage, ()))
        for stage, name in stages.items()
    }
    if inputs:
        sources["vertex_shader"].text = handed.vertex(sources["vertex_shader"].text)
    return sources


def _compile(gl: moderngl.Context, sources: Mapping[str, Source]) -> Program:
    check_time("compiling shaders")
    # moderngl calls Python functions while it makes a program, and crashes if a signal interrupts one.
    signals = SignalsWait(_program_of.__code__)
    signals.begin()
    try:
        return _program_of(gl, sources)
    finally:
        signals.end()


def _program_of(gl: moderngl.Context, sources: Mapping[str, Source]) -> Program:
    label = "+".join(source.name for source in sources.values())
    try:
        if "compute_shader" in sources:
            return Program(gl.compute_shader(sources["compute_shader"].text), label)
        vertex, fragment = sources["vertex_shader"], sources["fragment_shader"]
        return Program(gl.program(vertex_shader=vertex.text, fragment_shader=fragment.text), label)
    except moderngl.Error as error:
        log = str(error)
        # moderngl's message starts with the stage that failed; the file numbers belong to that stage.
        failed = next((s for k, s in sources.items() if k in log.lower()), None)
        text = failed.explain(log) if failed else log
        raise ShaderError(f"{label}: the driver refuses the shader\n{text.strip()}") from None
