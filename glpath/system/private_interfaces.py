"""Private interfaces of other packages: all that are used, each once, with the releases that have it.

No public interface does what they do. A release may change any of them without notice. Then the function here
raises GlpathError, which names the package, its version and what is not there; so does the test of this module.
`SEEN` is what `pyproject.toml` bounds: numba from above as well, since no kernel is compiled without its internals.

Cost:     none until a function is called; each imports its own package alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from glpath.errors import GlpathError


@dataclass(frozen=True)
class Releases:
    """Releases of a package whose private interfaces are as here, first and last that were tried."""

    first: str
    last: str


SEEN = {
    "numba": Releases("0.61", "0.68"),
    "trimesh": Releases("4.7", "5.2"),
    "pytest": Releases("8", "9.2"),
    "jupyter_rfb": Releases("1.0", "1.0"),
}


@dataclass(frozen=True)
class NumbaInternals:
    """What kernels are compiled and kept by.

    function_cache : base class of a cache of one function, with `_impl`, `_cache_path`, `_py_func`, `_index_key`
    dumps          : pickles what was compiled
    compiler_lock  : of the compiler, which is not thread-safe
    event, types   : who hears of compilations; of signatures
    """

    function_cache: Any
    dumps: Any
    compiler_lock: Any
    event: Any
    types: Any


#: Options of `numba.njit` that are in no manual: without reference counts, without wrappers for C and for Python.
NUMBA_OPTIONS = {"_nrt": False, "no_cfunc_wrapper": True}
NUMBA_WITHOUT_PYTHON = {"no_cpython_wrapper": True}


def numba_internals() -> NumbaInternals:
    return NumbaInternals(
        _attribute("numba", "numba.core.caching", "FunctionCache"),
        _attribute("numba", "numba.core.serialize", "dumps"),
        _attribute("numba", "numba.core.compiler_lock", "global_compiler_lock"),
        _module("numba", "numba.core.event"),
        _module("numba", "numba.core.types"),
    )


def numba_cache(dispatcher: Any) -> Any:
    """The cache of a compiled function, one that keeps nothing as a rule."""
    return _of("numba", dispatcher, "_cache")


def set_numba_cache(dispatcher: Any, cache: Any) -> None:
    numba_cache(dispatcher)  # where there is none, nothing would ask the new one
    dispatcher._cache = cache


def given_trimesh_normals(mesh: Any) -> Any:
    """The vertex normals that a mesh of trimesh was given; None without.

    The attribute `vertex_normals` makes up normals; the cache has them only where they were given (trimesh's own
    exporters ask so).
    """
    return mesh.vertex_normals if "vertex_normals" in _of("trimesh", mesh, "_cache") else None


def given_trimesh_lights(scene: Any) -> Any:
    """The lights that a `trimesh.Scene` was given; None without, where the attribute `lights` makes some up."""
    # It is there once lights were given, so that its absence says nothing: the test of this module asks for it.
    return getattr(scene, "_lights", None)


def is_xfail(item: Any) -> bool:
    """Whether a marker xfail holds for a test, as pytest itself sees it."""
    evaluate = _attribute("pytest", "_pytest.skipping", "evaluate_xfail_marks")
    return not item.config.getoption("runxfail", False) and evaluate(item) is not None


def rfb_page() -> tuple[str, str]:
    """JavaScript and CSS of a remote frame buffer in a notebook, which ours are added to."""
    buffer = _attribute("jupyter_rfb", "jupyter_rfb", "RemoteFrameBuffer")
    return _of("jupyter_rfb", buffer, "_esm"), _of("jupyter_rfb", buffer, "_css")


def _module(package: str, name: str) -> Any:
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name == package:  # not installed at all: the caller says what brings it
            raise
        raise _changed(package, f"module {name}") from error


def _attribute(package: str, module: str, name: str) -> Any:
    return _of(package, _module(package, module), name)


def _of(package: str, owner: Any, name: str) -> Any:
    try:
        return getattr(owner, name)
    except AttributeError as error:
        kind = owner.__name__ if hasattr(owner, "__name__") else type(owner).__name__
        raise _changed(package, f"{kind}.{name}") from error


def _changed(package: str, what: str) -> GlpathError:
    from importlib.metadata import PackageNotFoundError, version

    seen = SEEN[package]
    try:
        found = version(package)
    except PackageNotFoundError:
        found = "of an unknown version"
    return GlpathError(
        f"{package} {found} has no {what}, which glpath uses; releases {seen.first} to {seen.last} have it.",
        f'pip install "{package}~={seen.last}.0", or a newer glpath.',
    )
