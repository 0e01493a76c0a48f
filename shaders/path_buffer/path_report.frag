// path_report.frag: writes for each path the triangle that a scan found, or a PATH_ constant, to be read back.
#include "path/ray_record.glsl"
#include "path/path_result.glsl"

layout(location = 0) out int triangle;

void main()
{
    float weight;
    triangle = path_result(ivec2(gl_FragCoord.xy), weight);
}
