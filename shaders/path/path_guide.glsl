// path_guide.glsl: samples a direction of diffuse reflection by a guide, a stored distribution of the incident
// light; see `glpath.integrators.path_guide`.
// Needs:  <PATH_GUIDE>; radiosity.glsl; GUIDES_SHARED: several elements share a guide
// Source: Clarberg et al. 2005, Wavelet importance sampling (hierarchical sample warping).
#include <PATH_GUIDE>

// Returns the index of the guide for the front of the element at a position.
int guide_at(LatticePosition position)
{
    int element = position.element;
#ifdef GUIDES_SHARED
    ivec4 bytes = ivec4(guide_of_texel(element, GUIDE_OF_ELEMENT) * 255.0 + 0.5);
    return bytes.x + 256 * bytes.y + 65536 * bytes.z;
#else
    return element;
#endif
}

// Warps a uniform point u in the unit square to the density of the guide's light; pdf: density of the warped point.
vec2 guided(int guide, vec2 u, out float pdf)
{
    int level_first = guide * GUIDE_NODES;
    ivec2 cell = ivec2(0);
    pdf = 1.0;
    for (int level = 0; level < GUIDE_LEVELS; ++level)
    {
        vec4 shares = guide_node_texel(level_first + (cell.y << level) + cell.x, GUIDE_NODE_SHARES);
        level_first += 1 << (2 * level);
        float all = shares.x + shares.y + shares.z + shares.w, left = (shares.x + shares.z) / all;
        bool right = u.x >= left;
        u.x = right ? (u.x - left) / (1.0 - left) : u.x / left;
        vec2 column = right ? shares.yw : shares.xz;
        float below = column.x / (column.x + column.y);
        bool above = u.y >= below;
        u.y = above ? (u.y - below) / (1.0 - below) : u.y / below;
        pdf *= 4.0 * (above ? column.y : column.x) / all;
        cell = 2 * cell + ivec2(right, above);
    }
    // Rounding may bring u to 1, which is outside the cell.
    return (vec2(cell) + clamp(u, 0.0, 0.9999999)) / float(1 << GUIDE_LEVELS);
}
