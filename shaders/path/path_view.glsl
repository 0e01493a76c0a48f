// path_view.glsl: orthographic views of one scan of the path-buffer.
// Frame:  u, v, d: right-handed unit axes of a view, with the origin at the scene's centre. Cell coordinates: one
//         unit per cell, (0, 0) at the view's lower corner. A view has view_cells.x columns and view_cells.y rows;
//         views lie side by side in the buffer. Depth is along d, from 0 to 1 over the scene's bounding sphere.
// Needs:  VIEWS: maximum number of views
#include "gl/texels.glsl"
uniform vec3 path_u[VIEWS];
uniform vec3 path_v[VIEWS];
uniform vec3 path_d[VIEWS];
uniform vec3 scene_centre;
uniform float scene_diameter;
uniform vec2 view_cells;
uniform vec2 cell_jitter;       // offset of the grid in cells, in [0, 1), new for each scan
TEXELS(rgba32f, path_bounds);  // for each view: minimum u, v and minimum -u, -v of its live paths

struct PathView
{
    vec2 origin;
    vec2 scale;
    float first_column;
};

PathView path_view(int view)
{
    vec4 bounds = texel(path_bounds, ivec2(view, 0));
    vec2 extent = max(-bounds.zw - bounds.xy, vec2(1e-6 * scene_diameter));
    // Leave one cell for the jitter, or half a cell if the view has only one.
    vec2 used = max(view_cells - 1.0, 0.5 * view_cells);
    vec2 scale = used / extent;
    return PathView(bounds.xy - cell_jitter * (view_cells - used) / scale, scale, float(view) * view_cells.x);
}

vec3 path_space(int view, vec3 world)
{
    vec3 r = world - scene_centre;
    return vec3(dot(r, path_u[view]), dot(r, path_v[view]), dot(r, path_d[view]));
}

// Position in cells of the view, with depth in z; path: position in the path_space of that view.
vec3 cell_space(PathView view, vec3 path)
{
    return vec3((path.xy - view.origin) * view.scale, path.z / scene_diameter + 0.5);
}
