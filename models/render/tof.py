"""A Time-of-Flight camera as functions of true channels: infrared amplitude, measured depth, the paper's own noise.

The camera looks through the color lens (its light beside it), so both share one grid. Depth is z in metres, NaN where
no surface or no answer is; normals are x right, y up, z toward the camera; `camera` is (fx, fy, cx, cy) in pixels.
Amplitude is in units of a white matte surface facing the camera at one metre, linear.
"""

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import cv2
import numpy as np

from .multipath import facing, one_bounce, rays

LIGHT = 299_792_458.0  # metres a second
F0 = 0.05  # as in the renderer
DARKEST = 1e-6  # amplitude that stands in for none, so that weights never vanish
NEAREST_METRES = 1e-3  # a wild draw must not pass behind the camera


@dataclass(frozen=True)
class Sensor:
    """What a continuous-wave ToF camera does to depth; the defaults resemble an OAK-D ToF without its filters.

    Modulation and range are Luxonis' (80 MHz wraps at 1.87 m, five unwrapping levels reach about 7.5 m). Jitter, background and
    weakest are those of the drivers' synthetic camera; brightest is where our Azure Kinect frame saturates.
    """

    modulation_hertz: float = 80e6
    jitter_metres: float = 0.0008  # sigma that no light takes away
    shot_metres: float = 0.0005  # sigma at amplitude 1 from the signal's own photons: falls with its root
    background_metres: float = 0.0005  # sigma at amplitude 1 from constant light and readout: falls with amplitude
    footprint_pixels: float = 0.5  # sigma of the Gaussian over which a pixel mixes light
    multipath: float = 1.0  # share of the one-bounce light that is let in
    weakest: float = 0.015  # amplitude below which there is no answer
    brightest: float = 10.0  # amplitude at which a pixel saturates and has no answer
    grazing_cosine: float = 0.08  # cosine to the surface below which there is no answer
    spread_most: float = np.inf  # mixed depths that differ by more (sigma / distance) are given up, as some devices do
    range_metres: float = 7.5  # distances from here on wrap around to zero
    shift_pixels: tuple = (0.0, 0.0)  # how far the answer lies right of and below where it belongs
    reduce: int = 1  # pixels a side averaged into one: the answer's grid is that much coarser

    def at(self, severity):
        """The same camera with its flaws times `severity`: 0 answers with the truth, 1 is as it is; limits are divided by it."""
        if severity == 1:
            return self
        grown = lambda v: v * severity
        shrunk = lambda v: v / severity if severity > 0 else np.inf
        limits = ("brightest", "spread_most", "range_metres")
        same = ("modulation_hertz", "shift_pixels", "reduce")
        names = [f.name for f in fields(self) if f.name not in same]
        changed = {name: (shrunk if name in limits else grown)(getattr(self, name)) for name in names}
        shift = tuple(map(grown, self.shift_pixels))
        return replace(self, **changed, shift_pixels=shift, reduce=1 + round((self.reduce - 1) * severity))


# From our one captured frame (1 mm steps, after the device's filter). Its amplitude · distance² / cosine is 950 to 1460 on
# white walls and desk from 0.2 to 2.4 m; white is taken to be 1600. Sigma is then 2.4 mm at 0.037, 1.2 mm at 0.065, at most
# 0.6 mm above 0.12; half the pixels near 0.03 and all above 10 have no answer. The modulation is a guess below the 320 MHz of
# its sensor (Bamji et al., ISSCC 2018), and so is the spread, from the bands without an answer around its mug.
AZURE_KINECT = Sensor(modulation_hertz=200e6, jitter_metres=0.0005, shot_metres=0.0002, background_metres=0.00008,
                      weakest=0.03, spread_most=0.05, range_metres=np.inf)


