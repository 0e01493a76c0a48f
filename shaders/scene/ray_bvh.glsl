// ray_bvh.glsl: finds the nearest triangle along a ray by a BVH, or tests if any occludes the ray; see
// `glpath.gl.ray_bvh`.
// Needs:  <RAY_BVH>
// Frame:  world; boxes are stored in integer steps from the lower corner of the scene's box, and distances along
//         the ray are those of the world.
#include <RAY_BVH>
uniform vec3 ray_lower;  // lower corner of the scene's box; ray_step: size of the steps in which boxes are stored
uniform vec3 ray_step;
#ifdef HAS_INSTANCES
uniform vec2 mesh_grid;  // x: lower corner, y: step for the tree of an instanced mesh, the same for all axes
#endif
#include "sampling/directions.glsl"
#include "scene/opacity.glsl"

const float NO_HIT = 1e30;
// Widening of triangles' edges, as a fraction, so that a ray through a common edge hits at least one of the triangles.
const float EDGE = 1e-5;

// Maximum number of nodes visited before the items found so far are tested. Lanes of a vector then wait less for
// each other.
const int MAX_STEPS = 4;

struct Ray
{
    vec3 origin;
    vec3 direction;
    vec3 start;    // distance along the ray to the plane through the lower corner, for each axis
    vec3 inverse;  // distance along the ray for one step, for each axis
    uint order;    // bit position of the visiting order of children in LINK, for this octant's rays
    bool second;   // true if the visiting order is in LINK.z, false if it is in LINK.y
#ifdef HAS_INSTANCES
    int first;     // offset to add to the index of a mesh's triangle, which gives the number of a hit
    vec3 world_origin;
    vec3 world_direction;
#endif
};

Ray ray_along(vec3 origin, vec3 direction)
{
    bvec3 against = lessThan(direction, vec3(0.0));
    vec3 inverse = inverse_direction(direction);
    return Ray(origin, direction, (ray_lower - origin) * inverse, ray_step * inverse,
               (against.x ? 8u : 0u) + (against.y ? 16u : 0u), against.z
#ifdef HAS_INSTANCES
               , 0, origin, direction
#endif
               );
}

#ifdef HAS_INSTANCES
// Returns the ray in the space of an instance's mesh, in which distances along it are the same. x, y, z: rows of
// the linear map mesh_from_world; w: position of the instance. first: see Ray.
Ray ray_within(Ray ray, vec4 x, vec4 y, vec4 z, int first)
{
    vec3 o = ray.world_origin - vec3(x.w, y.w, z.w), d = ray.world_direction;
    vec3 origin = vec3(dot(x.xyz, o), dot(y.xyz, o), dot(z.xyz, o));
    vec3 direction = vec3(dot(x.xyz, d), dot(y.xyz, d), dot(z.xyz, d));
    bvec3 against = lessThan(direction, vec3(0.0));
    vec3 inverse = inverse_direction(direction);
    return Ray(origin, direction, (mesh_grid.x - origin) * inverse, mesh_grid.y * inverse,
               (against.x ? 8u : 0u) + (against.y ? 16u : 0u), against.z, first, ray.world_origin, ray.world_direction);
}
#endif

// Nodes still to visit in a group of four slots, packed; 0 means none. In the low 4 bits, bit i is set while the
// node that is i-th in visiting order is still to visit. The next 8 bits are the slots in that order, 2 bits each.
// The rest is the group's number.
#ifdef HAS_FAR_NODES
#define Visit uvec2
Visit visit(uint group, uint children) { return uvec2(group, children); }
uint group_of(Visit v) { return v.x; }
uint children_of(Visit v) { return v.y; }
#else
#define Visit uint
Visit visit(uint group, uint children) { return group << 12u | children; }
uint group_of(Visit v) { return v >> 12u; }
uint children_of(Visit v) { return v & 0xfffu; }
#endif
const Visit NOWHERE = Visit(0u);

#ifdef HAS_INSTANCES
// Marks the end of an instance on the stack, as an empty slot of the root's group. There the ray returns to world
// space.
Visit leave_instance() { return visit(0u, 17u); }
#endif

bool has_children(Visit v) { return (children_of(v) & 15u) != 0u; }

// State of a ray's traversal. The stack is an array that is never indexed dynamically, so that it stays in
// registers.
struct Walk
{
    Visit now;
    Visit later[RAY_STACK];
    uint items;       // items to test: 16 times the number of their group, plus one bit for each item
    uint more_items;  // items to test after these
#ifdef HAS_INSTANCES
    bool waits;       // true if these items must be tested before the ray may change space
#endif
};

