// object_classic.glsl: classical algorithm that tests a ray against every primitive of the scene [TB I, III.A].
// Needs:  object_intersect.glsl
//
// All engines choose the primitive with the lowest number among several at the same t.
#include "scene/object_intersect.glsl"
#include "scene/object_opacity.glsl"

// If a surface lets the ray through, takes the ray's next hit with the same primitive, because a sphere can be hit
// twice.
#ifdef HAS_ALPHA
#define PASS_THROUGH(AT, ROUTINE, PRIMITIVE)                                                                   \
    for (int k = 0; k < 2 && AT < NO_HIT && primitive_lets_through(PRIMITIVE, origin, direction, AT, false); ++k)     \
        AT = ROUTINE(PRIMITIVE, origin, direction, AT, exclude);
#else
#define PASS_THROUGH(AT, ROUTINE, PRIMITIVE)
#endif

#define TEST_ALL(FIRST, STOP, ROUTINE)                                      \
    for (int i = FIRST; i < STOP; ++i)                                      \
    {                                                                       \
        float at = ROUTINE(i, origin, direction, tmin, exclude);                \
        PASS_THROUGH(at, ROUTINE, i)                                        \
        COUNT_TEST                                                          \
        if (at < t)                                                         \
        {                                                                   \
            t = at;                                                         \
            primitive = i;                                                  \
        }                                                                   \
    }

#define TEST_ANY(FIRST, STOP, ROUTINE)                                      \
    for (int i = FIRST; i < STOP && !blocked; ++i)                          \
    {                                                                       \
        float at = ROUTINE(i, origin, direction, tmin, exclude);                \
        PASS_THROUGH(at, ROUTINE, i)                                        \
        blocked = at < tmax;                                                \
        COUNT_TEST                                                          \
    }

#ifdef COUNT_TESTS
uint tests = 0u;  // number of tests of this invocation so far
#define COUNT_TEST ++tests;
#else
#define COUNT_TEST
#endif

// Returns the nearest of the primitives from `begin` to before `end`, or -1 with t = NO_HIT.
int nearest_of(int begin, int end, vec3 origin, vec3 direction, float tmin, int exclude, out float t)
{
    int primitive = -1;
    t = NO_HIT;
    TEST_ALL(begin, min(end, first_ellipsoid), intersect_sphere)
    TEST_ALL(max(begin, first_ellipsoid), min(end, first_triangle), intersect_ellipsoid)
    TEST_ALL(max(begin, first_triangle), min(end, first_plane), intersect_triangle)
    TEST_ALL(max(begin, first_plane), end, intersect_plane)
    return primitive;
}

int nearest_classic(vec3 origin, vec3 direction, float tmin, int exclude, out float t)
{
    return nearest_of(0, primitive_count, origin, direction, tmin, exclude, t);
}

// Returns true if anything is between tmin and tmax. The first hit ends the search [TB IV.A 2 v].
bool blocked_classic(vec3 origin, vec3 direction, float tmin, float tmax, int exclude)
{
    bool blocked = false;
    TEST_ANY(0, first_ellipsoid, intersect_sphere)
    TEST_ANY(first_ellipsoid, first_triangle, intersect_ellipsoid)
    TEST_ANY(first_triangle, first_plane, intersect_triangle)
    TEST_ANY(first_plane, primitive_count, intersect_plane)
    return blocked;
}