class Sensed(NamedTuple):
    """A ToF frame on its own grid."""

    metres: np.ndarray  # (h, w) float32, z, NaN = no answer
    amplitude: np.ndarray  # (h, w) float32 in [0, brightest], NaN only where no surface is
    sigma: np.ndarray  # (h, w) float32 metres, of the random part of `metres`, NaN where that is
    camera: tuple  # fx, fy, cx, cy of this grid


def amplitude(albedo, normal, depth, camera, infrared_seed, roughness=None):
    """Clean amplitude (H, W) float32: infrared reflectance · cosine / distance², NaN where no surface is.

    With `roughness` (H, W) the renderer's microfacet lobe, seen along the light, is added to the reflectance.
    """
    cosine, length = facing(normal, camera)
    reflectance = infrared(albedo, infrared_seed)
    if roughness is not None:
        alpha2, k = np.square(np.square(roughness)), np.square(roughness + 1) / 8
        peak = alpha2 / np.square(np.square(cosine) * (alpha2 - 1) + 1)
        fresnel = F0 + (1 - F0) * 2.0 ** (-5.55473 - 6.98316)
        reflectance = reflectance + peak * fresnel / (4 * np.square(cosine * (1 - k) + k))
    return (reflectance * cosine / np.square(depth * length)).astype(np.float32)


def infrared(albedo, seed):
    """Infrared reflectance (H, W) in [0, 1] of albedo (H, W, 3): a smooth function of color, another for each seed, 1 for white.

    Many dyes let near infrared through to what they stain (Salamati et al. 2009, "Material classification using color and NIR
    images"): a share of the darkness, smooth in color, is lifted, so black may be bright. Equal colors of one scene stay equal.
    """
    rng = np.random.default_rng([int(seed), 850])  # 850 nm
    tone = np.sqrt(np.clip(np.asarray(albedo, np.float32), 0, 1))
    base = np.square(tone) @ rng.dirichlet([4, 2, 1]).astype(np.float32)  # the nearest band, red, tells most
    waves, start = rng.normal(0, 5, (3, 3)).astype(np.float32), rng.uniform(0, 2 * np.pi, 3).astype(np.float32)
    mood = np.cos(tone @ waves + start).sum(-1)
    through = np.float32(rng.uniform(0.2, 0.8)) / (1 + np.exp(1.5 - 1.5 * mood))
    return base + np.square(1 - base) * through


