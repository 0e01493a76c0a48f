// path_guide.frag: light that arrives at a guide's points, for each cell of the guide's grid of directions.
// Needs:  GUIDE_LEVELS; GUIDE_POINTS: number of points of a guide; GUIDE_RAYS: number of rays for each cell, a
//         divisor of GUIDE_POINTS; ALL_LIGHT; the needs of light_sample.glsl
// Runs over: a square of 2^GUIDE_LEVELS x 2^GUIDE_LEVELS pixels for each guide, one pixel for each cell; squares
//            lie row by row.
// Output: root mean square of the radiance along a cell's rays, W sr^-1 m^-2; radiance is the mean of its colour
//         channels
// Frame:  world
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"
#include "sampling/random.glsl"
#include "lights/light_sample.glsl"
#include "path/path_vertex.glsl"
#include "scene/ray_bvh.glsl"
#include "radiosity/radiosity.glsl"
#include "bsdf/cosine.glsl"
#ifdef HAS_THIN_DIELECTRICS
#include "bsdf/lobes.glsl"
const int MAX_THIN_DIELECTRICS = 8;  // maximum number of thin dielectrics that a ray passes in succession
#endif
#include <GUIDE_POINTS_STORE>

uniform int guide_count;
uniform int guides_across;
layout(location = 0) out float found;

// Returns the radiance along a ray: light reflected according to the radiosity solution, and emission or sky with
// its MIS weight against light samples. own: triangle that the ray leaves.
vec3 light_along(vec3 start, vec3 normal, vec3 direction, int own)
{
    float pdf = dot(normal, direction) / PI;
    int triangle = nearest_triangle(start, direction, own);
    vec3 through = vec3(1.0);
    float passed = 0.0;
#ifdef HAS_THIN_DIELECTRICS
    // Continue straight through thin dielectrics, as paths and their shadow rays do.
    for (int k = 0; k < MAX_THIN_DIELECTRICS && triangle >= 0; ++k)
    {
        vec4 plane = facet_texel(triangle, FACET_PLANE);
        float along = max(0.0, (plane.w - dot(plane.xyz, start)) / dot(plane.xyz, direction));
        vec3 passes = thin_transmittance(triangle, start, direction);
        if (max(passes.r, max(passes.g, passes.b)) <= 0.0) break;
        through *= passes;
        start += along * direction;
        passed += along;
        triangle = nearest_triangle(start, direction, triangle);
    }
#endif
    if (triangle < 0) {
#ifdef HAS_SKY
        return through * sky(direction) * power_heuristic(pdf, sky_pdf(direction));
#else
        return vec3(0.0);
#endif
    }
    float t, pdf_area;
    PathVertex v = vertex_on(triangle, start, direction, t);
    vec3 Le = emitted(v.surface, v.front, pdf_area);
    vec3 reflected = v.bsdf.diffuse * all_light(lattice_position(triangle, v.surface.position), v.front) / PI;
    return through * (reflected + Le * emission_share(pdf, pdf_area, passed + t, dot(v.plane.xyz, direction)));
}

void main()
{
    const int SIDE = 1 << GUIDE_LEVELS;
    ivec2 pixel = ivec2(gl_FragCoord.xy), cell = pixel % SIDE, tile = pixel / SIDE;
    int guide = tile.y * guides_across + tile.x;
    found = 0.0;
    if (guide >= guide_count) return;
    uint number = uint((guide * SIDE + cell.y) * SIDE + cell.x);
    // Neighbouring cells start at different points of the guide. The points of one cell's rays are evenly spaced in
    // the guide's list.
    int first = (cell.x + 5 * cell.y) % (GUIDE_POINTS / GUIDE_RAYS);
    float sum = 0.0;
    for (int k = 0; k < GUIDE_RAYS; ++k)
    {
        vec4 from = guide_point_texel(guide * GUIDE_POINTS + first + k * (GUIDE_POINTS / GUIDE_RAYS), GUIDE_POINT_POSITION);
        int own = int(from.w);
        vec3 normal = facet_texel(own, FACET_PLANE).xyz, far = abs(from.xyz);
        // R2 sequence, which extends the golden-ratio sequence to two dimensions, with a random shift for each
        // cell.
        vec2 within = fract(vec2(random_number(number, 0u), random_number(number, 1u)) + float(k) * vec2(0.7548777, 0.5698403));
        vec3 direction = cosine_direction(normal, (vec2(cell) + within) / float(SIDE));
        vec3 start = from.xyz + RAY_ROUNDING * max(far.x, max(far.y, far.z)) * normal;
#ifdef HAS_ALPHA
        opacity_key = pcg(number + pcg(USE_OPACITY + uint(k)));
#endif
        float light = dot(light_along(start, normal, direction, own), vec3(1.0 / 3.0));
        sum += light * light;
    }
    found = sqrt(sum / float(GUIDE_RAYS));
}
