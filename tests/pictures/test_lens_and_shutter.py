"""What cameras see by every engine: parallel rays, all around, out of focus, and while something moves.

Witnesses: closed forms, still renders of the same times, Camera.rays in numpy, and Mitsuba.
"""

from __future__ import annotations

import functools
import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.buffers.t_buffer import ClassicEye, TBuffer
from glpath.compare import relative_mse
from glpath.errors import SceneError, SceneWarning, UsageError
from glpath.film.film import Film
from glpath.gl.camera import eye_uniforms
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.emitter_silhouettes import EmitterSilhouettes
from glpath.integrators.path_settings import PathSettings
from glpath.integrators.ray_paths import RayPathEngine
from glpath.io.load import scene_from_dict
from glpath.rendering import RenderJob, run
from glpath.sampling.points import PathSetSampler
from glpath.scene import check_scene, path_traceable
from glpath.scene.model import Scene
from glpath.scene.motion import Motion
from tests.support.command_line import run as command
from tests.support.engines import coarse, engine_options
from tests.support.gltf_files import Gltf

FLOOR = {"type": "quad", "corners": [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]]}
#: Glows alike all over, so that what is seen of it is its silhouette.
GLOW = {"emission": {"radiance": 1.0, "two_sided": True}}
PATH: list[dict[str, Any]] = [{"integrator": "path", "max_depth": 1}, {"integrator": "path-buffer", "max_depth": 1}]
RAYS: list[dict[str, Any]] = [{"integrator": "t-buffer"}, {"integrator": "classic"}]
NAMES = ["path", "pair", "t-buffer", "classic"]


def strip(left: float, right: float, depth: float = 0.0, **fields: Any) -> dict[str, Any]:
    """A glowing strip, upright, from x to x."""
    corners = [[left, -9, depth], [right, -9, depth], [right, 9, depth], [left, 9, depth]]
    return {"type": "quad", "corners": corners, **GLOW, **fields}


def scene_of(
    camera: dict[str, Any], *shapes: dict[str, Any], size: tuple[int, int] = (64, 4), **more: Any
) -> Scene:
    whole = {"position": [0, 0, 4], "target": [0, 0, 0], **camera}
    black = {"default": {"reflectance": 0.0}}
    film = {"resolution": size}
    return glpath.load_scene({"camera": whole, "film": film, "materials": black, "shapes": list(shapes), **more})


def profile(scene: Scene, options: dict[str, Any], spp: int = 256) -> np.ndarray:
    """(W,) radiance along the image, the mean over its height."""
    return np.asarray(glpath.render(scene, spp=spp, **options).mean[..., 1].mean(axis=0))


# ---- closed forms


@pytest.mark.parametrize("options", [*PATH, *RAYS], ids=NAMES)
def test_parallel_rays_show_a_thing_as_wide_as_it_is_at_any_distance(options: dict[str, Any]) -> None:
    for depth in (0.0, -30.0):
        scene = scene_of({"type": "orthographic", "height": 0.25}, strip(-1.1, 0.4, depth))
        pixel = 0.25 / 4
        found = profile(scene, options)
        left = 64 / 2 * pixel
        assert found.sum() * pixel == pytest.approx(1.5, abs=0.005)
        # Of the pixel in which it ends, the share that it covers.
        edges = np.clip((0.4 + left) / pixel - np.arange(64), 0, 1) - np.clip(
            (-1.1 + left) / pixel - np.arange(64), 0, 1
        )
        assert np.abs(found - edges).max() < 0.05


def test_what_is_behind_the_plane_of_parallel_rays_is_not_seen() -> None:
    for options in (*PATH, *RAYS):
        scene = scene_of({"type": "orthographic", "height": 1.0}, strip(-9, 0.0, 4.5), strip(0.0, 9, 3.5))
        found = profile(scene, options, spp=8)
        assert found[:31].max() == 0
        assert found[33:].min() == pytest.approx(1)


