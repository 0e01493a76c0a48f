// path_bounds.frag: bounding rectangle of each view's live paths, in the plane perpendicular to the view's
// direction, found in two passes.
// The first pass (FROM_PATHS) reduces blocks of path states to a small grid of bounds for each view. The second
// pass reduces each grid to one texel.
// Output: minima of u, v, -u, -v, so that both ends of the rectangle are minima.
#include "gl/texels.glsl"
#include <CONSTANTS>
#include "path/path_view.glsl"
#include "path/direction_code.glsl"

uniform ivec2 source_size;
uniform ivec2 block;

#ifdef FROM_PATHS
TEXELS(rgba32f, path_position);
layout(location = 0) out vec4 bounds[VIEWS];

void main()
{
    ivec2 from = ivec2(gl_FragCoord.xy) * block;
    ivec2 to = min(from + block, source_size);
    vec4 m[VIEWS];
    for (int view = 0; view < VIEWS; view++) m[view] = vec4(INFINITE_DEPTH);
    for (int y = from.y; y < to.y; y++) {
        for (int x = from.x; x < to.x; x++) {
            vec4 p = texel(path_position, ivec2(x, y));
            int own = coded_view(p.w);
            vec2 uv = path_space(own, p.xyz).xy;
            for (int view = 0; view < VIEWS; view++)
                m[view] = min(m[view], p.w != 0.0 && own == view ? vec4(uv, -uv) : vec4(INFINITE_DEPTH));
        }
    }
    for (int view = 0; view < VIEWS; view++) bounds[view] = m[view];
}
#else
TEXELS(rgba32f, path_grid_0);
TEXELS(rgba32f, path_grid_1);
layout(location = 0) out vec4 bounds;

void main()
{
    bool first = VIEWS == 1 || gl_FragCoord.x < 1.0;
    bounds = vec4(INFINITE_DEPTH);
    for (int y = 0; y < source_size.y; y++)
        for (int x = 0; x < source_size.x; x++)
            bounds = min(bounds, first ? texel(path_grid_0, ivec2(x, y)) : texel(path_grid_1, ivec2(x, y)));
}
#endif
