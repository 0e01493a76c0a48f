"""Wrong arguments of public functions raise UsageError, which names the argument, before any work."""

from __future__ import annotations

import functools
import inspect
import os
import pickle
import time
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

import glpath
from glpath.compare import relative_mse
from glpath.errors import GlpathError, UsageError
from glpath.rendering import run_options
from glpath.rendering.options import numbers, options
from glpath.rendering.points import Irradiance
from glpath.scene import Scene
from glpath.scene.source_location import shown
from glpath.system.arguments import checked, short_repr, types_of

# Integer that Python refuses to write in decimal.
HUGE = 10**5000
BOX = "cornell-box-36"
POSE = np.eye(4)
K = [[60.0, 0.0, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]]
HEIGHTS = np.zeros((4, 4))
FLOOR = [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]
POINT, UP = [[0.0, 0.0, 0.0]], [0.0, 1.0, 0.0]
WORDS = np.array(["a", "b"])


# Function, positional arguments that are right, and a wrong value of each keyword argument.
Case = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]
CASES: list[Case] = [
    (glpath.render, (BOX,), {name: HUGE for name in ("spp", "first_path_set", "device", "threads", "time_limit")}),
    (glpath.render, (BOX,), {name: HUGE for name in ("noise", "clean", "seed", "max_depth", "lookup_depth")}),
    (glpath.render, (BOX,), {"resolution": (HUGE, 8), "crop": (0, 0, HUGE, 1), "camera": {"fov": HUGE}}),
    (glpath.render, (BOX,), {"parameters": {"a": HUGE}, "ambient": HUGE, "progress": HUGE, "integrator": HUGE}),
    (glpath.render, (BOX,), {"film": "prev.npz", "on_step": 1, "on_progress": True, "strict": "no"}),
    (glpath.render, (BOX,), {name: WORDS for name in ("device", "backend", "integrator", "sampling", "guide")}),
    (glpath.render, (BOX,), {"parameters": {1: 2}, "timings": "yes", "require_gpu": WORDS, "cluster": 5}),
    (glpath.render_frames, (BOX,), {"frames": None, "spp": HUGE}),
    (glpath.render_views, (BOX, POSE, K), {"resolution": 64, "spp": HUGE, "convention": WORDS}),
    (glpath.irradiance, (BOX, POINT, UP), {"maintenance_factor": "0.8", "film": "prev.npz", "receiver": WORDS}),
    (glpath.irradiance, (BOX,), {"points": [[HUGE, 0, 0]], "normals": "up"}),
    (glpath.probes, (BOX,), {"grid": [[1, 2], [3]], "bounds": [[1, 2], [3]], "film": "prev.npz", "spp": HUGE}),
    (glpath.lightmap, (BOX,), {"uv": WORDS, "denoise": WORDS, "size": HUGE, "texels": HUGE}),
    (glpath.lightmap, (BOX,), {"denoise": "x"}),
    (glpath.load_scene, (), {"scene": {"name": HUGE}}),
    (glpath.load_scene, (BOX,), {"parameters": {1: 2}}),
    (glpath.load_scene, (BOX,), {"parameters": [("a", 1)]}),
    (glpath.export, (BOX,), {"path": None}),
    (glpath.export, (BOX,), {"path": b"a.glb"}),
    (glpath.export, (BOX, "a.xml"), {"spp": HUGE, "parameters": {1: 2}}),
    (glpath.element_error, (BOX,), {"spp": HUGE, "lookup_depth": HUGE}),
    (glpath.solve_radiosity, (BOX,), {"unshot": "0.1", "threshold": True, "patches": True, "checkpoint": True}),
    (glpath.solve_radiosity, (BOX,), {"unshot": True, "shafts": True, "overshoot": b"x", "ambient": b"x"}),
    (glpath.solve_radiosity, (BOX,), {"overshoot": "no", "method": WORDS, "form_factors": WORDS, "for_camera": 1}),
    (
        glpath.solve_radiosity,
        (BOX,),
        {
            name: HUGE
            for name in (
                "patches",
                "size",
                "splits",
                "adaptive",
                "threshold",
                "unshot",
                "max_steps",
                "emitter_samples",
                "receiver_points",
                "particles",
                "seed",
                "time_limit",
            )
        },
    ),
    (glpath.solve_radiosity, (BOX,), {"on_progress": True, "emitter_samples": True, "receiver_points": True}),
    (glpath.view_factors, (FLOOR,), {"error": HUGE, "threads": HUGE, "on_progress": True, "flip": "x"}),
    (glpath.view_factors, (FLOOR,), {"resume": "a\0b", "enforce": [3], "flip": WORDS}),
    (
        glpath.daylight_coefficients,
        (BOX, POINT, UP),
        {"latitude": "50", "suns": "600", "subdivision": [], "resume": "a\0b", "on_progress": True, "device": "0"},
    ),
    (
        glpath.daylight_coefficients,
        (BOX, POINT, UP),
        {name: HUGE for name in ("latitude", "suns", "subdivision", "samples", "max_depth", "elements", "seed")},
    ),
    (glpath.daylight_coefficients, (BOX, POINT, UP), {"suns": 1.5, "shard": 3, "cluster": 5, "receiver": WORDS}),
    (glpath.horizon, (HEIGHTS,), {"height": "2", "on_progress": True, "azimuths": HUGE, "holes": "x"}),
    (glpath.horizon, (HEIGHTS,), {"height": HUGE, "spacing": HUGE, "points": [[HUGE, 0]]}),
    (glpath.load_height_field, (HEIGHTS,), {"origin": 5, "holes": "x", "spacing": HUGE}),
    (glpath.texels, (BOX, 100.0), {"shapes": 3}),
    (glpath.texels, (BOX,), {"size": HUGE}),
    (glpath.camera, (POSE, K), {"resolution": 64, "convention": WORDS}),
    (glpath.camera, (POSE,), {"K": [[HUGE]]}),
    (glpath.relative_mse, (np.ones((2, 2, 3)), np.ones((2, 2, 3))), {"epsilon": -1}),
    (glpath.relative_mse, (np.ones((2, 2, 3)), np.ones((2, 2, 3))), {"epsilon": float("nan")}),
    (glpath.relative_mse, (np.ones((2, 2, 3)), np.ones((2, 2, 3))), {"epsilon": HUGE}),
    (glpath.read_image, (), {"path": None}),
    (glpath.read_image, (), {"path": b"a.png"}),
    (glpath.load_point_cloud, (), {"path": None}),
    (glpath.load_point_cloud, ("a.laz",), {"classes": 5}),
    (glpath.Film.save, (None,), {"path": None}),
    (glpath.Film.save, (None,), {"path": b"a.png"}),
    (glpath.Film.save, (None,), {"path": "a\0.png"}),
    (glpath.Film.save, (None, "a.png"), {"exposure": HUGE, "denoise": 1}),
    (glpath.Film.load, (), {"path": None}),
    (glpath.RadiositySolution.load, (), {"path": None, "scene": 3}),
]
EACH = [
    pytest.param(function, given, name, value, id=f"{function.__qualname__}-{name}-{short_repr(value)[:30]}")
    for function, given, wrong in CASES
    for name, value in wrong.items()
]


