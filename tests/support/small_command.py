"""`python -m tests.support.small_command ARGUMENTS`: runs the `glpath` command with little to compute.

Pages show commands for real pictures; a test runs each with a few pixels and samples.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from glpath.cli.main import run

#: For each command: options with a value to omit, and options to add.
SMALLER: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "render": (
        ("--resolution", "--spp", "--noise", "--clean", "--time-limit", "--crop"),
        ("--resolution", "24x16"),
    ),
    "lightmap": (("--size", "--spp", "--noise", "--clean"), ("--size", "512", "--spp", "2")),
    "daylight": (("--subdivision", "--samples", "--suns"), ("--samples", "2", "--suns", "40")),
    "measure": (("--spp", "--noise"), ("--spp", "4")),
    "probes": (("--spp", "--noise", "--grid"), ("--spp", "2", "--grid", "2x2x2")),
    "radiosity": (("--patches", "--particles"), ("--patches", "100")),
}


def smaller(arguments: Sequence[str]) -> list[str]:
    """Return the arguments with less to compute."""
    command = arguments[0] if arguments else ""
    if command not in SMALLER or "--job" in arguments or any(each.startswith("--help") for each in arguments):
        return list(arguments)
    left_out, added = SMALLER[command]
    kept, rest = [], iter(arguments)
    for each in rest:
        if each in left_out:
            next(rest)
        elif each.startswith("level="):  # for a generated scene
            kept.append("level=4")
        else:
            kept.append(each)
    if command == "render" and "--sample-range" not in kept:
        added = (*added, "--spp", "16")  # the fewest with which a picture may be denoised
    return [*kept, *added]


if __name__ == "__main__":
    sys.argv[1:] = smaller(sys.argv[1:])
    run()
