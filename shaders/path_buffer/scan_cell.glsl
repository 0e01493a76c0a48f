// scan_cell.glsl: WritePixel of the path-buffer [PB table 5] for the four paths of a cell at once.
// A surface is written if it is beyond z0 and nearer than the nearest hit so far. This shader does the first test,
// at the path's own position in the cell: whether the triangle covers it, and whether its depth there is beyond z0.
// The depth is exact, because planes are linear in an orthographic view. Blending does the second test.
// Paths of both hemispheres are tested: a path against the view's direction looks towards smaller depths.
//   PACKED     depth and the triangle's number as one float, see scan_word.glsl; blended by MIN
//   OCCLUSION  0 if anything was hit, otherwise NOTHING_FOUND; blended by MIN
//   NEAREST    first of two scans: depth only; blended by MIN
//   AT_NEAREST second scan: number of the triangle at the nearest depth; blended by MAX
// Needs:  <SCENE>, path_view.glsl, scan_triangle.glsl
#include "gl/texels.glsl"
#include <CONSTANTS>
#include "scene/opacity.glsl"
#include "path/ray_record.glsl"
#ifdef PACKED
#include "path/scan_word.glsl"
#endif

#ifdef HAS_ALPHA
UINT_TEXELS(rgba32ui, cell_slots);
#endif
TEXELS(rgba32f, cell_z0);
UINT_TEXELS(rgba32ui, cell_position);
#ifdef AT_NEAREST
TEXELS(rgba32f, cell_nearest);
#endif

// Minimum distances of a hit, because a path starts within rounding of its own surface: a constant in scene
// diameters, and a factor on the triangle's slope in depth per cell. Positions are exact to 3e-5 cells only, so a
// steep triangle has an error of depth.
const float DEPTH_TOLERANCE = 2e-6;
const float POSITION_TOLERANCE = 1e-4;

vec4 left_of(vec2 p, vec2 e, vec4 x, vec4 y)
{
    // The tolerance closes the seam between two triangles that share an edge.
    return e.x * (y - p.y) - e.y * (x - p.x) + 1e-4 * (abs(e.x) + abs(e.y));
}

#ifdef HAS_ALPHA
// Returns `hit` with false for the paths that the surface lets through.
bvec4 stopped(ivec2 cell, ScanTriangle s, vec2 a, vec4 x, vec4 y, vec4 direction_sign, bvec4 hit)
{
    // The random number depends on the path's number, which its slot holds, and on the scan's permutation_seed.
    uvec4 numbers = texel(cell_slots, cell) & NUMBER_MASK, face = face_texel(int(s.number), FACE_CORNERS);
    vec2 ab = s.b - s.a, ac = s.c - s.a;
    float area = ab.x * ac.y - ab.y * ac.x;
    for (int k = 0; k < 4; ++k) {
        vec2 p = vec2(x[k], y[k]) - a;
        vec2 bc = vec2(p.x * ac.y - p.y * ac.x, ab.x * p.y - ab.y * p.x) / area;
        if (s.see_through == 2u) bc = bc.yx;
        opacity_key = pcg(numbers[k] + pcg(permutation_seed));
        bool front = (s.see_through == 2u) == (direction_sign[k] > 0.0);
        if (hit[k] && triangle_lets_through(int(s.number), face, vec3(1.0 - bc.x - bc.y, bc), front)) hit[k] = false;
    }
    return hit;
}
#endif

// Tests the four paths of a cell against a triangle, and returns the values to blend. s: its corners are in cells
// of the whole buffer.
vec4 scan_cell(ivec2 cell, ScanTriangle s, out bvec4 hit)
{
    vec4 z0 = texel(cell_z0, cell);
    uvec4 position = texel(cell_position, cell);
    vec4 x = vec4(position & 0xffffu) * (1.0 / 65535.0);
    vec4 y = vec4((position >> 16u) & 0x7fffu) * (1.0 / 32767.0);
    vec4 direction_sign = 1.0 - 2.0 * vec4(position >> 31u);

    // Corners relative to the cell, because differences of close numbers are exact.
    vec2 a = s.a - vec2(cell);
    vec2 b = s.b - vec2(cell);
    vec2 c = s.c - vec2(cell);
    vec4 inside = min(min(left_of(a, b - a, x, y), left_of(b, c - b, x, y)), left_of(c, a - c, x, y));
    precise vec4 z = s.depth_plane.x * (x - a.x) + s.depth_plane.y * (y - a.y) + s.depth_plane.z;
    vec4 t = (z - z0) * direction_sign;

    float min_t = DEPTH_TOLERANCE + POSITION_TOLERANCE * (abs(s.depth_plane.x) + abs(s.depth_plane.y));
#ifdef SKIPS_NEAR
    min_t = max(min_t, s.skipped);
#endif
    hit = bvec4(uvec4(greaterThan(inside, vec4(0.0))) & uvec4(greaterThan(t, vec4(min_t))));
#ifdef HAS_ALPHA
    if (s.see_through != 0u && any(hit)) hit = stopped(cell, s, a, x, y, direction_sign, hit);
#endif
#if defined(PACKED)
    return mix(vec4(NOTHING_FOUND), uintBitsToFloat(scan_words(t, s.number)), hit);
#elif defined(OCCLUSION)
    return mix(vec4(NOTHING_FOUND), vec4(0.0), hit);
#elif defined(NEAREST)
    return mix(vec4(INFINITE_DEPTH), t, hit);
#elif defined(AT_NEAREST)
    hit = bvec4(uvec4(hit) & uvec4(lessThanEqual(t, texel(cell_nearest, cell) * (1.0 + 1e-6) + 2e-7)));
    return mix(vec4(0.0), vec4(uintBitsToFloat(s.number + MIN_NORMAL)), hit);
#endif
}