@pytest.mark.parametrize(("function", "given", "name", "value"), EACH)
def test_a_wrong_argument_is_refused_with_its_name(
    function: Callable[..., Any], given: tuple[Any, ...], name: str, value: Any
) -> None:
    with pytest.raises(UsageError, match=rf"\b{name}\b"):
        function(*given, **{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("coefficients", 3), ("weather", None), ("weather", b"a.epw"), ("occupied", "8-18"), ("occupied", 8),
        ("occupied", (8, HUGE)), ("blinds", 3), ("threshold", "300"), ("threshold", HUGE), ("ground", "0.2"),
    ],
    ids=short_repr,
)  # fmt: skip
def test_a_year_of_daylight_refuses_wrong_arguments(name: str, value: Any) -> None:
    coefficients = object.__new__(glpath.DaylightCoefficients)
    with pytest.raises(UsageError, match=rf"^{name}\b"):
        glpath.daylight_year(**{"coefficients": coefficients, "weather": "a.epw", name: value})


def test_sensor_points_need_a_path() -> None:
    from glpath.io.honeybee import sensor_points

    with pytest.raises(UsageError, match="path"):
        sensor_points(3, "desk")  # type: ignore[arg-type]


def test_a_large_integer_is_described_by_its_digits() -> None:
    with pytest.raises(UsageError, match=r"^spp: an integer of 5,001 digits where"):
        glpath.render(BOX, spp=HUGE)


