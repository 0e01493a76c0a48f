"""Private interfaces of other packages: all uses in one module, with the releases that were tested.

The packages have no public interface for the same purpose. A release may change a private interface without notice.
Then the function here raises GlpathError with the package, its version and the missing name, and this module's test
fails. `pyproject.toml` requires the releases of `SEEN`. It also has an upper bound for numba, because no kernel can
be compiled without numba's internals.

Cost:     none until a function is called; each function imports only its own package.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from glpath.errors import GlpathError, warning_filter


@dataclass(frozen=True)
class Releases:
    """First and last release of a package that were tested and have the private interfaces used here."""

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
    """Internals of numba that compile and cache kernels.

    function_cache : base class of one function's cache, with `_impl`, `_cache_path`, `_py_func`, `_index_key`
    dumps          : function that pickles compiled code
    compiler_lock  : lock of the compiler, which is not thread-safe
    event, types   : modules for listeners of compilations, and for types of signatures
    """

    function_cache: Any
    dumps: Any
    compiler_lock: Any
    event: Any
    types: Any


#: Undocumented options of `numba.njit`: no reference counts, no wrapper for C, no wrapper for Python.
NUMBA_OPTIONS = {"_nrt": False, "no_cfunc_wrapper": True}
NUMBA_WITHOUT_PYTHON = {"no_cpython_wrapper": True}


# File in the current folder from which numba reads settings, if PyYAML is installed.
_NUMBA_FILE = ".numba_config.yaml"
# Settings of numba that choose the folder of cached kernels.
_NUMBA_FOLDERS = ("CACHE_DIR", "CACHE_LOCATOR_CLASSES")


def import_numba() -> Any:
    """Import numba so that it ignores a settings file in the current folder, and return the package.

    Otherwise the author of that folder, such as an unpacked archive, could choose how code is compiled. If numba is
    imported already, its settings stay.
    """
    if "numba" in sys.modules or not os.path.exists(_NUMBA_FILE):
        return _module("numba", "numba")
    yaml = sys.modules.get("yaml")
    # Numba reads the file only if it can import this module.
    sys.modules["yaml"] = None  # type: ignore[assignment]
    try:
        with warning_filter("ignore", UserWarning):  # about the settings file
            package = _module("numba", "numba")
    finally:
        del sys.modules["yaml"]
        if yaml is not None:
            sys.modules["yaml"] = yaml
    config = _module("numba", "numba.core.config")
    _of("numba", config, "_config_fname")
    config._config_fname = ""  # because each compilation looks for the settings file again
    return package


def import_matplotlib_with_defaults() -> None:
    """Import matplotlib so that it ignores MPLBACKEND and all settings files except its own defaults.

    Matplotlib would read `matplotlibrc` in the current folder first, even a file of another user. If matplotlib is
    imported already, its settings stay. Raises ImportError.
    """
    if "matplotlib" in sys.modules:
        return
    exists, backend = os.path.exists, os.environ.pop("MPLBACKEND", None)

    def exists_for_matplotlib(path: Any) -> bool:
        folder, name = os.path.split(os.fspath(path)) if isinstance(path, str | os.PathLike) else ("", "")
        ignored = name == "matplotlibrc" and os.path.basename(folder) != "mpl-data"
        return not ignored and exists(path)

    os.path.exists = exists_for_matplotlib
    try:
        import_module("matplotlib")
    finally:
        os.path.exists = exists
        if backend is not None:
            os.environ["MPLBACKEND"] = backend


@contextmanager
def numba_folders_of_environment() -> Iterator[None]:
    """Context in which only environment variables, and no settings file, choose the folder of cached kernels."""
    config = _module("numba", "numba.core.config")
    before = {name: getattr(config, name) for name in _NUMBA_FOLDERS if hasattr(config, name)}
    try:
        folder, locators = os.environ.get("NUMBA_CACHE_DIR", ""), os.environ.get("NUMBA_CACHE_LOCATOR_CLASSES", "")
        chosen = dict(zip(_NUMBA_FOLDERS, (folder, locators), strict=True))
        vars(config).update({name: chosen[name] for name in before})
        yield
    finally:
        vars(config).update(before)


def numba_internals() -> NumbaInternals:
    return NumbaInternals(
        _attribute("numba", "numba.core.caching", "FunctionCache"),
        _attribute("numba", "numba.core.serialize", "dumps"),
        _attribute("numba", "numba.core.compiler_lock", "global_compiler_lock"),
        _module("numba", "numba.core.event"),
        _module("numba", "numba.core.types"),
    )


def numba_cache(dispatcher: Any) -> Any:
    """Return the cache of a compiled function. Numba's default cache stores nothing."""
    return _of("numba", dispatcher, "_cache")


def set_numba_cache(dispatcher: Any, cache: Any) -> None:
    numba_cache(dispatcher)  # raises if there is no `_cache`, because numba would then never use the new cache
    dispatcher._cache = cache


def given_trimesh_normals(mesh: Any) -> Any:
    """Return the vertex normals that a trimesh mesh was given; None if it was given none.

    The attribute `vertex_normals` computes missing normals. So the mesh's cache is tested first, which has normals
    only if they were given. Trimesh's own exporters use the same test.
    """
    return mesh.vertex_normals if "vertex_normals" in _of("trimesh", mesh, "_cache") else None


def given_trimesh_lights(scene: Any) -> Any:
    """Return the lights that a `trimesh.Scene` was given, or None. Its property `lights` would create lights."""
    # The attribute exists only if lights were given, so its absence is no error. This module's test checks for it.
    return getattr(scene, "_lights", None)


def is_xfail(item: Any) -> bool:
    """Return True if pytest expects a test to fail: a marker xfail applies, and `--runxfail` is not given."""
    evaluate = _attribute("pytest", "_pytest.skipping", "evaluate_xfail_marks")
    return not item.config.getoption("runxfail", False) and evaluate(item) is not None


def rfb_page() -> tuple[str, str]:
    """Return the JavaScript and CSS of jupyter_rfb's remote frame buffer; glpath adds its own code to them."""
    buffer = _attribute("jupyter_rfb", "jupyter_rfb", "RemoteFrameBuffer")
    return _of("jupyter_rfb", buffer, "_esm"), _of("jupyter_rfb", buffer, "_css")


def _module(package: str, name: str) -> Any:
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name == package:  # the package is not installed; the caller reports how to install it
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
