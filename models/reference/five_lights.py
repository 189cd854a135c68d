"""`python3 -m models.reference.five_lights FOLDER… --run RUN --size 128 --out DIR`: OSS's answers for rendered capture folders.

Five of each capture's true pictures go in and are never asked for; DIR/NAME receives relit_NNN.exr for its other lights, NaN where no
surface is, and times.json, so that `capturectl eval --answers 6=DIR` can take them.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from ..render.pack import folder_arrays
from ..render.shards import write
from . import checkpoint
from .answer import exr
from .scenes import Scenes
from .stages import stage

arguments = argparse.ArgumentParser(prog="models.reference.five_lights", description=__doc__.split("\n")[0])
arguments.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
arguments.add_argument("--run", type=Path, required=True, help="where synthesis-oss.pt is")
arguments.add_argument("--size", type=int, default=128, help="pixels on a side that the network sees")
arguments.add_argument("--out", type=Path, required=True)


def main():
    asked = arguments.parse_args()
    torch.set_num_threads(1)
    one = stage("synthesis", "oss")
    checkpoint.warmed(one.network, checkpoint.path(asked.run, "synthesis", "oss")).eval()
    for done, folder in enumerate(asked.folders, 1):
        with tempfile.TemporaryDirectory() as packed:
            write([folder_arrays(folder)], Path(packed) / "0000-0000")
            scenes = Scenes([Path(packed)], one.needs, five=True)
            full, times = scenes.shards[0], [None] * scenes.shards[0].lights
            known = torch.isfinite(torch.from_numpy(np.array(full.channels["depth"][0])))[None].float()
            (asked.out / folder.name).mkdir(parents=True, exist_ok=True)
            for row in scenes.samples(asked.size, one.lights):
                found = scenes.batch([row], asked.size, np.random.default_rng(0))
                began = time.monotonic()
                with torch.no_grad():
                    relit = one.answer(found)["relit"].clamp(min=0)
                times[row[2]] = 1e3 * (time.monotonic() - began)
                relit = torch.nn.functional.interpolate(relit, (full.size, full.size), mode="bilinear")
                exr(asked.out / folder.name / f"relit_{row[2]:03}.exr", relit, known)
            (asked.out / folder.name / "times.json").write_text(json.dumps({"milliseconds": times}))
        print(f"{folder.name} {done}/{len(asked.folders)}", flush=True)


if __name__ == "__main__":
    main()