@pytest.mark.parametrize("split", [1, 1 << 20], ids=["small ones apart", "all drawn"])
@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("three-spheres", {}),
        ("stacked", {"objects": 400, "kind": "triangle", "ground": True}),
        ("stacked", {"objects": 300}),
        ("cornell-box", {}),
    ],
)
def test_a_t_buffer_by_parallel_rays_has_the_bits_of_the_classical_algorithm(
    name: str, parameters: dict[str, object], split: int
) -> None:
    gl, size, rng = get_context().gl, (97, 61), np.random.default_rng(1)
    scene = glpath.load_scene(name, parameters)
    far = float(np.linalg.norm(scene.camera.target - scene.camera.position))
    for step, height in enumerate((0.3 * far, 0.8 * far, 2.0 * far)):
        # In the last, the plane where rays start goes through the scene.
        position = scene.camera.position + 0.1 * far * step * rng.normal(size=3)
        position = position + (0.5 * step * (scene.camera.target - position) if step == 2 else 0.0) * 0.9
        camera = replace(scene.camera, projection="orthographic", height=height, resolution=size, position=position)
        objects, eye = DeviceScene(gl, replace(scene, camera=camera)), eye_uniforms(camera, pixel=(0.3, 0.8))
        buffers = ClassicEye(gl, objects, size), TBuffer(gl, objects, size, split_from=split)
        for buffer in buffers:
            buffer.fill(eye)
        (primitive, t), (found, u) = (buffer.read() for buffer in buffers)
        assert np.array_equal(primitive, found)
        assert np.array_equal(t, u)
        assert (primitive >= 0).any()


@pytest.mark.parametrize("options", [*PATH, *RAYS], ids=NAMES)
@pytest.mark.parametrize("depth", [-4.0, 1.5])
def test_the_circle_of_confusion_is_as_large_as_a_thin_lens_makes_it(options: dict[str, Any], depth: float) -> None:
    """A half plane's edge, out of focus: the share of a disk on one side of a line, by similar triangles."""
    focus, radius, fov = 4.0, 0.4, 10.0
    camera = {"fov": fov, "aperture_radius": radius, "focus_distance": focus}
    scene = scene_of(camera, strip(0.0, 90, depth), size=(64, 16))
    found = profile(scene, options, 1024)
    away = 4.0 - depth
    focal = 16 / (2 * np.tan(np.radians(fov / 2)))
    confusion = focal * radius * abs(1 / away - 1 / focus)  # radius, pixels
    x = np.clip((np.arange(64) + 0.5 - 32) / confusion, -1, 1)
    share = 0.5 + (x * np.sqrt(1 - x * x) + np.arcsin(x)) / np.pi
    assert confusion > 4
    assert np.abs(found - share).max() < 0.02


@pytest.mark.parametrize("options", [*PATH, *RAYS], ids=NAMES)
def test_what_lies_in_focus_is_as_sharp_as_by_a_pinhole(options: dict[str, Any]) -> None:
    shapes = [strip(-1.1, 0.43)]
    sharp = profile(scene_of({}, *shapes), options)
    lens = profile(scene_of({"aperture_radius": 0.5}, *shapes), options)
    assert np.abs(sharp - lens).max() < 0.02
    far = profile(scene_of({"aperture_radius": 0.5, "focus_distance": 8.0}, *shapes, size=(64, 16)), options)
    assert np.count_nonzero((far > 0.02) & (far < 0.98)) > 4


@pytest.mark.parametrize("options", [*PATH, *RAYS], ids=NAMES)
@pytest.mark.parametrize("what", ["object", "camera"])
def test_a_bright_edge_that_moves_is_a_ramp(options: dict[str, Any], what: str) -> None:
    """At one speed past the pixels, each is bright for a time that grows evenly along its way."""
    way = 2.0
    motion = [{"time": 0.0}, {"time": 2.0, "transform": [{"translate": [2 * way, 0, 0]}]}]
    camera: dict[str, Any] = {"shutter": [0.5, 1.5], "fov": 7.15}
    shape = strip(-9, -2.0, motion=motion) if what == "object" else strip(-9, 0)
    if what == "camera":
        keys = [(0.0, 2.0), (2.0, 2.0 - 2 * way)]
        camera["motion"] = [{"time": t, "position": [x, 0, 4], "target": [x, 0, 0]} for t, x in keys]
    sets = 64 if options["integrator"] in ("t-buffer", "classic") else 256
    found = profile(scene_of(camera, shape), options, sets)
    pixel = 2 * 4 * np.tan(np.radians(7.15) / 2) / 4
    x = (np.arange(64) + 0.5 - 32) * pixel
    ramp = np.clip((1.0 - x) / way, 0, 1)
    assert np.abs(found - ramp).max() < 4 / sets  # each set has one time, so that the ramp has so many steps
    assert np.count_nonzero((ramp > 0) & (ramp < 1)) > 10


