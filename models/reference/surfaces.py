"""`python3 -m models.reference.surfaces FOLDER… --run RUN --variant sips|env --out DIR`: surfaces of rendered capture folders.

DIR/NAME receives albedo.exr, normal.exr and roughness.exr of a DecomposeNet that is trained but not shipped, NaN where no surface is,
so that `capturectl eval --answers "5:SIPS: surfaces without depth=DIR"` can take them.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch

from ..render.pack import folder_arrays
from ..render.shards import write
from . import checkpoint
from .answer import exr
from .scenes import Scenes
from .stages import stage

arguments = argparse.ArgumentParser(prog="models.reference.surfaces", description=__doc__.split("\n")[0])
arguments.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
arguments.add_argument("--run", type=Path, required=True, help="where decompose-VARIANT.pt is")
arguments.add_argument("--variant", required=True, choices=("sips", "env"))
arguments.add_argument("--size", type=int, default=128, help="pixels on a side that the network sees")
arguments.add_argument("--out", type=Path, required=True)


def main():
    asked = arguments.parse_args()
    torch.set_num_threads(1)
    one = stage("decompose", asked.variant)
    checkpoint.warmed(one.network, checkpoint.path(asked.run, "decompose", asked.variant)).eval()
    for done, folder in enumerate(asked.folders, 1):
        with tempfile.TemporaryDirectory() as packed:
            write([folder_arrays(folder)], Path(packed) / "0000-0000")
            scenes = Scenes([Path(packed)], one.needs)
            full = scenes.shards[0]
            known = torch.isfinite(torch.from_numpy(np.array(full.channels["depth"][0])))[None].float()
            found = scenes.batch(scenes.samples(asked.size, one.lights)[:1], asked.size, np.random.default_rng(0))
            with torch.no_grad():
                answer = one.answer(found)
            enlarged = lambda name: torch.nn.functional.interpolate(answer[name], (full.size, full.size), mode="bilinear")
            out = asked.out / folder.name
            out.mkdir(parents=True, exist_ok=True)
            exr(out / "albedo.exr", enlarged("albedo").clamp(0, 1), known)
            exr(out / "normal.exr", torch.nn.functional.normalize(enlarged("normal")), known)
            exr(out / "roughness.exr", enlarged("roughness"), known)
        print(f"{folder.name} {done}/{len(asked.folders)}", flush=True)


if __name__ == "__main__":
    main()
