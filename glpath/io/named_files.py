"""Search for the files that a model names, such as pictures. Notes report files found elsewhere or not at all.

Models move between machines. The file names in them may then be paths of another machine, or differ in case or
encoding. They may also contain backslashes or quotes, or have accents as separate characters.
"""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from glpath.system.files import absence_of, reason_of
from glpath.system.time_limit import check_time

# Maximum number of subfolders that are searched for a missing file.
_MAX_FOLDERS = 100
# Maximum number of trailing parts of a path that are tried for a missing file; textures/wood.png has two parts.
_MAX_PARTS = 8
# Encodings that are tried for a file name that is not UTF-8, and has therefore been decoded as Latin-1.
_ENCODINGS = ("gb18030", "cp932", "big5", "cp949", "cp1250", "cp1251", "cp1252")
# Maximum cost of all searches of a model for files that are not where they are named. A file that is found
# elsewhere costs 1; a missing one costs _MISSING, because all spellings and folders are tried.
_MAX_SEARCHES, _MISSING = 10_000, 10
# Maximum length of a path on common systems; longer names are not tried in other spellings.
_MAX_NAME = 4096
# Maximum number of files that a note lists.
_LISTED = 10
# Maximum length, in letters, of each name in a note.
_LONGEST = 120


class Folders:
    """Cache of folder listings, so that each folder is read once."""

    def __init__(self) -> None:
        self._names: dict[Path, dict[str, str] | None] = {}
        self._subfolders: dict[Path, list[str]] = {}
        self._resolved: dict[Path, Path] = {}

    def names(self, folder: Path) -> dict[str, str] | None:
        """Return the alphabetically first entry by case-folded name; None if the folder cannot be listed."""
        if folder not in self._names:
            try:
                self._names[folder] = {_folded(each): each for each in sorted(os.listdir(folder), reverse=True)}
            except (OSError, ValueError):  # ValueError if the path contains a NUL
                self._names[folder] = None
        return self._names[folder]

    def resolved(self, folder: Path) -> Path:
        """Return the absolute path of a folder without links."""
        if folder not in self._resolved:
            self._resolved[folder] = folder.resolve()
        return self._resolved[folder]

    def subfolders(self, folder: Path) -> list[str]:
        """Return the names of the alphabetically first _MAX_FOLDERS subfolders; [] if the folder is unreadable."""
        if folder not in self._subfolders:
            try:
                names = sorted(each.name for each in os.scandir(folder) if each.is_dir())
            except OSError:
                names = []
            self._subfolders[folder] = names[:_MAX_FOLDERS]
        return self._subfolders[folder]


class UnusableError(Exception):
    """Error for an unusable file that a model names. Its text ends a sentence: "which does not exist"."""


@dataclass
class NamedFiles:
    """Search for the files that one model names, with a record of its results.

    moved    : description of the file that is read instead of a missing file, by name of the missing file
    unusable : reason why a picture is not used, by name of the picture
    folders  : listings of the folders that were searched
    """

    moved: dict[str, str] = field(default_factory=dict)
    unusable: dict[str, str] = field(default_factory=dict)
    _paths: dict[tuple[Path, str], Path | UnusableError] = field(default_factory=dict)
    _cost: int = 0
    folders: Folders = field(default_factory=Folders)

    def find(self, folder: Path, name: str) -> Path:
        """Return the file `name` of a folder, in any spelling, or else a file of that base name elsewhere in it.

        `spelt_file` tries the spellings. If several files have the base name, the file whose path has the most
        folders in common with `name` is chosen. `notes` reports a file found elsewhere. Raises UnusableError.
        """
        key = (folder, name)
        if key not in self._paths:
            check_time()
            self._paths[key] = self._searched(folder, name)
        found = self._paths[key]
        if isinstance(found, UnusableError):
            raise found
        return found

    def _searched(self, folder: Path, name: str) -> Path | UnusableError:
        """Return a file or an error as `find` does. Only the named path is tried after too many searches."""
        is_over = self._cost >= _MAX_SEARCHES
        try:
            if is_over:
                return _exact_file(folder, name, self.folders)
            return spelt_file(folder, name, self.folders)
        except UnusableError as error:
            path = None if is_over else self._elsewhere(folder, name)
            self._cost += _MISSING if path is None else 1
            return path or error

    def _elsewhere(self, folder: Path, name: str) -> Path | None:
        spellings = (name, *_spellings(name))
        found = (_of_base_name(folder, _parts(each), self.folders) for each in spellings)
        paths = next(filter(None, found), None)
        if not paths:
            return None
        others = f" (one of {len(paths)} files of that name)" if len(paths) > 1 else ""
        self.moved[name] = f"{paths[0].relative_to(folder).as_posix()} is read{others}"
        return paths[0]

    def notes(self) -> list[str]:
        """Return a sentence on files read from elsewhere, and one for each reason why files are not used."""
        texts = []
        if self.moved:
            listed = _listed([f"for {_quoted(name)} {used}" for name, used in self.moved.items()])
            texts.append(f"Paths without a file in the folder of the model ({len(self.moved):,}): {listed}.")
        names_of: dict[str, list[str]] = {}
        for name, reason in self.unusable.items():
            names_of.setdefault(reason, []).append(_quoted(name))
        for reason, names in names_of.items():
            if len(names) == 1:
                texts.append(f"The texture {names[0]}, {reason}.")
            else:
                each = f"each of {reason}" if reason.startswith("which") else f"each {reason}"
                texts.append(f"{len(names):,} textures, {each}: {_listed(names)}.")
        if self._cost >= _MAX_SEARCHES:
            texts.append("Other folders and spellings, after many files that are not where they are named.")
        return texts