@pytest.mark.parametrize(
    "nested",
    [[[HUGE]], {"a": [{"b": (1, HUGE)}]}, {HUGE: 1}, np.array([HUGE], object), {HUGE}],
    ids=["lists", "dictionaries", "key", "array", "set"],
)
def test_large_integers_are_found_within_other_values(nested: Any) -> None:
    with pytest.raises(UsageError, match="scene: an integer of 5,001 digits"):
        glpath.load_scene(nested)


def test_lists_that_contain_themselves_end_the_search() -> None:
    endless: list[Any] = [1]
    endless.append(endless)
    with pytest.raises(GlpathError):
        glpath.load_scene(endless)  # type: ignore[arg-type]


def test_a_film_in_place_of_its_file_is_the_remedy() -> None:
    with pytest.raises(UsageError, match=r"film: 'prev.npz' where a Film or None is needed\n  glpath.Film.load"):
        glpath.render(BOX, film="prev.npz")  # type: ignore[arg-type]


def _public() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield each public function, method and class method, with its name."""
    for name in glpath.__all__:
        found = getattr(glpath, name)
        if inspect.isfunction(found):
            yield name, found
        elif inspect.isclass(found) and not issubclass(found, BaseException):
            for method in dir(found):
                member = inspect.getattr_static(found, method)
                member = getattr(member, "__func__", member)
                if not method.startswith("_") and inspect.isfunction(member):
                    yield f"{name}.{method}", member


def _complete(result: Any) -> None:
    """Render frames, which a generator renders one by one."""
    list(result if inspect.isgenerator(result) else ())


@pytest.mark.parametrize("name", [name for name, _ in _public()])
def test_each_parameter_refuses_an_object_of_another_type(name: str) -> None:
    function = dict(_public())[name]
    right: dict[str, Any] = {
        "points": POINT,
        "normals": UP,
        "scene": BOX,
        "size": 100.0,
        "faces": FLOOR,
        "pose": POSE,
    }
    right |= {"K": K, "poses": POSE, "frames": [], "image": np.ones((2, 2, 3)), "field": HEIGHTS, "path": "a.none"}
    right["reference"] = right["image"]
    for parameter in list(inspect.signature(function).parameters.values()):
        if parameter.name in ("self", "cls") or parameter.annotation in ("object", "Any"):
            continue
        if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            continue
        if parameter.name in options() and name != "render":
            continue  # all functions share these checks, but some functions work for seconds before
        needed = [p for p in inspect.signature(function).parameters.values() if p.default is p.empty]
        given = {p.name: right.get(p.name) for p in needed if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)}
        with pytest.raises(GlpathError):
            _complete(function(**{**given, parameter.name: object()}))


def test_names_in_annotations_have_values_or_are_classes() -> None:
    """A name that only type checkers import is taken for a class, so it must not be the name of a union."""
    unknown = set()
    for _, function in _public():
        names = ChainMap(inspect.unwrap(function).__globals__, vars(run_options))
        for parameter in inspect.signature(function).parameters.values():
            for each in types_of(parameter.annotation, names) or ():
                unknown.update({each.needed} if isinstance(each.accepts, functools.partial) else ())
    assert unknown <= {
        "a Film",
        "a Connection",
        "a Weather",
        "a Material",
        "a Camera",
        "a Scene",
        "a ParticleSurfaces",
    }


def test_numpy_scalars_and_numbers_of_other_types_are_allowed() -> None:
    seen = {}

    @checked
    def call(count: int, size: float, flag: bool, pair: tuple[int, int] | None = None) -> None:
        seen.update(locals())

    call(np.int64(3), np.float32(2), np.bool_(True), pair=np.array([1, 2]))  # type: ignore[arg-type]
    assert type(seen["count"]) is int
    assert seen["flag"] is True
    assert type(seen["size"]) is float
    call(3, Fraction(1, 2), False, pair=[64.0, 64.0])  # type: ignore[arg-type]
    for wrong in (np.array(3), True, 3.0, "3"):
        with pytest.raises(UsageError, match=r"^count"):
            call(wrong, 1.0, True)  # type: ignore[arg-type]


def test_a_solver_takes_integers_of_numpy() -> None:
    counts = {name: np.int64(1) for name in ("max_steps", "particles")}
    options: dict[str, Any] = {"patches": np.int64(12), "seed": np.int64(3), "splits": np.int64(0), **counts}
    ours = glpath.solve_radiosity(BOX, **options)
    plain = glpath.solve_radiosity(BOX, **{name: int(value) for name, value in options.items()})
    assert ours.settings == plain.settings
    assert np.array_equal(ours.elements, plain.elements)


def test_checked_functions_keep_name_text_and_signature() -> None:
    assert pickle.loads(pickle.dumps(glpath.camera)) is glpath.camera
    assert (glpath.camera.__name__, glpath.camera.__module__) == ("camera", "glpath.scene.camera_matrices")
    assert list(inspect.signature(glpath.camera).parameters) == ["pose", "K", "resolution", "convention"]
    assert (inspect.getdoc(Scene.at) or "").strip()
    assert inspect.ismethod(glpath.Film.load)
    assert inspect.getdoc(Irradiance.spread)


@pytest.mark.timed
def test_the_checks_take_less_than_20_microseconds() -> None:
    @checked
    def call(scene: Any, points: list[float], spp: int = 1, size: float = 1.0, path: str | Path = "a") -> None:
        pass

    call(BOX, [1.0])
    best = 1.0
    for _ in range(20):
        start = time.process_time()
        for _ in range(1000):
            call(BOX, [1.0, 2.0, 3.0], spp=4, size=2.0, path="film.npz")
        best = min(best, (time.process_time() - start) / 1000)
    assert best < 20e-6


class Broken:
    """Object that cannot be written as text."""

    def __repr__(self) -> str:
        raise RuntimeError("no text")


class BrokenPath(os.PathLike[str]):
    """Path without a text."""

    def __fspath__(self) -> str:
        raise RuntimeError("no text")


RECURSIVE: list[Any] = []
RECURSIVE.append(RECURSIVE)
DEEP = functools.reduce(lambda inside, _: [inside], range(3000), [])
VAST, LONG = Fraction(10**400, 3), 100_000 * "x"
BLACK = np.zeros((2, 2, 3))
CALLS: dict[str, Callable[[], Any]] = {
    "parameter with a surrogate": lambda: glpath.load_scene("teapot", {"level": "\udc80"}),
    "scene with a surrogate": lambda: glpath.load_scene({"unit": "\udc80"}),
    "name with a surrogate": lambda: glpath.load_scene("\udc80"),
    "background with a surrogate": lambda: glpath.load_scene(BOX, {"background": "\udc80"}),
    "list that contains itself": lambda: glpath.load_scene("teapot", {"level": RECURSIVE}),
    "deep option": lambda: glpath.render(BOX, integrator="classic", shadow_resolution=DEEP),
    "deep frames": lambda: list(glpath.render_frames(BOX, DEEP)),
    "option without a text": lambda: glpath.render(BOX, integrator="classic", shadow_resolution=Broken()),
    "frame without a text": lambda: list(glpath.render_frames(BOX, [Broken()])),
    "array of shadows": lambda: glpath.render(BOX, integrator="classic", shadows=WORDS, shadow_resolution=64),
    "array of rules": lambda: glpath.view_factors(FLOOR, enforce=WORDS),
    "array without axes as frames": lambda: list(glpath.render_frames(BOX, np.array(5))),
    "vast texel": lambda: glpath.texels(BOX, 1e200),
    "tiny texel": lambda: glpath.texels(BOX, 1e-200),
    "vast pose": lambda: glpath.camera(VAST, K),
    "vast poses": lambda: list(glpath.render_views(BOX, np.array([VAST]), K)),
    "vast points": lambda: glpath.irradiance(BOX, VAST, UP),
    "vast factor": lambda: glpath.irradiance(BOX, POINT, [UP], maintenance_factor=VAST),
    "vast heights": lambda: glpath.load_height_field(np.full((2, 2), VAST)),
    "vast origin": lambda: glpath.load_height_field(HEIGHTS, origin=(VAST, 0)),
    "duration as groups": lambda: glpath.view_factors(FLOOR, groups=np.timedelta64(3, "s")),
    "vast epsilon": lambda: relative_mse(BLACK, BLACK, VAST),
    "image of objects": lambda: relative_mse(np.array([None, 1, "x"], dtype=object), BLACK),
    "relative error of zeros": lambda: relative_mse(BLACK, BLACK, 0),
    "long backend": lambda: glpath.render(BOX, backend=LONG),
    "long convention": lambda: glpath.camera(POSE, K, convention=LONG),
    "long rule": lambda: glpath.view_factors(FLOOR, enforce=[LONG]),
    "long groups": lambda: glpath.view_factors(FLOOR, groups=LONG),
    "long pattern": lambda: glpath.texels(BOX, 1.0, shapes=LONG),
    "long option": lambda: glpath.render(BOX, **{LONG: 1}),
    "cast without a text": lambda: glpath.render(BOX, cast=Broken()),  # type: ignore[arg-type]
    "key without a text": lambda: glpath.load_scene({Broken(): 1}),  # type: ignore[dict-item]
    "camera that is a range": lambda: glpath.load_scene({"camera": range(3)}),
    "path with a lone surrogate": lambda: glpath.read_image("\ud800"),
    "path without a text": lambda: glpath.read_image(BrokenPath()),  # type: ignore[arg-type]
    "long parameter": lambda: glpath.load_scene("teapot", {LONG: 1}),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.filterwarnings("error")
def test_an_unusual_value_is_an_error_with_a_short_text_in_utf_8(call: str) -> None:
    with pytest.raises(GlpathError) as error:
        CALLS[call]()
    assert len(str(error.value).encode()) < 1500


def test_text_with_a_surrogate_is_located_in_the_scene() -> None:
    with pytest.raises(GlpathError, match=r'^scene\["materials"\]\["a"\]\["type"\] has text with a lone surrogate'):
        glpath.load_scene({"materials": {"a": {"type": "\udc80"}}, "name": "a"})


def test_a_real_number_of_another_type_is_passed_on_as_a_float() -> None:
    assert glpath.load_height_field(HEIGHTS, spacing=np.float32(2)).spacing == (2.0, 2.0)
    assert checked(_identity)(Fraction(1, 4)) == 0.25
    assert type(checked(_identity)(np.float32(0.5))) is float


SECOND = np.timedelta64(1, "s")
DURATIONS: dict[str, Callable[[Any], Any]] = {
    "epsilon": lambda value: relative_mse(np.ones((2, 2, 3)), np.ones((2, 2, 3)), value),
    "image": lambda value: relative_mse(np.full((2, 2, 3), value), np.ones((2, 2, 3))),
    "height": lambda value: glpath.horizon(HEIGHTS, height=value),
    "size": lambda value: glpath.texels(BOX, value),
    "latitude": lambda value: glpath.daylight_coefficients(BOX, POINT, [UP], latitude=value),
    "up": lambda value: glpath.daylight_coefficients(BOX, POINT, [UP], up=[value] * 3),
    "threshold": lambda value: glpath.solve_radiosity(BOX, threshold=value),
    "seed": lambda value: glpath.render(BOX, seed=value),
    "spp": lambda value: glpath.render(BOX, spp=value),
}


@pytest.mark.parametrize("name", DURATIONS)
def test_a_duration_of_numpy_is_not_a_number(name: str) -> None:
    with pytest.raises(UsageError, match=rf"^{name}\b"):
        DURATIONS[name](SECOND)


def test_complex_numbers_are_not_an_array_of_numbers() -> None:
    with pytest.raises(UsageError, match=r"^points: .*an array of numbers is needed"):
        glpath.irradiance(BOX, [[1j, 0, 0]], [UP])  # type: ignore[list-item]


def test_the_text_of_a_value_that_cannot_be_written_names_its_type() -> None:
    def no_length(_: object) -> int:
        raise RuntimeError("no length")

    unlisted = type("list", (list,), {"__len__": no_length})  # reprlib takes a type of this name for a list
    assert "Broken" in short_repr(Broken())
    assert "Broken" in short_repr([Broken()])
    assert short_repr(unlisted([1])) == "an object of the type list"


def _no_text(*_: object) -> str:
    raise RuntimeError("no text")


_TEXTS = dict.fromkeys(("__repr__", "__str__", "__format__"), _no_text)
_METACLASS = type("Metaclass", (type,), {"__name__": property(_no_text), "__repr__": _no_text})
#: Objects that raise an error when they are written or examined, by the annotation of an argument.
TEXTLESS: dict[str, Callable[[], Any]] = {
    "number": lambda: type("Number", (int,), _TEXTS)(77),
    "negative number": lambda: type("Number", (int,), _TEXTS)(-3),
    "fraction": lambda: type("Number", (float,), _TEXTS)(0.5),
    "text": lambda: type("Text", (str,), _TEXTS)("eglx"),
    "object": lambda: type("Thing", (), _TEXTS)(),
    "text that is no text": lambda: type("Thing", (), {"__repr__": lambda _: 3})(),
    "class without a name": lambda: _METACLASS("Thing", (), {})(),
    "class that cannot be read": lambda: type("Thing", (), {"__class__": property(_no_text)})(),
}


@pytest.mark.parametrize("value", TEXTLESS)
@pytest.mark.parametrize("name", ["device", "backend", "require_gpu"])
def test_a_context_refuses_values_without_a_text(name: str, value: str) -> None:
    from glpath.gl.context import open_context

    with pytest.raises(GlpathError) as error:
        open_context(**{"backend": "osmesa" if name == "device" else "auto", name: TEXTLESS[value]()})
    assert len(str(error.value)) < 500


def test_an_object_of_a_subclass_is_passed_on_as_its_base_class() -> None:
    @checked
    def call(count: int, size: float, name: str, path: str | Path) -> tuple[type, ...]:
        return type(count), type(size), type(name), type(path)

    number, size, text = (type("Sub", (base,), _TEXTS) for base in (int, float, str))
    assert call(number(3), size(0.5), text("a"), text("b")) == (int, float, str, str)
    assert call(number(3), number(3), text("a"), Path("b")) == (int, int, str, type(Path("b")))


@pytest.mark.parametrize("value", TEXTLESS)
def test_a_value_without_a_text_is_shown_by_its_type(value: str) -> None:
    assert len(shown({"a": [TEXTLESS[value]()]})) < 100
    assert len(short_repr([TEXTLESS[value]()])) < 100
    if value != "class that cannot be read":
        with pytest.raises(GlpathError):
            glpath.load_scene({"camera": {"fov": TEXTLESS[value](), "position": 3}})


@pytest.mark.parametrize(
    "value",
    [
        SECOND, np.datetime64("2026-01-01"), [SECOND], np.array(SECOND), np.array([SECOND], object),
        np.array([np.datetime64("2026-01-01")], object), ["3"], np.array(["3"], object), b"3", None, 1j,
    ],
    ids=short_repr,
)  # fmt: skip
def test_an_option_refuses_durations_dates_and_texts_as_numbers(value: Any) -> None:
    with pytest.raises(UsageError, match=r"^noise: .* where a finite number is needed"):
        numbers("noise", value, 1)
    if value is not None and value != b"3":
        with pytest.raises(UsageError, match=r"^(noise|points): "):
            glpath.irradiance(BOX, [[value, 0, 0]], [UP])  # type: ignore[list-item]


def test_an_option_takes_numbers_of_all_kinds() -> None:
    for value in (3, 3.0, [3], (np.float32(3),), np.int8(3), Fraction(3), np.array([Fraction(3)]), range(3, 4)):
        assert numbers("noise", value, 1).tolist() == [3.0]


def _identity(value: float) -> float:
    return value


class RaisingPath(os.PathLike[str]):
    def __init__(self, text: Any) -> None:
        self.text = text

    def __fspath__(self) -> str:
        if self.text is None:
            raise ValueError("no text")
        return self.text


class RaisingMapping(dict[str, Any]):
    def keys(self) -> Any:
        raise RuntimeError("no keys")

    __iter__ = items = keys


class RaisingArray:
    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("no array")


class Convertible:
    def __array__(self, *_: Any, **__: Any) -> Any:
        return np.arange(3)


class RaisingAttributes:
    def __getattr__(self, name: str) -> Any:
        raise RuntimeError(name)


RAISING: dict[str, Callable[[], Any]] = {
    "scene path": lambda: glpath.load_scene(RaisingPath(None)),  # type: ignore[arg-type]
    "scene path that is a number": lambda: glpath.load_scene(RaisingPath(3)),  # type: ignore[arg-type]
    "faces": lambda: glpath.view_factors(RaisingPath(None)),
    "scene": lambda: glpath.load_scene(RaisingMapping(a=1)),
    "parameters": lambda: glpath.load_scene("teapot", RaisingMapping(level=1)),
    "camera": lambda: glpath.render(BOX, camera=RaisingMapping(fov=9)),
    "pose": lambda: glpath.camera(RaisingArray(), K),  # type: ignore[arg-type]
    "K": lambda: glpath.camera(POSE, RaisingAttributes()),  # type: ignore[arg-type]
    "points": lambda: glpath.horizon(HEIGHTS, RaisingArray()),  # type: ignore[arg-type]
    "groups": lambda: glpath.view_factors(FLOOR, groups=RaisingAttributes()),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("call", RAISING)
def test_an_argument_whose_methods_raise_is_refused_with_the_error(call: str) -> None:
    with pytest.raises(UsageError, match=r"\n  A method of the Raising\w+ raised (Value|Type|Runtime)Error"):
        RAISING[call]()


def test_arguments_of_other_types_are_passed_on_as_built_in_ones() -> None:
    seen: dict[str, Any] = {}

    @checked
    def call(path: str | Path, table: Mapping[str, int], numbers: ArrayLike, pair: tuple[float, float]) -> None:
        seen.update(locals())

    call(RaisingPath("a"), ChainMap({"a": 1}), Convertible(), [Fraction(1, 2), 2])  # type: ignore[arg-type]
    assert (seen["path"], seen["table"], seen["pair"]) == ("a", {"a": 1}, (0.5, 2))
    assert isinstance(seen["numbers"], np.ndarray)
    memory = np.arange(3)
    call("a", {}, memory, (1.0, 2.0))
    assert seen["numbers"] is memory


# Arrays of 10^12 rows without memory of their own.
LINE, WIDE = np.broadcast_to(np.float32(1), 10**12), np.broadcast_to(np.float32(1), (10**12, 3))
LARGE: dict[str, Callable[[], Any]] = {
    "pose": lambda: glpath.camera(WIDE, K),
    "poses": lambda: list(glpath.render_views(BOX, WIDE, K)),
    "K": lambda: glpath.camera(POSE, WIDE),
    "image": lambda: relative_mse(WIDE, WIDE),
    "heights": lambda: glpath.load_height_field(LINE),
    "horizon points": lambda: glpath.horizon(HEIGHTS, LINE),
    "normals": lambda: glpath.horizon(HEIGHTS, None, WIDE),
    "suns": lambda: glpath.horizon(HEIGHTS).sun_hours(WIDE, [1.0]),
    "energy": lambda: glpath.horizon(HEIGHTS).direct_irradiation([1.0], [1.0], WIDE),
    "heights at": lambda: glpath.load_height_field(HEIGHTS).heights_at(LINE),
    "normals at": lambda: glpath.load_height_field(HEIGHTS).normals_at(LINE),
    "position": lambda: glpath.load_scene(BOX).with_camera(position=WIDE),
    "pixels": lambda: glpath.load_scene(BOX).camera.rays(LINE),
    "points": lambda: glpath.irradiance(BOX, LINE, UP),
}


@pytest.mark.parametrize("call", LARGE)
def test_the_shape_of_a_large_array_is_checked_before_it_is_copied(call: str) -> None:
    with pytest.raises(GlpathError, match=r"shape|three numbers"):
        LARGE[call]()


def test_an_array_too_large_for_memory_is_an_error() -> None:
    for call in (lambda: glpath.horizon(HEIGHTS, WIDE), lambda: glpath.load_height_field(WIDE)):
        with pytest.raises(GlpathError, match="not fit into memory"):
            call()


MASKED = np.ma.masked_array(np.ones((2, 2, 3)), mask=True)
MASKS: dict[str, Callable[[], Any]] = {
    "points": lambda: glpath.horizon(HEIGHTS, MASKED[0]),
    "normals": lambda: glpath.horizon(HEIGHTS, None, MASKED[0, 0]),
    "image": lambda: relative_mse(MASKED, BLACK),
    "groups": lambda: glpath.view_factors(FLOOR, groups=MASKED[0, 0, :1]),
}


@pytest.mark.parametrize("name", MASKS)
def test_masked_values_are_not_numbers(name: str) -> None:
    with pytest.raises(UsageError, match=rf"^{name}\b[^\n]*\n  Masked values are no numbers"):
        MASKS[name]()
    filled = np.ma.masked_array(np.ones((2, 2, 3)), mask=False)
    assert relative_mse(filled, filled) == 0
