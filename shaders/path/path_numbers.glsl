// path_numbers.glsl: the random numbers of a path's vertices.
// Needs:  BRANCHES of a path; BOUNCES: as many directions come from the sequence for each; START_POINTS; random.glsl
//
// The set has a point of a sequence for each bounce; a path shifts it by numbers of its own, the same in every set, so
// that the points of each pixel are as even as the sequence, and those of two pixels have nothing in common.
uniform uint path_seed;              // of a path's own shifts
uniform uvec2 direction_points[BRANCHES * BOUNCES];
uniform uint choice_points[BRANCHES * BOUNCES];
uniform bool lattice;                // the first direction is a point of a lattice, the others of a Sobol sequence

float unit(uint bits)
{
    return float(bits >> 8u) * (1.0 / 16777216.0);
}

// Where on its branches a path is.
struct PathId
{
    uint path;
    int depth;   // number of the vertex
    int branch;
};

// Another number at each vertex of each branch, for the uses of random.glsl, 0 and 1.
float random_at(PathId at, uint use)
{
    return random_number(at.path, 8u * uint(BRANCHES * at.depth + at.branch + 1) + use);
}

// Is this vertex a point that paths start at?
bool at_start(PathId at)
{
#ifdef START_POINTS
    return at.depth == 0;
#else
    return false;
#endif
}

#ifdef HAS_ALPHA
void opacity_key_at(PathId at, uint use)
{
    opacity_key = pcg(at.path + pcg(random_seed + 8u * uint(BRANCHES * at.depth + at.branch + 1) + use));
}
#endif

// Which part of the lights a vertex takes.
float choice_number(PathId at)
{
    if (at.depth >= BOUNCES) return random_at(at, USE_LIGHT);
    uint point = choice_points[BOUNCES * at.branch + at.depth];
    return unit(point ^ pcg(at.path + pcg(path_seed + 2u * uint(at.depth) + 1u)));
}

// A lattice's shift is a sum, a net's an exclusive or.
vec2 direction_numbers(PathId at)
{
    if (at.depth >= BOUNCES) return vec2(random_at(at, 0u), random_at(at, 1u));
    uvec2 point = direction_points[BOUNCES * at.branch + at.depth];
    uint first = pcg(path_seed + 2u * uint(at.depth));
    uvec2 shift = uvec2(pcg(at.path + first), pcg(at.path + pcg(first)));
    uvec2 own = lattice && at.depth == 0 ? point + shift : point ^ shift;
    return vec2(unit(own.x), unit(own.y));
}