def sensed(depth, amplitude, normal, camera, rng, sensor=Sensor()):
    """What the camera says of true `depth` (H, W), clean `amplitude` (H, W) and `normal` (H, W, 3).

    A pixel sums phasors amplitude · exp(4πi f distance / c) over its footprint, so steps give depths in between; indirect
    light is added first. Along the ray sigma² = jitter² + shot² / amplitude + (background / amplitude)² (Lange & Seitz 2001).

    # Errors
    ValueError where the picture cannot be divided by `sensor.reduce`.
    """
    height, width = depth.shape
    k = sensor.reduce
    if height % k or width % k:
        raise ValueError(f"depth is {width} x {height}: not a multiple of Sensor.reduce = {k}; crop it")
    wavenumber = np.float32(4 * np.pi * sensor.modulation_hertz / LIGHT)
    known = np.isfinite(depth)
    cosine, length = facing(normal, camera)
    span = np.where(known, depth * length, 0)
    direct = np.where(known, np.fmax(np.asarray(amplitude, np.float32), DARKEST), 0)
    real, imaginary = direct, np.float32(0)
    if sensor.multipath:
        more = one_bounce(depth, direct, normal, camera, wavenumber)
        real, imaginary = direct + sensor.multipath * more[0], sensor.multipath * more[1]
    # phases count from the middle of the scene: single precision then holds steps far below the jitter
    middle = np.float32(span.sum() / max(known.sum(), 1))
    apart = np.where(known, span - middle, 0)
    real, imaginary = _turned(real, imaginary, wavenumber * apart)
    layers = [real, imaginary, direct, direct * apart, known, np.where(known, cosine, 0)]
    if np.isfinite(sensor.spread_most):
        layers.append(direct * np.square(apart))
    real, imaginary, weight, apart, share, cosine, *square = _mixed(np.stack(layers, -1).astype(np.float32), sensor)

    camera = tuple(float(f) / k for f in camera[:2]) + tuple((float(c) - (k - 1) / 2) / k for c in camera[2:])
    length = rays(camera, share.shape)[1]
    known = share >= 0.5
    with np.errstate(divide="ignore", invalid="ignore"):
        apart, cosine = apart / weight, cosine / share
        # the phase is read against that of the mean distance: no wrap but the one asked for below
        real, imaginary = _turned(real, imaginary, -wavenumber * apart)
        mixed = np.maximum(np.hypot(real, imaginary), DARKEST)
        sigma = np.sqrt(sensor.jitter_metres**2 + sensor.shot_metres**2 / mixed + (sensor.background_metres / mixed) ** 2)
        distance = middle + apart + np.arctan2(imaginary, real) / wavenumber
        distance += sigma * rng.standard_normal(sigma.shape, np.float32)
        measured = mixed * (1 + wavenumber * sigma * rng.standard_normal(sigma.shape, np.float32))
        answered = known & (measured >= sensor.weakest) & (measured < sensor.brightest) & (cosine >= sensor.grazing_cosine)
        if square:
            spread = np.sqrt(np.maximum(square[0] / weight - np.square(apart), 0))
            answered &= spread <= sensor.spread_most * distance
    if np.isfinite(sensor.range_metres):
        distance = np.mod(distance, sensor.range_metres)
    return Sensed(
        np.where(answered, np.maximum(distance, NEAREST_METRES) / length, np.nan).astype(np.float32),
        np.where(known, np.clip(measured, 0, sensor.brightest), np.nan).astype(np.float32),
        np.where(answered, sigma / length, np.nan).astype(np.float32),
        camera,
    )


def paper_noise(depth, rng):
    """The paper's noise (H, W) metres: nearness in [0, 1] over known pixels (0 where unknown), Gaussian noise of 6.25e-2, then
    a Gaussian blur of one pixel, as training does it; NaN stays NaN."""
    known = np.isfinite(depth)
    if not known.any():
        return np.array(depth, np.float32)
    least, most = depth[known].min(), depth[known].max()
    span = max(most - least, 1e-3)
    near = np.where(known, (most - depth) / span, 0).astype(np.float32)
    near += np.float32(6.25e-2) * rng.standard_normal(near.shape, np.float32)
    near = cv2.GaussianBlur(near, (7, 7), 1.0, borderType=cv2.BORDER_REPLICATE)
    return np.where(known, np.maximum(most - near * span, NEAREST_METRES), np.nan).astype(np.float32)


def _turned(real, imaginary, phase):
    c, s = np.cos(phase), np.sin(phase)
    return real * c - imaginary * s, real * s + imaginary * c


def _mixed(layers, sensor):
    """Footprint and shift as one separable filter, then the box of the coarser grid: the layers (C, h, w)."""

    def taps(shift):
        radius = np.ceil(3 * sensor.footprint_pixels + abs(shift))
        at = np.arange(-radius, radius + 1)
        linear = np.maximum(1 - np.abs(at + shift), 0)
        bell = np.exp(-0.5 * np.square(at / sensor.footprint_pixels)) if sensor.footprint_pixels else (at == 0) * 1.0
        return np.convolve(linear, bell / bell.sum(), "same")

    across, down = map(taps, sensor.shift_pixels)
    if len(across) > 1 or len(down) > 1:
        layers = cv2.sepFilter2D(layers, cv2.CV_32F, across, down, borderType=cv2.BORDER_REPLICATE)
    if sensor.reduce > 1:
        height, width, count = layers.shape
        k = sensor.reduce
        layers = layers.reshape(height // k, k, width // k, k, count).mean((1, 3))
    return np.moveaxis(layers, -1, 0)
