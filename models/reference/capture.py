"""A capture folder as what the networks are fed; the plain cases alone: linear color, no distortion, depth on the color grid."""

import tomllib

import cv2
import numpy as np
import OpenEXR
import torch

from . import feeding


def read(folder, name, required=True):
    """A picture of the folder, (height, width[, 3]): EXR as stored, PNG as stored whole numbers; None where there is none."""
    if (path := folder / f"{name}.exr").exists():
        with OpenEXR.File(str(path)) as file:
            channels = file.channels()
            return channels["RGB" if "RGB" in channels else next(iter(channels))].pixels
    if (path := folder / f"{name}.png").exists():
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        return picture[..., 2::-1] if picture.ndim == 3 else picture
    if required:
        raise SystemExit(f"{folder}: neither {name}.exr nor {name}.png; export it from your camera's raw files")
    return None


def linear(folder, name, color, required=True):
    """A photograph as light, (3, height, width), black taken off, white = 1; None where there is none."""
    picture = read(folder, name, required)
    if picture is None:
        return None
    if picture.dtype.kind == "u":
        picture = picture / np.iinfo(picture.dtype).max
    black, white = color.get("black_level", 0.0), color.get("white_level", 1.0)
    light = np.float32((picture - black) / (white - black)).transpose(2, 0, 1)
    if light.shape[1:] != (color["height"], color["width"]):
        declared = f"capture.toml says {color['width']} × {color['height']}"
        raise SystemExit(f"{folder}/{name}: {light.shape[2]} × {light.shape[1]} pixels, {declared}; correct one of them")
    return torch.from_numpy(light)[None]


def plain(folder):
    """capture.toml; SystemExit naming the field where the case is not a plain one."""
    declared = tomllib.loads((folder / "capture.toml").read_text())
    color = declared["color"]
    lens, depth = color.get("distortion", {}).get("model", "none"), declared.get("depth", {})
    rules = {
        "color.transfer": (color.get("transfer", "linear") == "linear", "only linear is read here; linearise the pictures"),
        "color.distortion": (lens == "none", "undistort the pictures first"),
        "depth": (depth.keys() <= {"depth_unit_metres"}, "depth must lie on the color grid; register it first"),
        "flash.intensity": ("intensity" in declared.get("flash", {}), "is needed: the value of a white wall at one metre"),
        "color.width, height": (color["width"] % 32 == color["height"] % 32 == 0, "must be multiples of 32; crop the pictures"),
    }
    for field, (kept, remedy) in rules.items():
        if not kept:
            raise SystemExit(f"{folder}/capture.toml: {field}: {remedy}")
    return declared


def fed(folder, lights):
    """The batch that `Scenes` would give for the folder under each of the lights (unit vectors), truth apart."""
    declared = plain(folder)
    color = declared["color"]
    flash, ambient = linear(folder, "flash", color), linear(folder, "ambient", color, required=False)
    if ambient is None:
        ambient = torch.zeros_like(flash)
    exposure = lambda name: np.prod([color.get(name, {}).get(part, 1.0) for part in ("seconds", "gain")])
    alone = (flash - ambient * float(exposure("flash_exposure") / exposure("ambient_exposure"))).clamp(min=0)
    depth = read(folder, "depth").squeeze()
    if depth.dtype.kind == "u":
        depth = depth * declared.get("depth", {}).get("depth_unit_metres", 0.001)
    depth = np.where(depth > 0, depth, np.nan).astype(np.float32)
    mask = read(folder, "mask", required=False)
    if mask is not None:
        depth[(mask if mask.ndim == 2 else mask.max(-1)) == 0] = np.nan
    depth = torch.from_numpy(depth)[None, None]
    camera = torch.tensor([[color[name] for name in ("fx", "fy", "cx", "cy")]], dtype=torch.float32)
    intensity = torch.tensor([float(declared["flash"]["intensity"])])
    known = torch.isfinite(depth).float()
    common = {"known": known, "mask": known, "camera": camera, "near": feeding.nearness(depth)}
    common |= {"flash": feeding.scaled(alone, intensity, depth), "ambient": feeding.scaled(flash, intensity, depth)}
    return [common | {"light": light[None], "cloud": feeding.cloud(depth, camera, light[None])} for light in lights]
