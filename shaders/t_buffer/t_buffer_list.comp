// t_buffer_list.comp: lists the vertices of all marked primitives in order, and writes the command that draws them. It runs in
// one work group.
layout(local_size_x = 256) in;

uniform int words;     // number of words in `large`, which marks primitives by one bit each
uniform int vertices;  // number of vertices of one primitive

layout(std430, binding = 1) buffer Elements { uint elements[]; };
layout(std430, binding = 4) buffer Large { uint large[]; };
layout(std430, binding = 5) buffer Command { uint command[]; };  // elements, instances, first, base vertex and instance

shared uint found[256];

void main()
{
    int own = int(gl_LocalInvocationID.x), share = (words + 255) / 256;
    int begin = own * share, end = min(begin + share, words);
    uint marks = 0u;
    for (int i = begin; i < end; ++i) marks += uint(bitCount(large[i]));
    found[own] = marks;
    barrier();
    uint slot = 0u;
    for (int i = 0; i < own; ++i) slot += found[i];
    if (own == 255)
    {
        command[0] = uint(vertices) * (slot + marks);
        command[1] = 1u;
        command[2] = 0u;
        command[3] = 0u;
        command[4] = 0u;
    }
    for (int i = begin; i < end; ++i)
    {
        uint word = large[i];
        large[i] = 0u;
        while (word != 0u)
        {
            int bit = findLSB(word);
            word &= word - 1u;
            for (int corner = 0; corner < vertices; ++corner)
                elements[int(slot) * vertices + corner] = uint((32 * i + bit) * vertices + corner);
            ++slot;
        }
    }
}
