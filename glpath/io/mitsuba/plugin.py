"""Parameters of a plugin, with types and locations: parameters are read by name, and unread ones are refused."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from glpath.io.mitsuba.document import Document, Element
from glpath.io.mitsuba.spectra import colour_of_black_body, colour_of_spectrum
from glpath.io.values import LARGEST
from glpath.scene.geometry import Float64
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.files import read_bytes
from glpath.system.numerals import real
from glpath.system.suggestions import similar_names

#: Tags of elements that are plugins.
PLUGINS = (
    "bsdf",
    "texture",
    "emitter",
    "shape",
    "medium",
    "phase",
    "sensor",
    "film",
    "sampler",
    "rfilter",
    "integrator",
)
#: Linear Rec. 709 of light with energy 1 at all wavelengths. A light's `<spectrum>` with one number multiplies it.
EQUAL_ENERGY = np.array([1.204795, 0.948289, 0.908916])
#: Allowed types of a `<spectrum>`.
_SPECTRA = dict.fromkeys(("d65", "blackbody", "uniform", "srgb", "regular", "irregular"))
_PROPERTIES = ("float", "integer", "boolean", "string", "rgb", "spectrum", "point", "vector", "transform")


class Plugin:
    """Plugin whose parameters are read by name; `check_all_read` refuses the others."""

    def __init__(self, element: Element, document: Document, depth: int = 0) -> None:
        self.element, self.document, self._depth = element, document, depth
        document.count_plugin(element)
        self.kind = element.attribute("type")
        self.location: SourceLocation = element.location
        self._properties: dict[str, Element] = {}
        self._nested: list[tuple[str, Element]] = []
        self._asked: dict[str, None] = {}
        for child in element.children:
            resolved = document.resolved(child, depth)
            if child.tag == "ref" and resolved.tag == "spectrum":
                self._properties[child.attribute("name")] = resolved
            elif child.tag == "ref" or child.tag in PLUGINS:
                self._nested.append((child.name, resolved))
            elif child.tag in _PROPERTIES:
                name = child.attribute("name")
                if name in self._properties:
                    raise child.location.error(f"gives `{name}` a second time.", "Remove one of them.")
                self._properties[name] = child
            else:
                raise child.location.error(
                    f"is an element that is not read. Allowed: {', '.join((*_PROPERTIES, *PLUGINS, 'ref'))}."
                )

    @property
    def id(self) -> str:
        return self.element.attributes.get("id", "")

    def __contains__(self, name: str) -> bool:
        self._asked[name] = None
        return name in self._properties or any(each == name for each, _ in self._nested)

    def nested(self, tag: str, name: str = "") -> list[Plugin]:
        """Return the nested plugins with a tag, in order; if `name` is not empty, only those with that name."""
        found: list[Element] = []
        others: list[tuple[str, Element]] = []
        for each, element in self._nested:
            if element.tag == tag and (not name or each == name):
                found.append(element)
            else:
                others.append((each, element))
        self._nested = others
        return [Plugin(element, self.document, self._depth + 1) for element in found]

    def number(self, name: str, default: float, low: float = -LARGEST, high: float = LARGEST) -> float:
        """Return the number in parameter `name`; `default` if the parameter is missing.

        Raises SceneError for a number below `low` or above `high`.
        """
        child = self._take(name, ("float", "integer"))
        if child is None:
            return default
        (value,) = _numbers(child, "value", (1,))
        return _checked(value, child, low, high)

    def whole(self, name: str, default: int, low: int = 0) -> int:
        value = self.number(name, default, low)
        if value != int(value):
            raise self._properties[name].location.error(f"is {value:g}, but must be a whole number.")
        return int(value)

    def flag(self, name: str, default: bool) -> bool:
        child = self._take(name, ("boolean",))
        if child is None:
            return default
        value = child.attribute("value").lower()
        if value not in ("true", "false"):
            raise child.location.error(f"is {shown(value)}, but must be true or false.")
        return value == "true"

    def text(self, name: str, default: str = "", allowed: Sequence[str] = ()) -> str:
        child = self._take(name, ("string",))
        if child is None:
            return default
        value = child.attribute("value")
        if allowed and value not in allowed:
            raise child.location.error(f"is {shown(value)}, but must be one of: {', '.join(allowed)}.")
        return value

    def where(self, name: str) -> SourceLocation:
        """Return the location of parameter `name`; the plugin's location if the parameter is missing."""
        return self._properties[name].location if name in self._properties else self.location

    def kind_of(self, name: str) -> str:
        """Return the tag of property `name`; empty if the property is missing."""
        self._asked[name] = None
        return self._properties[name].tag if name in self._properties else ""

    def colour(self, name: str, default: float, *, light: bool = False) -> Float64:
        """Return the (3,) value of a colour parameter, linear Rec. 709; grey of value `default` if it is missing.

        Raises SceneError for a channel below 0.

        light : True for a light, False for a reflectance
        """
        child = self._take(name, ("rgb", "spectrum", "float"))
        if child is None:
            return np.full(3, default)
        own = child.attributes
        if child.tag == "spectrum" and ("type" in own or "filename" in own or ":" in own.get("value", "")):
            return self._colour_of_spectrum(child, light)
        if child.attributes.get("value", "").lstrip().startswith("#"):
            raise child.location.error("is of hexadecimal digits, but must be one or three numbers.")
        values = _numbers(child, "value", (1, 3) if child.tag == "rgb" else (1,))
        for value in values:
            _checked(value, child, 0.0, LARGEST)
        colour = np.array(np.broadcast_to(values, 3), np.float64)
        return colour * EQUAL_ENERGY if light and child.tag == "spectrum" else colour

    def _colour_of_spectrum(self, element: Element, light: bool) -> Float64:
        """Return the colour of a `<spectrum>`, which is read once for all references to it or to its file."""
        is_plugin = "type" in element.attributes
        colours = self.document.colours
        key: str | Element = element
        if not is_plugin and "filename" in element.attributes:
            key = os.path.realpath(element.file(element.attributes["filename"]))
        if (key, light) not in colours:
            colours[key, light] = (
                _spectrum_plugin(Plugin(element, self.document, self._depth + 1), light)
                if is_plugin
                else colour_of_spectrum(*_by_wavelengths(element), light=light)
            )
        return colours[key, light].copy()

    def share(self, name: str, default: float) -> Float64:
        """Return a colour as `colour` does.

        Raises SceneError for a channel above 1; a spectrum is clipped to 1 instead.
        """
        colour = self.colour(name, default)
        if self.kind_of(name) == "spectrum":
            return np.minimum(colour, 1.0)  # as in Mitsuba for colours outside the gamut
        if np.any(colour > 1):
            raise self.where(name).error(
                f"is {shown(colour)}, but must be between 0 and 1.", "A surface reflects at most what it receives."
            )
        return colour

    def fraction(self, name: str, default: float) -> float:
        """Return a number, or the mean of a colour, as in Mitsuba. Raises SceneError unless it is from 0 to 1."""
        if self.kind_of(name) in ("rgb", "spectrum"):
            return float(self.share(name, default).mean())
        return self.number(name, default, 0.0, 1.0)

    def texture(self, name: str) -> Plugin | None:
        """Return the texture of a parameter; None if it has no texture."""
        self._asked[name] = None
        found = self.nested("texture", name)
        return found[0] if found else None

    def numbers(self, name: str) -> list[float]:
        """Return the numbers of a text, separated by commas or spaces, at least one. Raises SceneError."""
        text = self.text(name)
        try:
            values = [real(word) for word in text.replace(",", " ").split()]
        except ValueError:
            values = []
        if not values:
            raise self.where(name).error(f"lacks numbers for `{name}`: {shown(text)}.")
        return values

    def vector(self, name: str, default: Sequence[float] | None = None) -> Float64:
        """Return the (3,) value of a point or vector parameter; without a default the parameter is required."""
        child = self._take(name, ("point", "vector"))
        if child is None:
            if default is None:
                raise self.location.error(f"lacks the parameter `{name}`, which must be there.")
            return np.array(default, np.float64)
        return _vector(child, 0.0)

    def transform(self, name: str) -> Float64:
        """Return the (4, 4) product of all steps for column vectors. Raises SceneError.

        The first step is applied first.
        """
        matrix = np.eye(4)
        for step in self._transform_steps(name):
            matrix = _step(step) @ matrix
        if not np.all(np.abs(matrix) <= LARGEST):
            raise self.where(name).error(f"reaches beyond {LARGEST:g} scene units.")
        stretch = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        if not stretch[2] > 1e-9 * stretch[0]:
            raise self.where(name).error("is singular: it flattens what it moves.", "Give no factor of zero.")
        return matrix

    def inverse_transform(self, name: str) -> Float64:
        """Return the (4, 4) inverse of `transform`, as Mitsuba computes it.

        Mitsuba inverts a rotation by transposing it, even if its axis is no unit vector.
        """
        matrix = np.eye(4)
        for step in self._transform_steps(name):
            moved = _step(step)
            matrix = matrix @ (moved.T if step.tag == "rotate" else np.linalg.inv(moved))
        return matrix

    def _transform_steps(self, name: str) -> Sequence[Element]:
        """Return the steps of a transform parameter, which count as parameters of the scene."""
        child = self._take(name, ("transform",))
        if child is None:
            return ()
        self.document.count_plugin(child)
        return child.children

    def refuse_unless(self, name: str, value: float, why: str) -> None:
        """Raise SceneError if a number is given that is not `value`, the only supported one."""
        if self.texture(name) is not None:
            raise self.location.error(f"has a texture for `{name}`, which is not read: {why}.", "Leave it out.")
        found = self.colour(name, value) if self.kind_of(name) in ("rgb", "spectrum") else self.number(name, value)
        if np.any(np.asarray(found) != value):
            raise self.where(name).error(
                f"is {shown(found)}, but only {value:g} is read: {why}.", "Leave it out, or take another plugin."
            )

    def check_all_read(self) -> None:
        """Raise SceneError for a parameter or nested plugin that was never read."""
        allowed = ", ".join(self._asked) or "none"
        for name, child in self._properties.items():
            if name not in self._asked:
                near = similar_names(name, self._asked, 1)
                raise child.location.error(
                    f"is a parameter that is not read of {shown(self.kind)}. Allowed: {allowed}.",
                    f"Did you mean `{near[0]}`?" if near else "Remove it where it does not change the picture.",
                )
        for name, element in self._nested:
            given = f" for `{name}`" if name else ""
            raise element.location.error(
                f"stands{given} in {shown(self.kind)}, which does not take it. Allowed: {allowed}."
            )

    def _take(self, name: str, tags: Sequence[str]) -> Element | None:
        self._asked[name] = None
        for each, element in self._nested:
            if each == name:
                raise element.location.error(
                    f"is {_an(element.tag)} for `{name}`, but it must be: {' or '.join(tags)}."
                )
        child = self._properties.get(name)
        if child is not None and child.tag not in tags:
            raise child.location.error(f"is {_an(child.tag)}, but must be: {' or '.join(tags)}.")
        return child


