// stream_records.glsl: streamed triangles are on the device only while their chunk is. What shading needs of those that a
// buffer names is copied then (stream_record.comp): a record for each of its texels, one above the other in a texture.
// Needs:  STREAMED: numbers from first_streamed on are of streamed triangles; the others are in <SCENE>.
// Frame:  world.
#include "gl/texels.glsl"
const int RECORD_CORNER_A = 0;  // and in w the number of the shape
const int RECORD_CORNER_B = 1;
const int RECORD_CORNER_C = 2;
const int RECORD_PLANE = 3;     // as FACET_PLANE
const int RECORD_TEXELS = 4;

ivec2 record_texel(ivec2 texel_of_buffer, int which)
{
    return ivec2(texel_of_buffer.x, RECORD_TEXELS * texel_of_buffer.y + which);
}
