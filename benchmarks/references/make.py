"""Makes a converged picture with Mitsuba 3, and measures its error.

    python -m benchmarks.references.make --out benchmarks/references/cornell-box-36-depth3.npz

Many pictures of `--batch` samples with different seeds are summed in float64. Because they are independent, their
spread gives the error of their mean. The file holds

radiance  : (H, W, 3) float16, linear Rec. 709, row 0 at the top; rounding adds less than 1e-7 to relMSE
made_with : JSON: the program and its version, scene, depth, samples, command, and `relmse_of_reference`

Needs the `reference` extra. Each stored 256 x 256 picture took about half an hour on two shared cores; roulette was
off.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import mitsuba as mitsuba_peer

MITSUBAS_OWN = "mi.cornell_box"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--scene", default=MITSUBAS_OWN, help=f"a glpath scene, or {MITSUBAS_OWN} (the default)")
    options.add_argument("--side", type=int, default=256, help="pixels of the picture, which is square")
    options.add_argument("--depth", type=int, default=3, help="as in the path-buffer paper: 1 is direct light only")
    options.add_argument("--spp", type=int, default=32768, help="samples per pixel in all")
    options.add_argument("--batch", type=int, default=1024, help="samples per pixel of one seed")
    options.add_argument("--seed", type=int, default=0, help="the first seed")
    options.add_argument("--out", type=Path, required=True)
    args = options.parse_args()
    batches = args.spp // args.batch
    if batches < 2:
        options.error("--spp must be at least twice --batch, for the error is estimated between batches")

    if args.scene == MITSUBAS_OWN:
        if args.side != 256:
            options.error(f"--side {args.side}: {MITSUBAS_OWN} has 256")
        peer = mitsuba_peer.mitsuba_cornell_box(args.depth, spp=args.batch)
    else:
        from glpath.io import load_scene

        scene = load_scene(args.scene).with_camera(resolution=(args.side, args.side))
        peer = mitsuba_peer.to_mitsuba(scene, args.depth, spp=args.batch)

    if mitsuba_peer.samples_rendered(peer, args.batch) != args.batch:
        options.error(f"--batch {args.batch} is not a number of samples that multijitter can take; try a square")
    total: Any = 0.0
    squares: Any = 0.0
    for i in range(batches):
        image = mitsuba_peer.render_peer(peer, args.batch, args.seed + i)
        total, squares = total + image, squares + image**2
        print(f"{i + 1}/{batches}", file=sys.stderr, flush=True)
    mean = total / batches
    variance_of_mean = np.maximum(squares / batches - mean**2, 0) / (batches - 1)
    stored = mean.astype(np.float16)
    weight = 1 / (mean**2 + 0.01)

    import mitsuba as mi

    made_with = {
        "program": f"Mitsuba {mi.__version__}, {mi.variant()}, path, rr_depth 5, multijitter, box filter",
        "scene": args.scene,
        "max_depth": args.depth,
        "spp": batches * args.batch,
        "batches": batches,
        "first_seed": args.seed,
        "relmse_of_reference": float(np.mean(variance_of_mean * weight)),
        "relmse_of_rounding": float(np.mean((stored.astype(np.float64) - mean) ** 2 * weight)),
        "image_mean": mean.mean(axis=(0, 1)).tolist(),
        "command": "python -m benchmarks.references.make "
        f"--scene {args.scene} --side {args.side} --depth {args.depth} --spp {args.spp} --batch {args.batch} "
        f"--seed {args.seed} --out {args.out.name}",
        "python": platform.python_version(),
    }
    args.out.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(args.out, radiance=stored, made_with=json.dumps(made_with, indent=1))
    print(json.dumps(made_with, indent=1))


if __name__ == "__main__":
    main()