Walk walk_from_root()
{
    Walk walk;
    walk.now = visit(0u, 1u);
    for (int i = 0; i < RAY_STACK; ++i) walk.later[i] = NOWHERE;
    walk.items = 0u;
    walk.more_items = 0u;
#ifdef HAS_INSTANCES
    walk.waits = false;
#endif
    return walk;
}

bool walk_continues(Walk walk) { return has_children(walk.now) || walk.items != 0u; }

// Index of the lowest set bit of a 4-bit number.
uint lowest_bit(uint bits) { return (0x12131210u >> ((bits & 15u) << 1u)) & 3u; }

// Distances along the ray to the lower planes of four boxes on one axis, as integers of the same bits. Nonnegative
// floats have the order of these integers; negative distances stay below all others.
ivec4 lower_planes(uvec4 bounds, float start, float inverse)
{
    return floatBitsToInt(fma(vec4(bounds & 0xffffu), vec4(inverse), vec4(start)));
}

ivec4 upper_planes(uvec4 bounds, float start, float inverse)
{
    return floatBitsToInt(fma(vec4(bounds >> 16u), vec4(inverse), vec4(start)));
}

// Permutes four bits, one for each child, into the visiting order from a word of LINK.
uint in_order(uint bits, uint order)
{
    return ((bits >> (order & 3u)) & 1u) | ((bits >> ((order >> 2u) & 3u)) & 1u) << 1u
         | ((bits >> ((order >> 4u) & 3u)) & 1u) << 2u | ((bits >> (order >> 6u)) & 1u) << 3u;
}

#ifdef HAS_INSTANCES
void push(inout Walk walk, Visit above)
{
    for (int i = 0; i < RAY_STACK; ++i)
    {
        Visit own = walk.later[i];
        walk.later[i] = above;
        above = own;
    }
}

// Handles a slot that is not a node: at an instance, the ray enters the space of its mesh; at the empty slot of
// leave_instance(), it returns to the world. If items remain to be tested, only sets `waits`. rest: slots of the
// group still to visit.
void change_space(inout Walk walk, inout Ray ray, Visit rest, uvec4 x, uvec4 y, uvec4 z, uvec4 link)
{
    walk.waits = walk.items != 0u;
    if (walk.waits) return;
    if (link.x != 0u) {
        if (has_children(rest)) push(walk, rest);
        push(walk, leave_instance());
        walk.now = visit(link.x >> 8u, 1u);
        ray = ray_within(ray, uintBitsToFloat(x), uintBitsToFloat(y), uintBitsToFloat(z), int(link.y));
    } else {
        walk.now = walk.later[0];
        for (int i = 0; i < RAY_STACK; ++i) walk.later[i] = i + 1 < RAY_STACK ? walk.later[i + 1] : NOWHERE;
        ray = ray_along(ray.world_origin, ray.world_direction);
    }
}
#define WALKING_RAY inout Ray
#else
#define WALKING_RAY Ray
#endif

