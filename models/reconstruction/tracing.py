"""Pictures and shadow maps of a meshed capture under its lamps."""

import drjit as dr
import mitsuba as mi
import numpy as np

from ..render.environment import denoised
from ..render.tracer import direct, indirect


def traced(tracer, camera, lamps, asked):
    """(size, size, 3) linear light of each lamp, NaN where the mesh has a hole, and (size, size) whether it is lit.

    Vertices lie where rays through the pixels' centres go, and such a ray may slip between its triangles: what counts is
    jittered, and a pixel is a hole where most of its rays miss."""
    rng, side = np.random.default_rng(1), asked.direct_side
    h = tracer.hit(mi.Point3f(0), camera.rays(side, rng))
    dr.eval(h.__dict__)
    covered = camera.image(dr.select(h.valid, mi.Float(1), 0), side)
    known, part = covered > 0.5, np.maximum(covered, 1e-3)
    shares = [camera.image(dr.select(tracer.visible(h, lamp), mi.Float(1), 0), side) / part for lamp in lamps]
    lit, (albedo, normal) = direct(tracer, camera, lamps, side, rng)
    more, _ = indirect(tracer, camera, lamps, asked.indirect_side, asked.bounces, rng)
    pictures = [(a + denoised(b, albedo, normal)) / part for a, b in zip(lit, more)]
    return [np.where(known, picture, np.nan) for picture in pictures], [(~known | (share > 0.5))[..., 0] for share in shares]
