"""Rendered shards as batches for the networks: several folders, several sizes, read as they are needed.

A root holds shards, folders NNNN-MMMM with one .npy a channel, as `python3 -m models.render --as shards` writes them
(../render/README.md). Whether a shard has `relit` decides what it can train.
"""

from pathlib import Path

import numpy as np
import torch

from . import feeding

PER_LIGHT = ("light", "relit", "shadow")
SMALL = ("light", "camera", "intensity")
"""Read whole; pictures are memory-mapped."""

FIVE = np.array([[0, 0, 1], *([x / 2, y / 2, 0.5**0.5] for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)))])
"""The lights of OSS: frontal and four at 45°; each scene gives those of its own that come nearest."""

MIRRORED_FIVE = [0, 2, 1, 4, 3]


class Shard:
    """The named channels of one folder: arrays of N scenes, the pictures S × S, L lights a scene."""

    def __init__(self, folder, needs):
        self.folder = folder
        for name in needs:
            if not (folder / f"{name}.npy").exists():
                remedy = "render the shard again with `python3 -m models.render --as shards`"
                raise SystemExit(f"{folder}/{name}.npy: not there; {remedy}")
        self.channels = {name: np.load(folder / f"{name}.npy", mmap_mode=None if name in SMALL else "r") for name in needs}
        self.size = self.channels["depth"].shape[-1]
        self.count, self.lights = self.channels["light"].shape[:2]

    def five(self, scene):
        """Indices of the scene's lights nearest to `FIVE`, each taken once."""
        left = np.array(self.channels["light"][scene] @ FIVE.T)
        chosen = []
        for k in range(5):
            chosen.append(int(left[:, k].argmax()))
            left[chosen[-1]] = -np.inf
        return chosen

    def lights_of(self, scene, asked):
        """What to relight to: every light (`each`), those not among the five (`others`), or one for the scene (`one`)."""
        if asked == "one":
            return [0]
        return [k for k in range(self.lights) if asked == "each" or k not in self.five(scene)]


class Scenes:
    """All shards of some roots that have what is needed."""

    def __init__(self, roots, needs, noisy=False, five=False, crops=0.0, mirrored=False):
        """`needs`: channels by name. `noisy`: the paper's noise on depth. `five`: five lit pictures go in. `crops`: share of the
        larger pictures that are cut instead of reduced. `mirrored`: half of all samples are mirrored left to right."""
        self.needs = tuple(dict.fromkeys(("depth", "camera", "light", *needs)))
        self.noisy, self.five, self.crops, self.mirrored = noisy, five, crops, mirrored
        folders = [folder for root in roots for folder in sorted(Path(root).glob("[0-9]*-[0-9]*")) if folder.is_dir()]
        if "relit" in self.needs:
            folders = [folder for folder in folders if (folder / "relit.npy").exists()]
        if not folders:
            kind = " with relit pictures" if "relit" in self.needs else ""
            where = ", ".join(map(str, roots))
            raise SystemExit(f"{where}: no shards{kind}; write some with `python3 -m models.render --as shards`")
        self.shards = [Shard(folder, self.needs) for folder in folders]

    def samples(self, size, lights="each", at_most=None):
        """(shard, scene, light) of everything that gives pictures of the size, as rows; `at_most` so many scenes."""
        fitting = [(number, shard) for number, shard in enumerate(self.shards) if shard.size % size == 0]
        if not fitting:
            sizes = sorted({shard.size for shard in self.shards})
            raise SystemExit(f"size {size}: shards of {sizes} pixels give none; ask for one of these over a whole number")
        scenes = [(number, shard, scene) for number, shard in fitting for scene in range(shard.count)][:at_most]
        return np.array([(number, scene, light) for number, shard, scene in scenes for light in shard.lights_of(scene, lights)])

    def batch(self, samples, size, rng):
        """Tensors by name, (batch, channels, size, size), of rows of `samples`: the needed channels, `known` (1 = surface),
        and what the networks are given (see `feeding`)."""
        parts = [self.sample(self.shards[shard], scene, light, size, rng) for shard, scene, light in samples]
        return self.fed({name: torch.stack([part[name] for part in parts]) for name in parts[0]}, rng)

    def sample(self, shard, scene, light, size, rng):
        """One scene under one light, reduced or cut to the size, perhaps mirrored."""
        read = lambda name, at: torch.from_numpy(np.array(shard.channels[name][at])).float()
        found = {name: read(name, (scene, light) if name in PER_LIGHT else scene) for name in self.needs}
        if self.five:
            chosen = shard.five(scene)
            found["pictures"] = torch.cat([read("relit", (scene, k)) for k in chosen])
            found["five"] = read("light", scene)[chosen]
        factor = shard.size // size
        if factor > 1 and rng.random() < self.crops:
            factor = int(rng.choice([f for f in range(1, factor) if factor % f == 0]))
        found = cut(reduced(found, factor), size, rng)
        return mirrored(found) if self.mirrored and rng.random() < 0.5 else found

    def fed(self, found, rng):
        """The batch with ranges kept and the networks' inputs added."""
        known = torch.isfinite(found["depth"]).float()
        depth = feeding.noisy_depth(found["depth"], rng) if self.noisy else found["depth"]
        for name in found.keys() - {"depth", "camera", "light", "five", "intensity"}:
            top = feeding.BRIGHTEST if name in ("relit", "pictures") else 255 if name == "shadow" else torch.inf
            low = -1 if name.startswith("normal") else 0
            found[name] = torch.nan_to_num(found[name], posinf=65504).clamp(low, top)
        if "shadow" in found:
            found["shadow"] = found["shadow"] / 255
        if "flash" in found:
            if "ambient" in found:
                found["ambient"] = feeding.scaled(found["flash"] + found["ambient"], found["intensity"], depth)
            found["flash"] = feeding.scaled(found["flash"], found["intensity"], depth)
        found |= {"known": known, "mask": known, "near": feeding.nearness(depth)}
        found["cloud"] = feeding.cloud(depth, found["camera"], found["light"])
        return found


