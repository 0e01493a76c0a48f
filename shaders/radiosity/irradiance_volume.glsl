// irradiance_volume.glsl: irradiance by position and normal, for streamed triangles, which have no elements of a solution.
// Needs:  <IRRADIANCE_VOLUME>
// Frame:  world. Units: irradiance W m^-2, linear Rec. 709; a: fraction of direct light that is included, 0 to 1.
// Source: McTaggart 2004, Half-Life 2 / Valve Source Shading: ambient cubes.
#include <IRRADIANCE_VOLUME>
uniform vec3 volume_lower;
uniform float volume_cell;  // side of a cell, scene units
uniform ivec3 volume_size;

// Returns the irradiance on one side of a surface. normal: unit, pointing out of that side; front: true for the
// surface's front.
vec4 volume_irradiance(vec3 position, vec3 normal, bool front)
{
    vec3 from_middle = (position - volume_lower) / volume_cell - 0.5;
    ivec3 first = ivec3(floor(from_middle));
    vec3 f = from_middle - vec3(first), share = normal * normal;
    ivec3 axis = (front ? 0 : 6) + ivec3(0, 2, 4) + ivec3(lessThan(normal, vec3(0.0)));
    vec4 sum = vec4(0.0);
    for (int corner = 0; corner < 8; ++corner) {
        ivec3 step = ivec3(corner & 1, corner >> 1 & 1, corner >> 2);
        ivec3 cell = clamp(first + step, ivec3(0), volume_size - 1);
        int number = cell.x + volume_size.x * (cell.y + volume_size.y * cell.z);
        int row = int(volume_cells_texel(number >> 2, VOLUME_CELLS_ROWS)[number & 3]);
        vec3 part = mix(1.0 - f, f, vec3(step));
        vec4 found = share.x * volume_texel(row, axis.x) + share.y * volume_texel(row, axis.y)
                   + share.z * volume_texel(row, axis.z);
        sum += part.x * part.y * part.z * found;
    }
    return sum;
}