@pytest.mark.parametrize("options", [*PATH, RAYS[1]], ids=["path", "pair", "classic"])
def test_a_panorama_sees_what_its_rays_do(options: dict[str, Any]) -> None:
    """Against the sky along Camera.rays, and a box all around that shines in six colours."""
    environment = {"zenith": [0, 0, 1], "horizon": [1, 0, 0]}
    faces = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = 3 * side
            corners[:, (axis + 1) % 3] = [-1, 1, 1, -1]
            corners[:, (axis + 2) % 3] = [-1, -1, 1, 1]
            colour = [0.2 + 0.3 * axis, 0.5 + 0.4 * side, 0.3]
            faces.append(
                {"type": "quad", "corners": corners.tolist(), "emission": {"radiance": colour, "two_sided": True}}
            )
    camera = {"type": "panorama", "position": [0.2, -0.1, 0.3], "target": [1, 0.4, -2], "up": [0.1, 1, 0]}
    scene = scene_of(camera, *faces, size=(96, 48), sky=environment)
    found = glpath.render(scene, spp=64, **options).mean
    # Four by four rays a pixel, in numpy.
    fine = replace(scene.camera, resolution=(4 * 96, 4 * 48))
    rays, eye = fine.rays(), fine.position
    expected = scene.sky.radiance(rays)  # type: ignore[union-attr]
    for face in faces:
        corners = np.array(face["corners"])
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((corners[0] - eye) @ normal) / (rays @ normal)
        hit = eye + t[..., None] * rays
        flat = np.abs(normal) > 0
        inside = (t > 0) & np.all(flat | (np.abs(hit) <= 1), axis=-1)
        expected[inside] = face["emission"]["radiance"]
    expected = expected.reshape(48, 4, 96, 4, 3).mean(axis=(1, 3))
    assert np.abs(found - expected).mean() < 0.006
    assert relative_mse(found, expected) < 1e-3


# ---- what moves, against still renders of the same times

MOVING: dict[str, Any] = {
    "camera": {"position": [0, 1.0, 4], "target": [0, 0.5, 0], "fov": 35, "shutter": [0, 1]},
    "film": {"resolution": [48, 32]},
    "materials": {"floor": {"reflectance": 0.6}, "red": {"reflectance": [0.7, 0.2, 0.1]}},
    "sky": {"zenith": 0.4, "horizon": 0.4},
    "shapes": [
        FLOOR | {"material": "floor"},
        {
            "type": "sphere",
            "center": [-0.8, 0.4, 0],
            "radius": 0.3,
            "material": "red",
            "subdivisions": 3,
            "motion": [{"time": 0}, {"time": 1, "transform": [{"translate": [0.8, 0.2, 0]}]}],
        },
        {
            "type": "box",
            "min": [0.5, 0.2, -0.2],
            "max": [0.9, 0.6, 0.2],
            "material": "red",
            "motion": [
                {"time": 0.2},
                {
                    "time": 1,
                    "transform": [
                        {"translate": [-0.7, -0.4, 0]},
                        {"rotate": {"axis": [0, 0, 1], "angle": 80}},
                        {"translate": [0.7, 0.4, 0]},
                    ],
                },
            ],
        },
        {
            "type": "quad",
            "corners": [[-0.3, 1.6, -0.3], [0.3, 1.6, -0.3], [0.3, 1.6, 0.3], [-0.3, 1.6, 0.3]],
            "emission": {"radiance": 12, "two_sided": True},
            "motion": [{"time": 0}, {"time": 1, "transform": [{"translate": [1.2, 0, 0]}]}],
        },
    ],
}


