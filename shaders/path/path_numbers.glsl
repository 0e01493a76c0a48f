// path_numbers.glsl: random numbers for the vertices of a path.
// Needs:  BRANCHES: number of branches of a path; BOUNCES: number of first bounces whose directions come from the
//         sequence; START_POINTS: paths start at points instead of an eye; random.glsl
//
// Each path set has one sequence point for each bounce. Each path shifts this point by random numbers of its own.
// A path has the same random numbers in every set. So the points of one pixel are as evenly spread as the sequence,
// and the points of two pixels are independent.
uniform uint path_seed;              // seed of the paths' shifts
uniform uvec2 direction_points[BRANCHES * BOUNCES];
uniform uint choice_point;           // sequence point of the path set, see choice_number()
uniform bool lattice;                // true if the first bounce uses lattice points, and later bounces Sobol points

float unit(uint bits)
{
    return float(bits >> 8u) * (1.0 / 16777216.0);
}

// Identifies a vertex: its path, its branch, and its index along that branch.
struct PathId
{
    uint path;
    int depth;   // index of the vertex along its branch
    int branch;
};

// Returns a random number in [0, 1), different for each vertex, branch and use. use: USE_ constant of random.glsl,
// or 0 and 1 for the two numbers of a direction.
float random_at(PathId at, uint use)
{
    return random_number(at.path, 8u * uint(BRANCHES * at.depth + at.branch + 1) + use);
}

// Returns true if this vertex is a point at which paths start.
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

// Returns a random number in [0, 1) by which a vertex chooses one of its light samples.
float choice_number(PathId at)
{
    uint vertex = uint(BRANCHES * at.depth + at.branch);
    return unit(choice_point ^ pcg(at.path + pcg(path_seed + 2u * vertex + 1u)));
}

// Returns two numbers in [0, 1) that determine a path's next direction. They are a shifted sequence point for the
// first BOUNCES bounces, and random numbers after that. Lattice points are shifted by addition, Sobol points by
// exclusive or.
vec2 direction_numbers(PathId at)
{
    if (at.depth >= BOUNCES) return vec2(random_at(at, 0u), random_at(at, 1u));
    uvec2 point = direction_points[BOUNCES * at.branch + at.depth];
    uint first = pcg(path_seed + 2u * uint(at.depth));
    uvec2 shift = uvec2(pcg(at.path + first), pcg(at.path + pcg(first)));
    uvec2 own = lattice && at.depth == 0 ? point + shift : point ^ shift;
    return vec2(unit(own.x), unit(own.y));
}
