// random.glsl: random numbers as hashes of a counter, so that any path of any set can be traced independently of
// all others.
// Source: Jarzynski & Olano 2020, Hash Functions for GPU Rendering (pcg).
uniform uint random_seed;  // hash of seed, path set and depth, computed on the CPU

const uint USE_COSINE = 1u;
const uint USE_ROULETTE = 2u;
const uint USE_LIGHT = 3u;
const uint USE_LOOKUP = 4u;
const uint USE_OPACITY = 5u;         // numbers for the opacity test of the path's next hit
const uint USE_SHADOW_OPACITY = 6u;  // numbers for the opacity tests between a vertex and its light
const uint USE_LOBE = 7u;

uint pcg(uint v)
{
    uint state = v * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Uniform in [0, 1).
float random_unit(uint counter)
{
    return float(pcg(counter) >> 8u) * (1.0 / 16777216.0);
}

// `path` is the pixel's index in the whole image.
float random_number(uint path, uint use)
{
    return random_unit(path + pcg(random_seed + use));
}
