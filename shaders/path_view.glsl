// path_view.glsl: the orthographic view of one scan of the path-buffer.
// Frame:  path_u, path_v, path_d right-handed and unit; origin at the scene's centre. Cell coordinates are in
//         cells, (0, 0) at the lower corner. Depth runs along path_d, 0 to 1 over the scene's bounding sphere.
uniform vec3 path_u;
uniform vec3 path_v;
uniform vec3 path_d;
uniform vec3 scene_centre;
uniform float scene_diameter;
uniform vec2 cell_count;
uniform vec2 cell_jitter;       // in [0, 1): where the grid starts, another place each scan
uniform sampler2D path_bounds;  // one texel: least u, v and least -u, -v of the live paths

struct PathView
{
    vec2 origin;
    vec2 scale;
};

PathView path_view()
{
    vec4 bounds = texelFetch(path_bounds, ivec2(0), 0);
    vec2 extent = max(-bounds.zw - bounds.xy, vec2(1e-6 * scene_diameter));
    // The jitter may take a cell, or half of the only one.
    vec2 used = max(cell_count - 1.0, 0.5 * cell_count);
    vec2 scale = used / extent;
    return PathView(bounds.xy - cell_jitter * (cell_count - used) / scale, scale);
}

vec3 path_space(vec3 world)
{
    vec3 r = world - scene_centre;
    return vec3(dot(r, path_u), dot(r, path_v), dot(r, path_d));
}

vec3 cell_space(PathView view, vec3 world)
{
    vec3 p = path_space(world);
    return vec3((p.xy - view.origin) * view.scale, p.z / scene_diameter + 0.5);
}
