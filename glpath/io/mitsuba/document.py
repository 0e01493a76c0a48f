"""Mitsuba's XML as a tree of elements with their lines [expat]; parameters, includes and references are resolved.

Files with a document type are refused, so that entities cannot expand without limit.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from glpath.errors import SceneError
from glpath.io.values import nearby_files
from glpath.scene.geometry import Float64
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.files import absence_of, read_bytes, reason_of
from glpath.system.suggestions import listed_names, similar_names
from glpath.system.time_limit import check_time

_DEEPEST = 15  # maximum depth of nested includes, as in Mitsuba
_NESTED = 100  # maximum depth of nested elements
# Maximum number of elements in a scene with its includes.
_MAX_ELEMENTS = 2**19
# Maximum number of bytes of a scene with its includes.
_MAX_BYTES = 2**28
# Maximum number of files of a scene with its includes.
_MAX_FILES = 2**10
# Maximum total length, in characters, of the values that replace `$name`s in a scene with its includes.
_MAX_VALUES = 2**22
# Maximum depth of plugins nested by `<ref>`s. If each plugin has two `<ref>`s, the number of plugins doubles with
# each level.
_MAX_REFERENCES = 16
# Maximum number of plugins that are read, with their children. A plugin to which several `<ref>`s refer counts for
# each of them.
_MAX_PLUGINS = 2**23
# Maximum length of a tag, type or name in characters, and maximum number of `<path>`s in a scene with its includes.
_MAX_NAME, _MAX_PATHS = 256, 2**10
# Maximum number of paths in all that are tried to find the files of a scene. Each takes a few microseconds.
_MAX_LOOKUPS = 2**21
# A `$` and all letters that may belong to a name, which may be only their beginning; or `\$` for a dollar sign.
_DOLLAR = re.compile(r"(\\?)\$(\w[\w.-]*|)")
_WORD = re.compile(r"\w+")
_VERSION = re.compile(r"([0-9]{1,4})(\.|$)")
_CAMEL = re.compile(r"([a-z0-9])([A-Z])")
# Tags of Mitsuba 0.x that have another name today.
_RENAMED = {"lookAt": "lookat"}


class SearchPath:
    """Folders in which a scene's files are looked for.

    The folders are those of its `<path>`s, the latest first, then that of the scene, as in Mitsuba.
    """

    def __init__(self, scene_folder: Path) -> None:
        self.folders: list[Path] = []
        self._by_real_path: dict[str, Path] = {}
        self._changes = self._lookups = 0
        self._found: dict[tuple[Path, str, bool, int], Path] = {}
        self.prepend(scene_folder)

    def prepend(self, folder: Path) -> None:
        """Look in a folder before all others, and only once."""
        real = os.path.realpath(folder)
        if next(reversed(self._by_real_path), None) == real:
            return
        self._by_real_path.pop(real, None)
        self._by_real_path[real] = folder
        self.folders = list(reversed(self._by_real_path.values()))
        self._changes += 1

    def find(self, folder: Path, name: str, location: SourceLocation, *, is_include: bool = False) -> Path:
        """Return the path of a file; if no folder has it, that in `folder`, the folder of the file that names it.

        As in Mitsuba, `folder` comes first for an include, and last for other files. Each name is looked for once.
        Raises SceneError after _MAX_LOOKUPS paths.
        """
        key = (folder, name, is_include, self._changes)
        if key not in self._found:
            check_time()
            self._found[key] = folder / name
            for each in (folder, *self.folders) if is_include else (*self.folders, folder):
                self._lookups += 1
                if self._lookups > _MAX_LOOKUPS:
                    raise location.error(
                        f"names {shown(name)}, but the scene's files were looked for at {_MAX_LOOKUPS:,} paths "
                        f"already, in {len(self.folders):,} folders.",
                        "Remove each <path> that is not needed.",
                    )
                if os.path.exists(os.path.join(each, name)):
                    self._found[key] = each / name
                    break
        return self._found[key]


@dataclass(eq=False)
class Element:
    """XML element with its tag, attributes and children, and the folders of the files that it names.

    folder   : folder of its file, where relative paths start
    searched : further folders of files
    """

    tag: str
    attributes: dict[str, str]
    location: SourceLocation
    folder: Path
    searched: SearchPath
    children: list[Element] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.attributes.get("name", "")

    def file(self, name: str) -> Path:
        """Return the path of a file that the element names, see `SearchPath.find`. Raises SceneError."""
        return self.searched.find(self.folder, name, self.location, is_include=self.tag == "include")

    def attribute(self, name: str) -> str:
        """Return the value of a required attribute. Raises SceneError."""
        if name not in self.attributes:
            found = ", ".join(self.attributes) or "none"
            raise self.location.error(f"lacks the attribute `{name}`. It has: {found}.")
        return self.attributes[name]


@dataclass
class Document:
    """Scene file with all its includes.

    root       : the element <scene>
    identified : elements by their id
    defaults   : `<default>`s, in order, as text; None for a parameter that is used before it has a default
    colours    : (3,) colour of each `<spectrum>`, by its file or element, and by whether it is that of a light
    """

    root: Element
    identified: dict[str, Element]
    defaults: dict[str, str | None]
    colours: dict[tuple[str | Element, bool], Float64] = field(default_factory=dict)
    _plugins: int = 0

    @property
    def has_sensor(self) -> bool:
        return any(child.tag == "sensor" for child in self.root.children)

    def count_plugin(self, element: Element) -> None:
        """Count a plugin and its children when they are read. Raises SceneError beyond _MAX_PLUGINS."""
        check_time()
        self._plugins += 1 + len(element.children)
        if self._plugins > _MAX_PLUGINS:
            raise element.location.error(
                f"brings the scene to more than {_MAX_PLUGINS:,} plugins and parameters; no more are read.",
                "A plugin counts for each <ref> to it. Do many of them refer to a large one?",
            )

    def resolved(self, element: Element, depth: int = 0) -> Element:
        """Return the element to which a `<ref>` refers; any other element itself. Raises SceneError.

        depth : number of plugins around the element
        """
        if depth > _MAX_REFERENCES:
            raise element.location.error(
                f"is in more than {_MAX_REFERENCES} plugins by references; a scene needs five.",
                "Does one of them refer to itself?",
            )
        if element.tag != "ref":
            return element
        wanted = element.attribute("id")
        found = self.identified.get(wanted)
        if found is None:
            near = similar_names(wanted, self.identified, 1)
            listed = listed_names(self.identified) or "no element"
            raise element.location.error(
                f"refers to {shown(wanted)}, but the file has the ids {listed}.",
                f"Did you mean {shown(near[0])}?" if near else "Give the element that is meant this id.",
            )
        return found


def read_document(
    path: Path, parameters: Mapping[str, object], *, complete: bool = True, others: Collection[str] = ()
) -> Document:
    """Read the document of a file. Raises SceneError, also for parameters that the file does not have.

    parameters : values that replace the file's `<default>`s, and values for `$name` without a default
    complete   : True raises SceneError for a `$name` without a value and for unknown parameters. False replaces
                 such a `$name` by empty text and ignores unknown parameters
    others     : names of optional parameters, which the file need not have
    """
    reader = _Reader({name: str(value) for name, value in parameters.items()}, path.parent, complete)
    root = reader.read(path, SourceLocation(str(path)), 0, 0)
    if root.tag != "scene":
        raise root.location.error(
            "is the root, but a scene's is <scene>.", "Other XML of Mitsuba is included: <include filename=...>."
        )
    for name in parameters if complete else ():
        if name not in reader.defaults and name not in others:
            allowed = listed_names(f"{key}={value or ''}" for key, value in reader.defaults.items()) or "none"
            near = similar_names(name, reader.defaults, 1)
            raise SourceLocation(str(path)).error(
                f"has no parameter `{name}`. Allowed: {allowed}.",
                f"Did you mean `{near[0]}`?" if near else 'A parameter is a <default name="..." value="..."/>.',
            )
    return Document(root, reader.identified, reader.defaults)


class _Reader:
    """Reader of a file and its includes in document order.

    A `<default>`, `<path>` or `<alias>` applies to all that follows it.
    """

    def __init__(self, given: Mapping[str, str], scene_folder: Path, complete: bool) -> None:
        self._searched = SearchPath(scene_folder)
        self._scene_folder = scene_folder
        self._values = dict(given)
        self._complete = complete
        self.defaults: dict[str, str | None] = {}
        self.identified: dict[str, Element] = {}
        self._longest = max(map(len, given), default=0)
        self._files = self._bytes = self._elements = self._substituted = self._paths = 0

    def read(self, path: Path, location: SourceLocation, depth: int, nested: int) -> Element:
        """Return the root element of a file.

        location      : location that names the file
        depth, nested : number of files that include the file, and of elements around its root
        """
        if depth > _DEEPEST:
            raise location.error(f"includes files in each other, more than {_DEEPEST} deep.", "Is it a circle?")
        if not os.path.isfile(path):
            raise location.error(
                f"names {path}, which {absence_of(path)}.",
                nearby_files("Files", path, (".xml",)),
            )
        self._files += 1
        if self._files > _MAX_FILES:
            raise location.error(f"is the include after {_MAX_FILES:,} files; no more are read.")
        try:
            content = read_bytes(path, _MAX_BYTES - self._bytes)
        except OSError as error:
            raise location.error(f"cannot be read: {reason_of(error)}.") from error
        self._bytes += len(content)
        root = self._parsed(content, path, nested)
        _check_old_names(root)
        self._resolve(root, depth, nested)
        return root

    def _resolve(self, element: Element, depth: int, nested: int) -> None:
        """Resolve an element: substitute `$name`, register its id, then resolve its children in order.

        Includes are replaced by their content.
        """
        check_time()
        for key, text in element.attributes.items():
            if "$" in text:
                element.attributes[key] = _DOLLAR.sub(lambda found: self._substitute(found, element), text)
        name = element.attributes.get("id", "")
        if element.tag not in ("ref", "alias", "default") and name:
            if name in self.identified:
                before = self.identified[name].location.path.partition(",")[0]
                raise element.location.error(
                    f"has the id {shown(name)}, which the element of {before} has.", "Give each its own."
                )
            self.identified[name] = element
        children = []
        for child in element.children:
            self._resolve(child, depth, nested + 1)
            if child.tag == "include":
                path = child.file(child.attribute("filename"))
                if not (self._complete or os.path.isfile(path)):
                    continue
                root = self.read(path, child.location, depth + 1, nested + 1)
                children += root.children if root.tag == "scene" else [root]
            elif child.tag == "alias":
                known = child.attribute("id")
                if known not in self.identified:
                    raise child.location.error(f"is of {shown(known)}, an id that no element before it has.")
                self.identified[child.attribute("as")] = self.identified[known]
            elif child.tag == "default":
                key, value = child.attribute("name"), child.attribute("value")
                _check_length("the parameter", key, child.location)
                self.defaults.setdefault(key, value)
                self._values.setdefault(key, value)
                self._longest = max(self._longest, len(key))
            elif child.tag == "path":
                self._search(child)
            else:
                children.append(child)
        element.children = children

    def _search(self, element: Element) -> None:
        """Add the folder of a `<path>` to the searched folders.

        The folder is relative to the folder of the file with the `<path>`, or to that of the scene.
        """
        self._paths += 1
        if self._paths > _MAX_PATHS:
            raise element.location.error(f"is the <path> after {_MAX_PATHS:,} others; no more are read.")
        folders = [folder / element.attribute("value") for folder in (element.folder, self._scene_folder)]
        found = [folder for folder in folders if os.path.isdir(folder)]
        if not found:
            raise element.location.error(
                f"names {' and '.join(map(str, dict.fromkeys(folders)))}, which is no folder.",
                "Files are looked for in it.",
            )
        self._searched.prepend(found[0])

    def _substitute(self, found: re.Match[str], element: Element) -> str:
        if found[1]:
            return found[0].removeprefix("\\")
        return self._value(found[2], element) if found[2] else found[0]

    def _value(self, name: str, element: Element) -> str:
        word = _WORD.match(name)
        _check_length("the parameter", name if word is None else word[0], element.location)
        # The longest known name counts, as in Mitsuba, so `$widthpx` may be `$width` and px.
        for end in range(min(len(name), self._longest), 0, -1):
            if name[:end] in self._values:
                self.defaults.setdefault(name[:end], None)
                value = self._values[name[:end]]
                self._substituted += len(value)
                if self._substituted > _MAX_VALUES:
                    raise element.location.error(
                        f"brings the values of parameters to more than {_MAX_VALUES:,} letters in all.",
                        "Do parameters stand for each other?",
                    )
                return value + name[end:]
        word = _WORD.match(name)
        assert word is not None
        name, rest = word[0], name[word.end() :]
        self.defaults.setdefault(name, None)
        if not self._complete:
            return rest
        raise element.location.error(
            f"names the parameter `${name}`, which has no value.",
            f'Give it one: -D {name}=..., or <default name="{name}" value="..."/> before it.',
        )

    def _parsed(self, content: bytes, path: Path, nested: int) -> Element:
        """Parse a file and return its root element."""
        parser = expat.ParserCreate()
        stack: list[Element] = []
        roots: list[Element] = []

        def start(tag: str, attributes: dict[str, str]) -> None:
            location = SourceLocation(str(path), f"line {parser.CurrentLineNumber}")
            _check_length("the tag", tag, location)
            kind = ""
            for key in ("type", "name"):
                if key in attributes:
                    _check_length(f"the {key}", attributes[key], location)
                    kind += f' {key}="{attributes[key]}"'
            location = SourceLocation(str(path), f"{location.path}, <{tag}{kind}>")
            self._elements += 1
            if nested + len(stack) > _NESTED:
                raise location.error(f"is in more than {_NESTED} elements; a scene needs ten.")
            if self._elements > _MAX_ELEMENTS:
                raise location.error(f"is the element after {_MAX_ELEMENTS:,} others; no more are read.")
            element = Element(_RENAMED.get(tag, tag), dict(attributes), location, path.parent, self._searched)
            (stack[-1].children if stack else roots).append(element)
            stack.append(element)

        def doctype(*_: object) -> None:
            location = SourceLocation(str(path), f"line {parser.CurrentLineNumber}")
            remedy = "Remove <!DOCTYPE ...>."
            raise location.error("has a document type, which scenes of Mitsuba do not have.", remedy)

        parser.StartElementHandler = start
        parser.EndElementHandler = lambda _: stack.pop()
        parser.StartDoctypeDeclHandler = doctype
        try:
            parser.Parse(content, True)
        except expat.ExpatError as error:
            location = SourceLocation(str(path), f"line {error.lineno}, column {error.offset + 1}")
            raise location.error(f"is not XML: {expat.errors.messages[error.code]}.") from error
        except (LookupError, ValueError) as error:  # raised for an unknown declared encoding
            location = SourceLocation(str(path), f"line {parser.CurrentLineNumber}")
            raise location.error(f"has an encoding that is not read: {error}.", "Write it as UTF-8.") from error
        return roots[0]


def _check_length(what: str, name: str, location: SourceLocation) -> None:
    """Raise SceneError for a long name.

    Substitution tries every prefix of a parameter's name, and tags, types and names are in the location of each
    element.

    what : what is named, such as "the parameter"
    """
    if len(name) > _MAX_NAME:
        raise location.error(
            f"names {what} {shown(name)} of {len(name):,} letters, but {_MAX_NAME} are the most.",
            "Give it a shorter name.",
        )


def _check_old_names(root: Element) -> None:
    """Convert the camel-case names of Mitsuba 0.x, in place: toWorld becomes to_world, intIOR int_ior."""
    version = root.attributes.get("version", "3.0.0")
    found = _VERSION.match(version)
    if found is None:
        raise root.location.error(f"has the version {shown(version)}.", 'For example version="3.0.0".')
    if int(found[1]) >= 2:
        return
    for element in _walk(root):
        if element.tag not in ("default", "include", "alias") and element.name:
            element.attributes["name"] = _CAMEL.sub(r"\1_\2", element.name).lower()
    for element in _walk(root):
        if element.tag == "bsdf" and element.attributes.get("type") == "diffuse":
            for child in element.children:
                if child.name == "diffuse_reflectance":
                    child.attributes["name"] = "reflectance"


def _walk(element: Element) -> Iterator[Element]:
    yield element
    for child in element.children:
        yield from _walk(child)


def error_of_kind(element: Element, what: str, allowed: Mapping[str, object], remedy: str = "") -> SceneError:
    """Return the error for a plugin of an unsupported type."""
    kind = element.attributes.get("type", "")
    near = similar_names(kind, allowed, 1)
    return element.location.error(
        f"is {what} of the type {shown(kind)}, which is not read. Allowed: {', '.join(sorted(allowed))}.",
        remedy or (f"Did you mean {shown(near[0])}?" if near else "Use one of them instead."),
    )
