// path_bounds.frag: the box around the live paths, seen along the scan's direction; two passes of it.
// First pass (FROM_PATHS): from path states to a small grid; second: from the grid to one texel.
// Output: least u, v, -u, -v, so that a minimum serves for both ends.
#include "constants.glsl"
#include "path_view.glsl"

#ifdef FROM_PATHS
uniform sampler2D path_position;
#else
uniform sampler2D path_grid;
#endif
uniform ivec2 source_size;
uniform ivec2 block;

layout(location = 0) out vec4 least;

void main()
{
    ivec2 start = ivec2(gl_FragCoord.xy) * block;
    ivec2 stop = min(start + block, source_size);
    vec4 m = vec4(INFINITE_DEPTH);
    for (int y = start.y; y < stop.y; y++) {
        for (int x = start.x; x < stop.x; x++) {
#ifdef FROM_PATHS
            vec4 p = texelFetch(path_position, ivec2(x, y), 0);
            vec2 uv = path_space(p.xyz).xy;
            m = min(m, p.w != 0.0 ? vec4(uv, -uv) : vec4(INFINITE_DEPTH));
#else
            m = min(m, texelFetch(path_grid, ivec2(x, y), 0));
#endif
        }
    }
    least = m;
}
