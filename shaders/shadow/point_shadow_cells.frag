// point_shadow_cells.frag: for every cell of a face, maps the direction of its centre back, and writes the
// resulting face and cell. This checks that the mapping of a point light is consistent on this device.
#include "shadow/point_shadow_map.glsl"

uniform int face;

layout(location = 0) out vec4 found;      // cell found: column, row, face; w: distance from its centre, cells
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
