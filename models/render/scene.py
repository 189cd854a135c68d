"""One random scene in the camera's frame: x right, y down, z forward, metres.

Everything is a pure function of (split, index, seed, share of packaged things). What shapes and textures a split may
use stands in `bank`.
"""

from dataclasses import dataclass

import numpy as np
import trimesh

from .bank import SPLITS, Bank

FLIP = np.array([1.0, -1.0, -1.0])  # between camera axes and those given by people


@dataclass
class Scene:
    """Triangles with a normal and a texture coordinate per corner, all in the camera's frame."""

    corners: np.ndarray  # (F, 3, 3) metres
    normals: np.ndarray  # (F, 3, 3) unit
    uv: np.ndarray  # (F, 3, 2) in tiles, mirrored beyond [0, 1]
    tile: np.ndarray  # (F,) which of `tiles`
    tiles: np.ndarray  # (T, 512, 512, 6) albedo RGB, roughness, slope of the relief
    fov_degrees: float
    lights: np.ndarray  # (L, 3) toward the light, x right, y up, z toward the camera
    flash_position: np.ndarray  # (3,) metres
    ambient: dict  # room light: its share, sky radiance up and down, lamps (position, radiant intensity)
    facts: dict  # what the scene was made of, for truth/scene.json


def scene(split, index, seed, light_count, packaged=0.0):
    """The scene of that split and index; `packaged` is the share of its shapes and textures that come from packages."""
    rng = np.random.default_rng([seed, list(SPLITS).index(split), index])
    bank = Bank(split, packaged, rng)
    layout = str(rng.choice(["desk", "wall", "free"], p=[0.55, 0.2, 0.25]))
    fov, distance = rng.uniform(40, 70), np.exp(rng.uniform(np.log(0.6), np.log(2.2)))
    view = distance * np.tan(np.radians(fov / 2))  # half the width of the field at that distance
    pitch, yaw, made, planes = _supports(rng, layout, distance, view)
    used = []
    for _ in range(rng.integers(4, 10) if layout == "free" else rng.integers(3, 11)):
        solid = bank.solid()
        made.append(_placed(rng, layout, solid, view, distance, 2 + int(rng.integers(6))))
        used.append({"shape": solid.name, "family": solid.family})
    to_camera = _looking(rng, pitch, yaw)
    centre = np.array([0, 0, 0.3 * view if layout == "desk" else 0.0])
    corners, normals, uv, tile = (np.concatenate([m[k] for m in made]) for k in range(4))
    corners = (corners - centre) @ to_camera.T + [0, 0, distance]
    # nothing may touch or enclose the lens: an object that comes too near is left out whole
    part = np.repeat(np.arange(len(made)), [len(m[0]) for m in made])
    nearest = np.full(len(made), np.inf)
    np.minimum.at(nearest, part, corners[:, :, 2].min(1))
    kept = (nearest > 0.15 * distance)[part] | (tile < 2)
    textures = [bank.tile() for _ in range(8)]
    return Scene(
        corners=corners[kept],
        normals=(normals @ to_camera.T)[kept],
        uv=uv[kept],
        tile=tile[kept],
        tiles=np.stack([tile for _, tile in textures]),
        fov_degrees=fov,
        lights=_lights(rng, light_count, [to_camera @ p for p in planes]),
        flash_position=np.r_[rng.uniform(0.008, 0.03) * _unit(rng.normal(size=2)), 0.0],
        ambient=_room(rng, to_camera @ [0, 0, 1.0], distance),
        facts={"split": split, "index": index, "seed": seed, "layout": layout, "distance_metres": distance,
               "objects": used, "textures": [name for name, _ in textures]},
    )


def _supports(rng, layout, distance, view):
    """The camera's pitch and yaw, the support's parts, and the normals lights must stand above (world frame, z up)."""
    if layout == "free":
        return np.radians(rng.uniform(-30, 60)), rng.uniform(-np.pi, np.pi), [], []
    if layout == "wall":
        pitch, yaw = np.radians(rng.uniform(-25, 25)), rng.uniform(-0.6, 0.6)
        frame = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])  # plane normal +z becomes world -y, toward the camera
        wall = _moved(_plane(6 * distance, view * rng.uniform(0.8, 2.0), 0), frame, np.zeros(3))
        return pitch, yaw, [wall], [np.array([0, -1.0, 0])]
    pitch, half = np.radians(rng.uniform(18, 70)), 6 * distance
    made, planes = [_plane(half, view * rng.uniform(0.8, 2.0), 0)], [np.array([0, 0, 1.0])]
    if rng.random() < 0.45:
        turn = rng.uniform(-0.6, 0.6)
        back = np.array([np.sin(turn), -np.cos(turn), 0])
        frame = np.stack([np.cross([0, 0, 1.0], back), np.array([0, 0, 1.0]), back], 1)
        made.append(_moved(_plane(half, view * rng.uniform(0.8, 2.0), 1), frame, -back * view * rng.uniform(0.5, 1.2)))
        planes.append(back)
    return pitch, 0.0, made, planes


