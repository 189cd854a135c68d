"""Random environment maps, and their files. Needs no renderer.

A map is latitude-longitude, (H, 2H, 3), linear: its middle is what the camera looks at, its left half lies to the
camera's left, its first row is straight up.
"""

import colorsys

import cv2
import numpy as np

BRIGHTEST = 1000.0  # radiance; where the whole map has value 1, a white matte surface that sees all of it has value 1
MOST_FORWARD = 0.342  # cosine to the line of sight: light from more than 20 degrees behind the scene is left out


def toward(height):
    """Unit vectors to the pixels of a map, (height, 2 height, 3): x right, y down, z forward."""
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    longitude = np.pi * ((np.arange(2 * height) + 0.5) / height - 1)[None]
    level = np.cos(latitude)
    return np.stack(np.broadcast_arrays(level * np.sin(longitude), -np.sin(latitude), level * np.cos(longitude)), -1)


def areas(height):
    """Steradians of a pixel of each row, (height,)."""
    heights = np.sin(np.linspace(np.pi / 2, -np.pi / 2, height + 1))
    return (heights[:-1] - heights[1:]) * np.pi / height


def counted(pixels):
    """The map without the light from more than 20 degrees behind the scene, which the closed form leaves out too."""
    return pixels * (toward(len(pixels))[..., 2:] <= MOST_FORWARD)


def procedural(number, up=None, height=64):
    """Map of that number, (height, 2 height, 3) float32 in [0, 1000], exactly as a Radiance file holds it.

    `up` is the unit vector that points away from the ground, camera axes; without it the camera looks somewhere between
    60 degrees down and 20 up. The light that counts is that of a lamp of intensity 0.8 to 2.5.
    """
    rng = np.random.default_rng([number, 11])
    pitch, roll = rng.uniform(np.radians(-20), np.radians(60)), rng.normal(0, 0.07)
    if up is None:
        up = np.array([np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch), -np.sin(pitch)])
    least = np.eye(3)[np.abs(up).argmin()]
    right = np.cross(least, up) / np.linalg.norm(np.cross(least, up))
    d = toward(2 * height) @ np.stack([right, up, np.cross(right, up)], 1)  # y is up from here on
    kind = rng.choice(5, p=[0.27, 0.28, 0.2, 0.1, 0.15])
    fine = [_outdoors, _room, _studio, _night, _gels][kind](rng, d)
    pixels = np.maximum(fine, 0).reshape(height, 2, 2 * height, 2, 3).mean((1, 3))
    power = (counted(pixels).mean(-1) * areas(height)[:, None]).sum() / np.pi
    pixels *= np.exp(rng.uniform(np.log(0.8), np.log(2.5))) / max(power, 1e-6 * pixels.max())
    return shared_exponent(pixels.clip(0, BRIGHTEST))


def shared_exponent(pixels):
    """Rounded to what a Radiance file can hold: eight bits a channel and one exponent for the three."""
    step = np.ldexp(1.0, np.frexp(pixels.max(-1, keepdims=True) * (256 / 255.5))[1] - 8)
    return (np.round(pixels / step) * step).astype(np.float32)


def write_map(path, pixels):
    """Writes a Radiance .hdr; values that `shared_exponent` would change lose up to 1 / 128 of the largest channel."""
    if not cv2.imwrite(str(path), np.ascontiguousarray(np.asarray(pixels, np.float32)[..., ::-1])):
        raise OSError(f"{path}: not written; is the folder there and does the name end in .hdr?")


def read_map(path):
    """The pixels of a Radiance .hdr, (H, W, 3) float32."""
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.float32:
        raise OSError(f"{path}: not a Radiance .hdr")
    return np.ascontiguousarray(pixels[..., ::-1])


