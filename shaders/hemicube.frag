// hemicube.frag: which triangle the light point sees; its number + 1, 0 for none.
flat in uint triangle_id;
layout(location = 0) out float seen;

void main()
{
    seen = float(triangle_id + 1u);
}
