"""Relit pictures under environment maps: light from all around instead of from lamps.

A map is latitude-longitude, (H, 2H, 3), linear: its middle is what the camera looks at, its left half lies to the
camera's left, its first row is straight up; each pixel has one radiance all over. Where the whole map has value 1, a
white matte surface that sees all of it has value 1.

A vectorised drjit variant must be active before this module is imported.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
from mitsuba_oidn import denoise

from .environment_maps import areas, counted
from .tracer import BRIGHTEST, FLOOR_ROUGHNESS, Float, UInt, Vec3, density, drawn, shaded

LIGHT_SAMPLES = 4  # of the map, for each camera sample
RIM = 8  # pixels


class Environment:
    """A map ready to be looked up and drawn from."""

    def __init__(self, pixels):
        """`pixels` (H, 2H, 3), linear, >= 0; ValueError for another shape, impossible values or no light that counts."""
        pixels = np.asarray(pixels, np.float64)
        height = len(pixels)
        if pixels.shape != (height, 2 * height, 3):
            raise ValueError(f"environment map has shape {pixels.shape}; give (H, 2H, 3)")
        if not (np.isfinite(pixels).all() and (pixels >= 0).all()):
            raise ValueError("environment map holds values that are negative or not finite; clean it first")
        pixels = counted(pixels)
        power = pixels.mean(-1) * areas(height)[:, None]
        if power.sum() <= 0:
            raise ValueError("environment map sends no light toward what the camera sees")
        columns = power.cumsum(1) / np.maximum(power.sum(1, keepdims=True), 1e-300)
        rows = power.sum(1).cumsum() / power.sum()
        heights = np.sin(np.linspace(np.pi / 2, -np.pi / 2, height + 1))
        flat = lambda a: Float(np.ascontiguousarray(a, np.float32).ravel())
        self.radiances, self.columns, self.rows, self.heights = flat(pixels), flat(columns), flat(rows), flat(heights)
        self.height, self.power = height, dr.opaque(Float, power.sum())
        dr.eval(self.radiances, self.columns, self.rows, self.heights)

    def radiance(self, l):
        """Of the map toward the unit vectors l, camera axes; 0 where it is left out."""
        high = self.height
        row = UInt(dr.clip((0.5 + dr.asin(dr.clip(l.y, -1, 1)) / dr.pi) * high, 0, high - 0.5))
        column = UInt(dr.clip((0.5 + dr.atan2(l.x, l.z) / dr.two_pi) * 2 * high, 0, 2 * high - 0.5))
        return dr.gather(Vec3, self.radiances, row * 2 * self.height + column)

    def density(self, radiance):
        """Of `drawn` toward a direction of that radiance, per steradian."""
        return dr.sum(radiance) / 3 / self.power

    def drawn(self, u, w):
        """Directions drawn in proportion to the mean of the channels, and their radiance; u and w in [0, 1)."""
        row, u = _place(self.rows, UInt(0), self.height, u)
        column, w = _place(self.columns, row * 2 * self.height, 2 * self.height, w)
        radiance = dr.gather(Vec3, self.radiances, row * 2 * self.height + column)
        up = dr.lerp(dr.gather(Float, self.heights, row), dr.gather(Float, self.heights, row + 1), u)
        longitude = dr.pi * ((Float(column) + w) / self.height - 1)
        sin, cos = dr.sincos(longitude)
        level = dr.safe_sqrt(1 - up * up)
        return Vec3(level * sin, -up, level * cos), radiance


def _place(cumulative, first, count, u):
    """Which of the `count` steps from `first` u falls into, and where in it, [0, 1)."""
    at = lambda i: dr.gather(Float, cumulative, first + i)
    step = dr.binary_search(0, count - 1, lambda i: at(i) <= u)
    low = dr.select(step > 0, at(dr.maximum(step, 1) - 1), 0)
    return step, dr.clip((u - low) / dr.maximum(at(step) - low, 1e-12), 0, 1 - 1e-6)


def lit(tracer, camera, environment, per_side, bounces, rng):
    """The scene under the map, indirect light over up to `bounces` surfaces included: (size, size, 3), 0 where no surface is.

    Unlike a lamp's, a map's direct light has noise too, so the whole picture is denoised: 40 dB from 360 samples a pixel
    instead of 28 to 36 (three scenes, per_side 3).
    """
    direct, indirect, albedo, normal = traced(tracer, camera, environment, per_side, bounces, rng)
    covered = albedo.max(-1, keepdims=True) > 0
    return denoised(direct + indirect, albedo, normal) * covered


def denoised(image, albedo, normal):
    """The image without noise, (H, W, 3) >= 0; the guides are those of `traced`.

    The denoiser errs by up to a fifth at a picture's rim and corners, so the picture goes on mirrored for a while.
    """
    mirrored = [np.pad(channels, ((RIM, RIM), (RIM, RIM), (0, 0)), mode="reflect") for channels in (image, albedo, normal)]
    return np.maximum(denoise(*mirrored, hdr=True)[RIM:-RIM, RIM:-RIM], 0)


def traced(tracer, camera, environment, per_side, bounces, rng):
    """Direct light, light over one to `bounces` other surfaces, albedo, normal: (size, size, 3) each, not denoised.

    Each vertex draws from the map and from its reflectance; the two share the integral by the balance heuristic
    (Veach 1997). A way that was drawn from the reflectance and meets a surface goes on from there.
    """
    d = camera.rays(per_side, rng)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(int(rng.integers(2**31)), dr.width(d))
    h = tracer.hit(mi.Point3f(0), d)
    dr.eval(h.__dict__)
    guides = [camera.image(dr.select(h.valid, q, 0), per_side) for q in (h.albedo, h.ns)]
    # the samples of a pixel stand evenly over the map (R2 sequence, Roberts 2018), shifted pixel by pixel
    shift = [Float(np.repeat(rng.random(camera.size**2, np.float32), per_side**2)) for _ in range(2)]
    turn = Float(np.tile(np.arange(per_side**2, dtype=np.float32), camera.size**2)) * LIGHT_SAMPLES
    carried, direct, indirect = Vec3(1), Vec3(0), dr.zeros(Vec3, dr.width(d))
    for bounce in range(bounces + 1):
        count = 1 if bounce else LIGHT_SAMPLES
        if bounce:
            h.rough = dr.maximum(h.rough, FLOOR_ROUGHNESS)
        found = Vec3(0)
        for k in range(count):
            if bounce:
                u, w = sampler.next_1d(), sampler.next_1d()
            else:
                u, w = ((s + (turn + k) * g) for s, g in zip(shift, (0.7548776662, 0.5698402910)))
                u, w = u - dr.floor(u), w - dr.floor(w)
            l, radiance = environment.drawn(u, w)
            facing = _facing(h, l)
            clear = facing & ~tracer.scene.ray_test(mi.Ray3f(h.lifted + h.ng * h.eps, l), active=facing)
            found += dr.select(clear, _arriving(h, l, environment, radiance, count), 0)
            dr.eval(found)
        l = drawn(h, sampler)
        facing = _facing(h, l)
        next_h = tracer.hit(h.lifted + h.ng * h.eps, l, facing)
        missed = facing & ~next_h.valid
        found += dr.select(missed, _arriving(h, l, environment, environment.radiance(l), count), 0)
        if bounce:
            indirect += carried * found
        else:
            direct += found
        weight = shaded(h.ns, h.v, l, h.albedo, h.rough) / dr.pi / dr.maximum(density(h, l), 1e-8)
        next_h.valid &= dr.dot(h.ng, l) > 0
        carried = dr.select(next_h.valid, carried * dr.minimum(weight, 4), 0)
        h = next_h
        dr.eval(h.__dict__, carried, direct, indirect, sampler)
    most = BRIGHTEST * environment.power / dr.pi
    indirect *= dr.minimum(1, most / dr.maximum(dr.max(indirect), 1e-12 * most))
    return camera.image(direct, per_side), camera.image(indirect, per_side), *guides


def _facing(h, l):
    """As for lamps, the smooth normal decides which side is lit."""
    return h.valid & (dr.dot(h.smooth, l) > 0) & (dr.dot(h.ns, l) > 0)


def _arriving(h, l, environment, radiance, count):
    """One sample's share of the light sent on to the viewer, where `count` were drawn from the map, one from the lobes."""
    return shaded(h.ns, h.v, l, h.albedo, h.rough) / dr.pi * radiance / (count * environment.density(radiance) + density(h, l))