@pytest.mark.filterwarnings("ignore:.*lost the roulette:glpath.SceneWarning")
@pytest.mark.parametrize(
    "options",
    [
        {"max_depth": 3},
        {"max_depth": 3, "integrator": "path-buffer"},
        {"integrator": "t-buffer", "shadows": "cube"},
    ],
    ids=["path", "pair", "t-buffer"],
)
def test_a_path_set_is_that_of_the_scene_as_it_stands_at_its_time(
    options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Where lamps end, still scenes have rays more, which moving ones do without.
    monkeypatch.setattr(EmitterSilhouettes, "are_in", staticmethod(lambda scene: False))
    if "shadows" in options:
        options = options | {"shadow_resolution": 128}
    scene, sampler, sets = glpath.load_scene(MOVING), PathSetSampler(0, 3), range(3, 7)
    assert scene.moving_shapes == (1, 2, 3)
    found = glpath.render(scene, spp=len(sets), first_path_set=sets.start, **options).mean
    stills = [
        glpath.render(scene.at(float(sampler.eye(i)[2])), spp=1, first_path_set=i, **options).mean for i in sets
    ]
    # Ties between boxes of another tree may fall otherwise; the device's arithmetic is the same.
    assert np.isclose(found, np.mean(stills, axis=0), rtol=1e-5, atol=1e-6).mean() > 0.999
    assert np.abs(stills[0] - stills[1]).max() > 0.01


@pytest.mark.filterwarnings("ignore:.*lost the roulette:glpath.SceneWarning")
@pytest.mark.parametrize(
    "options", [{"max_depth": 2}, {"max_depth": 2, "integrator": "path-buffer"}, RAYS[0]], ids=NAMES[:3]
)
def test_parts_of_a_render_of_what_moves_merge_to_its_bits(options: dict[str, Any]) -> None:
    camera = MOVING["camera"] | {"aperture_radius": 0.1}
    camera["motion"] = [{"time": 0}, {"time": 1, "position": [0.3, 1.2, 4]}]
    scene = glpath.load_scene(MOVING | {"camera": camera})
    whole = glpath.render(scene, spp=24, **options)
    parts = [glpath.render(scene, spp=n, first_path_set=m, **options) for m, n in ((0, 8), (8, 16))]
    assert np.array_equal(parts[0].merge(parts[1]).radiance_sums, whole.radiance_sums)


def test_a_moving_lamp_a_still_shutter_and_the_digest() -> None:
    scene = glpath.load_scene(MOVING)
    frozen = scene.with_camera(shutter=(0.5, 0.5))
    assert not frozen.moving_shapes
    film = glpath.render(frozen, spp=4, max_depth=2)
    assert np.array_equal(film.mean, glpath.render(scene.at(0.5), spp=4, max_depth=2).mean)
    assert scene.digest(camera=False) == frozen.digest(camera=False) != scene.at().digest(camera=False)
    assert scene.digest() != frozen.digest()


def test_a_shape_that_is_added_moves_as_well() -> None:
    motion = [{"time": 0}, {"time": 1, "transform": [{"translate": [4, 0, 0]}]}]
    scene = scene_of({"shutter": [0.25, 0.5]}, strip(0, 1)).add(strip(0, 1, motion=motion))
    assert scene.moving_shapes == (1,)
    assert scene.bounds[1][0] == pytest.approx(2)
    assert scene.at(0.5).bounds[1][0] == pytest.approx(3)


def test_the_picture_of_a_solution_has_the_camera_of_its_scene() -> None:
    """What numba's rays meet, against what the classical algorithm's do."""
    from glpath.radiosity.picture import EyeHits

    scene, gl = glpath.load_scene("cornell-box-36"), get_context().gl
    for kind, size in (("orthographic", (40, 30)), ("panorama", (40, 20))):
        seen = scene.with_camera(projection=kind, height=2.4, resolution=size)
        if kind == "panorama":
            seen = seen.with_camera(position=np.array([0.1, 0.2, 0.3]))
        buffer = ClassicEye(gl, DeviceScene(gl, seen), size)
        buffer.fill(eye_uniforms(seen.camera))
        primitive, _ = buffer.read()
        assert np.mean(EyeHits.of(seen, 1).triangle[..., 0] == primitive) > 0.98  # an edge may fall to either side
        assert (primitive >= 0).mean() > 0.3


def test_a_shutter_that_sees_no_motion_and_an_odd_panorama_are_warned_of() -> None:
    scene = glpath.load_scene(MOVING)
    assert check_scene(scene) == []
    (text,) = check_scene(scene.with_camera(shutter=(0.0, 0.0)))
    assert "motion (sphere-1, box-2, quad-3), but the shutter opens for the moment 0 alone" in text
    assert check_scene(scene.with_camera(shutter=(0.5, 0.5))) == []
    (text,) = check_scene(scene.with_camera(projection="panorama", resolution=(64, 64)))
    assert "The panorama has 64 x 64 pixels" in text


@pytest.mark.parametrize("engine", ["path", "pair"])
def test_aovs_are_out_of_focus_and_blurred_as_the_picture_is(engine: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """What glows with radiance 1 has the albedo 1, all else 0: the AOV is the picture."""
    # Where lamps end, the picture has more rays than the AOV.
    monkeypatch.setattr(EmitterSilhouettes, "are_in", staticmethod(lambda scene: False))
    motion = [{"time": 0}, {"time": 1, "transform": [{"translate": [1, 0, 0]}]}]
    for camera in (
        {"fov": 10.0, "aperture_radius": 0.4, "shutter": [0, 1]},
        {"type": "orthographic", "height": 0.5},
        {"type": "panorama"},
    ):
        scene = scene_of(camera, strip(-1, 0.2, -4, motion=motion), size=(64, 32))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # of the moment 0
            film = glpath.render(scene, spp=16, max_depth=1, aovs=("albedo", "normal"), **engine_options(engine))
        assert np.allclose(film.aov("albedo"), film.mean, atol=1e-5)
        assert np.allclose(film.aov("normal")[..., 2], film.mean[..., 0], atol=1e-5)
        assert 0.005 < film.mean.mean() < 0.98


def test_the_compute_shader_of_graphics_cards_has_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = path_traceable(glpath.load_scene(MOVING | {"camera": MOVING["camera"] | {"aperture_radius": 0.2}}))
    context, films = get_context(), []
    for hardware in (False, True):
        monkeypatch.setattr(context, "info", replace(context.info, hardware=hardware))
        engine = RayPathEngine(
            context.gl,
            DeviceScene(context.gl, scene),
            PathSettings(max_depth=2),
            (0, 0, 48, 32),
        ).prepare()
        for index in range(3):
            engine.trace_path_set(index)
        films.append(engine.take())
    assert np.array_equal(*films)
    assert films[0].max() > 0


# ---- refusals


def test_a_gather_refuses_what_moves_by_name_but_not_a_camera_that_does() -> None:
    scene = glpath.load_scene(MOVING)
    with pytest.raises(SceneError, match=r"sphere-1, box-2, quad-3 move while the shutter is open.*one moment"):
        glpath.render(scene, integrator="gather", spp=1)
    camera = MOVING["camera"] | {"motion": [{"time": 0}, {"time": 1, "position": [0.3, 1.2, 4]}]}
    still = [shape | {"motion": []} for shape in MOVING["shapes"]]
    scene = glpath.load_scene(MOVING | {"camera": camera, "shapes": still})
    film = glpath.render(scene, integrator="gather", radiosity=coarse(scene), spp=4)
    assert film.mean.max() > 0


def test_a_t_buffer_says_which_camera_it_has_not() -> None:
    scene = glpath.load_scene(MOVING).with_camera(projection="panorama", resolution=(8, 4))
    with pytest.raises(SceneError, match="a camera of type panorama; a T-buffer"):
        glpath.render(scene, integrator="t-buffer", spp=1)


def test_a_lamp_that_grows_is_refused() -> None:
    growing = [{"time": 0}, {"time": 1, "transform": [{"scale": 2.0}]}]
    shapes = [MOVING["shapes"][0], MOVING["shapes"][3] | {"motion": growing}]
    with pytest.raises(SceneError, match='"quad-1" emits, and changes its size'):
        glpath.render(MOVING | {"shapes": shapes}, spp=1)


@pytest.mark.parametrize(
    ("motion", "told"),
    [
        ([{"time": 1}, {"time": 0}], r"\[1\]\[\"time\"\] is 0, but must be above 1"),
        ([{"time": 0, "transform": [{"scale": [-1, 1, 1]}]}], r"\[\"transform\"\] mirrors"),
        ([{"time": 0, "transform": [{"scale": 0}]}], "without a zero"),
        ([{"transform": []}], "lacks the field `time`"),
    ],
)
def test_keys_that_cannot_be_are_told_with_their_place(motion: list[dict[str, Any]], told: str) -> None:
    with pytest.raises(SceneError, match=told):
        scene_of({}, strip(0, 1, motion=motion))


# ---- motion itself


def test_a_motion_turns_at_one_speed_and_goes_straight() -> None:
    def turn(degrees: float) -> np.ndarray:
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])

    first, last = np.column_stack([2.0 * turn(10), [0, 0, 0]]), np.column_stack([4.0 * turn(170), [6, 0, 0]])
    motion = Motion(np.array([1.0, 3.0]), np.array([first, last]), np.eye(3, 4)[None])
    assert np.allclose(motion.map_at(1.5), np.column_stack([2.5 * turn(50), [1.5, 0, 0]]))
    assert np.allclose(motion.map_at(0), first)
    assert np.allclose(motion.map_at(9), last)
    assert motion.moves_within(0, 2)
    assert not motion.moves_within(3, 4)
    half = Motion(
        np.array([0.0, 1.0]), np.array([np.eye(3, 4), np.column_stack([turn(180), np.zeros(3)])]), motion.placed
    )
    found = half.map_at(0.5)[:, :3]
    assert np.allclose(found, turn(90)) or np.allclose(found, turn(-90))


