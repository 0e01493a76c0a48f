"""`python -m benchmarks bench NAME`, `... figure NAME`, `... scene NAME`; `make bench` and `make figure` call it.

Errors, warnings and exit codes are those of the `glpath` command.
"""

from __future__ import annotations

from benchmarks import bench_command, figure_command, scene_command
from glpath.cli.main import program, run

PROGRAM = "python -m benchmarks"

app = program(PROGRAM, "Measures glpath, and makes the figures and tables of its papers and its models again.")
for _command in (bench_command, figure_command, scene_command):
    _command.register(app)

if __name__ == "__main__":
    run(app, PROGRAM)
