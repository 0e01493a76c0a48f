// directions.glsl: axes perpendicular to a direction, and the inverse of a ray direction for slab tests.

// Sets two axes perpendicular to a unit direction. Source: Duff et al. 2017, Building an Orthonormal Basis, Revisited.
void axes_across(vec3 d, out vec3 x, out vec3 y)
{
    float side = d.z < 0.0 ? -1.0 : 1.0;
    precise float a = -1.0 / (side + d.z);
    precise float b = d.x * d.y * a;
    precise vec3 across = vec3(1.0 + side * d.x * d.x * a, side * b, -side * d.x);
    precise vec3 along = vec3(b, side + d.y * d.y * a, -d.y);
    x = across;
    y = along;
}

// Inverse of a direction; a component of 0 is replaced by one small enough that its slab test stays correct.
vec3 inverse_direction(vec3 direction)
{
    vec3 smallest = mix(vec3(1e-20), vec3(-1e-20), lessThan(direction, vec3(0.0)));
    return 1.0 / mix(direction, smallest, lessThan(abs(direction), vec3(1e-20)));
}
