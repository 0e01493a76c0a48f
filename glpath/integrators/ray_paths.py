"""Engine of "path", and of "gather" with cast "bvh", which casts the rays of each path by a BVH in the shader.

A path set is one path for every pixel, as with the path-buffer, but its paths share only their position in the
pixels. Each path samples its directions by the cosine at the surface or, with a radiosity solution, by the incident
light (`path_guide`). The lights are divided into parts. A vertex draws a sample of each part, and selects one of
them by its contribution. If at least twelve lights have a position, a light tree draws a sample of these for each
vertex (`glpath.lights.tree`). Rectangular emitters close to surfaces are sampled by solid angle
(`glpath.lights.rectangles`), and the sky can be sampled through portals (`glpath.scene.portal`). A gather's path
branches at its first vertex, which is the source of nearly all its error. The branches share the eye ray and the
direct light at this vertex, which are 0.4 of a set's cost.

Unlike with the path-buffer, no ray is lost in a crowded cell, and the error is noise without streaks. The cost of a
ray grows with the logarithm of the number of triangles, that of a scan with the number itself.
docs/explanation/accuracy.md has measurements.

A path set is one draw, whose fragment shader traces a path from the eye to its end (`shaders/path/path_rays.glsl`).
On a graphics card, a compute shader does this with bit-identical results, because some cards shade pixels in few of
their cores.

Cost:     the BVH; a ray and a shadow ray for each vertex of a path.
Poor at:  caustics, which directions seldom find; scenes lit through small openings without portals; geometry that
          does not fit into memory.
Source:   Kajiya 1986, The rendering equation; Veach 1997 for the weights; Talbot 2005, Importance resampling for
          global illumination.
"""

from __future__ import annotations

from copy import copy

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.context import context_of
from glpath.gl.device_radiosity import DeviceRadiosity
from glpath.gl.device_scene import DeviceScene
from glpath.gl.lanes import LANE_DEFINES
from glpath.gl.light_draws import LightDraws, by_portals
from glpath.gl.lights import LIGHT_ROWS, background_uniforms, light_defines, light_rows, sky_uniforms
from glpath.gl.passes import Pass, PixelDispatch, draw_areas, run_in_areas
from glpath.gl.program import load_program
from glpath.gl.program_parts import ProgramParts
from glpath.gl.ray_bvh import RayBvh
from glpath.gl.sums import Sums
from glpath.gl.thin_dielectrics import thin_dielectric_variants
from glpath.integrators.emitter_silhouettes import EmitterSilhouettes
from glpath.integrators.engine import Uniforms, Window
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.ground import Ground
from glpath.integrators.path_guide import PathGuide
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_settings import PathSettings
from glpath.lights.lighting import Lighting
from glpath.lights.rectangles import LampRectangles
from glpath.lights.samples import LightSamples
from glpath.lights.tree import others, positional
from glpath.sampling.points import PathSetSampler, counter_hash, radical_inverse
from glpath.scene.model import Environment
from glpath.sensors.sensor import CameraSensor, PointSensor, Sensor

# Minimum and maximum number of light samples of a path set, from which its paths select. Paths that share a sample
# have correlated errors, so a larger picture has more samples. 1,024 samples of an environment map take the CPU one
# millisecond.
_LIGHTS = 128, 1024
# Number of pixels for each light sample, if the number of samples is within `_LIGHTS`.
_PIXELS_PER_LIGHT = 8
# Maximum number of parts into which the lights are divided. A vertex evaluates a sample of each part, for 2 % of a
# set's time, and casts a shadow ray for one of them.
_PARTS = 8
# Number of samples that a light tree draws for each vertex. A second one takes a third of a set's time, and reduces
# the error only if lights have profiles.
_TREE_SAMPLES = 1
# Minimum number of lights with a position for which a light tree is built.
_TREE_MIN = 12
# Maximum number of triangles and punctual lights in a tree, because building it takes some 50 microseconds for each
# of them.
_TREE_MAX = 1 << 16
# Number of path sets whose light samples are computed at once; a divisor of `PathSetSampler._CHUNK`.
_LIGHT_BLOCK = 16
# Number of bounces that take their numbers from the sequence; later bounces have independent random numbers.
_MAX_BOUNCES = 14
#: Maximum number of vertices of a path without a depth limit, which only roulette ends. With a reflectance of 0.999
#: everywhere, longer paths carry only 1e-7 of the light. In a closed room without absorption, light transport has
#: no solution, and every path reaches this maximum.
CEILING = 1 << 14
# Maximum number of vertices of a path in the cost estimate by which a draw is divided into areas. Few paths are
# longer.
_USUAL_DEPTH = 64
# Approximate number of boxes and triangles tested by a vertex's ray and shadow ray together in a large scene.
_TESTS_A_VERTEX = 200


