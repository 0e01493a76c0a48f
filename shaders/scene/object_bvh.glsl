// object_bvh.glsl: finds the nearest primitive along a ray by a BVH, or tests if any primitive occludes the ray.
// The results are bit-identical to those of object_classic.glsl.
// Needs:  object_classic.glsl, <BVH>
#include "scene/object_classic.glsl"
#include <BVH>

// Returns true if the ray is inside the box anywhere between tmin and tmax. The interval is slightly widened
// against rounding (Ize 2013).
bool meets_box(vec3 lower, vec3 upper, vec3 origin, vec3 inverse, float tmin, float tmax)
{
    vec3 a = (lower - origin) * inverse, b = (upper - origin) * inverse;
    vec3 first = min(a, b), last = max(a, b);
    float enter = max(max(first.x, first.y), max(first.z, tmin));
    float leave = min(min(last.x, last.y), min(last.z, tmax)) * 1.0000005;
    return enter <= leave;
}

// Returns the next leaf whose box the ray hits, -1 if there is none. node: where the search begins, and on return
// where it continues.
int next_leaf(inout int node, vec3 origin, vec3 inverse, float tmin, float tmax)
{
    int leaf = -1;
    while (node < node_count && leaf < 0)
    {
        uvec4 lower = node_texel(node, NODE_LOWER), upper = node_texel(node, NODE_UPPER);
        bool hit = meets_box(uintBitsToFloat(lower.xyz), uintBitsToFloat(upper.xyz), origin, inverse, tmin, tmax);
        leaf = hit ? int(upper.w) - 1 : -1;
        node = hit ? node + 1 : int(lower.w);
    }
    return leaf;
}

int nearest_by_bvh(vec3 origin, vec3 direction, float tmin, int exclude, out float t)
{
    int primitive = -1;
    t = NO_HIT;
    vec3 inverse = inverse_direction(direction);
    int node = 0, leaf = next_leaf(node, origin, inverse, tmin, t);
    while (leaf >= 0)
    {
        uvec4 of_leaf = leaf_texel(leaf, LEAF_PRIMITIVES);
        for (int i = 0; i < 4; ++i)
        {
            int candidate = int(of_leaf[i]) - 1;
            if (candidate < 0) break;
            float at = intersect(candidate, origin, direction, tmin, exclude);
            PASS_THROUGH(at, intersect, candidate)
            COUNT_TEST
            if (at < t || (at == t && at < NO_HIT && candidate < primitive))
            {
                t = at;
                primitive = candidate;
            }
        }
        leaf = next_leaf(node, origin, inverse, tmin, t);
    }
    TEST_ALL(first_plane, primitive_count, intersect_plane)
    return primitive;
}

bool blocked_by_bvh(vec3 origin, vec3 direction, float tmin, float tmax, int exclude)
{
    bool blocked = false;
    TEST_ANY(first_plane, primitive_count, intersect_plane)
    vec3 inverse = inverse_direction(direction);
    int node = 0, leaf = blocked ? -1 : next_leaf(node, origin, inverse, tmin, tmax);
    while (leaf >= 0)
    {
        uvec4 of_leaf = leaf_texel(leaf, LEAF_PRIMITIVES);
        for (int i = 0; i < 4; ++i)
        {
            int candidate = int(of_leaf[i]) - 1;
            if (candidate < 0 || blocked) break;
            float at = intersect(candidate, origin, direction, tmin, exclude);
            PASS_THROUGH(at, intersect, candidate)
            blocked = at < tmax;
            COUNT_TEST
        }
        leaf = blocked ? -1 : next_leaf(node, origin, inverse, tmin, tmax);
    }
    return blocked;
}