# ---- jobs and files


def test_a_job_keeps_all_of_a_camera_and_reads_those_of_before() -> None:
    camera = {"aperture_radius": 0.2, "focus_distance": 3.0, "shutter": [0, 2]}
    camera["motion"] = [{"time": 0}, {"time": 1.5, "position": [1, 0, 4]}]
    scene = scene_of(camera, strip(0, 1), size=(8, 8))
    job = RenderJob.of(scene, spp=8, max_depth=1)
    text = job.to_json()
    again = RenderJob.from_json(text)
    assert again == job
    assert np.array_equal(run(again, scene=scene).mean, glpath.render(scene, spp=8, max_depth=1).mean)
    plain = json.loads(RenderJob.of(scene_of({}, strip(0, 1)), spp=1).to_json())["sensor"]
    assert set(plain) == {"type", "position", "target", "up", "fov", "resolution"}


def test_a_camera_is_replaced_by_options_and_then_stands_still(tmp_path: Path) -> None:
    camera = {"shutter": [0, 1], "motion": [{"time": 0}, {"time": 1, "position": [1, 0, 4]}]}
    scene = scene_of(camera, strip(0, 1), size=(8, 8))
    changed = RenderJob.of(scene, spp=1, camera={"aperture_radius": 0.1, "shutter": (0, 0.5)}).sensor
    assert changed.aperture_radius == 0.1
    assert changed.camera.moves
    still = RenderJob.of(scene, spp=1, camera={"position": (0, 0, 5), "type": "orthographic", "height": 2}).sensor
    assert not still.motion
    assert (still.projection, still.height) == ("orthographic", 2.0)
    with pytest.raises(UsageError, match="camera type: 'fisheye'; allowed are perspective"):
        RenderJob.of(scene, spp=1, camera={"type": "fisheye"})


