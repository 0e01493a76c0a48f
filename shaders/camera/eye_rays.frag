// eye_rays.frag: casts the eye's rays, and writes the number + 1 of the triangle that each ray hits; 0 for none.
// Needs:  <SCENE>, <RAY_BVH>
// Runs over: the pixels of the window. Frame: world
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "camera/camera.glsl"
#include "scene/ray_bvh.glsl"

layout(location = 0) out uint seen;

void main()
{
#ifdef HAS_ALPHA
    new_opacity_key(ivec2(gl_FragCoord.xy) + eye_corner, 0u);
#endif
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    seen = uint(nearest_triangle(eye_origin(pixel), eye_direction(pixel), -1) + 1);
}
