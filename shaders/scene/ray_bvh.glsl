// ray_bvh.glsl: the nearest triangle along a ray, and whether there is any, by a BVH; see `glpath.gl.ray_bvh`.
// Needs:  <RAY_BVH>
// Frame:  world; boxes are intersected in steps of the scene's own box, the distance along the ray being the same.
#include <RAY_BVH>
uniform int ray_node_count;  // of one tree
uniform bool ray_octants;    // there are eight
uniform vec3 ray_lower;      // of the scene's box in steps: where it begins, and a step
uniform vec3 ray_step;
#include "sampling/directions.glsl"
#include "scene/opacity.glsl"

const float NO_HIT = 1e30;
// A ray through a common edge meets one of the triangles at least: their edges are as much wider, in shares of them.
const float EDGE = 1e-5;

struct Ray
{
    vec3 origin;
    vec3 direction;
    vec3 start;      // in steps
    vec3 inverse;    // of the direction in steps
    int first;       // the tree of the direction's signs, and its end
    int end;
};

Ray ray_along(vec3 origin, vec3 direction)
{
    bvec3 against = lessThan(direction, vec3(0.0));
    int octant = ray_octants ? int(against.x) + 2 * int(against.y) + 4 * int(against.z) : 0;
    int first = octant * ray_node_count;
    return Ray(origin, direction, (origin - ray_lower) / ray_step, ray_step * inverse_direction(direction), first,
               first + ray_node_count);
}

// The next leaf's item from a node on, nearer than tmax; -1 for none. Advances the node.
int next_item(inout int node, Ray ray, float tmax)
{
    int item = -1;
    while (node < ray.end && item < 0)
    {
        uvec4 box = ray_node_texel(node, RAY_NODE_BOX);
        vec3 a = (vec3(box.xyz & 0xffffu) - ray.start) * ray.inverse, b = (vec3(box.xyz >> 16u) - ray.start) * ray.inverse;
        vec3 near = min(a, b), far = max(a, b);
        float enter = max(max(near.x, near.y), max(near.z, 0.0)), leave = min(min(far.x, far.y), min(far.z, tmax));
        bool hit = enter <= leave, leaf = box.w >= LEAF_BIT;
        item = hit && leaf ? int(box.w - LEAF_BIT) : -1;
        node = hit || leaf ? node + 1 : int(box.w);
    }
    return item;
}

// The distance to an item's triangle, NO_HIT where it is missed or excluded.
float meet_item(Ray ray, int item, int exclude, out int triangle)
{
    uvec4 of_corner = ray_item_texel(item, RAY_ITEM_CORNER), of_ab = ray_item_texel(item, RAY_ITEM_AB);
    vec3 ab = uintBitsToFloat(of_ab.xyz), ac = uintBitsToFloat(ray_item_texel(item, RAY_ITEM_AC).xyz);
    int one = int(of_corner.w), other = of_ab.w == NO_TRIANGLE ? -1 : int(of_ab.w);
    vec3 s = ray.origin - uintBitsToFloat(of_corner.xyz), p = cross(ray.direction, ac), q = cross(s, ab);
    float scale = 1.0 / dot(ab, p);
    vec3 uvt = vec3(dot(s, p), dot(ray.direction, q), dot(ac, q)) * scale;
    float across = uvt.x + uvt.y;
    triangle = across > 1.0 && other >= 0 ? other : one;
    float min_weight = min(uvt.x, uvt.y), max_weight = other >= 0 ? max(uvt.x, uvt.y) : across;
    bool hit = min_weight >= -EDGE && max_weight <= 1.0 + EDGE && uvt.z > 0.0 && (exclude < 0 || (exclude != one && exclude != other));
    return hit ? uvt.z : NO_HIT;
}

#ifdef HAS_ALPHA
bool item_lets_through(int item, int triangle, vec3 position)
{
    return (ray_item_texel(item, RAY_ITEM_AC).w & ITEM_ALPHA) != 0u && lets_through(triangle, position);
}
#endif

#ifdef HAS_THIN_DIELECTRICS
// Share of the light that a thin dielectric lets through, and what all thin dielectrics between a ray's start and a light let.
vec3 thin_transmittance(int triangle, vec3 position, vec3 direction);
vec3 passed_thin_dielectrics;
#endif

// exclude: the triangle that the ray starts on, -1 for none. Where there is HAS_ALPHA, opacity_key is set before.
int nearest_triangle(vec3 origin, vec3 direction, int exclude)
{
    Ray ray = ray_along(origin, direction);
    float t = NO_HIT;
    int nearest = -1, node = ray.first, item = next_item(node, ray, t);
    while (item >= 0)
    {
        int triangle;
        float at = meet_item(ray, item, exclude, triangle);
#ifdef HAS_ALPHA
        if (at < t && item_lets_through(item, triangle, origin + at * direction)) at = NO_HIT;
#endif
        if (at < t) {
            t = at;
            nearest = triangle;
        }
        item = next_item(node, ray, t);
    }
    return nearest;
}

bool is_blocked(vec3 origin, vec3 direction, float tmax, int exclude)
{
    Ray ray = ray_along(origin, direction);
    bool blocked = false;
#ifdef HAS_THIN_DIELECTRICS
    passed_thin_dielectrics = vec3(1.0);
#endif
    int node = ray.first, item = next_item(node, ray, tmax);
    while (item >= 0)
    {
        int triangle;
        float at = meet_item(ray, item, exclude, triangle);
        blocked = at < tmax;
#ifdef HAS_ALPHA
        blocked = blocked && !item_lets_through(item, triangle, origin + at * direction);
#endif
#ifdef HAS_THIN_DIELECTRICS
        if (blocked && (ray_item_texel(item, RAY_ITEM_AC).w & ITEM_THIN_DIELECTRIC) != 0u) {
            passed_thin_dielectrics *= thin_transmittance(triangle, origin + at * direction, direction);
            blocked = max(passed_thin_dielectrics.r, max(passed_thin_dielectrics.g, passed_thin_dielectrics.b)) <= 0.0;
        }
#endif
        item = blocked ? -1 : next_item(node, ray, tmax);
    }
    return blocked;
}
