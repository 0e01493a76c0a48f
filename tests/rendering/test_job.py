"""A job is a render as a value: through JSON and in parts it gives the same bits."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import UsageError
from glpath.film.batches import BLOCK
from glpath.integrators.gather_settings import GatherSettings
from glpath.io import load_scene
from glpath.rendering import RenderJob, run
from glpath.rendering.job import SceneSource
from tests.support.command_line import run as cli
from tests.support.repository import ROOT

BOX = "cornell-box-36"
SMALL: dict[str, Any] = {"resolution": (24, 16), "max_depth": 2}
SCENE = (ROOT / "scenes" / f"{BOX}.toml").read_text()


def test_a_job_gives_the_film_of_the_call_that_it_describes() -> None:
    options = {**SMALL, "spp": 3, "first_path_set": 5, "seed": 2, "crop": (3, 2, 9, 8), "camera": {"fov": 30.0}}
    job, film = RenderJob.of(BOX, **options), glpath.render(BOX, **options)
    again = run(RenderJob.from_json(job.to_json()))
    np.testing.assert_array_equal(again.radiance_sums, film.radiance_sums)
    assert again.ranges == film.ranges == ((5, 8),)
    assert replace(again.metadata, elapsed_s=0) == replace(film.metadata, elapsed_s=0)


@pytest.mark.parametrize("parts", [2, 3, 5, 100])
@pytest.mark.parametrize(("scene", "integrator"), [(BOX, "path"), ("three-spheres", "t-buffer")])
def test_the_films_of_the_parts_merge_into_the_whole_bit_for_bit(scene: str, integrator: str, parts: int) -> None:
    job = RenderJob.of(scene, integrator=integrator, spp=45, first_path_set=3, **SMALL)
    split = job.split(parts)
    assert len(split) == min(parts, 6)
    edges = [part.path_sets for part in split]
    assert (edges[0][0], edges[-1][1]) == (3, 48)
    assert all(a[1] == b[0] and a[1] % BLOCK == 0 for a, b in pairwise(edges))
    assert {part.spp > 0 for part in split} == {True}
    merged = reduce(lambda a, b: a.merge(b), [run(part) for part in reversed(split)])
    whole = run(job)
    np.testing.assert_array_equal(merged.radiance_sums, whole.radiance_sums)
    np.testing.assert_array_equal(merged.batch_counts, whole.batch_counts)
    assert merged.ranges == whole.ranges


def test_a_job_comes_back_from_json_whatever_it_holds(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(SCENE)
    jobs = [
        RenderJob.of(BOX),
        RenderJob.of("stacked", integrator="t-buffer", parameters={"objects": 30}, shadows="cube"),
        RenderJob.of(file, integrator="gather", radiosity=tmp_path / "solution.npz", radiosity_lookup="constant"),
        RenderJob.of(str(file), camera={"position": (0.1, 1 / 3, 4.0)}, ambient=0.1, roulette=3),
        RenderJob.of(load_scene(file), integrator="classic", count_tests=True),
    ]
    assert [job.scene.kind for job in jobs] == ["shipped", "shipped", "file", "file", "memory"]
    assert jobs[1].scene.parameters == {"objects": 30}
    for job in jobs:
        assert RenderJob.from_json(job.to_json()) == job
        job.save(tmp_path / "jobs" / "a.json")
        assert RenderJob.load(tmp_path / "jobs" / "a.json") == job


def test_the_digest_is_that_of_the_scene_without_its_camera() -> None:
    near, far = (RenderJob.of(BOX, camera={"fov": fov}) for fov in (20.0, 60.0))
    assert near.scene == far.scene
    assert near.scene.sha256 == load_scene(BOX).digest(camera=False)
    assert near.sensor != far.sensor


def test_a_scene_that_has_changed_is_refused_by_its_digest(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(SCENE)
    job = RenderJob.of(file, spp=1, **SMALL)
    data = load_scene(file)
    other = replace(data, ambient=np.full(3, 0.25))
    with pytest.raises(glpath.SceneError) as caught:
        run(job, scene=other)
    assert job.scene.sha256 in str(caught.value)
    assert other.digest(camera=False) in str(caught.value)
    # The camera is the job's: another one in the file changes nothing, another lamp does.
    file.write_text(SCENE.replace("fov = ", "fov = 1"))
    np.testing.assert_array_equal(run(job).mean, run(job, scene=data).mean)
    file.write_text(SCENE.replace("radiance = [", "radiance = [1", 1))
    assert file.read_text() != SCENE
    with pytest.raises(glpath.SceneError, match=job.scene.sha256):
        run(job)


def test_a_scene_in_memory_is_handed_in() -> None:
    scene = load_scene(BOX)
    job = RenderJob.from_json(RenderJob.of(scene, spp=2, **SMALL).to_json())
    with pytest.raises(glpath.UsageError, match="made in memory"):
        run(job)
    np.testing.assert_array_equal(run(job, scene=scene).mean, glpath.render(BOX, spp=2, **SMALL).mean)


def test_a_solution_in_memory_has_no_place_in_json() -> None:
    solution = glpath.solve_radiosity(BOX, method="monte-carlo", patches=50, particles=4096)
    job = RenderJob.of(BOX, integrator=GatherSettings(radiosity=solution))
    with pytest.raises(glpath.UsageError, match="Save it"):
        job.to_json()


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (["format"], "film", "film of version 1"),
        (["version"], 7, "version 7"),
        (["integrator", "name"], "bdpt", "allowed are path, path-buffer, gather, classic, t-buffer"),
        (["integrator", "max_depth"], 0, "max_depth: 0 where a whole number from 1"),
        (["integrator", "speed"], 9, "setting of path: 'speed'; allowed are seed, aovs"),
        (["integrator", "guide"], "cone", "allowed are solution, cosine"),
        (["sensor", "type"], "lightmap", "sensor"),
        (["sensor", "fov"], 190.0, "fov"),
        (["sensor", "resolution"], [0, 4], "resolution"),
        (["window"], [0, 0, 99, 4], "window: 99 x 4 pixels"),
        (["path_sets"], [4, 4], "path_sets"),
        (["path_sets"], [-1, 4], "path_sets"),
        (["scene"], {"kind": "file"}, "name"),
        (["colour"], 1, "colour"),
    ],
)
def test_a_broken_job_is_refused_with_its_place(tmp_path: Path, path: list[str], value: Any, words: str) -> None:
    data = json.loads(RenderJob.of(BOX, **SMALL).to_json())
    table = data
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    file = tmp_path / "job.json"
    file.write_text(json.dumps(data))
    with pytest.raises(glpath.GlpathError) as caught:
        RenderJob.load(file)
    assert str(caught.value).startswith(str(file))
    assert words in str(caught.value)


def test_no_job_is_no_traceback(tmp_path: Path) -> None:
    for text in ("", "{", "[]", "null"):
        with pytest.raises(glpath.UsageError, match="is not a render job"):
            RenderJob.from_json(text)
    with pytest.raises(glpath.UsageError, match="cannot be read"):
        RenderJob.load(tmp_path / "nothing.json")


def test_a_source_says_what_it_is() -> None:
    scene = load_scene(BOX)
    assert SceneSource.of(BOX, scene, None).kind == "shipped"
    assert SceneSource.of(Path("a.toml"), scene, None) == SceneSource(
        "file", str(Path("a.toml").resolve()), scene.digest(camera=False)
    )


def test_the_command_line_renders_a_job_file(tmp_path: Path) -> None:
    job = RenderJob.of(BOX, spp=16, **SMALL)
    for i, part in enumerate(job.split(2)):
        part.save(tmp_path / f"{i}.json")
        result = cli("render", "--job", tmp_path / f"{i}.json", "-o", tmp_path / f"{i}.npz", "-q")
        assert result.exit_code == 0, result.stderr
    films = [glpath.Film.load(tmp_path / f"{i}.npz") for i in range(2)]
    np.testing.assert_array_equal(films[1].merge(films[0]).radiance_sums, run(job).radiance_sums)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([BOX], "SCENE beside --job"),
        (["--spp", "4"], "--spp beside --job"),
        (["--seed", "0"], "--seed beside --job"),
        (["--shadows", "cube"], "--shadows beside --job"),
        (["--crop", "0,0,4,4"], "--crop beside --job"),
    ],
)
def test_a_job_says_all_of_the_image(tmp_path: Path, arguments: list[str], words: str) -> None:
    RenderJob.of(BOX, spp=1).save(tmp_path / "a.json")
    result = cli("render", *arguments, "--job", tmp_path / "a.json", "-o", tmp_path / "a.npz")
    assert (result.exit_code, words in result.stderr) == (2, True), result.stderr
    assert not (tmp_path / "a.npz").exists()


def test_without_scene_and_job_the_usage_is_wrong(tmp_path: Path) -> None:
    result = cli("render", "-o", tmp_path / "a.png")
    assert (result.exit_code, "no SCENE and no --job" in result.stderr) == (2, True)


def test_info_prints_the_digest_that_a_job_goes_by() -> None:
    digest = RenderJob.of(BOX).scene.sha256
    assert f"sha256:{digest}" in cli("info", BOX).stdout
    assert json.loads(cli("info", BOX, "--json").stdout)["content_sha256"] == digest


@pytest.mark.parametrize("path", [None, 5, "a\0b", "\ud800", 2**63, b"a"], ids=ascii)
def test_a_job_needs_a_path(path: Any) -> None:
    with pytest.raises(UsageError, match=r"^path: "):
        RenderJob.load(path)
    with pytest.raises(UsageError, match=r"^path: "):
        RenderJob.of(BOX, spp=1).save(path)


@pytest.mark.parametrize("text", [None, b"{}", "\ud800"], ids=ascii)
def test_a_job_needs_text(text: Any) -> None:
    with pytest.raises(UsageError):
        RenderJob.from_json(text)
