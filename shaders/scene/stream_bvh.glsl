// stream_bvh.glsl: tests if a ray hits any triangle of a part of the stream, by a BVH and the intersection routine
// of mesh triangles. The results of all parts together are those of the same triangles in memory.
// Needs:  <SCENE>, <OCCLUDERS>; the needs of object_bvh.glsl
#include "scene/object_bvh.glsl"
#include <OCCLUDERS>

bool blocked_by_part(vec3 origin, vec3 direction, float tmin, float tmax, int exclude)
{
    bool blocked = false;
    vec3 inverse = inverse_direction(direction);
    int node = 0, leaf = next_leaf(node, origin, inverse, tmin, tmax);
    while (leaf >= 0)
    {
        uvec4 of_leaf = leaf_texel(leaf, LEAF_PRIMITIVES);
        for (int i = 0; i < 4; ++i)
        {
            int item = int(of_leaf[i]) - 1;
            if (item < 0 || blocked) break;
            vec4 a = occluder_texel(item, OCCLUDER_A), b = occluder_texel(item, OCCLUDER_B);
            TriangleFrom from = triangle_from(origin, a.xyz, b.xyz, occluder_texel(item, OCCLUDER_C).xyz);
            bool own = first_streamed + int(a.w) + (int(b.w) << 16) == exclude;
            blocked = !own && triangle_hit(from, direction, tmin) < tmax;
            COUNT_TEST
        }
        leaf = blocked ? -1 : next_leaf(node, origin, inverse, tmin, tmax);
    }
    return blocked;
}
