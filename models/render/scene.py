"""One random scene in the camera's frame: x right, y down, z forward, metres.

Everything is a pure function of (split, index, seed). Shapes and textures are numbered, and each split owns
its own numbers: those ending in 8 are validation's, in 9 the test's, all others training's.
"""

from dataclasses import dataclass

import numpy as np
import trimesh

from .shapes import shape
from .textures import texture

SPLITS = {"train": range(8), "val": range(8, 9), "test": range(9, 10)}
CREASE = np.cos(np.radians(35))  # faces that meet at less than this are shaded as one smooth surface
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


def scene(split, index, seed, light_count):
    """The scene of that split and index."""
    rng = np.random.default_rng([seed, list(SPLITS).index(split), index])
    draw = lambda: int(rng.integers(10_000_000) * 10 + rng.choice(list(SPLITS[split])))
    layout = str(rng.choice(["desk", "wall", "free"], p=[0.55, 0.2, 0.25]))
    fov, distance = rng.uniform(40, 70), np.exp(rng.uniform(np.log(0.6), np.log(2.2)))
    view = distance * np.tan(np.radians(fov / 2))  # half the width of the field at that distance
    pitch, yaw, made, planes = _supports(rng, layout, distance, view)
    used = []
    for _ in range(rng.integers(4, 10) if layout == "free" else rng.integers(3, 11)):
        shape_id = draw()
        family, vertices, faces = shape(shape_id)
        vertices, size = _placed(rng, layout, vertices, view, distance)
        made.append(_object(vertices, faces, 2 + int(rng.integers(6)), rng.uniform(0.6, 2.0) / size))
        used.append({"shape": shape_id, "family": family})
    to_camera = _looking(rng, pitch, yaw)
    centre = np.array([0, 0, 0.3 * view if layout == "desk" else 0.0])
    corners, normals, uv, tile = (np.concatenate([m[k] for m in made]) for k in range(4))
    corners = (corners - centre) @ to_camera.T + [0, 0, distance]
    # nothing may touch or enclose the lens: an object that comes too near is left out whole
    part = np.repeat(np.arange(len(made)), [len(m[0]) for m in made])
    nearest = np.full(len(made), np.inf)
    np.minimum.at(nearest, part, corners[:, :, 2].min(1))
    kept = (nearest > 0.15 * distance)[part] | (tile < 2)
    texture_ids = [draw() for _ in range(8)]
    return Scene(
        corners=corners[kept],
        normals=(normals @ to_camera.T)[kept],
        uv=uv[kept],
        tile=tile[kept],
        tiles=np.stack([texture(i) for i in texture_ids]),
        fov_degrees=fov,
        lights=_lights(rng, light_count, [to_camera @ p for p in planes]),
        flash_position=np.r_[rng.uniform(0.008, 0.03) * _unit(rng.normal(size=2)), 0.0],
        ambient=_room(rng, to_camera @ [0, 0, 1.0], distance),
        facts={"split": split, "index": index, "seed": seed, "layout": layout, "distance_metres": distance,
               "objects": used, "textures": texture_ids},
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


def _placed(rng, layout, vertices, view, distance):
    """The shape turned, sized and put in the layout: vertices in the world frame and its longest side in metres."""
    crowded = layout == "free"  # nothing else fills the picture there
    size = view * np.exp(rng.uniform(np.log(0.35 if crowded else 0.18), np.log(1.1 if crowded else 0.85)))
    upright = rng.random() < (0.6 if layout == "desk" else 0.2)
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    if upright:
        turn = trimesh.transformations.rotation_matrix(rng.uniform(0, 6.28), [0, 0, 1])[:3, :3]
    vertices = vertices @ turn.T * size
    x, y = rng.uniform(-1, 1, 2) * (0.45 if crowded else 0.65) * view
    if layout == "desk":
        vertices += [x, y, -vertices[:, 2].min() - 1e-4 * distance]
        if rng.random() < 0.12:
            vertices[:, 2] += rng.uniform(0.05, 0.5) * view
    elif layout == "wall":
        sink = rng.uniform(-0.4, 0.6) * (vertices[:, 1].max() - vertices[:, 1].min())
        vertices += [x, -vertices[:, 1].max() + max(sink, -0.3 * view), y]
    else:
        vertices += [x, rng.uniform(-0.6, 0.6) * view, y]
    return vertices, size


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


def _object(vertices, faces, tile, density):
    """Corners, crease-aware normals and box-projected texture coordinates of one object."""
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    keep = np.linalg.norm(area, axis=1) > 1e-14
    corners, area, faces = corners[keep], area[keep], faces[keep]
    face_normal = _unit(area)
    # merge vertices that coincide, then average the normals of the faces round each that meet smoothly
    _, weld = np.unique(np.round(corners.reshape(-1, 3) / np.ptp(vertices, axis=0).max(), 6), axis=0, return_inverse=True)
    weld = weld.ravel()
    order = np.argsort(weld, kind="stable")
    start = np.r_[0, np.cumsum(np.bincount(weld))]
    valence = np.diff(start)[weld]
    this = np.repeat(np.arange(len(weld)), valence)
    within = np.arange(len(this)) - np.repeat(np.cumsum(valence) - valence, valence)
    other = order[start[weld[this]] + within]
    smooth = np.einsum("ij,ij->i", face_normal[this // 3], face_normal[other // 3]) > CREASE
    normals = np.stack([np.bincount(this, area[other // 3, k] * smooth, len(weld)) for k in range(3)], -1)
    axis = np.abs(face_normal).argmax(1)
    plane = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    uv = np.stack([np.take_along_axis(corners[:, i], plane, 1) for i in range(3)], 1) * density
    return corners, _unit(normals).reshape(-1, 3, 3), uv, np.full(len(corners), tile)