def test_the_command_line_has_the_camera_and_tells_of_it(tmp_path: Path) -> None:
    scene, small = "cornell-box-36", ("--spp", 1, "--max-depth", 1, "--quiet")
    lens = ("--camera-aperture-radius", 0.2, "--camera-focus-distance", 3, "--camera-shutter", "0,0.5")
    assert command("render", scene, "-o", tmp_path / "a.npz", "--resolution", "16x8", *small, *lens).exit_code == 0
    expected = glpath.render(
        scene,
        spp=1,
        max_depth=1,
        resolution=(16, 8),
        camera={"aperture_radius": 0.2, "focus_distance": 3.0, "shutter": (0, 0.5)},
    )
    assert np.array_equal(Film.load(tmp_path / "a.npz").mean, expected.mean)
    panorama = ("--camera-type", "panorama", "--resolution", "16x8")
    assert command("render", scene, "-o", tmp_path / "b.npz", *panorama, *small).exit_code == 0
    for option, value, told in (
        ("--camera-height", 0, "--camera-height is 0, but must be above 0"),
        ("--camera-aperture-radius", -1, "--camera-aperture-radius is -1, but must be 0 or more"),
        ("--camera-shutter", "1,0", "--camera-shutter is 1,0, but must be two finite numbers"),
        ("--camera-shutter", "1", "--camera-shutter 1: expected T,T"),
        ("--camera-type", "fisheye", "camera type: 'fisheye'; allowed are perspective"),
    ):
        found = command("render", scene, "-o", tmp_path / "c.npz", *small, option, value)
        assert found.exit_code != 0
        assert told in " ".join(found.output.split())
    (tmp_path / "d.toml").write_text(
        '[camera]\ntype = "orthographic"\nheight = 2\nposition = [0, 0, 4]\ntarget = [0, 0, 0]\nshutter = [0, 1]\n'
        '[[shapes]]\ntype = "sphere"\nradius = 1\nname = "ball"\n'
        "motion = [{ time = 0 }, { time = 1, transform = [{ scale = 2 }] }]\n"
    )
    told = command("info", tmp_path / "d.toml").output
    assert "2 high, by parallel rays" in told
    assert "from 0 to 1 s; what moves: ball" in told


# ---- Mitsuba

BOX: dict[str, Any] = {
    "camera": {"position": [0, 1, 3.4], "target": [0, 1, 0], "fov": 39},
    "film": {"resolution": [64, 64]},
    "materials": {"white": {"reflectance": 0.7}, "red": {"reflectance": [0.6, 0.06, 0.05]}},
    "shapes": [
        {"type": "box", "min": [-1, 0, -1], "max": [1, 2, 3.6], "flip_normals": True, "material": "white"},
        {"type": "box", "min": [-0.7, 0, 0.9], "max": [-0.3, 1.1, 1.3], "material": "red"},
        {"type": "box", "min": [0.2, 0, -0.8], "max": [0.7, 0.7, -0.3], "material": "red"},
        {
            "type": "quad",
            "corners": [[-0.4, 1.98, -0.4], [0.4, 1.98, -0.4], [0.4, 1.98, 0.4], [-0.4, 1.98, 0.4]],
            "emission": {"radiance": 12},
        },
    ],
}


