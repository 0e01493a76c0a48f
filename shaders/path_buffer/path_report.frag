// path_report.frag: writes the result of a scan for each path, to be read back: triangle or PATH_...
#include "path/ray_record.glsl"
#include "path/path_result.glsl"

layout(location = 0) out int triangle;

void main()
{
    float weight;
    triangle = path_result(ivec2(gl_FragCoord.xy), weight);
}
