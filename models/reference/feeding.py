"""What the networks are fed, from what a capture holds; inference elsewhere must do the very same.

Pictures are (batch, channels, height, width). Depth is in metres, NaN where no surface is known; `known` is 1 where one is.
"""

import torch

from .frames import points, seen_from

BRIGHTEST = 2.0
"""Flash, rendered and relit light are cut here; a white Lambertian facing the lamp is 1."""

NEAREST_SPAN = 1e-3
"""Metres, or units of the cloud, below which an extent counts as none."""


def span(depth):
    """(known, least, most) of each picture's depth; the latter two (batch, 1, 1, 1), in metres."""
    known = torch.isfinite(depth)
    least = torch.where(known, depth, torch.inf).amin((1, 2, 3), keepdim=True)
    most = torch.where(known, depth, -torch.inf).amax((1, 2, 3), keepdim=True)
    return known.float(), least, most


def nearness(depth):
    """1 at the nearest known surface, 0 at the farthest and where none is known."""
    known, least, most = span(depth)
    return torch.nan_to_num((most - depth) / (most - least).clamp(min=NEAREST_SPAN)) * known


def cloud(depth, camera, light):
    """T(ω, P): the points about the middle of their box, in units of half its longest side, 0 where unknown, then seen from
    the light (batch, 3). `camera` is (batch, 4): fx, fy, cx, cy in pixels."""
    known = torch.isfinite(depth).float()
    return seen_from(light, normalised(points(depth, camera), known))


def normalised(cloud, known):
    """The cloud about its middle, in units of half its extent; what is unknown lies in the middle."""
    low = torch.where(known > 0, cloud, torch.inf).amin((2, 3), keepdim=True)
    high = torch.where(known > 0, cloud, -torch.inf).amax((2, 3), keepdim=True)
    half = ((high - low) / 2).amax(1, keepdim=True).clamp(min=NEAREST_SPAN)
    return torch.nan_to_num((cloud - (low + high) / 2) / half) * known


def scaled(light, intensity, depth):
    """Flash light as if a white Lambertian facing the flash at the median distance were 1; 0 where no surface is known.

    `intensity` (batch) is the value of such a patch at one metre; the median is the lower of two middle values.
    """
    median = depth.flatten(1).nanmedian(1).values
    factor = (median**2 / intensity.clamp(min=1e-6)).view(-1, 1, 1, 1)
    return torch.where(torch.isfinite(depth), (light * factor).clamp(0, BRIGHTEST), 0)


def noisy(near, rng):
    """The paper's noise on depth in [0, 1] at 256 × 256: Gaussian of 6.25e-2, then a Gaussian blur of one pixel."""
    dirty = near + 6.25e-2 * torch.from_numpy(rng.standard_normal(near.shape, dtype="float32"))
    offsets = torch.arange(-3.0, 4.0)
    kernel = torch.exp(-(offsets**2) / 2)
    kernel = kernel / kernel.sum()
    padded = torch.nn.functional.pad(dirty, (3, 3, 3, 3), mode="replicate")
    rows = torch.nn.functional.conv2d(padded, kernel.view(1, 1, 1, -1))
    return torch.nn.functional.conv2d(rows, kernel.view(1, 1, -1, 1))


def noisy_depth(depth, rng):
    """Depth with the paper's noise, in metres; whatever is fed is then made from it alone, as it would be outside."""
    known, least, most = span(depth)
    dirty = most - noisy(nearness(depth), rng) * (most - least).clamp(min=NEAREST_SPAN)
    return torch.where(known > 0, dirty, torch.nan)
