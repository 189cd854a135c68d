"""What scenes are built from: solids and texture tiles, each made once a process and used in many scenes.

Each split owns its own things. Of all numbers those ending in 8 are validation's, in 9 the test's, all others training's.
`other`, the second test split, is made of packaged things alone, out of a pool of its own.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .shapes import shape
from .textures import texture

SPLITS = {"train": range(8), "val": range(8, 9), "test": range(9, 10), "other": range(10)}
SHAPES, TEXTURES = 60, 40  # numbers a last digit: each thing is made once a process and kept
CREASE = np.cos(np.radians(35))  # faces that meet at less than this are shaded as one smooth surface


@dataclass(frozen=True)
class Solid:
    """A shape in its own frame: longest side 1, z up."""

    name: str
    family: str
    corners: np.ndarray  # (F, 3, 3)
    normals: np.ndarray  # (F, 3, 3) unit
    uv: np.ndarray  # (F, 3, 2) box-projected, 1 a longest side


class Bank:
    """The things that one scene of a split draws from, by the scene's own random numbers."""

    def __init__(self, split, packaged, rng):
        self.rng = rng
        self.digits = SPLITS[split]
        self.packaged, self.pool = (1.0, "other") if split == "other" else (packaged, "train")

    def _drawn(self, count):
        """A number of this split's, and the pool it is meant for; None is procedural."""
        pool = self.pool if self.rng.random() < self.packaged else None
        return int(self.rng.integers(count)) * 10 + int(self.rng.choice(self.digits)), pool

    def solid(self):
        """One solid."""
        return _solid(*self._drawn(SHAPES))

    def tile(self):
        """The name of a texture and its tile in a tint and a roughness of this scene's own: (512, 512, 6), see `textures`."""
        rng = self.rng
        number, pool = self._drawn(TEXTURES)
        tile = _tile(number, pool).astype(np.float32)
        turned = np.roll(np.eye(3), rng.integers(3), 1) if rng.random() < 0.5 else np.eye(3)  # swaps the channels
        tint = turned * rng.uniform(0.7, 1.15, 3)
        tile[..., :3] = (tile[..., :3] @ tint.astype(np.float32)).clip(0.01, 0.95)
        tile[..., 3] = (tile[..., 3] * np.float32(rng.uniform(0.8, 1.25))).clip(0.08, 1.0)
        return f"{pool or 'procedural'} {number}", tile


@lru_cache(maxsize=None)
def _solid(number, pool):
    if pool is None:
        family, vertices, faces = shape(number)
    else:
        from .assets import packaged_shape  # only those who ask for packaged things need the packages

        family, vertices, faces = packaged_shape(number, pool)
    return Solid(f"{pool or 'procedural'} {number}", family, *_smoothed(vertices, faces))


@lru_cache(maxsize=None)
def _tile(number, pool):
    if pool is None:
        return texture(number).astype(np.float16)
    from .assets import packaged_texture

    return packaged_texture(number, pool).astype(np.float16)


def _smoothed(vertices, faces):
    """Corners, crease-aware normals and box-projected texture coordinates of a mesh, single precision."""
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    keep = np.linalg.norm(area, axis=1) > 1e-14
    corners, area = corners[keep], area[keep]
    face_normal = area / np.linalg.norm(area, axis=1, keepdims=True)
    # merge vertices that coincide, then average the normals of the faces round each that meet smoothly
    grid = np.round(corners.reshape(-1, 3) * 1e6).astype(np.int64) + (1 << 20)
    _, weld = np.unique(grid @ [1 << 42, 1 << 21, 1], return_inverse=True)
    order = np.argsort(weld, kind="stable")
    start = np.r_[0, np.cumsum(np.bincount(weld))]
    valence = np.diff(start)[weld]
    this = np.repeat(np.arange(len(weld)), valence)
    within = np.arange(len(this)) - np.repeat(np.cumsum(valence) - valence, valence)
    other = order[start[weld[this]] + within]
    smooth = np.einsum("ij,ij->i", face_normal[this // 3], face_normal[other // 3]) > CREASE
    normals = np.stack([np.bincount(this, area[other // 3, k] * smooth, len(weld)) for k in range(3)], -1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    plane = np.array([[1, 2], [0, 2], [0, 1]])[np.abs(face_normal).argmax(1)]
    uv = np.stack([np.take_along_axis(corners[:, i], plane, 1) for i in range(3)], 1)
    return corners.astype(np.float32), normals.reshape(-1, 3, 3).astype(np.float32), uv.astype(np.float32)
