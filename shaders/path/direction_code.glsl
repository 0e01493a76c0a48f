// direction_code.glsl: encodes the direction in which a path continues in the w of its position.
// The code is 0 for a path that has ended. Otherwise its magnitude is the cosine between direction and surface, in (0, 1], plus 2
// times the index of the path's view. The code is negative if the path runs against the view's direction.
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