def a_moving_scene() -> Scene:
    way = [
        {"translate": [0.5, 0.0, -1.1]},
        {"rotate": {"axis": [0, 0, 1], "angle": 20}},
        {"translate": [0, 0.2, 1.1]},
    ]
    shapes = [dict(shape) for shape in BOX["shapes"]]
    shapes[1]["motion"] = [{"time": 0}, {"time": 1, "transform": way}]
    keys = [{"time": 0}, {"time": 1, "position": [0.2, 1.1, 3.4]}]
    return glpath.load_scene(
        BOX | {"camera": BOX["camera"] | {"shutter": [0, 1], "motion": keys}, "shapes": shapes}
    )


@functools.cache
def stills_of_mitsuba() -> list[Any]:
    """Mitsuba 3 has no motion blur: 64 renders, each in the middle of its part of the time; of two seeds."""
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    from benchmarks.peers.mitsuba import render_mitsuba

    scene, times = a_moving_scene(), (np.arange(64) + 0.5) / 64
    return [
        np.mean([render_mitsuba(scene.at(t), 8, 3, seed=100 * s + i) for i, t in enumerate(times)], axis=0)
        for s in (1, 2)
    ]


@pytest.mark.evidence
@pytest.mark.parametrize("engine", ["path", "pair"])
def test_what_moves_is_the_mean_of_mitsubas_stills(engine: Any) -> None:
    theirs, scene = stills_of_mitsuba(), a_moving_scene()
    ours = [glpath.render(scene, spp=512, max_depth=3, **engine_options(engine), seed=seed).mean for seed in (1, 2)]
    assert np.mean(ours) == pytest.approx(np.mean(theirs), rel=0.005)
    floor = relative_mse(ours[0], ours[1]) + relative_mse(theirs[0], theirs[1])
    found = relative_mse(ours[0], theirs[0])
    print(f"{engine}: relMSE {found:.2e}, between seeds {floor:.2e}, mean {np.mean(ours) / np.mean(theirs):.5f}")
    assert found < 0.65 * floor  # of two pictures alike in noise it is the half


def a_scene_through(kind: str) -> Scene:
    changes = {
        "orthographic": {"type": "orthographic", "height": 1.9},
        "lens": {"fov": 39, "aperture_radius": 0.15},
    }
    camera = {k: v for k, v in BOX["camera"].items() if k != "fov"} | changes[kind]
    return glpath.load_scene(BOX | {"camera": camera})


@functools.cache
def pictures_of_mitsuba(kind: str) -> list[Any]:
    pytest.importorskip("mitsuba", reason="needs the reference extra")
    from benchmarks.peers.mitsuba import render_mitsuba

    return [render_mitsuba(a_scene_through(kind), 512, 3, seed=seed) for seed in (1, 2)]


@pytest.mark.evidence
@pytest.mark.parametrize("engine", ["path", "pair"])
@pytest.mark.parametrize("kind", ["orthographic", "lens"])
def test_mitsuba_sees_the_same_through_the_same_camera(kind: str, engine: Any) -> None:
    theirs, scene = pictures_of_mitsuba(kind), a_scene_through(kind)
    ours = [glpath.render(scene, spp=512, max_depth=3, **engine_options(engine), seed=seed).mean for seed in (1, 2)]
    assert np.mean(ours) == pytest.approx(np.mean(theirs), rel=0.005)
    floor = relative_mse(ours[0], ours[1]) + relative_mse(theirs[0], theirs[1])
    found = relative_mse(ours[0], theirs[0])
    print(f"{kind} {engine}: relMSE {found:.2e}, {floor:.2e}, mean {np.mean(ours) / np.mean(theirs):.5f}")
    assert found < 0.65 * floor


# ---- glTF, and files for other programs


def animated(tmp_path: Path, parent_turns: bool = False) -> Path:
    """A triangle that goes from x = 0 to 4 within two seconds, beside one that stays, seen by parallel rays."""
    file = Gltf()
    mesh = file.mesh(material=file.add("materials", doubleSided=True))
    moving = file.node(mesh=mesh, name="moving", scale=[2, 2, 2])
    stays = file.node(mesh=mesh, translation=[0, -2, 0])
    lens = file.add("cameras", type="orthographic", orthographic={"xmag": 6, "ymag": 3, "zfar": 100, "znear": 0})
    camera = file.node(camera=lens, translation=[0, 0, 5], name="Flat")
    times = file.accessor([0.0, 2.0])
    if parent_turns:
        angle = np.radians(100) / 2
        ends = file.accessor([[0, 0, 0, 1], [0, 0, np.sin(angle), np.cos(angle)]])
        arm = file.node(children=[moving], translation=[0, 0, 0])
        file.json["nodes"][moving]["translation"] = [3, 0, 0]
        channel = {"sampler": 0, "target": {"node": arm, "path": "rotation"}}
        roots = [arm, stays, camera]
    else:
        ends = file.accessor([[0, 0, 0], [4, 0, 0]])
        channel = {"sampler": 0, "target": {"node": moving, "path": "translation"}}
        roots = [moving, stays, camera]
    file.add("animations", samplers=[{"input": times, "output": ends}], channels=[channel])
    file.add("scenes", nodes=roots)
    return file.write(tmp_path)


