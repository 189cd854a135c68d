"""Closed shapes and thin structures, each a pure function of one integer.

A shape is (vertices (N, 3), faces (M, 3)) in its own frame: centred on the origin, longest side 1, z up. Faces that meet smoothly wind
alike; which way is open, since the tracer turns every normal to the viewer.
"""

import numpy as np
import trimesh


def shape(shape_id):
    """The shape of that number: its family's name, vertices and faces."""
    rng = np.random.default_rng([0x5A4E, shape_id])
    names, chances = zip(*((f.__name__, chance) for f, chance in FAMILIES))
    pick = rng.choice(len(names), p=np.array(chances) / sum(chances))
    mesh = FAMILIES[pick][0](rng)
    vertices = np.asarray(mesh.vertices, float)
    low, high = vertices.min(0), vertices.max(0)
    vertices = (vertices - (low + high) / 2) / (high - low).max()
    return names[pick], vertices, np.asarray(mesh.faces)


def _sphere(detail=5):
    return trimesh.creation.icosphere(subdivisions=detail)


def ellipsoid(rng):
    mesh = _sphere()
    mesh.vertices = mesh.vertices * rng.uniform(0.45, 1.0, 3)
    return mesh


def box(rng):
    return trimesh.creation.box(extents=rng.uniform(0.25, 1.0, 3))


def cylinder(rng):
    radius = rng.uniform(0.15, 0.6)
    taper = rng.choice([1.0, rng.uniform(0.0, 0.9)])
    return _lathe(np.array([[0, 0], [radius, 0], [radius * taper, 1], [0, 1]]))


def torus(rng):
    return trimesh.creation.torus(1.0, rng.uniform(0.15, 0.45), major_sections=96, minor_sections=48)


def superquadric(rng):
    """Barr 1981: |x|^(2/b) + |y|^(2/b) to the b/a, plus |z|^(2/a), equals 1."""
    a, b = rng.uniform(0.25, 1.9, 2)
    mesh = _sphere()
    d = np.abs(mesh.vertices) + 1e-9
    r = ((d[:, 0] ** (2 / b) + d[:, 1] ** (2 / b)) ** (b / a) + d[:, 2] ** (2 / a)) ** (-a / 2)
    mesh.vertices = mesh.vertices * r[:, None] * rng.uniform(0.4, 1.0, 3)
    return mesh


def blob(rng):
    """A sphere or torus displaced along its normals by a few waves: stays closed."""
    round_one = rng.random() < 0.75
    mesh = _sphere() if round_one else trimesh.creation.torus(1.0, 0.4, major_sections=128, minor_sections=64)
    amplitude = rng.uniform(0.05, 0.45) * (1.0 if round_one and rng.random() < 0.8 else 0.5)
    p, bump = mesh.vertices, 0.0
    for _ in range(8):
        k = rng.normal(size=3)
        k *= rng.uniform(1.0, 7.0) / np.linalg.norm(k)
        bump = bump + np.sin(p @ k + rng.uniform(0, 6.28)) / np.linalg.norm(k)
    mesh.vertices = p + mesh.vertex_normals * (amplitude * bump / 2.0)[:, None]
    mesh.vertices = mesh.vertices * rng.uniform(0.5, 1.0, 3)
    return mesh


def vase(rng):
    """A solid of revolution, hollow like a cup two times in three."""
    z = np.linspace(0, 1, 40)
    r = 0.3 + sum(rng.uniform(-0.12, 0.12) / k * np.sin(np.pi * k * z + rng.uniform(0, 6.28)) for k in (1, 2, 3))
    r = np.maximum(r, 0.05) * rng.uniform(0.7, 1.5)
    outer = np.c_[r, z]
    if rng.random() < 0.67:
        wall = rng.uniform(0.012, 0.05)
        inner = np.c_[np.maximum(r - wall, 0.01), np.maximum(z, wall)][::-1]
        return _lathe(np.vstack([[0, 0], outer, inner, [0, wall]]))
    return _lathe(np.vstack([[0, 0], outer, [0, 1]]))


