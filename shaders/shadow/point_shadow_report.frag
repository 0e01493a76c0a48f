// point_shadow_report.frag: writes the visibility of a light from points that are given as texels.
#include "shadow/point_shadow.glsl"

uniform sampler2D points;   // world positions; w: index of the object
uniform sampler2D normals;  // unit normals in the world
uniform int light;

layout(location = 0) out float visibility;

void main()
{
    vec4 point = texelFetch(points, ivec2(gl_FragCoord.xy), 0);
    vec3 normal = texelFetch(normals, ivec2(gl_FragCoord.xy), 0).xyz;
    visibility = point_light_visibility(light, point.xyz, normal, int(point.w));
}
