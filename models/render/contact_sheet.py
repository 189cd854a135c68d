"""`python -m models.render.contact_sheet DIR SHEET.png [FIRST COUNT LIGHTS]`: capture folders as one picture to look at.

A row is a scene: flash, albedo, normal, roughness, depth, then relit and shadow of the first lights.
"""

import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import OpenEXR


def exr(path):
    """The image of a float EXR, (H, W, 3) or (H, W)."""
    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        return channels["RGB" if "RGB" in channels else "Y"].pixels


def shown(linear):
    linear = np.nan_to_num(linear).clip(0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def row(folder, lights, side=192):
    """The scene's channels side by side."""
    truth, gray = folder / "truth", lambda a: np.repeat(np.nan_to_num(a)[..., None], 3, 2)
    depth = exr(folder / "depth.exr")
    low, high = np.nanpercentile(depth, [1, 95])
    cells = [shown(exr(folder / "flash.exr")), shown(exr(truth / "albedo.exr")), np.nan_to_num(exr(truth / "normal.exr")) / 2 + 0.5,
             gray(exr(truth / "roughness.exr")), gray(1 - (depth - low) / (high - low))]
    entries = tomllib.loads((truth / "lights.toml").read_text())["light"]
    for entry in entries[:lights]:
        cell = shown(exr(truth / entry["image"]))
        shadow = cv2.imread(str(truth / entry["shadow"]), 0) / 255.0
        x, y, z = entry["direction"]
        for picture in (cell, gray(shadow)):
            small = cv2.resize(np.float32(picture.clip(0, 1)), (side, side), interpolation=cv2.INTER_AREA)
            centre, tip = (22, 22), (int(22 + 18 * x), int(22 - 18 * y))
            cv2.circle(small, centre, 18, (0.2, 0.2, 0.2), -1)
            cv2.line(small, centre, tip, (1, 1, 0), 2)
            cv2.circle(small, tip, 3, (1, 0.3, 0), -1)
            cells.append(small)
    return np.concatenate([cv2.resize(np.float32(c.clip(0, 1)), (side, side), interpolation=cv2.INTER_AREA) for c in cells], 1)


def main():
    root, out, first, count, lights = Path(sys.argv[1]), sys.argv[2], *map(int, (sys.argv[3:] + ["0", "12", "3"][len(sys.argv) - 3 :]))
    folders = sorted(p for p in root.iterdir() if p.name.isdigit())[first : first + count]
    sheet = np.concatenate([row(f, lights) for f in folders], 0)
    cv2.imwrite(out, np.uint8(sheet[..., ::-1] * 255))


if __name__ == "__main__":
    main()