def carved(rng):
    """Two or three primitives joined, one or two subtracted."""
    solid = _part(rng)
    for join in [True] * rng.integers(0, 3) + [False] * rng.integers(1, 3):
        other = _part(rng)
        other.apply_scale(rng.uniform(0.5, 0.9))
        other.apply_translation(rng.uniform(-0.35, 0.35, 3))
        made = solid.union(other, engine="manifold") if join else solid.difference(other, engine="manifold")
        if len(made.faces) > 20:
            solid = made
    return solid


def rods(rng):
    """Thin rods: a bundle, a frame or a table on legs."""
    parts, kind, r = [], rng.integers(3), rng.uniform(0.008, 0.03)
    if kind == 0:
        for _ in range(rng.integers(2, 7)):
            ends = rng.uniform(-0.5, 0.5, (2, 3))
            parts.append(trimesh.creation.cylinder(r, segment=ends, sections=20))
    elif kind == 1:
        half = rng.uniform(0.2, 0.5, 3)
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
        for i in range(8):
            for j in range(i + 1, 8):
                if np.sum(np.abs(corners[i] - corners[j]) > 1e-9) == 1:
                    parts.append(trimesh.creation.cylinder(r, segment=[corners[i], corners[j]], sections=20))
    else:
        half = rng.uniform(0.2, 0.5, 2)
        height, top = rng.uniform(0.3, 0.8), trimesh.creation.box(extents=[2 * half[0], 2 * half[1], rng.uniform(0.02, 0.06)])
        top.apply_translation([0, 0, height])
        parts = [top] + [
            trimesh.creation.cylinder(r, segment=[[x, y, 0], [x, y, height]], sections=20)
            for x in (-0.9 * half[0], 0.9 * half[0])
            for y in (-0.9 * half[1], 0.9 * half[1])
        ]
    return trimesh.util.concatenate(parts)


def sheet(rng):
    """A thin sheet, flat or rolled about one axis, with a back side."""
    n, thick = 60, rng.uniform(0.005, 0.03)
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(-0.5, 0.5, n) * rng.uniform(0.3, 1.0), indexing="ij")
    bend = rng.choice([1e-3, rng.uniform(0.5, 4.0)])
    angle = u * bend
    sides = []
    for offset in (-thick / 2, thick / 2):
        radius = 1 / bend + offset
        sides.append(np.stack([radius * np.sin(angle), v, radius * np.cos(angle) - 1 / bend], -1).reshape(-1, 3))
    i, j = np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij")
    a = (i * n + j).ravel()
    quad = np.stack([a, a + n, a + n + 1, a + 1], 1)
    edge = np.r_[np.arange(n), np.arange(1, n) * n + n - 1, (n - 1) * n + np.arange(n - 2, -1, -1), np.arange(n - 2, -1, -1) * n]
    rim = np.stack([edge[:-1], edge[1:], edge[1:] + n * n, edge[:-1] + n * n], 1)
    quads = np.vstack([quad[:, ::-1], quad + n * n, rim])
    faces = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return trimesh.Trimesh(np.vstack(sides), faces, process=False)


def hoop(rng):
    """One to three thin rings."""
    parts = []
    for _ in range(rng.integers(1, 4)):
        ring = trimesh.creation.torus(rng.uniform(0.25, 0.5), rng.uniform(0.008, 0.035), major_sections=96, minor_sections=20)
        ring.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        parts.append(ring)
    return trimesh.util.concatenate(parts)


def _part(rng):
    kind = rng.integers(4)
    if kind == 0:
        return _sphere(4).apply_scale(rng.uniform(0.35, 0.6))
    if kind == 1:
        return trimesh.creation.box(extents=rng.uniform(0.4, 1.0, 3))
    if kind == 2:
        made = trimesh.creation.cylinder(rng.uniform(0.15, 0.45), rng.uniform(0.4, 1.2), sections=80)
    else:
        made = trimesh.creation.torus(rng.uniform(0.3, 0.5), rng.uniform(0.08, 0.2), major_sections=80, minor_sections=40)
    return made.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))


def _lathe(profile):
    return trimesh.creation.revolve(profile, sections=96)


FAMILIES = [
    (ellipsoid, 1.0), (box, 1.6), (cylinder, 1.0), (torus, 0.8), (superquadric, 1.6), (blob, 1.6),
    (vase, 1.3), (carved, 1.6), (rods, 1.0), (sheet, 0.9), (hoop, 0.5),
]
