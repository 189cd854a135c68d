"""`python3 -m models.compact.distance LESSONS…`: how far off what casts a shadow is, LESSON.distance.npy beside every lesson.

Bytes (lamps, height, width): 255 e^(-d / 0.2), d the distance along the ray toward the lamp to the first surface that it passes
behind by no more than `THICKNESS`, in median depths of the picture; 0 where there is none. A march over the lesson's own depth: for
comparing designs, where what it costs does not count.
"""

import sys

import numpy as np
import torch
from torch.nn import functional

from .lessons import arrays, files

THICKNESS = 0.15
"""Of what is marched through, in median depths."""

STEPS = 64


def distances(lesson):
    """As above."""
    ground = torch.from_numpy(lesson["ground"].astype(np.float32))
    view = torch.from_numpy(lesson["view"].astype(np.float32))
    height, width = ground.shape[1:]
    known = ground[6] > 0
    depth = torch.where(known, torch.exp(ground[4] / 2), torch.nan)
    slope = view[:2] / view[2].clamp(min=1e-3)
    points = torch.stack([-slope[0] * depth, -slope[1] * depth, -depth])
    # The lens of the lesson: pixels per unit of slope, and where slopes are nothing.
    columns, rows = -slope[0].nanmean(0), -slope[1].nanmean(1)
    fx, fy = (width - 1) / float(columns[-1] - columns[0]), (height - 1) / float(rows[-1] - rows[0])
    cx, cy = -float(columns[0]) * fx, -float(rows[0]) * fy
    seen = torch.where(known, depth, torch.inf)[None, None]
    found = []
    for toward in lesson["toward"]:
        toward = torch.from_numpy(np.array(toward)) / float(np.linalg.norm(toward))
        nearest = torch.zeros(height, width)
        for metres in np.geomspace(0.01, 1.5, STEPS)[::-1]:
            there = points + float(metres) * toward[:, None, None]
            away = -there[2]
            x = (cx + fx * there[0] / away) / (width - 1) * 2 - 1
            y = (cy + fy * there[1] / away) / (height - 1) * 2 - 1
            surface = functional.grid_sample(seen, torch.stack([x, y], -1)[None], mode="nearest", align_corners=True)[0, 0]
            inside = (x.abs() <= 1) & (y.abs() <= 1) & (away > 0.01)
            behind = away - surface
            nearest = torch.where(inside & (behind > 0.002 * away) & (behind < THICKNESS), float(np.exp(-metres / 0.2)), nearest)
        found.append((255 * nearest * known).round().to(torch.uint8).numpy())
    return np.stack(found)


for file in files(sys.argv[1:]):
    np.save(file.with_suffix(".distance.npy"), distances(arrays(file)))
