"""`python -m models.render --out DIR --split val --count 40 --size 256`: renders what is not there yet."""

import argparse
import os
import sys
import time
from pathlib import Path

arguments = argparse.ArgumentParser(prog="models.render", description=__doc__)
arguments.add_argument("--out", type=Path, required=True, help="folder that receives NNNN/, one a scene")
arguments.add_argument("--split", choices=["train", "val", "test"], required=True)
arguments.add_argument("--count", type=int, default=40, help="scenes START .. START + COUNT")
arguments.add_argument("--start", type=int, default=0)
arguments.add_argument("--size", type=int, default=256, help="pixels on a side")
arguments.add_argument("--lights", type=int, default=12, help="directional lights a scene")
arguments.add_argument("--seed", type=int, default=1, help="another seed is another set of scenes")
arguments.add_argument("--direct-side", type=int, default=3, help="its square is the samples a pixel of direct light")
arguments.add_argument("--indirect-side", type=int, default=2, help="its square is the samples a pixel of indirect light")
arguments.add_argument("--bounces", type=int, default=3, help="of indirect light; 0 is direct light only")
arguments.add_argument("--ambient-every", type=int, default=4, help="each Nth scene has a lit room and ambient.exr; 0 is none")
arguments.add_argument("--threads", type=int, default=1)
arguments.add_argument("--as", dest="form", choices=["capture-folder"], default="capture-folder")


def main():
    asked = arguments.parse_args()
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1")
    if not Path(os.environ["DRJIT_LIBLLVM_PATH"]).exists():
        sys.exit(f"{os.environ['DRJIT_LIBLLVM_PATH']}: not there; run models/render/setup.sh or set DRJIT_LIBLLVM_PATH")
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(asked.threads)
    from .capture_folder import rendered, write
    from .scene import scene

    asked.out.mkdir(parents=True, exist_ok=True)
    todo = [i for i in range(asked.start, asked.start + asked.count) if not (asked.out / f"{i:04}").exists()]
    began = time.monotonic()
    for done, index in enumerate(todo, 1):
        made = scene(asked.split, index, asked.seed, asked.lights)
        with_ambient = asked.ambient_every > 0 and index % asked.ambient_every == asked.ambient_every - 1
        channels = rendered(made, asked.size, asked.direct_side, asked.indirect_side, asked.bounces, with_ambient)
        write(made, channels, asked.out / f"{index:04}", asked.size)
        each = (time.monotonic() - began) / done
        print(f"{asked.split} {index:04} {made.facts['layout']:5} {len(made.corners):7} triangles "
              f"{done}/{len(todo)} {each:.1f} s a scene, {each * (len(todo) - done) / 60:.1f} min left", flush=True)


main()
