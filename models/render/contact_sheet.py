"""`python -m models.render.contact_sheet DIR SHEET.png [FIRST COUNT LIGHTS SIDE]`: capture folders as one picture to look at.

A row is a scene: with flash, without, albedo, normal, roughness, depth, infrared, under an environment map, then relit and
shadow of the first lights, the lamp's direction in the corner.
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


def row(folder, lights, side):
    """The scene's channels side by side; black where a scene lacks one."""
    truth, gray = folder / "truth", lambda a: np.repeat(np.nan_to_num(a).squeeze()[..., None], 3, 2)
    depth, black = exr(folder / "depth.exr").squeeze(), np.zeros((side, side, 3))
    low, high = np.nanpercentile(depth, [1, 95])
    maybe = lambda path, look: look(exr(path)) if path.exists() else black
    cells = [shown(exr(folder / "flash.exr")), maybe(folder / "ambient.exr", shown), shown(exr(truth / "albedo.exr")),
             np.nan_to_num(exr(truth / "normal.exr")) / 2 + 0.5, gray(exr(truth / "roughness.exr")),
             gray(1 - (depth - low) / (high - low)), maybe(folder / "amplitude.exr", lambda a: shown(gray(a))),
             maybe(truth / "environment_000.exr", shown)]
    entries = tomllib.loads((truth / "lights.toml").read_text())["light"]
    for entry in entries[:lights]:
        x, y, _ = entry["direction"]
        for picture in (shown(exr(truth / entry["image"])), gray(cv2.imread(str(truth / entry["shadow"]), 0) / 255.0)):
            small = cv2.resize(np.float32(picture.clip(0, 1)), (side, side), interpolation=cv2.INTER_AREA)
            r = side // 11
            centre, tip = (r + 3, r + 3), (int(r + 3 + r * x), int(r + 3 - r * y))
            cv2.circle(small, centre, r, (0.2, 0.2, 0.2), -1)
            cv2.line(small, centre, tip, (1, 1, 0), 1)
            cv2.circle(small, tip, 2, (1, 0.3, 0), -1)
            cells.append(small)
    return np.concatenate([cv2.resize(np.float32(c.clip(0, 1)), (side, side), interpolation=cv2.INTER_AREA) for c in cells], 1)


def main():
    root, out = Path(sys.argv[1]), sys.argv[2]
    first, count, lights, side = map(int, (sys.argv[3:] + ["0", "12", "3", "192"][len(sys.argv) - 3 :]))
    folders = sorted(p for p in root.iterdir() if p.name.isdigit())[first : first + count]
    sheet = np.concatenate([row(f, lights, side) for f in folders], 0)
    cv2.imwrite(out, np.uint8(sheet[..., ::-1] * 255))


if __name__ == "__main__":
    main()
