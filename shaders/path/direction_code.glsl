// direction_code.glsl: encodes in one float, the w component of a path's position, the direction in which the path
// continues.
// The code is 0 for a path that has ended. Otherwise its magnitude is 2 times the index of the path's view, plus
// the absolute cosine between the direction and the surface normal, in (0, 1]. The code is negative if the path
// runs against the view's direction.
float pack_direction(int view, float cosine)
{
    return cosine < 0.0 ? cosine - 2.0 * float(view) : cosine + 2.0 * float(view);
}

int coded_view(float direction_code)
{
    return VIEWS == 1 ? 0 : int(abs(direction_code) > 1.5);
}

float coded_cosine(float direction_code)
{
    return abs(direction_code) - 2.0 * float(coded_view(direction_code));
}
