"""Checkpoints of daylight coefficients: nothing of others is removed, and nothing done is lost."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from glpath.apps.daylight import kept_words
from glpath.apps.daylight.checkpoint import DaylightCheckpoint
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.compute import _words, _words_of_pass, daylight_coefficients
from glpath.apps.daylight.kept_shards import KeptShards
from glpath.apps.daylight.kept_words import KeptPass, KeptWords
from glpath.apps.daylight.visibility import Seen
from glpath.errors import GlpathError, ImageError
from glpath.jobs.checkpoint import Checkpoint
from glpath.jobs.connection import Connection
from glpath.radiosity.solvers.checkpoint import SolverCheckpoint
from glpath.system.checkpoint import CheckpointFile
from tests.conftest import MakeFilm
from tests.support.command_line import run
from tests.support.weather_files import write_epw

AT, UP = np.array([[0.0, 0.1, 0.0], [0.2, 0.1, 0.2]]), np.array([0.0, 1.0, 0.0])
QUICK: dict[str, Any] = {"samples": 2, "max_depth": 1}


@pytest.fixture
def sensors(tmp_path: Path) -> Path:
    path = tmp_path / "p.csv"
    path.write_text("x,y,z,nx,ny,nz\n0,0.1,0,0,1,0\n")
    return path


def coefficients(**options: Any) -> DaylightCoefficients:
    return daylight_coefficients("cornell-box-36", AT, UP, **QUICK, **options)


def test_folder_with_other_files_is_refused_before_the_work(tmp_path: Path) -> None:
    for name in ("thesis.tex", "2-of-3.npz", "0-of-0.npz.bak"):
        folder = tmp_path / f"with {name}"
        folder.mkdir()
        (folder / "1-of-4.npz").touch()
        (folder / name).touch()
        with pytest.raises(ImageError, match=r"has .*; the folder of a cluster's shards has only files K-of-"):
            KeptShards(folder, "work", 4, 9)
        assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize(
    "name", ["0-of-4", "5-of-4", "0-of-0", "01-of-4", "1-of-04", "1-of-9", f"1-of-{10**100}", f"{10**100}-of-4"]
)
def test_numbers_of_shards_out_of_range_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / f"{name}.npz").touch()
    with pytest.raises(ImageError, match=r"has .*-of-.*; .* K-of-") as error:
        KeptShards(tmp_path, "work", 4, 8)
    assert "Move the file elsewhere" in str(error.value)
    assert len(list(tmp_path.iterdir())) == 1


def test_temporary_file_of_a_killed_process_is_removed_from_the_folder(tmp_path: Path) -> None:
    for name in (".1-of-4.0123abcd.part.npz", "2-of-4.npz"):
        (tmp_path / name).touch()
    assert KeptShards(tmp_path, "work", 3, 9).count == 4
    assert [path.name for path in tmp_path.iterdir()] == ["2-of-4.npz"]


def test_only_shards_are_removed_with_their_folder(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    for name in ("1-of-2.npz", "2-of-2.npz", "thesis.tex"):
        (folder / name).touch()
    DaylightCheckpoint(folder).remove()
    assert [file.name for file in folder.iterdir()] == ["thesis.tex"]
    (folder / "thesis.tex").unlink()
    DaylightCheckpoint(folder).remove()
    assert not folder.exists()


def test_second_process_is_refused_a_cluster_s_folder(tmp_path: Path) -> None:
    folder, cluster = tmp_path / "dc.npz.part", object.__new__(Connection)
    with DaylightCheckpoint(folder), pytest.raises(GlpathError, match="has it already: process"):
        coefficients(resume=folder, cluster=cluster)


@pytest.mark.parametrize("kind", [DaylightCheckpoint, SolverCheckpoint, Checkpoint])
@pytest.mark.parametrize("exists", [False, True])
def test_checkpoint_that_is_a_link_is_refused(kind: type[CheckpointFile], exists: bool, tmp_path: Path) -> None:
    link, target = tmp_path / "part", tmp_path / "old.npz"
    link.symlink_to(target)
    if exists:
        target.touch()
    with pytest.raises(ImageError, match="part: is a symbolic link; a checkpoint is a file of its own"), kind(link):
        pass
    kind(link).remove()
    assert (link.is_symlink(), target.exists()) == (False, exists)


@pytest.mark.parametrize("link", ["symbolic", "hard"])
@pytest.mark.parametrize("kind", [KeptWords, KeptPass, Checkpoint])
def test_checkpoint_that_becomes_a_link_is_replaced_by_a_file(
    kind: type[CheckpointFile], link: str, tmp_path: Path, make_film: MakeFilm
) -> None:
    part, victim = tmp_path / "part.npz", tmp_path / "victim"
    words = np.arange(6, dtype=np.uint32).reshape(3, 2)
    kept = kind(part)

    def write(done: int) -> None:
        if isinstance(kept, KeptWords):
            kept.keep(done, words, None, last=False)
        elif isinstance(kept, KeptPass):
            kept.keep(done, words, last=False)
        else:
            assert isinstance(kept, Checkpoint)
            kept.write(make_film([(0, 8 * done)]))

    if isinstance(kept, KeptWords):
        kept.read("0" * 64, 2, False)
    elif isinstance(kept, KeptPass):
        kept.read("0" * 64, (3, 2), 3)
    write(2)
    part.rename(victim)
    part.symlink_to(victim) if link == "symbolic" else os.link(victim, part)
    before = victim.read_bytes()
    write(3)
    assert (kept.failure, part.is_symlink(), part.stat().st_nlink) == (None, False, 1)
    assert victim.read_bytes() == before != part.read_bytes()
    if isinstance(kept, KeptWords):
        again = KeptWords(part).read("0" * 64, 2, False)
        assert np.array_equal([word for word, _ in again], words)


@pytest.mark.parametrize("kind", [DaylightCheckpoint, SolverCheckpoint, Checkpoint])
def test_checkpoint_that_is_a_pipe_is_refused_and_stays(kind: type[CheckpointFile], tmp_path: Path) -> None:
    pipe = tmp_path / "part"
    os.mkfifo(pipe)
    with pytest.raises(ImageError, match="part: is a pipe, where a checkpoint must be a file"), kind(pipe):
        pass
    with pytest.raises(ImageError, match="part: is a pipe, and is not removed"):
        kind(pipe).remove()
    assert pipe.is_fifo()


@pytest.mark.parametrize("size", [0, 1, 60])
def test_file_that_ends_within_its_first_line_counts_as_missing(size: int, tmp_path: Path) -> None:
    key = "0" * 64
    for kept, head in ((KeptWords, kept_words._HEAD), (KeptPass, kept_words._STREAM_HEAD)):
        path = tmp_path / kept.__name__
        path.write_bytes(head.format(key).encode()[:size])
        found = kept(path).read(key, 2, False) if kept is KeptWords else kept(path).read(key, (1, 2), 1)
        assert found in ([], (0, None))
        path.write_bytes(b"glpath of others"[: max(8, size)] + b"x" * 100)
        with pytest.raises(ImageError, match="holds the words of other sensors"):
            kept(path).read(key, 2, False) if kept is KeptWords else kept(path).read(key, (1, 2), 1)


def saved_words(path: Path, words: np.ndarray) -> KeptWords:
    """Save all words one by one, after the first two."""
    kept = KeptWords(path)
    kept.read("0" * 64, words.shape[1], False)
    for done in range(2, len(words) + 1):
        kept.keep(done, words, None, last=False)
    return kept


@pytest.mark.parametrize("damage", ["changed", "zeros", "repeated", "cut off"])
def test_words_end_at_the_first_damaged_record_and_are_written_anew(damage: str, tmp_path: Path) -> None:
    path, words = tmp_path / "part", np.arange(10, dtype=np.uint32).reshape(5, 2)
    saved_words(path, words)
    content = path.read_bytes()
    start, size = len(content) - 5 * 12, 12  # each record has two words of 4 bytes, and a checksum of 4
    third = slice(start + 2 * size, start + 3 * size)
    record = {
        "changed": bytes([content[third][0] ^ 1]) + content[third][1:],
        "zeros": bytes(size),
        "repeated": content[third.start - size : third.start],
        "cut off": content[third][:7],
    }[damage]
    path.write_bytes(content[: third.start] + record + (b"" if damage == "cut off" else content[third.stop :]))
    kept = KeptWords(path)
    found = kept.read("0" * 64, 2, False)
    assert np.array_equal([word for word, _ in found], words[:2])
    kept.keep(5, words, None, last=False)
    assert path.read_bytes() == content


def test_appended_words_reach_the_disk_within_an_interval_and_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed: list[int] = []
    words = np.arange(10, dtype=np.uint32).reshape(5, 2)
    with monkeypatch.context() as patch:
        patch.setattr(kept_words, "_FLUSH_SECONDS", 1e6)
        kept = saved_words(tmp_path / "part", words)  # the first two words are in a new file, which is flushed
        patch.setattr(os, "fsync", flushed.append)
        kept.keep(5, words, None, last=False)
        assert len(flushed) == 0
        kept.keep(5, words, None, last=True)
        assert len(flushed) == 1
        patch.setattr(kept_words, "_FLUSH_SECONDS", 0.0)
        kept.keep(5, words, None, last=False)
    assert len(flushed) == 2


@pytest.mark.parametrize(
    ("at", "value", "message"),
    [(0, 5, "it has 5 chunks, of a stream of 4"), (0, 2, "it has a wrong checksum"), (9, 1, "a wrong checksum")],
)
def test_damaged_pass_over_a_stream_is_refused(at: int, value: int, message: str, tmp_path: Path) -> None:
    kept, words = KeptPass(tmp_path / "part"), np.zeros((3, 2), np.uint32)
    kept.read("0" * 64, words.shape, 4)
    kept.keep(3, words, last=False)
    done, found = KeptPass(kept.path).read("0" * 64, words.shape, 4)
    assert (done, np.array_equal(found, words)) == (3, True)
    content = bytearray(kept.path.read_bytes())
    start = len(content) - 8 - words.nbytes - 4
    assert content[start] == 3
    content[start + at] = value
    kept.path.write_bytes(content)
    with pytest.raises(ImageError, match=f"part: is damaged: .*{message}") as error:
        KeptPass(kept.path).read("0" * 64, words.shape, 4)
    assert "Remove it to begin anew." in str(error.value)


@pytest.mark.parametrize("kind", ["", "stream "])
def test_words_of_an_earlier_version_are_refused(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "part"
    path.write_bytes(f"glpath daylight {kind}1 {'0' * 64}\n".encode() + bytes(32))
    with pytest.raises(ImageError, match="or of another version of glpath"):
        KeptPass(path).read("0" * 64, (3, 2), 4) if kind else KeptWords(path).read("0" * 64, 2, False)


def test_full_disk_does_not_end_the_computation_and_later_words_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    part = tmp_path / "part"
    opened: list[str] = []

    def full(path: Path, mode: str, **more: Any) -> Any:
        opened.append(mode)
        if len(opened) in (1, 3, 4):  # the first writing, and two after a good one
            raise OSError(28, "No space left on device")
        return open(path, mode, **more)

    monkeypatch.setattr(kept_words, "open", full, raising=False)
    whole = coefficients()
    with DaylightCheckpoint(part) as checkpoint:
        found = coefficients(resume=checkpoint)
    assert np.array_equal(found.words, whole.words)
    assert opened[:5] == ["wb", "wb", "r+b", "r+b", "r+b"]
    assert caplog.text.count("No space left on device; the computation continues") == 1
    monkeypatch.undo()
    size = part.stat().st_size
    kept = KeptWords(part)
    head = part.read_bytes()[: len(kept_words._HEAD.format("0" * 64))].decode()
    words = kept.read(head.split()[-1], len(AT), False)
    assert np.array_equal([seen.word for seen in words], whole.words)
    assert size == len(head) + whole.words.size * 4 + len(whole.words) * 4  # a checksum of 4 bytes for each word


def test_words_that_a_full_disk_refuses_are_rescued_at_a_signal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(path: Path) -> Any:
        raise ImageError(f"{path}: cannot be written: No space left on device.")

    kept, whole_file = KeptWords(tmp_path / "part"), kept_words.whole_file
    assert kept.read("0" * 64, 2, False) == []
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(kept_words, "whole_file", lambda path: (full if path == kept.path else whole_file)(path))
    words = np.arange(6, dtype=np.uint32).reshape(3, 2)
    kept.keep(2, words, None, last=True)
    (rescued,) = tmp_path.glob("glpath-*/part")
    assert f"No space left on device. What is done is kept in {rescued}" in caplog.text
    again = KeptWords(rescued).read("0" * 64, 2, False)
    assert np.array_equal([seen.word for seen in again], words[:2])


def test_words_that_a_full_disk_refused_are_rescued_at_a_signal_during_reflected_light(
    tmp_path: Path, sensors: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file in the temporary folder resumes to the words of a computation without a full disk."""

    def full(path: Path) -> Any:
        if path == part:
            raise ImageError(f"{path}: cannot be written: No space left on device.")
        return whole_file(path)

    def struck(*given: Any) -> Any:
        signal.raise_signal(signal.SIGINT)

    part, whole_file = tmp_path / "y.npz.part", kept_words.whole_file
    options = ("-o", tmp_path / "y.npz", "--points", sensors, "--samples", 2, "--resume")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with monkeypatch.context() as patch:
        patch.setattr(kept_words, "whole_file", full)
        patch.setattr("glpath.apps.daylight.compute._reflecting", struck)
        done = run("daylight", "cornell-box-36", *options)
    assert done.exit_code == 1, done.stderr
    assert not part.exists()
    (rescued,) = tmp_path.glob("glpath-*/y.npz.part")
    assert "glpath: interrupted: no checkpoint could be written\n  to resume: glpath daylight " in done.stderr
    assert f"No space left on device.\n  What is done is kept in {rescued}; move it" in done.stderr
    key = rescued.read_bytes().split(b"\n")[0].decode().split()[-1]
    words = [seen.word for seen in KeptWords(rescued).read(key, 1, False)]
    assert np.array_equal(words, daylight_coefficients("cornell-box-36", AT[:1], UP, **QUICK).words)


