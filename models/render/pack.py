"""`python -m models.render.pack OUT FOLDER…`: rendered capture folders as one shard, so that training's tools can read them."""

import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np

from .contact_sheet import exr
from .shards import write


def folder_arrays(folder):
    """What a shard keeps (see `shards`) of one rendered capture folder with clean depth."""
    truth, declared = folder / "truth", tomllib.loads((folder / "capture.toml").read_text())
    color, lights = declared["color"], tomllib.loads((truth / "lights.toml").read_text())["light"]
    first = lambda picture: np.nan_to_num(picture if picture.ndim == 3 else picture[..., None]).transpose(2, 0, 1)
    kept = {name: first(exr(truth / f"{name}.exr")) for name in ("albedo", "normal", "normal_smooth", "roughness")}
    flash = first(exr(folder / "flash.exr"))
    kept["ambient"] = first(exr(folder / "ambient.exr")) if (folder / "ambient.exr").exists() else np.zeros_like(flash)
    kept["flash"] = flash - kept["ambient"]
    kept["depth"] = exr(folder / "depth.exr").reshape(1, color["height"], color["width"])
    kept["amplitude"] = first(exr(folder / "amplitude.exr"))
    kept["light"] = np.array([light["direction"] for light in lights])
    kept["shadow"] = np.stack([cv2.imread(str(truth / light["shadow"]), cv2.IMREAD_GRAYSCALE)[None] for light in lights])
    kept["relit"] = np.stack([first(exr(truth / light["image"])) for light in lights])
    kept["camera"] = np.array([color[name] for name in ("fx", "fy", "cx", "cy")])
    kept["intensity"] = np.array(declared["flash"]["intensity"])
    return kept


def main():
    out, *folders = map(Path, sys.argv[1:])
    if not folders:
        sys.exit(__doc__)
    folders.sort()
    write([folder_arrays(folder) for folder in folders], out / f"{folders[0].name}-{folders[-1].name}")


if __name__ == "__main__":
    main()
