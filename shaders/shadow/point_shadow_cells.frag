// point_shadow_cells.frag: for every cell of a face, writes the face and cell that its own direction maps to. It checks that a
// point light's mapping is consistent on this device.
#include "shadow/point_shadow_map.glsl"

uniform int face;

layout(location = 0) out vec4 found;      // column, row, face, distance in cells from the cell's centre
layout(location = 1) out vec4 direction;  // unit direction

void main()
{
    vec2 cell = floor(gl_FragCoord.xy);
    vec3 d = shadow_direction(face, cell + 0.5);
    ShadowPosition home = shadow_position(d);
    vec2 off = abs(home.at - cell - 0.5);
    found = vec4(shadow_cell(home.at), float(home.face), max(off.x, off.y));
    direction = vec4(normalize(d), 0.0);
}
