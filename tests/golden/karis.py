"""Prints the expected values in src/scene/karis.rs, in double precision, of arguments as f32 holds
them (1 - n.h of a narrow lobe feels that rounding).

python3 tests/golden/karis.py
"""

import struct
from math import pi

CASES = [
    (1.0, 1.0, 1.0, 1.0, 0.2),
    (1.0, 1.0, 1.0, 1.0, 1.0),
    (0.8, 0.6, 0.95, 0.7, 0.3),
    (0.3, 0.9, 0.7, 0.75, 0.6),
    (0.05, 0.1, 0.999, 0.02, 0.15),
    (0.5, 0.5, 0.2, 0.4, 0.9),
    (0.99, 0.98, 0.9999, 0.99, 0.05),
]


def karis(nl, nv, nh, vh, roughness, f0=0.05):
    a = roughness**2
    d = a**2 / (pi * (nh**2 * (a**2 - 1) + 1) ** 2)
    k = (roughness + 1) ** 2 / 8
    g = nl / (nl * (1 - k) + k) * nv / (nv * (1 - k) + k)
    f = f0 + (1 - f0) * 2 ** ((-5.55473 * vh - 6.98316) * vh)
    return d * f * g / (4 * nl * nv)


for case in CASES:
    held = struct.unpack("5f", struct.pack("5f", *case))
    print(f"Case {{ arguments: {list(case)}, expected: {karis(*held):.7e} }},")