def _placed(rng, layout, solid, view, distance, tile):
    """The solid turned, sized and put in the layout, in the world frame: corners, normals, texture coordinates, tiles."""
    crowded = layout == "free"  # nothing else fills the picture there
    size = view * np.exp(rng.uniform(np.log(0.35 if crowded else 0.18), np.log(1.1 if crowded else 0.85)))
    upright = rng.random() < (0.6 if layout == "desk" else 0.2)
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    if upright:
        turn = trimesh.transformations.rotation_matrix(rng.uniform(0, 6.28), [0, 0, 1])[:3, :3]
    turn = turn.astype(np.float32)
    corners = solid.corners @ (turn.T * np.float32(size))
    low, high = corners.min((0, 1)), corners.max((0, 1))
    x, y = rng.uniform(-1, 1, 2) * (0.45 if crowded else 0.65) * view
    if layout == "desk":
        offset = [x, y, -low[2] - 1e-4 * distance]
        if rng.random() < 0.12:
            offset[2] += rng.uniform(0.05, 0.5) * view
    elif layout == "wall":
        sink = rng.uniform(-0.4, 0.6) * (high[1] - low[1])
        offset = [x, -high[1] + max(sink, -0.3 * view), y]
    else:
        offset = [x, rng.uniform(-0.6, 0.6) * view, y]
    uv = solid.uv * np.float32(rng.uniform(0.6, 2.0))
    return corners + np.float32(offset), solid.normals @ turn.T, uv, np.full(len(corners), tile)


def _looking(rng, pitch, yaw):
    """Rows: the camera's axes in the world, rolled by a few degrees."""
    forward = np.array([np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), -np.sin(pitch)])
    right = _unit(np.cross(forward, [0, 0, 1.0]))
    down = np.cross(forward, right)
    roll = rng.normal(0, 0.06)
    right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
    return np.stack([right, down, forward])


def _room(rng, up, distance):
    """Room light: two lamps overhead and a sky that brightens upward."""
    return {
        "share": rng.uniform(0.1, 0.6),  # of the flash photograph's mean
        "up": up,
        "sky": rng.uniform(0.2, 0.6) * np.array([1, rng.uniform(0.8, 1), rng.uniform(0.6, 1)]),
        "ground": rng.uniform(0.05, 0.25) * np.ones(3),
        "lamps": [(up * rng.uniform(1.2, 2.0) * distance + rng.normal(0, 0.8, 3) * distance, rng.uniform(0.3, 1.5) * distance**2)
                  for _ in range(2)],
    }


def _lights(rng, count, planes):
    """Directions jittered within equal parts of the cap up to 80 degrees off axis, all above every plane.

    Rings of equal solid angle, four sectors each; where a whole cell lies below a plane another cell is taken.
    """
    rings, lowest, chosen = max(count // 4, 1), np.cos(np.radians(80)), []
    offsets = rng.uniform(0, 2 * np.pi, rings)
    for k in range(count):
        for attempt in range(400):
            ring, sector = (k % rings, k // rings) if attempt < 40 else (int(rng.integers(rings)), rng.uniform(0, 4))
            z = 1 - (1 - lowest) * (ring + rng.random()) / rings
            phi = offsets[ring] + (sector + rng.random()) * np.pi / 2
            light = np.array([*(np.sqrt(1 - z * z) * np.array([np.cos(phi), np.sin(phi)])), z])
            if all((light * FLIP) @ p > 0.06 for p in planes):
                break
        chosen.append(light)
    return np.array(chosen)


def _unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _plane(half, period, tile):
    """The plane z = 0 as a grid, one texture tile every `period` metres."""
    n = 8
    g = np.linspace(-half, half, n + 1)
    x, y = np.meshgrid(g, g, indexing="ij")
    p = np.stack([x, y, 0 * x], -1)
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
    corners = np.concatenate([np.stack([a, b, c], -2).reshape(-1, 3, 3), np.stack([a, c, d], -2).reshape(-1, 3, 3)])
    normals = np.zeros_like(corners)
    normals[..., 2] = 1
    return corners, normals, corners[..., :2] / period, np.full(len(corners), tile)


def _moved(part, rotation, offset):
    corners, normals, uv, tile = part
    return corners @ rotation.T + offset, normals @ rotation.T, uv, tile
