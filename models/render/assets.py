"""Meshes and textures out of Debian packages, each a pure function of a number and a pool.

Pool "train" may mix with the procedural shapes and textures; pool "other" is for tests alone and shares no mesh, no
texture and no law of roughness with it. What belongs to which stands in `vetted.toml` (written by `vetting.py`);
the files stay in their packages and nothing of them is part of this project (`LICENCES.md`).
"""

import io
import os
import re
import struct
import tomllib
import zipfile
import zlib
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from .textures import SIZE

POOLS = ("train", "other")
PACKAGES = {  # package: where Debian puts it
    "sweethome3d-furniture": "/usr/share/sweethome3d/furniture",
    "0ad-data": "/usr/share/games/0ad/mods/public/public.zip",
    "redeclipse-data": "/usr/share/games/redeclipse/data",
}
# linear light of sRGB bytes
LINEAR = np.array([c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in np.arange(256) / 255], np.float32)
LEAST_AREA = 1e-10  # of a face, once the longest side is 1


class AssetsMissing(RuntimeError):
    """A package is not installed, or lacks a file of `vetted.toml`."""


def packaged_shape(number, pool):
    """The mesh of that number: its family's name, vertices (V, 3) and triangles (F, 3), at most 60 000.

    Centred on the origin, longest side 1, z up, no face without area. In pool "train" numbers ending in 8 and in 9
    have meshes of their own, as for the procedural shapes. AssetsMissing says which package to install.
    """
    rng = np.random.default_rng([0x3E5B, POOLS.index(pool), number])
    place, family = _drawn(rng, "shapes", number, pool)
    return family, *mesh(place)


def packaged_texture(number, pool):
    """The tile of that number: (512, 512, 6) float32, channels and ranges as of `textures.texture`.

    A square window of the packaged picture, mirrored and brightened at random. Pool "train" draws roughness as the
    procedural textures do, pool "other" reads it off the specular map, between two ends or as two lobes.
    Numbers ending in 8 and 9 as for `packaged_shape`. AssetsMissing says which package to install.
    """
    rng = np.random.default_rng([0x71E5, POOLS.index(pool), number])
    albedo_at, normal_at, specular_at, green = _drawn(rng, "textures", number, pool)
    beside = lambda name: f"{albedo_at.rsplit('/', 1)[0]}/{name}"
    # one window for all maps, in parts of their side
    first = picture(albedo_at)
    share = rng.uniform(min(SIZE / min(first.shape[:2]), 1.0), 1.0)
    corner, turn = rng.random(2), rng.integers(0, 2, 3).astype(bool)
    window = lambda image: _window(image, share, corner, turn)
    color = window(first)
    albedo = LINEAR[color]
    albedo *= min(np.exp(rng.uniform(np.log(0.8), np.log(2.0))), 0.95 / max(np.quantile(albedo[::4, ::4], 0.99), 1e-3))
    light = _stretched(cv2.cvtColor(np.ascontiguousarray(color), cv2.COLOR_RGB2GRAY).astype(np.float32))
    shine = _stretched(window(picture(beside(specular_at))).max(-1).astype(np.float32)) if specular_at else None
    rough = _even(rng, light, shine) if pool == "train" else _by_specular(rng, shine)
    wanted = rng.uniform(0.05, 0.3)  # standard deviation of the slopes
    if normal_at:
        sx, sy = np.moveaxis(_turned(slopes(window(picture(beside(normal_at))), green), turn), -1, 0)
        slope = np.stack([sx - sx.mean(), sy - sy.mean()], -1)
        slope *= min(wanted / max(slope.std(), 1e-6), 1.5)
    elif rng.random() < 0.5:  # no normal map: what is lighter stands higher, or all is flat
        height = cv2.GaussianBlur(light, (0, 0), rng.uniform(1.5, 4.0))
        slope = np.stack(np.gradient(height)[::-1], -1)
        slope *= 0.7 * wanted / max(slope.std(), 1e-6)
    else:
        slope = np.zeros((SIZE, SIZE, 2), np.float32)
    return np.concatenate([albedo.clip(0.01, 0.95), rough.clip(0.08, 1.0)[..., None], slope.clip(-1, 1)], -1).astype(np.float32)


def mesh(place):
    """Vertices (V, 3) and triangles (F, 3) of the OBJ file at `package:path`, as `packaged_shape` gives them."""
    vertices, faces = [], []
    for line in content(place).decode("latin-1").splitlines():
        kind = line[:2]
        if kind == "v ":
            vertices.append(line.split()[1:4])
        elif kind == "f ":
            ring = [int(corner.split("/", 1)[0]) for corner in line.split()[1:]]
            ring = [i - 1 if i > 0 else len(vertices) + i for i in ring]
            faces += [(ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1)]
    vertices, faces = np.array(vertices, float), np.array(faces)
    used = vertices[faces.ravel()] @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # y up becomes z up
    low, high = used.min(0), used.max(0)
    used = (used - (low + high) / 2) / (high - low).max()
    vertices, weld = np.unique(used.round(6), axis=0, return_inverse=True)
    faces = weld.reshape(-1, 3)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2 > LEAST_AREA]
    # the same face twice, back to back, would shade itself
    faces = faces[np.sort(np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1])]
    return vertices, faces


