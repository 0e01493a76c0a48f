// path_scan.frag: tests the paths of a cell against a triangle that touches the cell, see scan_cell.glsl.
#include <SCENE>
#include "path/path_view.glsl"
#include "path_buffer/scan_triangle.glsl"
#include "path_buffer/scan_cell.glsl"

#ifdef HAS_ALPHA
flat in uint see_through;
#endif
flat in vec4 corner_ab;
flat in vec2 corner_c;
flat in vec3 depth_plane;
flat in uint triangle_id;
#ifdef SKIPS_NEAR
flat in float skipped;
#endif

layout(location = 0) out vec4 found;

void main()
{
    ScanTriangle s;
    s.a = corner_ab.xy;
    s.b = corner_ab.zw;
    s.c = corner_c;
    s.depth_plane = depth_plane;
    s.number = triangle_id;
#ifdef HAS_ALPHA
    s.see_through = see_through;
#endif
#ifdef SKIPS_NEAR
    s.skipped = skipped;
#endif
    bvec4 hit;
    found = scan_cell(ivec2(gl_FragCoord.xy), s, hit);
}