def reduced(found, factor):
    """What a camera with pixels so many times as wide would see: means of squares, of the surface alone where the truth
    is meant; depth is never averaged, which would put surface between two others."""
    if factor == 1:
        return found
    found, squares = dict(found), lambda picture: torch.nn.functional.avg_pool2d(picture[None], factor)[0]
    known = torch.isfinite(found["depth"]).float()
    share = squares(known).clamp(min=1e-6)
    for name, picture in found.items():
        if name == "depth":
            found[name] = picture[:, factor // 2 :: factor, factor // 2 :: factor]
        elif name == "camera":
            fx, fy, cx, cy = picture / factor
            found[name] = torch.stack([fx, fy, cx - (factor - 1) / 2 / factor, cy - (factor - 1) / 2 / factor])
        elif name in ("albedo", "normal", "normal_smooth", "roughness"):
            found[name] = squares(torch.where(known > 0, picture.nan_to_num(), 0)) / share
        elif picture.ndim == 3:
            found[name] = squares(picture.nan_to_num(posinf=65504))
    for name in ("normal", "normal_smooth"):
        if name in found:
            found[name] = torch.nn.functional.normalize(found[name], dim=0)
    return found


def cut(found, size, rng):
    """A square of the size from a place that shows surface, the camera's centre moved along."""
    rest = found["depth"].shape[-1] - size
    if rest == 0:
        return found
    for _ in range(8):
        x, y = (int(v) for v in rng.integers(0, rest + 1, 2))
        if torch.isfinite(found["depth"][:, y : y + size, x : x + size]).float().mean() > 0.25:
            break
    else:
        x = y = rest // 2
    piece = {name: v[:, y : y + size, x : x + size] if v.ndim == 3 else v for name, v in found.items()}
    return piece | {"camera": found["camera"] - torch.tensor([0.0, 0.0, x, y])}


def mirrored(found):
    """The scene left to right: pictures, normals, lights and the camera's centre alike."""
    turned = {name: v.flip(-1) if v.ndim == 3 else v for name, v in found.items()}
    other = torch.tensor([-1.0, 1.0, 1.0])
    for name in ("normal", "normal_smooth"):
        if name in turned:
            turned[name] = turned[name] * other.view(3, 1, 1)
    turned["light"] = found["light"] * other
    fx, fy, cx, cy = found["camera"]
    turned["camera"] = torch.stack([fx, fy, found["depth"].shape[-1] - 1 - cx, cy])
    if "five" in found:
        turned["five"] = (found["five"] * other)[MIRRORED_FIVE]
        turned["pictures"] = turned["pictures"].unflatten(0, (5, 3))[MIRRORED_FIVE].flatten(0, 1)
    return turned