def picture(place):
    """The picture at `package:path`: (H, W, 3) uint8, RGB; of a DDS file the largest level up to 1024 pixels."""
    data = content(place)
    if not place.endswith(".dds"):
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    height, width, code = *struct.unpack_from("<II", data, 12), data[84:88]
    levels, start, block = struct.unpack_from("<I", data, 28)[0], 128, 8 if code == b"DXT1" else 16
    bytes_of = lambda: max((height + 3) // 4, 1) * max((width + 3) // 4, 1) * block
    while code[:3] == b"DXT" and max(height, width) > 1024 and levels > 1:
        start, levels = start + bytes_of(), levels - 1
        height, width = max(height // 2, 1), max(width // 2, 1)
    header = data[:12] + struct.pack("<II", height, width) + data[20:128]
    return np.asarray(Image.open(io.BytesIO(header + data[start:])).convert("RGB"))


def slopes(normals, green):
    """Slope of the relief along x and y of the tile, (H, W, 2), from a normal map of bytes.

    `green` is +1 where green faces up the picture (OpenGL), -1 where it faces down (DirectX). Y runs down the picture.
    """
    n = normals.astype(np.float32) / 127.5 - 1
    z = np.maximum(n[..., 2], 0.2)
    return np.stack([-n[..., 0] / z, green * n[..., 1] / z], -1)


def content(place):
    """The bytes of the file at `package:path`."""
    package, path = place.split(":", 1)
    root = Path(PACKAGES[package])
    if not root.exists():
        raise AssetsMissing(f"{root} does not exist: install the Debian package {package} (apt-get install {package})")
    try:
        if root.is_file():
            return _archive(root, os.getpid()).read(path)
        archive, _, member = path.partition(".sh3f/")
        if member:
            return _archive(root / f"{archive}.sh3f", os.getpid()).read(member)
        return (root / path).read_bytes()
    except (KeyError, FileNotFoundError):
        raise AssetsMissing(f"{root} has no {path}: install {package} of Debian 12, for which vetted.toml was made") from None


def split(name):
    """The last digit a number must have in pool "train" for that file: 8, 9, or None for the other eight.

    Variants of one thing, told apart by a last letter or number, fall on the same side.
    """
    stem = re.sub(r"\..*", "", name.rsplit("/", 1)[1].lower())
    digit = zlib.crc32(re.sub(r"[\d_\- ]+|_[a-z]\b", "", stem).encode()) % 10
    return digit if digit > 7 else None


@lru_cache
def vetted(kind, pool, digit=None):
    """What `vetted.toml` lists for the pool; in pool "train" only what belongs to numbers with that last digit."""
    listed = tomllib.loads(Path(__file__).with_name("vetted.toml").read_text())[pool][kind]
    return [row for row in listed if pool != "train" or split(row[0]) == digit]


@lru_cache
def _archive(path, _process):
    """An open archive; one for each process, since forked ones would share its place in the file."""
    return zipfile.ZipFile(path)


def _drawn(rng, kind, number, pool):
    rows = vetted(kind, pool, number % 10 if pool == "train" and number % 10 > 7 else None)
    return rows[rng.integers(len(rows))]


def _window(image, share, corner, turn):
    """A square window, `share` of the shorter side, mirrored and turned, as (SIZE, SIZE, channels)."""
    side = round(share * min(image.shape[:2]))
    y, x = (round(c * (n - side)) for c, n in zip(corner, image.shape))
    image = cv2.resize(image[y : y + side, x : x + side], (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    image = image[:, ::-1] if turn[0] else image
    image = image[::-1] if turn[1] else image
    return image.swapaxes(0, 1) if turn[2] else image


def _turned(slope, turn):
    """Slopes of a window that was mirrored and turned."""
    slope = slope * np.where(turn[:2], -1, 1).astype(np.float32)
    return slope[..., ::-1] if turn[2] else slope


def _stretched(field):
    """The field with its 2nd and 98th percentile at 0 and 1."""
    low, high = np.quantile(field[::4, ::4], [0.02, 0.98])
    return ((field - low) / max(high - low, 1e-3)).clip(0, 1).astype(np.float32)


def _even(rng, light, shine):
    """Roughness about one base, as of `textures.texture`; it varies with lightness or against the specular map."""
    low, high = [(0.6, 1.0), (0.3, 0.6), (0.15, 0.3), (0.08, 0.15)][rng.choice(4, p=[0.45, 0.27, 0.18, 0.10])]
    base = rng.uniform(low, high)
    vary = rng.choice([0.0, rng.uniform(0.1, 0.6)], p=[0.35, 0.65]) * base
    field = (1 - shine) if shine is not None and rng.random() < 0.5 else light * rng.choice([-1, 1])
    return base + vary * (field - field.mean())


def _by_specular(rng, shine):
    """Roughness from the specular map: between a dull and a shiny end, or two lobes with a soft edge between them."""
    dull, bright = rng.uniform(0.45, 1.0), rng.uniform(0.1, 0.4)
    if rng.random() < 0.5:
        edge = np.quantile(shine[::4, ::4], rng.uniform(0.3, 0.7))
        inner = 0.15 * (shine - edge)  # within a lobe
        shine = 1 / (1 + np.exp(-(shine - edge) / 0.04)) + inner
    return np.exp(np.log(dull) + (np.log(bright) - np.log(dull)) * shine)
