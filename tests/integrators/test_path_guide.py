"""Path guiding: what it chooses and how often, and that it changes the error of a picture, not the picture."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from glpath.gl.context import get_context
from glpath.gl.passes import Pass
from glpath.gl.program import load_program
from glpath.gl.texel_store import BYTES, make_store
from glpath.integrators import path_guide
from glpath.integrators.path_guide import guide_nodes, guide_points, path_guide_glsl
from glpath.io import load_scene, scene_from_dict
from glpath.radiosity.mesh import lattice
from glpath.scene import path_traceable

LEVELS, SIDE = 4, 16


def choose(
    nodes: NDArray[np.uint8], u: NDArray[np.float32], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> NDArray[np.float32]:
    """(N, 3): where the shader moves numbers (N, 2) by the first guide, and the density there."""
    gl = get_context().gl
    (folder / "choose.frag").write_text(
        """
        struct LatticePosition { int element; };
        #include "path/path_guide.glsl"
        uniform sampler2D numbers;
        layout(location = 0) out vec4 found;
        void main()
        {
            float density;
            vec2 moved = guided(0, texelFetch(numbers, ivec2(gl_FragCoord.xy), 0).xy, density);
            found = vec4(moved, density, float(guide_at(LatticePosition(0))));
        }
        """
    )
    for name in ("path/path_guide.glsl", "gl/texels.glsl", "gl/fullscreen.vert"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text((Path(glpath.__file__).parent.parent / "shaders" / name).read_text())
    monkeypatch.setattr("glpath.gl.program.shader_folder", lambda: folder)
    tables = {"guide_of": np.array([[[1, 2, 3, 0]]], np.uint8), "guide_node": nodes[0][:, None]}
    texture, uniforms = make_store(gl, BYTES, path_guide._LAYOUT, tables, "test")
    size = (min(len(u), 256), -(-len(u) // 256))
    given = gl.texture(size, 2, data=u.astype("f4").tobytes(), dtype="f4")
    given.filter = (moderngl.NEAREST, moderngl.NEAREST)
    target = gl.texture(size, 4, dtype="f4")
    program = load_program(
        gl,
        vertex="gl/fullscreen.vert",
        fragment="choose.frag",
        generated={"PATH_GUIDE": path_guide_glsl()},
        defines={"GUIDES_SHARED": 1, "GUIDE_LEVELS": LEVELS, "GUIDE_NODES": nodes.shape[1]},
    )
    textures = {"path_guide": texture, "numbers": given}
    Pass("choose", gl, program, gl.framebuffer([target]), textures=textures).run(uniforms)
    return np.frombuffer(target.read(), np.float32).reshape(-1, 4)


def test_a_choice_has_the_density_that_it_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Uniform numbers land in each cell as often as the density says, which is over 0 and sums up to 1."""
    light = np.random.default_rng(5).random((1, SIDE, SIDE)) ** 8
    light[0, 3:5, 7:9] = 200.0
    light[0, 9:, :4] = 0.0
    at = (np.arange(256) + 0.5) / 256
    u = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2).astype(np.float32)
    x, y, density, number = choose(guide_nodes(light), u, tmp_path, monkeypatch).T
    assert set(number) == {1 + 2 * 256 + 3 * 65536}
    assert min(x.min(), y.min()) >= 0
    assert max(x.max(), y.max()) < 1
    found = np.histogram2d(y, x, bins=SIDE, range=((0, 1), (0, 1)))[0] / len(u)
    told, told_of = np.zeros((SIDE, SIDE)), (np.floor(y * SIDE).astype(int), np.floor(x * SIDE).astype(int))
    told[told_of] = density / SIDE**2
    assert (told[found > 0] > 0).all()
    assert told.sum() == pytest.approx(1.0, abs=0.02)  # cells that no number of the grid was moved to are missing
    np.testing.assert_allclose(found, told, atol=2e-3)
    # The bright cells have what they are due, and the dark ones are not forgotten.
    assert found[3:5, 7:9].sum() > 0.3
    assert found[9:, :4].sum() > 0.5 * path_guide._UNGUIDED * 7 * 4 / SIDE**2


def test_without_light_all_directions_are_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    u = np.random.default_rng(1).random((256, 2)).astype(np.float32)
    moved = choose(guide_nodes(np.zeros((1, SIDE, SIDE))), u, tmp_path, monkeypatch)
    np.testing.assert_allclose(moved[:, :2], u, atol=1e-6)
    np.testing.assert_allclose(moved[:, 2], 1.0, atol=1e-6)


def test_parts_of_a_solved_element_share_its_guide() -> None:
    scene = path_traceable(load_scene("cornell-box-36"))
    divisions = np.full(len(scene.triangles), 2, np.int32)
    leaf = np.repeat(np.arange(len(divisions)), 4)
    guide_of, places = guide_points(scene, divisions, leaf)
    np.testing.assert_array_equal(guide_of, leaf)
    assert set(places[5, :, 3]) == {5.0}


