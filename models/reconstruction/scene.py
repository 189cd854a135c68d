"""A mesh of the depth map that wears the inferred materials, as the renderer's scenes are."""

import cv2
import numpy as np

from ..render.scene import FLIP, Scene
from ..render.textures import SIZE
from .mesh import pivoted


def meshed(depth, surface, focal, centre):
    """A `Scene` of depth (H, H) metres, NaN unknown, and `surface`: albedo (H, H, 3), normal (H, H, 3) x right, y up, z toward
    the camera, roughness (H, H). The picture itself is the texture; normals are the inferred ones, a corner each."""
    height = len(depth)
    rows, columns = np.nonzero(np.isfinite(depth) & np.isfinite(surface["normal"]).all(-1))
    z = depth[rows, columns]
    points = np.stack([(columns - centre) / focal * z, (rows - centre) / focal * z, z], -1)
    normals = surface["normal"][rows, columns] * FLIP
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    faces = pivoted(points, normals)
    paint = np.concatenate([surface["albedo"].clip(0.0, 1.0), surface["roughness"].clip(0.08, 1.0).reshape(height, height, 1)], -1)
    tile = np.zeros((1, SIZE, SIZE, 6), np.float32)
    tile[0, ..., :4] = cv2.resize(np.nan_to_num(paint).astype(np.float32), (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)
    uv = (np.stack([columns, rows], -1) + 0.5) / height
    nothing = np.zeros((0, 3))
    fov = 2 * np.degrees(np.arctan(height / 2 / focal))
    return Scene(points[faces], normals[faces], uv[faces], np.zeros(len(faces), int), tile, fov, nothing, np.zeros(3), {}, {})