def named_file(folder: Path, name: str, folders: Folders | None = None) -> Path:
    """Return the file at the path `name` below a model's folder; the case of letters may differ.

    Backslashes also separate folders. A link counts by its target, which must be inside the folder. Raises
    UnusableError.

    folders : cache of folder listings from earlier searches
    """
    folders = folders or Folders()
    path = folder / name.replace("\\", "/")
    try:
        is_inside = _is_inside(path, folders.resolved(folder))
        if is_inside and os.path.isfile(path):
            return path
        if (similar := _in_any_case(folder, _parts(name), folders)) is not None:
            return similar
        if not is_inside or _has_drive(name):
            raise UnusableError("which is outside the folder of the model")
        raise UnusableError(f"which {absence_of(path)}")
    except (OSError, RuntimeError, ValueError) as error:  # for a NUL or a circle of links
        raise UnusableError(f"which cannot be read: {reason_of(error)}") from error


def _exact_file(folder: Path, name: str, folders: Folders) -> Path:
    """Return the file at the path `name` below a folder, as it is spelt. Raises UnusableError."""
    path = folder / name.replace("\\", "/")
    if os.path.isfile(path) and _is_inside(path, folders.resolved(folder)):
        return path
    raise UnusableError("which is not where it is named")


def spelt_file(folder: Path, name: str, folders: Folders | None = None) -> Path:
    """Return the file that `named_file` finds for a name; also try it without quotes and in other encodings.

    Raises UnusableError.
    """
    try:
        return named_file(folder, name, folders)
    except UnusableError:
        for each in _spellings(name):
            with suppress(UnusableError):
                return named_file(folder, each, folders)
        raise


def _spellings(name: str) -> Iterator[str]:
    """Yield other spellings of a name: without quotes or a comment, and with its bytes in other encodings."""
    if len(name) > _MAX_NAME:
        return
    plain = without_comment(name)
    if len(plain) > 1 and plain[0] in "\"'" and plain[-1] == plain[0]:
        plain = plain[1:-1]
    if plain != name:
        yield plain
    if name.isascii():
        return
    try:
        stored = plain.encode("latin-1")
    except UnicodeEncodeError:
        return
    yield os.fsdecode(stored)
    for encoding in _ENCODINGS:
        with suppress(UnicodeDecodeError):
            yield stored.decode(encoding)


def without_comment(name: str) -> str:
    """Return a name without the part from " # " on, which may be a comment."""
    return name.partition(" # ")[0].rstrip()


def _is_inside(path: Path, resolved_folder: Path) -> bool:
    return path.resolve().is_relative_to(resolved_folder)


def _has_drive(name: str) -> bool:
    return name[1:2] == ":" and name[:1].isalpha()


def _parts(name: str) -> list[str]:
    return [part for part in name.replace("\\", "/").split("/") if part not in ("", ".")]


def _of_base_name(folder: Path, parts: Sequence[str], folders: Folders) -> list[Path]:
    """Return the files in a folder and its subfolders with the base name of a path, most similar paths first."""
    ends = [parts[start:] for start in range(max(len(parts) - _MAX_PARTS, 0), len(parts))]
    base_name = _folded(parts[-1]) if parts else ""
    for name in folders.subfolders(folder) if parts else ():
        names = folders.names(folder / name)
        if names is None or base_name in names:
            ends.append([name, parts[-1]])
    found = (_in_any_case(folder, each, folders) for each in ends)
    return list(dict.fromkeys(path for path in found if path is not None))


def _in_any_case(folder: Path, parts: Sequence[str], folders: Folders) -> Path | None:
    """Return the file at a path below a folder, ignoring case; None if there is none or a link leads outside."""
    path = folder
    try:
        for part in parts:
            if part == "..":
                return None
            if not os.path.exists(path / part):
                similar = (folders.names(path) or {}).get(_folded(part))
                if similar is None:
                    return None
                part = similar
            path /= part
        if path.is_file() and _is_inside(path, folders.resolved(folder)):
            return path
    except (OSError, RuntimeError, ValueError):  # for a NUL or a circle of links
        pass
    return None


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name.casefold())


def _quoted(name: str) -> str:
    plain = "".join(letter if letter.isprintable() else "?" for letter in name)
    return f'"{plain if len(plain) <= _LONGEST else plain[:_LONGEST] + " ..."}"'


def _listed(texts: Sequence[str]) -> str:
    more = f" and {len(texts) - _LISTED:,} more" if len(texts) > _LISTED else ""
    return ", ".join(texts[:_LISTED]) + more
