"""llvmpipe's use after free without glpath: two framebuffers drawn to in turn, a scene with a fence each time.

gcc -shared -fPIC -O1 -o slow_broadcast.so slow_broadcast.c -ldl
LP_NUM_THREADS=1 LD_PRELOAD=$PWD/slow_broadcast.so python plain_gl.py 10
"""

import sys
import time

import moderngl

gl = moderngl.create_context(standalone=True, backend="egl")
print(gl.info["GL_RENDERER"], gl.info["GL_VERSION"], flush=True)
program = gl.program(
    vertex_shader="""#version 430
        void main()
        {
            vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
            gl_Position = vec4(corner * (0.5 + gl_InstanceID * 0.01) - 1.0, 0, 1);
        }""",
    fragment_shader="""#version 430
        out vec4 color;
        void main() { color = vec4(gl_FragCoord.x); }""",
)
array = gl.vertex_array(program, [])
textures = [gl.texture((16, 16), 4, dtype="f4") for _ in range(2)]
targets = [gl.framebuffer([texture]) for texture in textures]
start, scenes = time.monotonic(), 0
while time.monotonic() - start < float(sys.argv[1]):
    for _ in range(50):
        for target in targets:
            target.use()
            array.render(vertices=3, instances=400)
        scenes += 2
    textures[0].read()
print("survived", scenes, "scenes")