// Visits the next node, and adds those of its children that the ray hits before tmax to the nodes or items of the
// walk.
void step_down(inout Walk walk, WALKING_RAY ray, float tmax)
{
    uint children = children_of(walk.now);
    uint child = (children >> (4u + 2u * lowest_bit(children))) & 3u;
    Visit rest = visit(group_of(walk.now), children & (children - 1u));
    ivec2 at = ray_slot_at(int(4u * group_of(walk.now) + child));
    uvec4 x = texel(ray_bvh, at), y = texel(ray_bvh, at + ivec2(RAY_SLOT_Y, 0)), z = texel(ray_bvh, at + ivec2(RAY_SLOT_Z, 0));
    uvec4 link = texel(ray_bvh, at + ivec2(RAY_SLOT_LINK, 0));
#ifdef HAS_INSTANCES
    if ((link.x & 255u) == 0u) {
        change_space(walk, ray, rest, x, y, z, link);
        return;
    }
#endif
    ivec4 x0 = lower_planes(x, ray.start.x, ray.inverse.x), x1 = upper_planes(x, ray.start.x, ray.inverse.x);
    ivec4 y0 = lower_planes(y, ray.start.y, ray.inverse.y), y1 = upper_planes(y, ray.start.y, ray.inverse.y);
    ivec4 z0 = lower_planes(z, ray.start.z, ray.inverse.z), z1 = upper_planes(z, ray.start.z, ray.inverse.z);
    ivec4 enter = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), ivec4(0)));
    ivec4 leave = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), ivec4(floatBitsToInt(tmax))));
    uint hit = (enter.x <= leave.x ? 1u : 0u) | (enter.y <= leave.y ? 2u : 0u) | (enter.z <= leave.z ? 4u : 0u)
             | (enter.w <= leave.w ? 8u : 0u);
    uint group = link.x >> 8u, item_bits = hit & (link.x >> 4u) & 15u;
    uint found = item_bits != 0u ? group << 4u | item_bits : 0u;
    walk.more_items = walk.items != 0u ? found : 0u;
    walk.items = walk.items != 0u ? walk.items : found;
    uint nodes = hit & link.x & 15u, order = ((ray.second ? link.z : link.y) >> ray.order) & 255u;
    bool down = nodes != 0u, aside = has_children(rest), push = down && aside, pop = !down && !aside;
    walk.now = down ? visit(group, order << 4u | in_order(nodes, order)) : aside ? rest : walk.later[0];
    Visit above = rest;
    for (int i = 0; i < RAY_STACK; ++i)
    {
        Visit own = walk.later[i], below = i + 1 < RAY_STACK ? walk.later[i + 1] : NOWHERE;
        walk.later[i] = push ? above : pop ? below : own;
        above = own;
    }
}

// Returns the slot of the next item whose box the ray hits before tmax, or -1 if this call has found none. Advances
// the walk.
int next_item(inout Walk walk, WALKING_RAY ray, float tmax)
{
    // Loops test at their end, because llvmpipe runs a loop that tests at its start one more time, with all lanes off.
    int steps = 0;
#ifdef HAS_INSTANCES
    walk.waits = false;
#endif
    if (walk.more_items == 0u && has_children(walk.now)) do
    {
        step_down(walk, ray, tmax);
#ifdef HAS_INSTANCES
        if (walk.waits) break;
#endif
    } while (has_children(walk.now) && walk.more_items == 0u && ++steps < MAX_STEPS);
    int item = walk.items == 0u ? -1 : int(4u * (walk.items >> 4u) + lowest_bit(walk.items));
    walk.items &= walk.items - 1u;
    if ((walk.items & 15u) == 0u) {
        walk.items = walk.more_items;
        walk.more_items = 0u;
    }
    return item;
}

// Intersects an item: a triangle, or two that form a parallelogram. Returns the distance along the ray, NO_HIT if
// the ray misses the item or `exclude` is one of its triangles. triangle: the one that is hit; flags: ITEM_ALPHA,
// ITEM_THIN_DIELECTRIC.
float meet_item(Ray ray, int item, int exclude, out int triangle, out uint flags)
{
    uvec4 of_corner = ray_slot_texel(item, RAY_SLOT_X), of_ab = ray_slot_texel(item, RAY_SLOT_Y);
    uvec4 of_ac = ray_slot_texel(item, RAY_SLOT_Z);
    vec3 ab = uintBitsToFloat(of_ab.xyz), ac = uintBitsToFloat(of_ac.xyz);
    flags = of_ac.w;
    int one = int(of_corner.w), other = of_ab.w == NO_TRIANGLE ? -1 : int(of_ab.w);
#ifdef HAS_INSTANCES
    one += ray.first;
    if (other >= 0) other += ray.first;
#endif
    vec3 s = ray.origin - uintBitsToFloat(of_corner.xyz), p = cross(ray.direction, ac), q = cross(s, ab);
    float scale = 1.0 / dot(ab, p);
    vec3 uvt = vec3(dot(s, p), dot(ray.direction, q), dot(ac, q)) * scale;
    float across = uvt.x + uvt.y;
    triangle = across > 1.0 && other >= 0 ? other : one;
    float min_weight = min(uvt.x, uvt.y), max_weight = other >= 0 ? max(uvt.x, uvt.y) : across;
    bool hit = min_weight >= -EDGE && max_weight <= 1.0 + EDGE && uvt.z > 0.0 && (exclude < 0 || (exclude != one && exclude != other));
    return hit ? uvt.z : NO_HIT;
}

// Opacity and glass are evaluated outside the loop over items, because llvmpipe executes all code of a loop in each iteration,
// for all lanes.