def _spectrum_plugin(plugin: Plugin, light: bool) -> Float64:
    """Return (3,) linear Rec. 709 of a `<spectrum type="...">`. Raises SceneError."""
    of_kind(plugin, _SPECTRA, "a spectrum")
    match plugin.kind:
        case "d65":
            colour = np.full(3, plugin.number("scale", 1.0, 0.0))
        case "uniform":
            colour = np.full(3, plugin.number("value", 1.0, 0.0))
        case "srgb":
            colour = plugin.colour("color", 0.0)
        case "blackbody":
            if not light:
                raise plugin.location.error("is a black body, which is the spectrum of a light only.")
            colour = colour_of_black_body(plugin.number("temperature", 5000.0, 1.0, 1e6))
        case "regular":
            values = plugin.numbers("values")
            first, last = plugin.number("wavelength_min", 360.0), plugin.number("wavelength_max", 830.0)
            wavelengths = np.linspace(first, last, len(values)).tolist()
            _check_wavelengths(wavelengths, values, plugin.location)
            colour = colour_of_spectrum(wavelengths, values, light=light)
        case _:
            wavelengths, values = plugin.numbers("wavelengths"), plugin.numbers("values")
            _check_wavelengths(wavelengths, values, plugin.location)
            colour = colour_of_spectrum(wavelengths, values, light=light)
    plugin.check_all_read()
    return colour


