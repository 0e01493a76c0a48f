"""Outputs of a command: checks before the work, and saving, where a failure of one output keeps the others."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from glpath.errors import GlpathError, ImageError, UsageError
from glpath.system.files import STDOUT, check_writable, file_id, inputs_of_command, is_stream, real_path
from glpath.system.locks import check_unlocked

#: Function that writes a result to the given path.
Save = Callable[[Path], object]


def check_outputs(
    paths: Sequence[Path], inputs: Iterable[str | Path | None] = (), derived: Iterable[Path] = ()
) -> None:
    """Raise GlpathError if an output cannot be written, is also an input, or is the same file as another output.

    Two different paths that lead to one file are an error; the same path twice is allowed. Also raise GlpathError,
    with the name of the process, if another process writes its checkpoint to an output. Files that the command has
    already read count as inputs; see `recorded_inputs`.

    paths   : outputs
    inputs  : further files that the command reads; None and names that are no files are ignored
    derived : outputs in the folders of `paths` that the user did not name, such as numbered frames
    """
    read = _files_of([*(each for each in inputs if each is not None), *inputs_of_command()])
    for index, path in enumerate(paths):
        check_writable(path)
        check_separate("-o", path, [other for other in paths[:index] if other != path])
        _check_no_input("-o", path, read)
        if not is_stream(path):
            check_unlocked(path)
    for path in derived:
        if os.path.isdir(path) and not os.path.islink(path):
            raise ImageError(f"{path}: is a folder, where a file is to be written.", "Name another output.")
        _check_no_input("output", path, read)


def check_no_input(option: str, path: Path) -> None:
    """Raise UsageError if an option's file is one that the command has read, because it would be replaced.

    option : name of the option, for the message
    """
    _check_no_input(option, path, _files_of(inputs_of_command()))


def _check_no_input(option: str, path: Path, read: Mapping[tuple[int, int], str | Path]) -> None:
    if (same := read.get(file_id(path) or (-1, -1))) is not None and not is_stream(path):
        raise UsageError(f"{option} {path}: is the input {same}, which it would replace.", "Name another output.")


def _files_of(paths: Iterable[str | Path]) -> dict[tuple[int, int], str | Path]:
    """Return the path of each existing file by device and inode; the first, if several paths lead to one file."""
    files: dict[tuple[int, int], str | Path] = {}
    for path in paths:
        if (found := file_id(path)) is not None:
            files.setdefault(found, path)
    return files


def check_separate(option: str, path: Path, outputs: Iterable[Path]) -> None:
    """Raise UsageError if an option's file is also an output, because one would replace the other.

    Pipes and devices may be named several times, except standard output as `-`.

    option : name of the option, for the message
    path   : file of the option
    """
    for output in outputs:
        if str(path) == str(output) == STDOUT or (not is_stream(path) and real_path(path) == real_path(output)):
            raise UsageError(
                f"{option} {path}: is the same file as the output {output}, so one would replace the other.",
                "Give each a name of its own.",
            )


def save_all(
    saves: Mapping[Path, Save], rescue: Mapping[str, Save] | None = None, where: str = ""
) -> tuple[list[Path], ImageError | None]:
    """Write several outputs of one result. If one fails, the others are still written.

    Files are written before pipes and devices, which may block. Files of a rescue suffix are written first, because
    they hold the whole result, and other outputs may take long.

    saves  : function that writes each output, by path
    rescue : functions that write the whole result, by file name. They are called with paths in a temporary folder
             if no output could be written, or if an output with the suffix of one of these file names failed.
             None if the result can be made again
    where  : message that reports the rescued files, with {} for their paths

    Returns the written paths, and an error that names all failures and the rescued files, or None.
    """
    written: list[Path] = []
    failures: dict[Path, Exception] = {}
    suffixes = {Path(name).suffix for name in rescue or ()}
    for path in sorted(saves, key=lambda path: (is_stream(path), path.suffix.lower() not in suffixes)):
        try:
            saves[path](path)
            written.append(path)
        except Exception as error:  # any error, even a bug of ours, must not lose the other outputs
            failures[path] = error
    if not failures:
        return written, None
    notes = []
    if rescue and (not written or any(path.suffix.lower() in suffixes for path in failures)):
        notes.append(rescued(rescue, where))
    errors = [
        error if isinstance(error, GlpathError) else ImageError(f"{path}: cannot be written: {error!r}.")
        for path, error in failures.items()
    ]
    if len(saves) == 1:
        message, lines = errors[0].message, [errors[0].remedy]
    else:
        message, lines = f"{len(failures)} of {len(saves)} outputs cannot be written.", [str(e) for e in errors]
    failure = ImageError(message, "\n".join(filter(None, [*lines, *notes])))
    failure.__cause__ = next(iter(failures.values()))
    return written, failure


def rescued(rescue: Mapping[str, Save], where: str) -> str:
    """Write a result into a temporary folder, and return a sentence that reports its location.

    Parameters are those of `save_all`.
    """
    names = ", ".join(map(str, _into_temporary_folder(rescue)))
    return where.format(names) if names else "Nor could it be kept in a temporary folder."


def _into_temporary_folder(rescue: Mapping[str, Save]) -> list[Path]:
    """Write the files into the first usable temporary folder, and return their paths; [] if no folder is usable."""
    try:
        usual = tempfile.gettempdir()
    except OSError:
        usual = ""
    for parent in filter(os.path.isdir, dict.fromkeys((usual, "/var/tmp", "/dev/shm"))):
        folder = ""
        try:
            folder = tempfile.mkdtemp(prefix="glpath-", dir=parent)
            for name, save in rescue.items():
                save(Path(folder) / name)
        except (OSError, GlpathError, MemoryError):
            shutil.rmtree(folder, ignore_errors=True)
        else:
            return [Path(folder) / name for name in rescue]
    return []
