// stream_record.comp: while a chunk of the stream is on the device, copies shading data of its triangles that a
// buffer names.
// Runs over: the texels of an area, 8 x 8 in a group. Texels that name triangles of other chunks keep their
//            records. Output:
//            see stream_records.glsl
// Needs:  OF_PATHS: the triangles are those that a scan has found for each path; without it, those of seen_buffer,
//         which holds numbers + 1 in EYE_FORMAT
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/stream_records.glsl"
#ifdef OF_PATHS
#include "path/ray_record.glsl"
#include "path/path_result.glsl"
#else
UINT_TEXELS(EYE_FORMAT, seen_buffer);
#endif

layout(local_size_x = 8, local_size_y = 8) in;

uniform ivec4 area;  // x, y, width and height of the area
uniform int chunk_first;
uniform int chunk_count;
uniform int chunk_shape;
layout(rgba32f) writeonly uniform image2D kept_records;

void main()
{
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, area.zw))) return;
#ifdef OF_PATHS
    float weight;
    int triangle = path_result(pixel, weight) - chunk_first;
#else
    int triangle = int(texel(seen_buffer, pixel).r) - 1 - chunk_first;
#endif
    if (triangle < 0 || triangle >= chunk_count) return;
    uint corner = 3u * uint(triangle);
    imageStore(kept_records, record_texel(pixel, RECORD_CORNER_A), vec4(vertex_position(corner), float(chunk_shape)));
    imageStore(kept_records, record_texel(pixel, RECORD_CORNER_B), vec4(vertex_position(corner + 1u), 0.0));
    imageStore(kept_records, record_texel(pixel, RECORD_CORNER_C), vec4(vertex_position(corner + 2u), 0.0));
    imageStore(kept_records, record_texel(pixel, RECORD_PLANE), facet_texel(triangle, FACET_PLANE));
}
