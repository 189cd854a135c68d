"""`python -m models.render.shadow_baselines DIR [--scenes N] [--lights N]`: shadow MSE of what needs no training.

The true normals (before relief: shadows are those of the shape) and the clean depth map are given. `n.l` calls a surface lit that faces the lamp; the marches also
walk each pixel's light ray across the depth map and call it shadowed where the ray passes behind a sample by less
than the assumed thickness (along z). Mean over all counted pixels of (shadow - truth)^2, on [0, 1].
"""

import argparse
import tomllib
from pathlib import Path

import cv2
import numpy as np

from .contact_sheet import exr

THICKNESSES_METRES = (np.inf, 0.8, 0.4, 0.2, 0.1)
STEPS = 192  # of equal length in the picture, so about two pixels at 256
BIAS = 0.006  # of the depth: what a pixel's own slope may differ by


def marched(depth, normal, light, focal, centre):
    """Per thickness, true where a surface that faces the lamp is lit."""
    height, width = depth.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    facing = normal @ light > 0
    use = facing & np.isfinite(depth)
    l = (light * [1, -1, -1]).astype(np.float32)
    z = depth[use]
    p = np.stack([(x[use] - centre[0]) / focal * z, (y[use] - centre[1]) / focal * z, z])
    n = normal[use].T * np.array([[1], [-1], [-1]], np.float32)
    p += n * 0.004 * z
    # the far end of each ray: 4 m on, or short of the lens plane
    reach = np.full(z.shape, 4.0, np.float32)
    if l[2] < 0:
        reach = np.minimum(reach, (p[2] - 0.05) / -l[2])
    q = p + l[:, None] * reach
    u0, v0 = focal * p[0] / p[2] + centre[0], focal * p[1] / p[2] + centre[1]
    u1, v1 = focal * q[0] / q[2] + centre[0], focal * q[1] / q[2] + centre[1]
    # cut where it leaves the picture
    with np.errstate(divide="ignore", invalid="ignore"):
        cuts = [np.where(d != 0, (edge - s) / d, np.inf) for s, d, edge in
                ((u0, u1 - u0, 0), (u0, u1 - u0, width - 1), (v0, v1 - v0, 0), (v0, v1 - v0, height - 1))]
    end = np.ones_like(z)
    for cut in cuts:
        end = np.where((cut > 1e-6) & (cut < end), cut, end)
    shadowed = [np.zeros(z.shape, bool) for _ in THICKNESSES_METRES]
    known = np.where(np.isfinite(depth), depth, 1e9).astype(np.float32)
    for k in range(1, STEPS + 1):
        s = end * k / STEPS
        u, v = u0 + (u1 - u0) * s, v0 + (v1 - v0) * s
        ray = 1 / ((1 - s) / p[2] + s / q[2])  # 1/z is linear in the picture
        far = (np.abs(u - u0) > 1) | (np.abs(v - v0) > 1)
        i, j = np.rint(v).clip(0, height - 1).astype(int), np.rint(u).clip(0, width - 1).astype(int)
        behind = ray - known[i, j]
        for dark, thickness in zip(shadowed, THICKNESSES_METRES):
            dark |= far & (behind > BIAS * ray) & (behind < thickness)
    lit = []
    for dark in shadowed:
        image = np.zeros(depth.shape, bool)
        image[use] = ~dark
        lit.append(image)
    return facing, lit


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("root", type=Path)
    arguments.add_argument("--scenes", type=int, default=1000)
    arguments.add_argument("--lights", type=int, default=1000)
    asked = arguments.parse_args()
    missed, invented, angles = [], [], []
    folders = sorted(p for p in asked.root.iterdir() if p.name.isdigit())[: asked.scenes]
    for folder in folders:
        color = tomllib.loads((folder / "capture.toml").read_text())["color"]
        depth, normal = exr(folder / "depth.exr"), exr(folder / "truth" / "normal_smooth.exr")
        mask = np.isfinite(depth)
        for entry in tomllib.loads((folder / "truth" / "lights.toml").read_text())["light"][: asked.lights]:
            truth = cv2.imread(str(folder / "truth" / entry["shadow"]), 0)[mask] > 127
            light = np.array(entry["direction"])
            facing, lit = marched(depth, normal, light, color["fx"], (color["cx"], color["cy"]))
            guesses = [np.ones_like(truth)] + [guess[mask] for guess in [facing, *lit]]
            missed.append([np.mean(guess & ~truth) for guess in guesses])
            invented.append([np.mean(~guess & truth) for guess in guesses])
            angles.append(np.degrees(np.arccos(light[2])))
    missed, invented, angles = np.array(missed), np.array(invented), np.array(angles)
    names = ["all lit", "n.l alone"] + [f"march, {'unlimited' if np.isinf(t) else f'{t} m'}" for t in THICKNESSES_METRES]
    bands = [(0, 30), (30, 55), (55, 81)]
    print(f"{len(folders)} scenes, {len(angles)} lights; shadow MSE = shadows missed + invented; MSE by degrees off axis {bands}")
    for name, out, in_ in zip(names, missed.T, invented.T):
        column = out + in_
        by_angle = "  ".join(f"{column[(angles >= a) & (angles < b)].mean():.2e}" if ((angles >= a) & (angles < b)).any() else "-" for a, b in bands)
        print(f"{name:18} {column.mean():.3e} = {out.mean():.2e} + {in_.mean():.2e}   {by_angle}")


if __name__ == "__main__":
    main()