@pytest.mark.filterwarnings("ignore:.*no light:glpath.SceneWarning")
def test_the_animations_of_a_model_are_its_motion_while_the_shutter_is_open(tmp_path: Path) -> None:
    path = animated(tmp_path)
    scene = glpath.load_scene(path, {"time": 0.5, "shutter": 1.0})
    assert scene.camera.shutter == (0.5, 1.5)
    assert (scene.camera.projection, scene.camera.height, scene.camera.resolution) == (
        "orthographic",
        6.0,
        (512, 256),
    )
    assert [scene.shapes[i].name for i in scene.moving_shapes] == ["moving"]
    for time in (0.5, 0.7, 1.5):
        expected = glpath.load_scene(path, {"time": time}).shapes.triangles
        found = scene.at(time).shapes.triangles
        assert np.allclose(
            np.sort(found.reshape(-1, 9), axis=0), np.sort(expected.reshape(-1, 9), axis=0), atol=1e-6
        )
    assert np.allclose(scene.shapes.triangles, scene.at(0.5).shapes.triangles)
    assert not glpath.load_scene(path, {"time": 0.5}).moving_shapes
    with pytest.raises(UsageError, match="shutter is 1, but the model is at rest"):
        glpath.load_scene(path, {"shutter": 1.0})


def test_what_a_turning_node_carries_goes_round(tmp_path: Path) -> None:
    """Between the times that are looked at, a chord is within a part in a thousand of the arc."""
    path = animated(tmp_path, parent_turns=True)
    placed = {"file": path.name, "time": 0.4, "transform": [{"scale": 0.5}, {"translate": [0, 1, 0]}]}
    base: dict[str, Any] = {
        "camera": {"position": [0, 0, 9], "target": [0, 0, 0], "shutter": [0.1, 1.3]},
        "assets": [placed],
    }
    scene = scene_from_dict(base, folder=tmp_path)
    for time in (0.1, 0.33, 0.9, 1.3):
        still = {"camera": base["camera"] | {"shutter": [0, 0]}, "assets": [placed | {"time": 0.4 + time}]}
        expected = scene_from_dict(still, folder=tmp_path)
        assert np.allclose(scene.at(time).bounds, expected.bounds, atol=3e-3)
    turned = base | {
        "assets": [placed | {"motion": [{"time": 0}, {"time": 1, "transform": [{"translate": [0, 0, 2]}]}]}]
    }
    both = scene_from_dict(turned, folder=tmp_path)
    assert np.allclose(both.at(0.5).bounds[1] - scene.at(0.5).bounds[1], [0, 0, 1], atol=1e-6)


def test_exporters_write_the_camera_and_say_what_they_leave_out(tmp_path: Path) -> None:
    parallel = scene_of({"type": "orthographic", "height": 3.0}, strip(0, 1), size=(64, 32))
    glpath.export(parallel, tmp_path / "a.glb")
    again = glpath.load_scene(tmp_path / "a.glb")  # of 179 cd m^-2, which is a lamp
    assert (again.camera.projection, again.camera.resolution) == ("orthographic", (512, 256))
    assert again.camera.height == pytest.approx(3.0)
    assert np.allclose(again.camera.position, parallel.camera.position)
    told: dict[str, list[str]] = {}
    motion = [{"time": 0}, {"time": 1, "transform": [{"translate": [1, 0, 0]}]}]
    cameras = {"lens": {"aperture_radius": 0.1}, "panorama": {"type": "panorama"}, "shutter": {"shutter": [0, 1]}}
    for name, camera in cameras.items():
        for suffix in (".glb", ".xml"):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                glpath.export(scene_of(camera, strip(0, 1, motion=motion)), tmp_path / f"b{suffix}")
            told[name + suffix] = [str(each.message) for each in caught]
    assert "lens is left out" in told["lens.glb"][0]
    assert told["lens.xml"] == []
    assert all("panorama" in told[f"panorama{suffix}"][0] for suffix in (".glb", ".xml"))
    assert all("nothing moves" in told[f"shutter{suffix}"][0] for suffix in (".glb", ".xml"))
    text = (tmp_path / "b.xml").read_text()
    assert 'type="perspective"' in text
