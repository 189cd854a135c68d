"""`python3 -m models.reconstruction FOLDER… --materials ANSWERS --out DIR`: meshes each capture's depth and path-traces it.

ANSWERS/NAME holds albedo.exr, normal.exr and roughness.exr of capture NAME, as `capturectl relight --tier paper` writes them. DIR/NAME
receives the same three, and relit_NNN.exr and shadow_NNN.png for the lights of the capture's truth, so that
`capturectl eval` can take DIR for a row. What no triangle covers stays unknown (NaN), which is this method's known weakness.
"""

import argparse
import json
import os
import shutil
import sys
import time
import tomllib
from pathlib import Path

import numpy as np

arguments = argparse.ArgumentParser(prog="models.reconstruction", description=__doc__.split("\n")[0])
arguments.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="capture folders with truth/lights.toml")
arguments.add_argument("--materials", type=Path, required=True)
arguments.add_argument("--out", type=Path, required=True)
arguments.add_argument("--direct-side", type=int, default=3, help="its square is the samples a pixel of direct light")
arguments.add_argument("--indirect-side", type=int, default=2, help="its square is the samples a pixel of indirect light")
arguments.add_argument("--bounces", type=int, default=3, help="of indirect light")
MATERIALS = ("albedo", "normal", "roughness")


def answered(folder, materials, asked):
    """Materials, pictures, shadow maps, milliseconds that the mesh took, and those of each light as times.json has them."""
    from ..render.contact_sheet import exr
    from ..render.tracer import Camera, Lamp, Tracer
    from .scene import meshed
    from .tracing import traced

    declared = tomllib.loads((folder / "capture.toml").read_text())
    if "depth" in declared:
        sys.exit(f"{folder}: its depth has a camera of its own; only depth on the color grid is meshed here")
    color = declared["color"]
    if (color["width"], color["fx"], color["cx"]) != (color["height"], color["fy"], color["cy"]):
        sys.exit(f"{folder}/capture.toml: [color] is not square about its middle; only rendered captures are taken here")
    lights = [light["direction"] for light in tomllib.loads((folder / "truth" / "lights.toml").read_text())["light"]]
    surface = {name: exr(materials / f"{name}.exr") for name in MATERIALS}
    began = time.monotonic()
    size, f = color["width"], color["fx"]
    scene = meshed(exr(folder / "depth.exr").squeeze(), surface, f, color["cx"])
    made = time.monotonic()
    camera = Camera(size, 2 * np.degrees(np.arctan(size / 2 / f)))
    pictures, shadows = traced(Tracer(scene), camera, [Lamp(np.array(d) * [1, -1, -1], False) for d in lights], asked)
    each = (time.monotonic() - made) / max(len(lights), 1)
    return surface, pictures, shadows, 1e3 * (made - began), {"milliseconds": [1e3 * each] * len(lights)}


def main():
    asked = arguments.parse_args()
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1")
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    from ..render.capture_folder import exr, png

    asked.out.mkdir(parents=True, exist_ok=True)
    todo = [folder for folder in asked.folders if not (asked.out / folder.name).exists()]
    for done, folder in enumerate(todo, 1):
        materials = asked.materials / folder.name
        if not (materials / "albedo.exr").exists():
            sys.exit(f"{materials}: no materials; write them with `capturectl relight {folder} --tier paper --out {materials}`")
        surface, pictures, shadows, meshing, times = answered(folder, materials, asked)
        building = asked.out / f".{folder.name}.{os.getpid()}"
        shutil.rmtree(building, ignore_errors=True)
        building.mkdir()
        for name, picture in surface.items():
            exr(building / f"{name}.exr", picture)
        for k, (picture, shadow) in enumerate(zip(pictures, shadows)):
            exr(building / f"relit_{k:03}.exr", picture)
            png(building / f"shadow_{k:03}.png", shadow)
        (building / "times.json").write_text(json.dumps(times))
        os.replace(building, asked.out / folder.name)
        print(f"{folder.name} {done}/{len(todo)}: mesh {meshing:.0f} ms, a light {times['milliseconds'][0]:.0f} ms", flush=True)


if __name__ == "__main__":
    main()