def _by_wavelengths(element: Element) -> tuple[list[float], list[float]]:
    """Return wavelengths in nm and values, from value="400:0.3, 500:0.7" or a file's lines. Raises SceneError."""
    if "filename" in element.attributes:
        path = element.file(element.attributes["filename"])
        try:
            lines = read_bytes(path).decode("utf-8-sig", errors="replace").splitlines()
        except OSError as error:
            raise element.location.error(f"names {path}, which cannot be read: {error.strerror}.") from error
        rows = [(f"line {number} of {path}", line) for number, line in enumerate(lines, start=1)]
        pairs = [
            (where, line.replace(",", " ").split()) for where, line in rows if line.strip()[:1] not in ("", "#")
        ]
    else:
        pairs = [("it", pair.split(":")) for pair in element.attribute("value").replace(",", " ").split()]
    wavelengths, values = [], []
    for where, words in pairs:
        try:
            wavelength, value = map(real, words)
        except ValueError as error:
            # A file is not quoted, because a scene may name any file.
            fault = f"has {shown(' '.join(words))}" if where == "it" else "has no pair of numbers"
            raise element.location.error(
                f"is a spectrum that is not read: {where} {fault}. Allowed: pairs of a wavelength in nm and a "
                "value.",
                'For example value="400:0.3, 550:0.5, 700:0.4".',
            ) from error
        wavelengths.append(wavelength)
        values.append(value)
    if not pairs:
        raise element.location.error("has no pair of a wavelength in nm and a value.")
    _check_wavelengths(wavelengths, values, element.location)
    return wavelengths, values


