"""Packed scenes as batches for the three networks."""

from pathlib import Path

import numpy as np
import torch

from .frames import points


class Scenes:
    """What `pack` wrote, read as it is needed."""

    def __init__(self, folder, noisy=False):
        self.channels = {path.stem: np.load(path, mmap_mode="r") for path in Path(folder).glob("*.npy")}
        if "flash" not in self.channels:
            raise SystemExit(f"{folder}: not packed scenes; make them with `python3 -m models.reference.pack`")
        self.noisy = noisy
        self.count, self.lights = self.channels["light"].shape[:2]

    def batch(self, scenes, lights, rng):
        """Tensors of the scenes and one light each, by name, and what the networks are given:
        `near` (batch, 1, …), depth in [0, 1] (0 = farthest and unknown), and `cloud`, points of half a scene's extent."""
        take = lambda name: torch.from_numpy(np.stack([self.channels[name][s] for s in scenes]).astype(np.float32))
        lit = lambda name: torch.from_numpy(np.stack([self.channels[name][s, k] for s, k in zip(scenes, lights)]).astype(np.float32))
        found = {name: take(name) for name in ("flash", "albedo", "normal", "roughness", "depth", "camera")}
        found |= {"light": lit("light"), "relit": lit("relit"), "shadow": lit("shadow") / 255}
        found["flash"] = torch.nan_to_num(found["flash"]).clamp(0, 1)
        depth = found["depth"]
        found["known"] = known = torch.isfinite(depth).float()
        least = torch.where(known > 0, depth, torch.inf).amin((1, 2, 3), keepdim=True)
        most = torch.where(known > 0, depth, -torch.inf).amax((1, 2, 3), keepdim=True)
        near = torch.nan_to_num((most - depth) / (most - least).clamp(min=1e-3))
        if self.noisy:
            near = noisy(near, rng) * known
            depth = most - near * (most - least)
        found["near"] = near
        found["cloud"] = normalised(points(torch.where(known > 0, depth, torch.nan), found["camera"]), known)
        return found


def noisy(near, rng):
    """The paper's noise on depth in [0, 1] at 256 × 256: Gaussian of 6.25e-2, then a Gaussian blur of one pixel."""
    dirty = near + 6.25e-2 * torch.from_numpy(rng.standard_normal(near.shape, dtype=np.float32))
    offsets = torch.arange(-3.0, 4.0)
    kernel = torch.exp(-(offsets**2) / 2)
    kernel = kernel / kernel.sum()
    padded = torch.nn.functional.pad(dirty, (3, 3, 3, 3), mode="replicate")
    rows = torch.nn.functional.conv2d(padded, kernel.view(1, 1, 1, -1))
    return torch.nn.functional.conv2d(rows, kernel.view(1, 1, -1, 1))


def normalised(cloud, known):
    """The cloud about its middle, in units of half its extent; what is unknown lies in the middle."""
    low = torch.where(known > 0, cloud, torch.inf).amin((2, 3), keepdim=True)
    high = torch.where(known > 0, cloud, -torch.inf).amax((2, 3), keepdim=True)
    half = ((high - low) / 2).amax(1, keepdim=True).clamp(min=1e-3)
    return (cloud - (low + high) / 2) / half * known
