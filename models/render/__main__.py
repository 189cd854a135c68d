"""`python -m models.render --out DIR --split val --count 40 --size 256`: renders what is not there yet."""

import argparse
import multiprocessing
import os
import sys
from pathlib import Path

from .bank import SPLITS
from .batch import work

arguments = argparse.ArgumentParser(prog="models.render", description=__doc__)
arguments.add_argument("--out", type=Path, required=True, help="folder that receives NNNN/, one a scene, or NNNN-MMMM/, one a shard")
arguments.add_argument("--split", choices=list(SPLITS), required=True)
arguments.add_argument("--as", dest="form", choices=["capture-folder", "shards"], default="capture-folder")
arguments.add_argument("--count", type=int, default=40, help="scenes START .. START + COUNT")
arguments.add_argument("--start", type=int, default=0)
arguments.add_argument("--shard", type=int, default=20, help="scenes a shard")
arguments.add_argument("--size", type=int, default=256, help="pixels on a side")
arguments.add_argument("--lights", type=int, default=12, help="directional lights a scene")
arguments.add_argument("--environments", type=int, default=0, help="environment maps a scene, capture folders only")
arguments.add_argument("--no-relit", dest="relit", action="store_false", help="shadow maps but no relit pictures: cheap")
arguments.add_argument("--depth-noise", choices=["none", "paper", "tof"], default="none", help="on the depth of capture folders")
arguments.add_argument("--packaged", type=float, default=0.0, help="share of shapes and textures from packages; `other` is all of them")
arguments.add_argument("--seed", type=int, default=1, help="another seed is another set of scenes")
arguments.add_argument("--direct-side", type=int, default=3, help="its square is the samples a pixel of direct light")
arguments.add_argument("--indirect-side", type=int, default=2, help="its square is the samples a pixel of indirect light")
arguments.add_argument("--bounces", type=int, default=3, help="of indirect light; 0 is direct light only")
arguments.add_argument("--ambient-every", type=int, default=4, help="each Nth scene has a lit room and its ambient light; 0 is none")
arguments.add_argument("--jobs", type=int, default=1, help="processes of one thread each")


def main():
    asked = arguments.parse_args()
    if asked.environments and asked.form == "shards":
        sys.exit("--environments: shards do not keep them; use --as capture-folder")
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1")
    if not Path(os.environ["DRJIT_LIBLLVM_PATH"]).exists():
        sys.exit(f"{os.environ['DRJIT_LIBLLVM_PATH']}: not there; run models/render/setup.sh or set DRJIT_LIBLLVM_PATH")
    asked.out.mkdir(parents=True, exist_ok=True)
    fresh = multiprocessing.get_context("spawn")
    processes = [fresh.Process(target=work, args=(asked, part)) for part in range(asked.jobs)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        sys.exit("a process failed; what is finished is kept, run the command again for the rest")


if __name__ == "__main__":
    main()
