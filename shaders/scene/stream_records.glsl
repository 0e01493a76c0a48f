// stream_records.glsl: records of streamed triangles. A streamed triangle is on the device only while its chunk is.
// During that time, stream_record.comp copies shading data of the triangles that a buffer names. Each texel of the
// buffer has a record of RECORD_TEXELS texels, one above the other in a texture.
// Needs:  STREAMED: triangle numbers from first_streamed on are streamed; the others are in <SCENE>.
// Frame:  world.
#include "gl/texels.glsl"
const int RECORD_CORNER_A = 0;  // w: index of the shape
const int RECORD_CORNER_B = 1;
const int RECORD_CORNER_C = 2;
const int RECORD_PLANE = 3;     // plane of the triangle, in the format of FACET_PLANE
const int RECORD_TEXELS = 4;

ivec2 record_texel(ivec2 texel_of_buffer, int which)
{
    return ivec2(texel_of_buffer.x, RECORD_TEXELS * texel_of_buffer.y + which);
}
