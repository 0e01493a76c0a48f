// path_scan.frag: WritePixel of the path-buffer [PB table 5] for four paths of a cell at once.
// A surface is written where it is beyond z0 and nearer than what was found so far. The first test is here, against the
// z0 texture, at the path's own position in the cell: whether the triangle covers it, and its depth there (exact
// for a plane in an orthographic view). The second is the blend equation MIN on what this shader writes.
// Both hemispheres: a path against the direction looks down the depth axis.
//   PACKED     depth and the triangle's number as one float, see scan_word.glsl
//   otherwise  two scans: NEAREST writes the depth alone; the next finds whose depth it was (blend MAX)
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/opacity.glsl"
#include "path/ray_record.glsl"
#ifdef PACKED
#include "path/scan_word.glsl"
#endif

#ifdef HAS_ALPHA
flat in uint see_through;
UINT_TEXELS(rgba32ui, cell_slots);
#endif
TEXELS(rgba32f, cell_z0);
UINT_TEXELS(rgba32ui, cell_position);
#if !defined(PACKED) && !defined(NEAREST)
TEXELS(rgba32f, cell_nearest);
#endif

flat in vec4 corner_ab;
flat in vec2 corner_c;
flat in vec3 depth_plane;
flat in uint triangle_id;

layout(location = 0) out vec4 found;

#ifdef SKIPS_NEAR
flat in float skipped;
#endif

// A path may start within rounding of its own surface. Depth is in scene diameters; a position is good to 3e-5 cells,
// which a steep surface turns into depth.
const float DEPTH_TOLERANCE = 2e-6;
const float POSITION_TOLERANCE = 1e-4;

vec4 left_of(vec2 p, vec2 e, vec4 x, vec4 y)
{
    // The tolerance closes the seam between two triangles of one edge.
    return e.x * (y - p.y) - e.y * (x - p.x) + 1e-4 * (abs(e.x) + abs(e.y));
}

void main()
{
    ivec2 cell = ivec2(gl_FragCoord.xy);
    vec4 z0 = texel(cell_z0, cell);
    uvec4 position = texel(cell_position, cell);
    vec4 x = vec4(position & 0xffffu) * (1.0 / 65535.0);
    vec4 y = vec4((position >> 16u) & 0x7fffu) * (1.0 / 32767.0);
    vec4 direction_sign = 1.0 - 2.0 * vec4(position >> 31u);

    // Corners relative to the cell: differences of near numbers are exact.
    vec2 a = corner_ab.xy - vec2(cell);
    vec2 b = corner_ab.zw - vec2(cell);
    vec2 c = corner_c - vec2(cell);
    vec4 inside = min(min(left_of(a, b - a, x, y), left_of(b, c - b, x, y)), left_of(c, a - c, x, y));
    precise vec4 z = depth_plane.x * (x - a.x) + depth_plane.y * (y - a.y) + depth_plane.z;
    vec4 t = (z - z0) * direction_sign;

    float min_t = DEPTH_TOLERANCE + POSITION_TOLERANCE * (abs(depth_plane.x) + abs(depth_plane.y));
#ifdef SKIPS_NEAR
    min_t = max(min_t, skipped);
#endif
    bvec4 hit = bvec4(uvec4(greaterThan(inside, vec4(0.0))) & uvec4(greaterThan(t, vec4(min_t))));
#ifdef HAS_ALPHA
    // Random for each path: its number is that of its slot, the scan's is in the seed.
    if (see_through != 0u && any(hit)) {
        uvec4 numbers = texel(cell_slots, cell) & NUMBER_MASK, face = face_texel(int(triangle_id), FACE_CORNERS);
        vec2 ab = b - a, ac = c - a;
        float area = ab.x * ac.y - ab.y * ac.x;
        for (int k = 0; k < 4; ++k) {
            vec2 p = vec2(x[k], y[k]) - a;
            vec2 bc = vec2(p.x * ac.y - p.y * ac.x, ab.x * p.y - ab.y * p.x) / area;
            if (see_through == 2u) bc = bc.yx;
            opacity_key = pcg(numbers[k] + pcg(permutation_seed));
            if (hit[k] && triangle_lets_through(int(triangle_id), face, vec3(1.0 - bc.x - bc.y, bc))) hit[k] = false;
        }
    }
#endif
#if defined(PACKED)
    found = mix(vec4(NOTHING_FOUND), uintBitsToFloat(scan_words(t, triangle_id)), hit);
#elif defined(NEAREST)
    found = mix(vec4(INFINITE_DEPTH), t, hit);
#else
    bvec4 nearest = lessThanEqual(t, texel(cell_nearest, cell) * (1.0 + 1e-6) + 2e-7);
    found = mix(vec4(0.0), vec4(uintBitsToFloat(triangle_id + MIN_NORMAL)), bvec4(uvec4(hit) & uvec4(nearest)));
#endif
}