def test_failed_checkpoint_of_the_first_scene_does_not_hide_that_of_the_second(
    tmp_path: Path, sensors: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def computed(scene: object, at: object, options: object, checkpoint: DaylightCheckpoint, run: object) -> object:
        if checkpoint.path.name == "y.npz.part":
            checkpoint.failure = "F: cannot be written: the disk is full."
        else:
            checkpoint.path.touch()
            signal.raise_signal(signal.SIGINT)
        return coefficients()

    monkeypatch.setattr("glpath.cli.daylight._computed", computed)
    monkeypatch.setattr("glpath.cli.daylight.year_request", MagicMock())
    options = ("-o", tmp_path / "y.npz", "--points", sensors, "--weather", "a.epw", "--blinds", "cornell-box-36")
    done = run("daylight", "cornell-box-36", *options, "--resume")
    assert done.exit_code == 1, done.stderr
    kept, resume, error, output = done.stderr.splitlines()[-4:]
    assert kept == f"glpath: interrupted: what could be written is in {tmp_path / 'y.blinds.npz.part'}"
    assert resume.startswith("  to resume: glpath daylight ")
    assert error == "glpath: error: F: cannot be written: the disk is full."
    assert output == f"  The coefficients are kept in {tmp_path / 'y.npz'}."


@pytest.mark.parametrize("words", [1, 2])
def test_signal_during_the_last_word_ends_the_computation(words: int, tmp_path: Path) -> None:
    def report(done: int) -> None:
        if done == 32 * words:
            signal.raise_signal(signal.SIGINT)

    rays: Any = MagicMock(transmits=False, count=2)
    rays.see_out.return_value = iter([Seen(np.full(2, 7, np.uint32), None)] * words)
    with pytest.raises(KeyboardInterrupt):
        _words(rays, np.zeros((32 * words, 3)), KeptWords(tmp_path / "part"), "0" * 64, report)
    assert len(KeptWords(tmp_path / "part").read("0" * 64, 2, False)) == words


@pytest.mark.parametrize("at", [1, 3])
def test_chunks_before_a_signal_are_kept_whenever_it_comes(at: int, tmp_path: Path) -> None:
    """It comes while the first or the last of three chunks is reported, and no checkpoint is due."""

    def report(done: int) -> None:
        reported.append(done)
        if done == at:
            signal.raise_signal(signal.SIGINT)

    reported: list[int] = []
    rays: Any = MagicMock(transmits=False, count=2, chunks=3)
    rays.see_out_of_resident.return_value = np.zeros((1, 2), np.uint32), None
    rays.pass_over.return_value = iter([1, 2, 3])
    with pytest.raises(KeyboardInterrupt):
        _words_of_pass(rays, np.zeros((32, 3)), KeptPass.of(tmp_path / "part"), "0" * 64, report)
    done, _ = KeptPass.of(tmp_path / "part").read("0" * 64, (1, 2), 3)
    assert done == reported[-1] > 0


@pytest.mark.parametrize("struck", [True, False])
def test_checkpoint_stays_until_the_year_with_blinds_is_saved(
    struck: bool, tmp_path: Path, sensors: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*given: Any, **options: Any) -> DaylightCoefficients:
        if calls and struck:
            signal.raise_signal(signal.SIGINT)
        if calls:
            raise GlpathError("the second computation fails")
        calls.append(1)
        return daylight_coefficients(*given, **options)

    calls: list[int] = []
    options = ("--points", sensors, "--weather", write_epw(tmp_path / "a.epw"), "--blinds", "cornell-box-36")
    options += ("--samples", 1, "--suns", 8, "--max-depth", 1, "--resume")
    out = tmp_path / "y.npz"
    with monkeypatch.context() as patch:
        patch.setattr("glpath.apps.daylight.compute.daylight_coefficients", fail)
        done = run("daylight", "cornell-box-36", "-o", out, *options)
    assert done.exit_code == (130 if struck else 1), done.stderr
    assert (tmp_path / "y.npz.part").exists()
    assert (f"what is done is in {tmp_path / 'y.npz.part'}" in done.stderr) == struck
    assert run("daylight", "cornell-box-36", "-o", out, *options).exit_code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.epw", "p.csv", "y.npz"]
