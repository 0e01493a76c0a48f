"""`python -m benchmarks bench NAME`, `figure NAME`, `scene NAME`, `gallery`, which targets of `make` call.

Errors, warnings and exit codes are those of the `glpath` command.
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
        "scene": Part(
            "benchmarks.scene_command",
            GROUP,
            "Make a model that ships, `scenes/NAME.glb`, or the room of another fineness.",
        ),
        "gallery": Part("benchmarks.gallery_command", GROUP, "Render the pictures of the documentation's gallery."),
    },
)

if __name__ == "__main__":
    run(app, PROGRAM)