@pytest.mark.parametrize("name", ["cornell-box-36", "room"])
def test_places_lie_on_the_elements_of_their_guide(name: str) -> None:
    scene = path_traceable(load_scene(name))
    divisions = np.where(np.arange(len(scene.triangles)) % 3 == 0, 2, 1).astype(np.int32)
    count = int(lattice.element_count(divisions).sum())
    guide_of, places = guide_points(scene, divisions, np.arange(count))
    assert guide_of.shape == (count,)
    assert set(guide_of) == set(range(len(places)))
    most = path_guide._MAX_GUIDES
    assert len(places) == count if count <= most else most // 4 < len(places) <= most
    of_element = np.repeat(np.arange(len(divisions)), divisions**2)
    triangle = places[..., 3].astype(int)
    for guide in range(0, len(places), 7):
        assert set(triangle[guide]) <= set(of_element[guide_of == guide])
    a, b, c = scene.triangles[triangle].transpose(2, 0, 1, 3)
    normal = np.cross(b - a, c - a)
    square = np.einsum("gpi,gpi->gp", normal, normal)
    size = np.sqrt(square)
    points = places[..., :3]
    assert (abs(np.einsum("gpi,gpi->gp", points - a, normal)) < 1e-5 * size * np.sqrt(size)).all()
    for p, q in ((a, b), (b, c), (c, a)):
        weight = np.einsum("gpi,gpi->gp", np.cross(q - p, points - p), normal) / square
        assert (weight > -1e-6).all()
    # Neighbours alone share a guide, with normals of one side of things.
    unit = normal / size[..., None]
    assert (np.einsum("gpi,gi->gp", unit, unit[:, 0]) > 0.3).all()


@pytest.mark.parametrize(
    ("name", "depth", "spp", "least"),
    [
        ("cornell-box-36", None, 32, 1.25),
        ("cornell-box-36", 3, 64, 1.35),
        ("cornell-box-36", 6, 64, 1.35),
        pytest.param("room", None, 16, 1.02, marks=pytest.mark.evidence),
        pytest.param("room", 4, 64, 1.1, marks=pytest.mark.evidence),
    ],
)
def test_a_guided_picture_is_the_same_with_less_error(name: str, depth: int | None, spp: int, least: float) -> None:
    """depth: of path tracing; None: a gather"""
    scene = path_traceable(load_scene(name)).with_camera(resolution=(32, 32))
    if depth is not None:
        options: dict[str, object] = {"max_depth": depth}
    else:
        method = {"method": "monte-carlo", "particles": 400_000} if name == "room" else {"patches": 500}
        options = {"integrator": "gather", "radiosity": glpath.solve_radiosity(scene, **method)}
    pictures, seeds = {}, 4 if name == "room" else 6
    for guide in ("cosine", "solution"):
        options |= {"guide": guide, "spp": spp}
        pictures[guide] = np.array([glpath.render(scene, seed=seed, **options).mean for seed in range(seeds)])
    means = {guide: each.mean(axis=0) for guide, each in pictures.items()}
    errors = {guide: each.var(axis=0, ddof=1) for guide, each in pictures.items()}
    # Of each pixel, and of the whole, beside what so few seeds can tell.
    spread = np.sqrt((errors["cosine"] + errors["solution"]) / seeds).clip(1e-4)
    assert abs((means["solution"] - means["cosine"]) / spread).mean() < 1.3
    assert means["solution"].mean() == pytest.approx(means["cosine"].mean(), rel=1e-2 if name == "room" else 2e-3)
    # Standard errors: the squares of few samples are those of the few brightest.
    relative = {guide: np.sqrt(each / (means["cosine"] ** 2 + 0.01)).mean() for guide, each in errors.items()}
    assert relative["cosine"] > least * relative["solution"]


def test_shared_directions_are_not_guided() -> None:
    with pytest.raises(glpath.UsageError, match=r"guide: 'solution' with cast .path-buffer."):
        glpath.render("cornell-box-36", integrator="gather", cast="path-buffer", guide="solution", spp=1)


def test_a_guided_furnace_is_a_closed_form() -> None:
    """Uniform light at every wall: what guides move about, weights must move back."""
    scene = load_scene("furnace").with_camera(resolution=(16, 16))
    plain, guided = (
        glpath.render(scene, spp=256, max_depth=6, guide=guide).mean for guide in ("cosine", "solution")
    )
    np.testing.assert_allclose(guided.mean(), plain.mean(), rtol=2e-3)
    np.testing.assert_allclose(guided, plain, rtol=0.05)


def test_films_know_whether_their_paths_were_guided(tmp_path: Path) -> None:
    scene = load_scene("cornell-box-36").with_camera(resolution=(16, 16))
    plain, guided = (glpath.render(scene, spp=4, max_depth=2, guide=guide) for guide in ("cosine", "solution"))
    assert "guide" not in plain.metadata.settings
    assert guided.metadata.settings["guide"] == "solution"
    assert "radiosity" not in guided.metadata.settings
    assert guided.metadata.statistics["radiosity_s"] > 0
    with pytest.raises(glpath.UsageError, match="guide"):
        plain.merge(guided)


@pytest.mark.filterwarnings("ignore:The material:glpath.SceneWarning")
def test_a_scene_that_radiosity_cannot_solve_says_so() -> None:
    lamp = {
        "type": "quad",
        "corners": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]],
        "material": "white",
        "emission": {"radiance": [1, 1, 1]},
    }
    scene = scene_from_dict(
        {
            "camera": {"position": [0, 0, 3], "target": [0, 0, 0]},
            "film": {"resolution": [8, 8]},
            "materials": {"white": {"reflectance": 1.0}},
            "shapes": [lamp],
        }
    )
    assert glpath.render(scene, spp=1).mean.max() > 0
    with pytest.raises(glpath.SceneError, match="reflectance"):
        glpath.render(scene, spp=1, guide="solution")