def _check_wavelengths(wavelengths: Sequence[float], values: Sequence[float], location: SourceLocation) -> None:
    """Raise SceneError unless the wavelengths ascend and each has a value of at least 0."""
    if len(wavelengths) != len(values):
        raise location.error(f"has {len(wavelengths)} wavelengths, but {len(values)} values.")
    if not all(before < after for before, after in pairwise(wavelengths)):
        raise location.error("has wavelengths that do not ascend.", "Sort its pairs, each wavelength once.")
    for value in values:
        if not 0 <= value <= LARGEST:
            raise location.error(f"has the value {value:g}, but must have values of 0 or more.")


def _an(tag: str) -> str:
    return f"an <{tag}>" if tag[0] in "aeio" else f"a <{tag}>"


def _numbers(element: Element, attribute: str, counts: Sequence[int]) -> list[float]:
    """Return the numbers of an attribute, separated by commas or spaces. Raises SceneError."""
    text = element.attribute(attribute)
    try:
        values = [real(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise element.location.error(
            f"has {attribute}={shown(text)}, but must have {' or '.join(map(str, counts))} number(s)."
        ) from error
    if len(values) not in counts:
        raise element.location.error(
            f"has {len(values)} numbers, but must have {' or '.join(map(str, counts))}: {shown(text)}."
        )
    for value in values:
        _checked(value, element, -LARGEST, LARGEST)
    return values


def _checked(value: float, element: Element, low: float, high: float) -> float:
    if not low <= value <= high:
        allowed = f"at most {high:g}" if value > high else f"at least {low:g}"
        if high < LARGEST:
            allowed = f"between {low:g} and {high:g}"
        raise element.location.error(f"is {value:g}, but must be {allowed}.")
    return value


def _vector(element: Element, default: float) -> Float64:
    """Return (3,) from the attribute value="x, y, z", or from x, y and z; missing coordinates are `default`."""
    if "value" in element.attributes:
        return np.array(np.broadcast_to(_numbers(element, "value", (1, 3)), 3), np.float64)
    return np.array(
        [_numbers(element, axis, (1,))[0] if axis in element.attributes else default for axis in "xyz"], np.float64
    )


def _step(step: Element) -> Float64:
    """Return the (4, 4) matrix of one step of a transform."""
    made = _STEPS.get(step.tag)
    if made is None:
        raise step.location.error(f"is no step of a transform. Allowed: {', '.join(_STEPS)}.")
    return np.asarray(made(step))


def _translate(step: Element) -> Float64:
    matrix = np.eye(4)
    matrix[:3, 3] = _vector(step, 0.0)
    return matrix


def _scale(step: Element) -> Float64:
    return np.diag([*_vector(step, 1.0), 1.0])


def _rotate(step: Element) -> Float64:
    axis = _vector(step, 0.0)
    if not np.linalg.norm(axis) > 0:
        raise step.location.error("has an axis of length zero.", 'For example <rotate y="1" angle="30"/>.')
    (degrees,) = _numbers(step, "angle", (1,))
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    # Rodrigues' formula. Mitsuba does not normalise the axis, so an axis of another length also scales.
    matrix = np.eye(4)
    matrix[:3, :3] = cosine * np.eye(3) + sine * np.cross(np.eye(3), axis) + (1.0 - cosine) * np.outer(axis, axis)
    return matrix


def _matrix(step: Element) -> Float64:
    values = np.array(_numbers(step, "value", (9, 16)))
    matrix = np.eye(4)
    size = int(len(values) ** 0.5)
    matrix[:size, :size] = values.reshape(size, size)
    if not np.allclose(matrix[3], [0, 0, 0, 1]):
        raise step.location.error(
            f"ends in the row {shown(matrix[3])}, but must end in [0, 0, 0, 1].",
            "Its rows are for column vectors: the translation is the last column.",
        )
    return matrix


def _look_at(step: Element) -> Float64:
    origin, target = (np.array(_numbers(step, key, (3,))) for key in ("origin", "target"))
    forward = target - origin
    if not np.linalg.norm(forward) > 0:
        raise step.location.error("has the same origin and target.", "Move one of them.")
    forward /= np.linalg.norm(forward)
    given = "up" in step.attributes
    up = np.array(_numbers(step, "up", (3,))) if given else np.eye(3)[np.argmin(np.abs(forward))]
    left = np.cross(up, forward)
    if not np.linalg.norm(left) > 1e-9 * np.linalg.norm(up):
        raise step.location.error("looks along its `up`.", "Give another up.")
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(forward, left), forward, origin], axis=1)
    return matrix


_STEPS = {
    "translate": _translate,
    "scale": _scale,
    "rotate": _rotate,
    "matrix": _matrix,
    "lookat": _look_at,
}


def of_kind(plugin: Plugin, kinds: Mapping[str, object], what: str) -> None:
    """Raise SceneError if the plugin's type is none of `kinds`."""
    from glpath.io.mitsuba.document import error_of_kind

    if plugin.kind not in kinds:
        raise error_of_kind(plugin.element, what, kinds)
