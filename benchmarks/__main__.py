"""Command `python -m benchmarks`: bench, figure, gallery, khronos, look, mitsuba-scenes, scene and walks.

`make bench` and `make figure` call it. Errors, warnings and exit codes are those of the `glpath` command.
"""

from __future__ import annotations

from glpath.cli.main import program, run
from glpath.cli.on_demand import Part

PROGRAM = "python -m benchmarks"
GROUP = "Commands"

app = program(
    PROGRAM,
    "Measures glpath, and makes the figures and tables of its papers and its models again.",
    {
        "bench": Part("benchmarks.bench_command", GROUP, "Measure how fast an engine is."),
        "figure": Part(
            "benchmarks.figure_command",
            GROUP,
            "Make a figure of the papers again, with its data and whether the paper's claim holds here.",
        ),
        "khronos": Part(
            "benchmarks.khronos_command", GROUP, "Compare sample models of glTF with Cycles, on a page."
        ),
        "mitsuba-scenes": Part(
            "benchmarks.mitsuba_scenes_command",
            GROUP,
            "Load Mitsuba's own files, and compare their pictures with Mitsuba's.",
        ),
        "scene": Part(
            "benchmarks.scene_command",
            GROUP,
            "Make a model that ships, `scenes/NAME.glb`, or the room of another fineness.",
        ),
        "look": Part(
            "benchmarks.look_command",
            GROUP,
            "Show models without an option, beside a viewer of the web.",
        ),
        "walks": Part(
            "benchmarks.walks_command", GROUP, "Follow the documentation as six readers would, to a result each."
        ),
        "gallery": Part("benchmarks.gallery_command", GROUP, "Render the pictures of the documentation's gallery."),
    },
)

if __name__ == "__main__":
    run(app, PROGRAM)
