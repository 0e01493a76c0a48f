// path_course.glsl: how a path goes on, as the w of its position.
// 0 for a path that has ended. Otherwise its magnitude is the cosine to the surface it leaves, in (0, 1], plus two for
// each view before its own; it is negative for a path against the view's direction.
float pack_course(int view, float cosine)
{
    return cosine < 0.0 ? cosine - 2.0 * float(view) : cosine + 2.0 * float(view);
}

int course_view(float course)
{
    return VIEWS == 1 ? 0 : int(abs(course) > 1.5);
}

float course_cosine(float course)
{
    return abs(course) - 2.0 * float(course_view(course));
}
