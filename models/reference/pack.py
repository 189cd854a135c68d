"""`python3 -m models.reference.pack FOLDER OUT --size 128`: capture folders with truth as plain arrays that train fast.

OUT receives one .npy per channel, scene by scene, and appears whole or not at all:

| file | shape | meaning |
|---|---|---|
| flash, albedo, normal | N, 3, S, S half | flash alone, linear; linear; unit, x right, y up, z toward the camera |
| roughness, depth | N, 1, S, S half, float | Karis' roughness; z in metres, NaN = no surface |
| light | N, L, 3 float | unit vectors toward the lamps |
| relit, shadow | N, L, 3 or 1, S, S half, byte | linear; 0 = in shadow, 255 = lit |
| camera | N, 4 float | fx, fy, cx, cy in pixels of S |
"""

import argparse
import shutil
import tomllib
from pathlib import Path

import cv2
import numpy as np

from ..render.contact_sheet import exr

arguments = argparse.ArgumentParser(prog="models.reference.pack", description=__doc__.split("\n")[0])
arguments.add_argument("folder", type=Path)
arguments.add_argument("out", type=Path)
arguments.add_argument("--size", type=int, default=128, help="pixels on a side; the scenes' own size over a whole number")


def smaller(picture, factor):
    """Means over squares: what a coarser camera would see. Channels first."""
    if picture.ndim == 2:
        picture = picture[..., None]
    height, width, channels = picture.shape
    squares = picture.reshape(height // factor, factor, width // factor, factor, channels)
    with np.errstate(invalid="ignore"):
        return squares.mean((1, 3)).transpose(2, 0, 1)


def scene(folder, size):
    """One scene's channels by name; see the module."""
    declared = tomllib.loads((folder / "capture.toml").read_text())["color"]
    if declared["width"] % size:
        raise SystemExit(f"{folder}: {declared['width']} pixels are no whole multiple of {size}; render or pack at another size")
    factor = declared["width"] // size
    truth = folder / "truth"
    flash = exr(folder / "flash.exr")
    if (folder / "ambient.exr").exists():
        flash = flash - exr(folder / "ambient.exr")
    lights = tomllib.loads((truth / "lights.toml").read_text())["light"]
    channels = {"flash": smaller(flash, factor)}
    for name in ("albedo", "normal", "roughness"):
        channels[name] = smaller(np.nan_to_num(exr(truth / f"{name}.exr")), factor)
    length = np.linalg.norm(channels["normal"], axis=0, keepdims=True)
    channels["normal"] = np.where(length > 1e-3, channels["normal"] / np.maximum(length, 1e-3), [[[0.0]], [[0.0]], [[1.0]]])
    # Depth is never averaged, which would put surface between two others.
    middle = factor // 2
    depth = exr(folder / "depth.exr").squeeze()
    channels["depth"] = depth[middle::factor, middle::factor][None]
    channels["light"] = np.array([light["direction"] for light in lights])
    channels["relit"] = np.stack([smaller(exr(truth / light["image"]), factor) for light in lights])
    shadows = [cv2.imread(str(truth / light["shadow"]), cv2.IMREAD_GRAYSCALE) for light in lights]
    channels["shadow"] = np.stack([np.rint(smaller(shadow.astype(np.float32), factor)) for shadow in shadows])
    centre = [(declared[c] - (factor - 1) / 2) / factor for c in ("cx", "cy")]
    channels["camera"] = np.array([declared["fx"] / factor, declared["fy"] / factor, *centre])
    return channels


KINDS = {"shadow": np.uint8, "depth": np.float32, "light": np.float32, "camera": np.float32}


def main():
    asked = arguments.parse_args()
    folders = sorted(path for path in asked.folder.iterdir() if (path / "capture.toml").exists())
    if not folders:
        raise SystemExit(f"{asked.folder}: no scenes; render some with `python3 -m models.render`")
    building = asked.out.with_name(f".{asked.out.name}.building")
    shutil.rmtree(building, ignore_errors=True)
    building.mkdir(parents=True)
    arrays = {}
    for index, folder in enumerate(folders):
        for name, channel in scene(folder, asked.size).items():
            if name not in arrays:
                kind, shape = KINDS.get(name, np.float16), (len(folders), *channel.shape)
                arrays[name] = np.lib.format.open_memmap(building / f"{name}.npy", "w+", kind, shape)
            arrays[name][index] = channel
        print(f"\r{index + 1}/{len(folders)} scenes", end="", flush=True)
    print()
    for array in arrays.values():
        array.flush()
    shutil.rmtree(asked.out, ignore_errors=True)
    building.rename(asked.out)


if __name__ == "__main__":
    main()