def _outdoors(rng, d):
    """Sky, clouds, sun with its glow, ground, and what stands on the horizon."""
    up = d[..., 1:2]
    zenith, horizon = _hue(rng, 0.55, 0.66, 0.6) * rng.uniform(0.2, 1), _white(rng) * rng.uniform(0.3, 1.5)
    sky = horizon + (zenith - horizon) * up.clip(0, 1) ** rng.uniform(0.3, 1)
    cover = rng.uniform(-0.6, 1)
    clouds = (_waves(rng, d * [1, 3, 1], 4, 30) + cover).clip(0, 1)
    sky = sky * (1 - clouds) + _white(rng) * rng.uniform(0.5, 1.5) * clouds
    sun = _toward(rng, rng.uniform(3, 80))
    color = np.array([1, 0.45, 0.15]) ** (0.25 / (0.1 + sun[1]))  # redder, the lower it stands
    sky = sky + color * rng.uniform(0.2, 3) * np.exp((d @ sun - 1) * rng.uniform(8, 60))[..., None]
    sky = sky + color * np.exp(rng.uniform(np.log(20), np.log(2000))) * _disc(d, sun, rng.uniform(2, 4)) * (rng.random() < 0.75)
    ground = _hue(rng, 0, 1, 0.5) * rng.uniform(0.05, 0.6) * (1 + 0.5 * _waves(rng, d, 6, 40)).clip(0.2, 2)
    around = np.arctan2(d[..., 0], d[..., 2])
    skyline = np.zeros(around.shape)
    for _ in range(rng.integers(0, 12)):  # buildings and trees
        apart = np.abs((around - rng.uniform(-np.pi, np.pi) + np.pi) % (2 * np.pi) - np.pi)
        skyline = np.maximum(skyline, (apart < rng.uniform(0.03, 0.4)) * rng.uniform(0.02, 0.7))
    skyline += rng.uniform(0, 0.1) * (1 + _waves(rng, d * [1, 0, 1], 3, 20)[..., 0])
    building = _hue(rng, 0, 1, 0.4) * rng.uniform(0.03, 0.5) * (1 + 0.7 * _waves(rng, d, 10, 40)).clip(0.2, 2)
    return np.where(up < 0, ground, np.where(up < skyline[..., None], building, sky))


def _room(rng, d):
    """A box seen from inside: colored walls with pictures on them, windows, lamps under the ceiling."""
    half, at = np.array([rng.uniform(1.5, 5), rng.uniform(1.1, 2), rng.uniform(1.5, 5)]), rng.uniform(-0.6, 0.6, 3)
    span = (half * np.sign(d) - at * half) / np.where(d == 0, 1e-9, d)
    axis = span.argmin(-1)
    p = at * half + d * span.min(-1, keepdims=True)
    face = 2 * axis + (np.take_along_axis(d, axis[..., None], -1)[..., 0] > 0)
    colors = np.stack([_hue(rng, 0, 1, rng.choice([0.15, 0.8])) * rng.uniform(0.03, 0.5) for _ in range(6)])
    corners = np.sort(1 - np.abs(p) / half, -1)[..., 1:2]  # darker toward the edges
    room = colors[face] * (0.5 + 0.5 * (corners / 0.3).clip(0, 1)) * (1 + 0.3 * _waves(rng, p, 2, 15))
    lit = lambda low, high: np.exp(rng.uniform(np.log(low), np.log(high)))
    for _ in range(rng.integers(0, 8)):
        room = np.where(_panel(rng, p, face, half, 0.05, 0.5), _hue(rng, 0, 1, 0.7) * rng.uniform(0.02, 0.7), room)
    for _ in range(rng.integers(0, 4)):
        window = _panel(rng, p, face, half, 0.15, 0.6)
        shining = _white(rng) * lit(2, 60) * (0.6 + 0.4 * (p[..., 1:2] / half[1]))
        room = np.where(window, shining * (1 + 0.5 * _waves(rng, d, 8, 40)).clip(0.1, 2), room)
    for _ in range(rng.integers(0 if rng.random() < 0.5 else 1, 5)):
        room = np.where(_panel(rng, p, face, half, 0.03, 0.3, 3), _white(rng) * lit(10, 300), room)
    return room