// Returns the triangle that the ray hits first, -1 for none. exclude: triangle that the ray starts on, -1 for none.
// With HAS_ALPHA, opacity_key must be set before.
int nearest_triangle(vec3 origin, vec3 direction, int exclude)
{
    Ray ray = ray_along(origin, direction);
    Walk walk = walk_from_root();
    float t = NO_HIT;
    int nearest = -1;
#ifdef HAS_ALPHA
    do
    {
        float at;
        int triangle;
        bool asks;
        do
        {
            int item = next_item(walk, ray, t);
            uint flags = 0u;
            at = item < 0 ? NO_HIT : meet_item(ray, item, exclude, triangle, flags);
            asks = at < t && (flags & ITEM_ALPHA) != 0u;
            if (at < t && !asks) {
                t = at;
                nearest = triangle;
            }
        } while (!asks && walk_continues(walk));
        if (asks && !lets_through(triangle, origin + at * direction, direction)) {
            t = at;
            nearest = triangle;
        }
    } while (walk_continues(walk));
#else
    do
    {
        int item = next_item(walk, ray, t), triangle;
        uint flags;
        float at = item < 0 ? NO_HIT : meet_item(ray, item, exclude, triangle, flags);
        if (at < t) {
            t = at;
            nearest = triangle;
        }
    } while (walk_continues(walk));
#endif
    return nearest;
}

#ifdef HAS_THIN_DIELECTRICS
// Transmittance of one thin dielectric (lobes.glsl); product over all thin dielectrics between a ray's start and a
// light.
vec3 thin_transmittance(int triangle, vec3 origin, vec3 direction);
vec3 passed_thin_dielectrics;

// Multiplies the product by the transmittance of `thin_ones`: triangles that a ray has passed, -1 after the last.
void pass_thin_dielectrics(ivec4 thin_ones, vec3 origin, vec3 direction)
{
    do
    {
        if (thin_ones.x >= 0) passed_thin_dielectrics *= thin_transmittance(thin_ones.x, origin, direction);
        thin_ones = ivec4(thin_ones.yzw, -1);
    } while (thin_ones.x >= 0);
}
#endif

bool is_blocked(vec3 origin, vec3 direction, float tmax, int exclude)
{
    Ray ray = ray_along(origin, direction);
    bool blocked = false;
    Walk walk = walk_from_root();
#if defined(HAS_ALPHA) || defined(HAS_THIN_DIELECTRICS)
#ifdef HAS_THIN_DIELECTRICS
    passed_thin_dielectrics = vec3(1.0);
#endif
    do
    {
        float at;
        int triangle;
        uint flags = 0u;
        bool is_thin = false, asks = false;
        ivec4 thin_ones = ivec4(-1);
        do
        {
            int item = next_item(walk, ray, tmax);
            at = item < 0 ? NO_HIT : meet_item(ray, item, exclude, triangle, flags);
            blocked = at < tmax;
#ifdef HAS_ALPHA
            asks = blocked && (flags & ITEM_ALPHA) != 0u;
#endif
#ifdef HAS_THIN_DIELECTRICS
            is_thin = blocked && !asks && (flags & ITEM_THIN_DIELECTRIC) != 0u;
            thin_ones = is_thin ? ivec4(triangle, thin_ones.xyz) : thin_ones;
            blocked = blocked && !is_thin;
#endif
        } while (!blocked && thin_ones.w < 0 && walk_continues(walk));
#ifdef HAS_ALPHA
        if (asks) {
            blocked = !lets_through(triangle, origin + at * direction, direction);
#ifdef HAS_THIN_DIELECTRICS
            is_thin = blocked && (flags & ITEM_THIN_DIELECTRIC) != 0u;
            thin_ones = is_thin ? ivec4(triangle, thin_ones.xyz) : thin_ones;
            blocked = blocked && !is_thin;
#endif
        }
#endif
#ifdef HAS_THIN_DIELECTRICS
        if (!blocked) {
            pass_thin_dielectrics(thin_ones, origin, direction);
            blocked = max(passed_thin_dielectrics.r, max(passed_thin_dielectrics.g, passed_thin_dielectrics.b)) <= 0.0;
        }
#endif
    } while (!blocked && walk_continues(walk));
#else
    do
    {
        int item = next_item(walk, ray, tmax), triangle;
        uint flags;
        float at = item < 0 ? NO_HIT : meet_item(ray, item, exclude, triangle, flags);
        blocked = at < tmax;
    } while (!blocked && walk_continues(walk));
#endif
    return blocked;
}
