"""Procedural tiles of albedo, roughness and relief, each a pure function of one integer."""

import colorsys

import cv2
import numpy as np
from scipy.spatial import cKDTree

SIZE = 512  # pixels on a side of one tile


def texture(texture_id):
    """The tile of that number: (512, 512, 6) float32.

    Linear albedo RGB in [0.01, 0.95], roughness in [0.08, 1], and the slope of the relief along x and y of the
    tile (rise over run, 0 where it is flat), clipped to [-1, 1].
    """
    rng = np.random.default_rng([0x7E87, texture_id])
    m = _pattern(rng)
    steps = np.sort(rng.random(3))
    colors = [_color(rng) for _ in range(3)]
    if rng.random() < 0.5:  # related colors
        colors = [colors[0], colors[0] * rng.uniform(0.3, 1.5), colors[0] * rng.uniform(0.3, 1.5)]
    at = [0.0, *steps[1:2], 1.0]
    albedo = np.stack([np.interp(m, at, [c[k] for c in colors]) for k in range(3)], -1)
    albedo *= 1 + rng.uniform(0, 0.25) * (_noise(rng, rng.uniform(0.6, 1.6))[..., None] - 0.5)
    low, high = [(0.6, 1.0), (0.3, 0.6), (0.15, 0.3), (0.08, 0.15)][rng.choice(4, p=[0.45, 0.27, 0.18, 0.10])]
    base = rng.uniform(low, high)
    vary = rng.choice([0.0, rng.uniform(0.1, 0.6)], p=[0.35, 0.65]) * base
    field = m if rng.random() < 0.5 else _noise(rng, rng.uniform(1.0, 2.0))
    rough = base + vary * (field - 0.5) * rng.choice([-1, 1])
    slope = np.zeros((SIZE, SIZE, 2))
    if rng.random() < 0.45:
        height = m if rng.random() < 0.5 else _noise(rng, rng.uniform(1.4, 2.4))
        height = cv2.GaussianBlur(height.astype(np.float32), (0, 0), rng.uniform(1.5, 4.0))
        slope = np.stack(np.gradient(height)[::-1], -1)
        slope = (slope * rng.uniform(0.03, 0.22) / max(slope.std(), 1e-6)).clip(-1, 1) if slope.std() > 1e-6 else 0 * slope
    return np.concatenate([albedo.clip(0.01, 0.95), rough.clip(0.08, 1.0)[..., None], slope], -1).astype(np.float32)


def _color(rng):
    value = np.exp(rng.uniform(np.log(0.03), np.log(0.95)))
    return np.array(colorsys.hsv_to_rgb(rng.random(), rng.beta(1.2, 2.2), value))


def _noise(rng, slope):
    """Power-law noise with spectrum 1/f^slope, periodic, in [0, 1] (three sigmas)."""
    f = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None])
    f[0, 0] = np.inf
    spectrum = (rng.normal(size=f.shape) + 1j * rng.normal(size=f.shape)) * (f + 2 / SIZE) ** -slope * (f < 0.25)
    field = np.fft.irfft2(spectrum, (SIZE, SIZE))
    return (field / field.std() / 6 + 0.5).clip(0, 1)


def _pattern(rng):
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    warp = rng.choice([0.0, rng.uniform(0.02, 0.3)])
    if warp:
        x, y = x + warp * (_noise(rng, 2.2) - 0.5), y + warp * (_noise(rng, 2.2) - 0.5)
    n = int(rng.integers(2, 12))
    kind = rng.integers(8)
    if kind == 0:
        m = np.full((SIZE, SIZE), rng.random())
    elif kind == 1:
        m = _noise(rng, rng.uniform(1.2, 2.4))
    elif kind == 2:
        m = 1 / (1 + np.exp(-40 * (_noise(rng, rng.uniform(1.3, 2.2)) - rng.uniform(0.4, 0.65))))
    elif kind == 3:
        m = ((np.floor(x * n) + np.floor(y * n)) % 2).astype(float)
    elif kind == 4:
        t = rng.uniform(0, np.pi)
        m = 0.5 + 0.5 * np.sin(2 * np.pi * n * (x * np.cos(t) + y * np.sin(t)))
        if rng.random() < 0.5:
            m = (m > rng.uniform(0.3, 0.7)).astype(float)
    elif kind == 5:
        row = np.floor(y * n)
        bx, by = (x * n / 2 + 0.5 * (row % 2)) % 1, (y * n) % 1
        level = rng.random(997)[((np.floor(x * n / 2 + 0.5 * (row % 2)) * 31 + row * 57) % 997).astype(int)]
        m = np.where((bx < 0.05) | (by < 0.1), 0.0, 0.4 + 0.6 * level)
    elif kind == 6:
        seeds = rng.random((int(rng.integers(8, 150)), 2))
        near, who = cKDTree(seeds).query(np.c_[x.ravel(), y.ravel()], k=2)
        m = rng.random(len(seeds))[who[:, 0]] * (near[:, 1] - near[:, 0] > rng.choice([0.0, 0.006]))
        m = m.reshape(SIZE, SIZE)
    else:
        r = np.hypot(x - rng.uniform(-0.5, 1.5), y - rng.uniform(-0.5, 1.5)) + 0.03 * _noise(rng, 2.0)
        m = (r * n * 2 % 1) ** rng.uniform(0.5, 2)
    return cv2.GaussianBlur(m.astype(np.float32), (0, 0), 0.8)