class RayPathEngine(PathSetEngine):
    """Engine that traces path sets of one window of the image; see `PathSetEngine` for the parameters.

    radiosity : radiosity solution of the scene's triangles, for look-ups, path guiding and the control variate;
                None if the settings need no solution
    """

    own_lens = True
    settings: PathSettings | GatherSettings

    def __init__(
        self,
        gl: moderngl.Context,
        scene: DeviceScene,
        settings: PathSettings | GatherSettings,
        window: Window,
        *,
        sensor: Sensor | None = None,
        radiosity: DeviceRadiosity | None = None,
        timings: bool = False,
    ) -> None:
        self._ambient = scene.scene.ambient if settings.ambient is None else np.asarray(settings.ambient)
        # With path length 1, ambient radiance replaces the sky's light, so sampling the sky would waste path sets.
        ambient_alone = settings.path_length == 1 and bool(np.any(self._ambient > 0))
        super().__init__(
            gl,
            scene,
            settings,
            window,
            sensor=sensor,
            max_radiance=max(float(np.max(self._ambient)), radiosity.max_radiance if radiosity else 0.0),
            lighting=Lighting.of(scene.scene, sky=False) if ambient_alone else None,
            timings=timings,
        )
        self.guide: PathGuide | None = None
        self.radiosity = radiosity
        self._light_block = -1
        self._light_table: moderngl.Texture | None = None
        self._edges_of: object = None

    # Frame.

    def trace_path_set(self, index: int) -> None:
        """Find the visible triangles, then trace one path for every pixel in one draw."""
        pixel = self._sampler[index].pixel
        self.move_to(index)  # moves objects to the time of the path set
        eye = self._eye_uniforms(pixel, index)
        self.see_silhouettes(index, pixel, eye)  # samples the light of pixels at an emitter's edge
        self._see(eye)  # finds the visible triangle of each pixel
        self.follow_paths(index, eye)  # traces each path to its end, and adds its light to the sums

    def see_silhouettes(self, index: int, sample: NDArray[np.float64], eye: Uniforms) -> None:
        """Sample the pixels at emitters' edges. The first path set of a window or sensor finds them beforehand."""
        if self._silhouettes is None:
            return
        with self.stopwatch.stage("emitter silhouettes"):
            of = (self.window, self.sensor)
            if self._edges_of != of:
                self._silhouettes.find(self._seen_from)
                self._edges_of = of
            self._silhouettes.see(index, sample, eye)

    def follow_paths(self, index: int, eye: Uniforms) -> None:
        """Trace all rays of all paths; see path/path_rays.glsl."""
        uniforms = self._constant | eye | self._of_set(index)
        with self.stopwatch.stage("paths"):
            run_in_areas(self._paths.now, self._areas, uniforms)
        self._sums.path_set_added()

    def _seen_in_mirrors(self) -> RayBvh | None:
        clear = any(self.scene.scene.materials[shape.material].is_clear for shape in self.scene.scene.shapes)
        if not clear or self._points is not None or {"albedo", "normal"}.isdisjoint(self.settings.aovs):
            return None
        self._bvh = self._bvh or RayBvh(self.gl, self.scene)
        return self._bvh

    def share(self, other: PathSetEngine, *, solution: bool = True) -> None:
        """Take the BVH of the other engine, and its path guides if both engines have the same solution."""
        super().share(other)
        if isinstance(other, RayPathEngine) and solution:
            self.guide = other.guide

    @property
    def _shares_lanes(self) -> bool:
        return isinstance(self.sensor, CameraSensor)

    def _prepare_stages(self) -> None:
        gl, scene, settings = self.gl, self.scene, self.settings
        hardware = context_of(gl).info.hardware
        self._bounces = min(max(2, settings.path_length), _MAX_BOUNCES)
        self._branches = settings.branches
        # Two samplers, because the branches' sampler runs ahead, and a sampler caches the sample values of only a
        # few path sets.
        sampler = PathSetSampler(settings.seed, self._bounces + 1, settings.sampling, lattice=True)
        self._sampler = self._branch_sampler = sampler
        if self._branches > 1:
            self._branch_sampler = copy(sampler)
        self._by_tree = _chosen_by_tree(self.lighting) and not (scene.moving and scene.moving.lamps)
        self._in_parts = others(self.lighting) if self._by_tree else self.lighting
        # Bounds in [0, 1] of the random numbers that select each part of the lights, see `_light_edges`.
        self._light_edges = np.zeros(1) if self._by_tree and self._in_parts.dark else _light_edges(self._in_parts)
        self._parts = len(self._light_edges) - 1
        bvh = self._bvh = self._bvh or RayBvh(gl, scene)
        width, height = self.sensor.resolution
        # On llvmpipe, an eye ray takes as long (0.2 us) as the vertices of a triangle, so eye rays are faster if
        # triangles outnumber pixels. The size of the whole image decides, so that an image in tiles is
        # bit-identical to the whole.
        many = not hardware and len(scene.scene.triangles) > width * height
        camera = scene.scene.camera
        wide = camera.projection == "panorama" or camera.aperture_radius > 0
        if self._points is None and scene.instances is None and (many or wide):
            self._look_by_rays()
        parts = self._program_parts(bvh)
        self._constant = parts.uniforms
        # Few paths are longer than `_USUAL_DEPTH`, only those that nothing but roulette ends. On llvmpipe, the draw
        # is not divided, because there is no watchdog. A small draw would also use one core, because each thread
        # gets a square of 64 x 64 pixels.
        vertices = min(settings.path_length, _USUAL_DEPTH)
        tests = self._branches * vertices * _TESTS_A_VERTEX
        self._areas = draw_areas(self._size, tests) if hardware else [(0, 0, *self._size)]
        # llvmpipe runs compute and fragment shaders on all cores, but fragment shaders faster.
        make = self._dispatch if hardware else self._pass
        self._paths = self._sums.sets.each(lambda read, write: make(read, write, parts))

    def _program_parts(self, bvh: RayBvh) -> ProgramParts:
        gl, scene, radiosity = self.gl, self.scene, self.radiosity
        parts = ProgramParts.of(scene, bvh)
        parts.uniforms |= self._constant_uniforms()
        parts.textures["eye_buffer"] = self._eye_buffer
        if self._points is not None:
            parts.textures |= self._points.textures
        parts.defines |= {
            **self._eye_defines,
            **light_defines(scene.scene.sky, self.lighting),
            "BOUNCES": self._bounces,
            "LIGHTS": len(self._light_shifts),
            "BRANCHES": self._branches,
            **({"PARTS": self._parts} if self._parts else {}),
            "LIGHT_ROWS": LIGHT_ROWS,
            **(LANE_DEFINES if self._shares_lanes else {}),
            **self._sums.defines,
        }
        # Callers may average many points. If points shared light samples, the errors of all points would be
        # correlated.
        self._draws: LightDraws | None = None
        independent = isinstance(self.sensor, PointSensor) and self.sensor.independent
        # With a tree there are no rectangles, because the tree has its own probabilities for single triangles.
        still = not self._by_tree and not (scene.moving and scene.moving.lamps)
        rectangles = LampRectangles.that_pay(self.lighting) if still else None
        # Shared light samples cannot depend on positions, but trees, portals and solid angles select by position.
        if self._by_tree or independent or rectangles or by_portals(self.lighting):
            samples = _TREE_SAMPLES if self._by_tree else 0
            self._draws = LightDraws(gl, self.lighting, scene.lights, self._light_edges, samples, rectangles)
            parts.add(self._draws)
        else:
            # Moving emitters have another position in each set, so each set is a block of its own.
            sets = 1 if scene.moving and scene.moving.lamps else _LIGHT_BLOCK
            self._light_table = gl.texture((LIGHT_ROWS * len(self._light_shifts), sets), 4, dtype="f4")
            self._light_table.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self._light_block = -1  # the table is empty
            parts.textures["light_table"] = self._light_table
        parts.defines |= thin_dielectric_variants(scene.scene)
        self._ground = None if self._points is not None else Ground.of(scene.scene, self.settings.seed)
        if self._ground is not None:
            parts.uniforms |= self._ground.uniforms
            parts.defines |= self._ground.defines
        self._silhouettes = self._new_silhouettes(bvh)
        if self._silhouettes is not None:
            parts.defines["EMITTER_SILHOUETTES"] = 1
            parts.textures |= self._silhouettes.textures
        if radiosity is not None:
            parts.add(radiosity)
            if self.settings.looks_up:
                parts.defines["GATHER"] = 1
            elif self.settings.corrects:
                parts.defines["CONTROL_VARIATE"] = 1
            if radiosity.has_all_light:
                width, height = self.sensor.resolution
                self.guide = self.guide or PathGuide(gl, scene, radiosity, width * height, parts)
                parts.add(self.guide)
        return parts

    def _new_silhouettes(self, bvh: RayBvh) -> EmitterSilhouettes | None:
        scene, camera = self.scene, self.scene.scene.camera
        # Edges of emitters out of focus or in motion are wide, so a search at a few positions does not find them.
        wide = camera.aperture_radius > 0 or camera.moves or scene.moving
        # `EmitterSilhouettes` does not support a ground.
        if self._points is not None or wide or self._ground is not None or not EmitterSilhouettes.are_in(scene):
            return None
        return EmitterSilhouettes(
            self.gl, scene, self._size, bvh, self.settings.seed, self.settings.sampling, self._eye_defines
        )

    def _pass(self, read: Sums, write: Sums, parts: ProgramParts) -> Pass:
        program = load_program(
            self.gl,
            vertex="gl/fullscreen.vert",
            fragment="path/path_rays.frag",
            generated=parts.generated,
            defines=parts.defines,
        )
        return Pass("paths", self.gl, program, write.target, textures={**parts.textures, **read.textures})

    def _dispatch(self, read: Sums, write: Sums, parts: ProgramParts) -> PixelDispatch:
        program = load_program(
            self.gl,
            compute="path/path_rays.comp",
            generated=parts.generated,
            defines={**parts.defines, "COMPUTE": 1},
        )
        written = {f"new_{name}": texture for name, texture in write.written.items()}
        textures = {**parts.textures, **read.textures, **written}
        return PixelDispatch("paths", self.gl, program, textures, frozenset(written))

    def _seen_from(self, position: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return (h, w), index of the triangle that each pixel's eye ray hits; -1 for none.

        position : point within the pixels through which the eye rays pass
        """
        self._look(self._eye_uniforms(position))
        return self.seen()

    def statistics(self) -> dict[str, object]:
        """Return the counts of `PathSetEngine`, with `paths_cut` instead of `paths_lost`.

        No ray is lost in a cell, because there are no cells.

        paths_cut : number of paths that were cut at `CEILING` vertices; absent if it is 0
        """
        counts = super().statistics()
        cut = counts.pop("paths_lost")
        return counts | ({"paths_cut": cut} if cut else {})

    # Uniforms of the draw.

    def _of_set(self, index: int) -> Uniforms:
        seed = self.settings.seed
        # Branches take consecutive indices of the sequence, so that all branches of a pixel are evenly distributed.
        branches = range(self._branches * index, self._branches * (index + 1))
        each = np.concatenate([self._branch_sampler[i].directions[: self._bounces] for i in branches])
        points, choice = _words(each[:, 0]), _words(self._sampler[index].own_light[3])
        return {
            "image_window": self._image_window(),
            "window_size": self._size,
            "random_seed": counter_hash(seed, index, 0, 5),
            "direction_points": [tuple(map(int, p)) for p in points],
            "choice_point": int(choice),
            **self._light_uniforms(index),
            **(self._ground.of_set(index) if self._ground is not None else {}),
            "correction_number": radical_inverse(index),
        }

    def _light_uniforms(self, index: int) -> Uniforms:
        if self._draws is None:
            return {"light_row": self._light_row(index)}
        return {"sequence_point": tuple(map(int, _words(self._sampler[index].own_light[:3])))}

    def _light_row(self, index: int) -> int:
        """Return the row of the light table that has the light samples of a path set.

        Each light sample is drawn with the set's sequence point, shifted by numbers that differ between samples.
        If the table lacks the row, rows of many sets are computed at once, because numpy's overhead exceeds the
        work for a single set.
        """
        assert self._light_table is not None, "prepared"
        size = self._light_table.height
        block, row = divmod(index, size)
        if self._light_block != block:
            sets = range(block * size, (block + 1) * size)
            points = _words(np.array([self._sampler[i].own_light[:3] for i in sets]))
            u = (points[:, None] ^ self._light_shifts) / 2.0**32
            edges = self._light_edges
            part = np.arange(u.shape[1]) % self._parts
            share = np.diff(edges)[part]
            u[..., 0] = np.clip(edges[part] + share * u[..., 0], edges[part], np.nextafter(edges[part + 1], 0.0))
            u = u.reshape(-1, 3)
            lights = LightSamples.dark(len(u)) if self.lighting.dark else self.lighting.samples(u)
            self._light_table.write(light_rows(lights, np.tile(share, size)))
            self._light_block = block
        return row

    def _constant_uniforms(self) -> Uniforms:
        settings = self.settings
        width, height = self.sensor.resolution
        lights = int(np.clip(width * height // _PIXELS_PER_LIGHT, *_LIGHTS))
        self._light_shifts = np.array(
            [
                [counter_hash(settings.seed, i, axis, 10) for axis in range(3)]
                for i in range(lights - lights % max(self._parts, 1))
            ],
            np.uint32,
        )
        mirrored = any(material.has_lobes for material in self.scene.scene.materials)
        roulette = settings.roulette_from(mirrored)
        return {
            **sky_uniforms(self.scene.scene.sky, self._in_parts),
            **background_uniforms(self.scene.scene),
            "quanta": self._sums.quanta,
            "max_depth": CEILING if settings.endless else settings.path_length,
            "cut_depth": CEILING - 1 if settings.endless else 1 << 30,
            "ambient": tuple(map(float, self._ambient)),
            "roulette_depth": 1 << 30 if roulette is None else roulette,
            "path_seed": counter_hash(settings.seed, 11),
            "lattice": self._sampler.lattice,
            **settings.lookup_uniforms(),
        }


def _chosen_by_tree(lighting: Lighting) -> bool:
    """Return True if there are enough lights with a position for a light tree, and not too many to build it."""
    punctual = len(positional(lighting))
    pieces = punctual + sum(len(side.cdf) - 1 for side in lighting.sides)
    return len(lighting.sides) + punctual >= _TREE_MIN and pieces <= _TREE_MAX


def _light_edges(lighting: Lighting) -> NDArray[np.float64]:
    """Return (parts + 1,) cumulative bounds in [0, 1] for selecting a part of the lights.

    A part is one light, or an eighth of the total probability if there are more than eight lights.

    An environment map counts as two lights, its suns and the rest. As one light, shadow rays would go to a sun even
    where only the rest is visible. The squared error with two is 0.6 of that with one; more gain little.
    """
    edges = lighting.cdf
    # With portals, the environment map counts as one light. Of two samples, the one outside the portals would often
    # be selected by its contribution, although it is usually occluded.
    if isinstance(lighting.sky, Environment) and not by_portals(lighting):
        edges = np.insert(edges, -1, edges[-2] + (edges[-1] - edges[-2]) * lighting.sky.split)
    parts = len(edges) - 1
    return edges if 1 < parts <= _PARTS else np.linspace(0.0, 1.0, max(1, min(parts, _PARTS)) + 1)


def _words(u: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Return numbers in [0, 1) as 32-bit integers, in units of 2**-32."""
    return np.asarray(u * 2.0**32, np.uint64).astype(np.uint32)