def _panel(rng, p, face, half, least, most, which=None):
    """Where an upright rectangle lies on one of the walls, or on face `which`."""
    which = rng.choice([0, 1, 4, 5]) if which is None else which
    a, b = [k for k in range(3) if k != which // 2]
    size = rng.uniform(least, most, 2)
    centre = rng.uniform(-1, 1, 2) * (1 - size)
    inside = (np.abs(p[..., a] / half[a] - centre[0]) < size[0]) & (np.abs(p[..., b] / half[b] - centre[1]) < size[1])
    return (inside & (face == which))[..., None]


def _studio(rng, d):
    """Softboxes, strips and ring lights round a dark backdrop."""
    picture = _hue(rng, 0, 1, 0.3) * np.exp(rng.uniform(np.log(0.003), np.log(0.2))) * (1.2 + d[..., 1:2])
    for _ in range(rng.integers(1, 6)):
        axis = _toward(rng, rng.uniform(-15, 85))
        right = np.cross(axis, _toward(rng, rng.uniform(-60, 60)))
        right /= np.linalg.norm(right)
        depth = d @ axis
        x, y = (d @ right) / np.maximum(depth, 1e-3), (d @ np.cross(axis, right)) / np.maximum(depth, 1e-3)
        w, h = np.tan(np.radians(rng.uniform(3, 30, 2)))
        far = np.hypot(x / w, y / h) if rng.random() < 0.3 else np.maximum(np.abs(x) / w, np.abs(y) / h)
        hole = rng.uniform(0.5, 0.85) if rng.random() < 0.15 else 0
        shape = (depth > 0) * (far < 1) * (far > hole) * (1 - rng.uniform(0, 0.7) * far.clip(0, 1) ** 2)
        color = _hue(rng, 0, 1, 0.9) if rng.random() < 0.25 else _white(rng)
        picture = picture + color * np.exp(rng.uniform(np.log(3), np.log(150))) * shape[..., None]
    return picture


def _night(rng, d):
    """A dim sky over many small lamps."""
    glow, dark = _hue(rng, 0, 1, 0.6) * rng.uniform(0.02, 0.3), _hue(rng, 0.55, 0.7, 0.7) * rng.uniform(0.002, 0.03)
    picture = np.where(d[..., 1:2] < 0, glow * 0.3, dark + (glow - dark) * np.exp(-5 * np.abs(d[..., 1:2])))
    for _ in range(rng.integers(4, 60)):
        at = _toward(rng, rng.normal(5, 20))
        color = _hue(rng, 0, 1, 0.9) if rng.random() < 0.4 else _white(rng)
        picture = picture + color * np.exp(rng.uniform(np.log(2), np.log(500))) * _disc(d, at, rng.uniform(1, 4))
    return picture


def _gels(rng, d):
    """Wide colored lobes of light on a dim ground."""
    picture = _white(rng) * rng.uniform(0.01, 0.3) * (1.1 + _waves(rng, d, 1, 6))
    for _ in range(rng.integers(2, 8)):
        sharpness = np.exp(rng.uniform(np.log(1.5), np.log(200)))
        lobe = np.exp((d @ _toward(rng, rng.uniform(-60, 90)) - 1) * sharpness)[..., None]
        picture = picture + _hue(rng, 0, 1, 0.9) * rng.uniform(0.2, 1) * sharpness * lobe
    return picture


def _toward(rng, degrees_up):
    """A unit vector at that elevation and any azimuth, y up."""
    around, high = rng.uniform(-np.pi, np.pi), np.radians(np.clip(degrees_up, -90, 90))
    return np.array([np.cos(high) * np.sin(around), np.sin(high), np.cos(high) * np.cos(around)])


def _disc(d, axis, radius_degrees):
    return (d @ axis > np.cos(np.radians(radius_degrees)))[..., None]


def _white(rng):
    """Lamps and daylight from warm to cool."""
    warmth = rng.uniform(-1, 1)
    return np.array([1, 0.72, 0.42]) ** max(warmth, 0) * np.array([0.7, 0.85, 1]) ** max(-warmth, 0)


def _hue(rng, low, high, most_saturation):
    return np.array(colorsys.hsv_to_rgb(rng.uniform(low, high), rng.uniform(0, most_saturation), 1))


def _waves(rng, p, low, high):
    """Smooth noise over positions p, (..., 1), mostly within [-1, 1]: waves, weaker the shorter they are."""
    total, amount = 0, 0
    for _ in range(12):
        k = np.exp(rng.uniform(np.log(low), np.log(high)))
        direction = rng.normal(size=3)
        total = total + np.sin(p @ (direction / np.linalg.norm(direction) * k) + rng.uniform(0, 2 * np.pi)) / k
        amount += 0.5 / k**2
    return (total / (2 * amount) ** 0.5)[..., None]
