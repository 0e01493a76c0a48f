// profile.glsl: intensity that a light with a photometric profile emits in a direction; `glpath.scene.profile` is
// the same on the CPU.
// Needs:  <SCENE>, HAS_PROFILES
// Units:  W sr^-1
#include "sampling/angles.glsl"

#ifdef HAS_PROFILES
// away: unit direction from the light; profile: index of its profile, from 0
float profile_intensity(int profile, vec3 away)
{
    vec4 axis = profile_texel(profile, PROFILE_AXIS), c0 = profile_texel(profile, PROFILE_C0);
    vec3 grid = profile_texel(profile, PROFILE_GRID).xyz;
    vec2 across = vec2(dot(away, c0.xyz), dot(away, cross(c0.xyz, axis.xyz)));
    float column = (arc_tangent(length(across), dot(away, axis.xyz)) - axis.w) * c0.w;
    float turn = arc_tangent(across.y, across.x) * (0.5 / PI), rounding = ANGLE_ROUNDING * c0.w;
    if (column < -rounding || column > grid.y + rounding) return 0.0;
    column = clamp(column, 0.0, grid.y);
    float row = (turn < 0.0 ? turn + 1.0 : turn) * grid.z;
    vec2 cell = vec2(min(floor(column), grid.y - 1.0), min(floor(row), grid.z - 1.0));
    vec2 share = vec2(column, row) - cell;
    vec4 v = candela_texel(int(grid.x) + int(cell.y) * int(grid.y) + int(cell.x), CANDELA_CORNERS);
    vec2 at_gamma = mix(v.xz, v.yw, share.x);
    return mix(at_gamma.x, at_gamma.y, share.y);
}
#endif
