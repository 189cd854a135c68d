"""Path tracing on Mitsuba's ray intersector with the paper's shading, all lamps along the same paths.

Sharing the paths means one surface lookup serves every lamp; each lamp then costs one shadow ray a vertex.
A vectorised drjit variant must be active before this module is imported.
"""

import drjit as dr
import mitsuba as mi
import numpy as np

from .textures import SIZE

F0 = 0.05
FLOOR_ROUGHNESS = 0.35  # from the second vertex on: caustics of point lights cannot be sampled
BRIGHTEST = 5.0  # indirect light of one sample, in units of a lit white surface

Float, UInt, Vec3, Bool = mi.Float, mi.UInt32, mi.Vector3f, mi.Bool


class Hit:
    """Where rays met the scene: position, facing normals, material."""


class Tracer:
    """A scene ready to be asked for hits and for light."""

    def __init__(self, scene):
        faces = len(scene.corners)
        mesh = mi.Mesh("scene", 3 * faces, faces)
        parameters = mi.traverse(mesh)
        self.corners = Float(scene.corners.astype(np.float32).ravel())
        parameters["vertex_positions"] = self.corners
        parameters["faces"] = dr.arange(UInt, 3 * faces)
        parameters.update()
        self.scene = mi.load_dict({"type": "scene", "mesh": mesh})
        self.normals = Float(scene.normals.astype(np.float32).ravel())
        self.uv = Float(scene.uv.astype(np.float32).ravel())
        self.tile = UInt(scene.tile.astype(np.uint32))
        self.tiles = Float(np.ascontiguousarray(scene.tiles[..., :4], np.float32).ravel())
        self.relief = Float(np.ascontiguousarray(scene.tiles[..., 4:], np.float32).ravel())
        dr.eval(self.corners, self.normals, self.uv, self.tile, self.tiles, self.relief)

    def hit(self, origin, direction, active=True):
        """The first surface along each ray."""
        found = self.scene.ray_intersect_preliminary(mi.Ray3f(origin, direction), coherent=False, active=active)
        h = Hit()
        h.valid = found.is_valid() & active
        face = dr.select(h.valid, found.prim_index, 0)
        b1, b2 = found.prim_uv.x, found.prim_uv.y
        b0 = 1 - b1 - b2
        corner = [dr.gather(mi.Point3f, self.corners, 3 * face + i, h.valid) for i in range(3)]
        h.p = mi.Point3f(b0 * corner[0] + b1 * corner[1] + b2 * corner[2])
        e1, e2 = Vec3(corner[1] - corner[0]), Vec3(corner[2] - corner[0])
        n = dr.normalize(dr.cross(e1, e2))
        normal = [dr.gather(Vec3, self.normals, 3 * face + i, h.valid) for i in range(3)]
        s = dr.normalize(b0 * normal[0] + b1 * normal[1] + b2 * normal[2])
        h.v = -direction
        # sheets seen from behind and meshes of either winding: both normals look at the viewer
        h.ng = dr.select(dr.dot(n, h.v) < 0, -n, n)
        side = dr.select(dr.dot(s, h.ng) < 0, Float(-1), Float(1))
        h.smooth = s * side
        # shadow rays start on the smooth surface that the facets stand for, or facets would shadow each other
        # along the terminator (Hanika, Ray Tracing Gems II, 2021)
        h.lifted = mi.Point3f(h.p)
        for b, c, m in zip((b0, b1, b2), corner, normal):
            below = dr.minimum(side * dr.dot(Vec3(h.p - c), m), 0)
            h.lifted = h.lifted - b * below * side * m
        uv = [dr.gather(mi.Point2f, self.uv, 3 * face + i, h.valid) for i in range(3)]
        tile = dr.gather(UInt, self.tile, face, h.valid)
        h.albedo, h.rough, slope = self._material(tile, b0 * uv[0] + b1 * uv[1] + b2 * uv[2], h.valid)
        # relief tilts the normal against the gradient of the height: along the directions in which u and v grow
        d1, d2 = uv[1] - uv[0], uv[2] - uv[0]
        across1, across2 = dr.cross(e2, n), dr.cross(n, e1)  # n x e1 and e2 x n span the dual basis, up to one factor
        area = dr.dot(across1, e1)
        grow = [(across1 * a + across2 * b) / area for a, b in ((d1.x, d2.x), (d1.y, d2.y))]
        unit = [dr.select(dr.norm(g) > 1e-12, dr.normalize(g), 0) for g in grow]
        bumped = dr.normalize(h.smooth - slope.x * unit[0] - slope.y * unit[1])
        h.ns = dr.select(dr.dot(bumped, h.v) > 0.02, bumped, h.smooth)
        h.eps = 2e-5 * (1 + dr.maximum(dr.maximum(dr.abs(h.p.x), dr.abs(h.p.y)), dr.abs(h.p.z)))
        return h

    def _material(self, tile, uv, active):
        def mirrored(x):
            x = x - 2 * dr.floor(x / 2)
            return dr.clip(dr.select(x > 1, 2 - x, x) * SIZE - 0.5, 0, SIZE - 1.001), dr.select(x > 1, Float(-1), Float(1))

        (x, turn_x), (y, turn_y) = mirrored(uv.x), mirrored(uv.y)
        i, j = UInt(x), UInt(y)
        a, b = x - Float(i), y - Float(j)

        def blend(kind, source):
            at = lambda di, dj: dr.gather(kind, source, (tile * SIZE + j + dj) * SIZE + i + di, active)
            return (at(0, 0) * (1 - a) + at(1, 0) * a) * (1 - b) + (at(0, 1) * (1 - a) + at(1, 1) * a) * b

        t, slope = blend(mi.Vector4f, self.tiles), blend(mi.Vector2f, self.relief)
        return Vec3(t.x, t.y, t.z), t.w, mi.Vector2f(slope.x * turn_x, slope.y * turn_y)

    def visible(self, h, lamp, active=True):
        """Whether lamp light reaches the surface: nothing in the way and its smooth normal, before relief, not turned away."""
        l, span, _ = lamp.seen_from(h.p)
        facing = h.valid & active & (dr.dot(h.smooth, l) > 0)
        ray = mi.Ray3f(h.lifted + h.ng * h.eps, l)
        ray.maxt = span
        return facing & ~self.scene.ray_test(ray, active=facing)

    def lit(self, h, lamp, active=True):
        """Radiance toward the viewer of light that came straight from the lamp."""
        l, _, power = lamp.seen_from(h.p)
        return dr.select(self.visible(h, lamp, active), power * shaded(h.ns, h.v, l, h.albedo, h.rough), 0)


class Lamp:
    """A directional lamp (far away) or a point lamp; power 1 lights a facing white surface to 1 (at one metre)."""

    def __init__(self, xyz, is_point, power=1.0):
        xyz = [dr.opaque(Float, float(c)) for c in xyz]
        self.xyz, self.w, self.power = Vec3(*xyz), dr.opaque(Float, float(is_point)), dr.opaque(Float, float(power))

    def seen_from(self, p):
        """Unit direction, distance and irradiance over pi."""
        to = self.xyz - self.w * Vec3(p)
        span = dr.norm(to)
        near = self.w > 0
        return to / span, dr.select(near, span * 0.9999, dr.inf), self.power * dr.select(near, dr.rcp(dr.square(span)), 1)


def shaded(n, v, l, albedo, rough):
    """BRDF x pi x max(n.l, 0): Lambert plus Karis 2013 with alpha = roughness squared and F0 = 0.05."""
    return (albedo + specular(n, v, l, rough)) * dr.maximum(dr.dot(n, l), 0)


def specular(n, v, l, rough):
    """The microfacet term times pi, so that it adds to an albedo."""
    h = dr.normalize(v + l)
    nl, nv = dr.maximum(dr.dot(n, l), 1e-4), dr.maximum(dr.dot(n, v), 1e-4)
    nh, vh = dr.maximum(dr.dot(n, h), 0), dr.maximum(dr.dot(v, h), 0)
    a2 = dr.square(dr.square(rough))
    d = a2 / dr.square(dr.square(nh) * (a2 - 1) + 1)
    k = dr.square(rough + 1) / 8
    g = 1 / ((nl * (1 - k) + k) * (nv * (1 - k) + k))  # the (n.x) cancel against the denominator
    f = F0 + (1 - F0) * dr.exp2((-5.55473 * vh - 6.98316) * vh)
    return d * g * f / 4


def drawn(h, sampler):
    """A direction drawn from half diffuse, half specular lobe, with the `density` below; may point below the surface."""
    pick, u, w = sampler.next_1d(), sampler.next_1d(), sampler.next_1d()
    frame = mi.Frame3f(h.ns)
    a2 = dr.square(dr.square(h.rough))
    cos_h = dr.sqrt((1 - u) / (1 + (a2 - 1) * u))
    sin_h = dr.safe_sqrt(1 - cos_h * cos_h)
    half = frame.to_world(Vec3(sin_h * dr.cos(dr.two_pi * w), sin_h * dr.sin(dr.two_pi * w), cos_h))
    mirrored = 2 * dr.dot(h.v, half) * half - h.v
    r = dr.sqrt(u)
    matte = frame.to_world(Vec3(r * dr.cos(dr.two_pi * w), r * dr.sin(dr.two_pi * w), dr.safe_sqrt(1 - u)))
    return dr.select(pick < _glossy(h), mirrored, matte)


def density(h, l):
    """Of `drawn`, per steradian; right where l is above the surface."""
    half = dr.normalize(h.v + l)
    nl, nh, vh = dr.dot(h.ns, l), dr.maximum(dr.dot(h.ns, half), 0), dr.maximum(dr.dot(h.v, half), 1e-4)
    a2 = dr.square(dr.square(h.rough))
    d = a2 / (dr.pi * dr.square(dr.square(nh) * (a2 - 1) + 1))
    glossy = _glossy(h)
    return glossy * d * nh / (4 * vh) + (1 - glossy) * dr.maximum(nl, 0) / dr.pi


def _glossy(h):
    """Share of directions drawn from the specular lobe."""
    return 0.15 + 0.35 * (1 - h.rough)


def bounced(h, sampler):
    """A direction of `drawn` and its reflectance / density, cut at 4."""
    l = drawn(h, sampler)
    weight = shaded(h.ns, h.v, l, h.albedo, h.rough) / dr.pi / dr.maximum(density(h, l), 1e-8)
    ok = h.valid & (dr.dot(h.ns, l) > 0) & (dr.dot(h.ng, l) > 0)
    return l, dr.select(ok, dr.minimum(weight, 4), 0), ok


class Camera:
    """A pinhole at the origin looking along z; pixel (0, 0) is the centre of the top-left one."""

    def __init__(self, size, fov_degrees):
        self.size, self.f, self.c = size, size / 2 / np.tan(np.radians(fov_degrees / 2)), (size - 1) / 2

    def rays(self, per_side, rng):
        """Directions of per_side^2 jittered samples a pixel (1: the exact centre), those of a pixel side by side."""
        s = per_side
        y, x, j, i = np.meshgrid(np.arange(self.size), np.arange(self.size), np.arange(s), np.arange(s), indexing="ij")
        jitter = (lambda k: (k + rng.random(k.shape, np.float32)) / s - 0.5) if s > 1 else (lambda k: 0.0)
        d = np.stack([(x + jitter(i) - self.c) / self.f, (y + jitter(j) - self.c) / self.f, np.ones(x.shape)]).reshape(3, -1)
        d /= np.linalg.norm(d, axis=0)
        return Vec3(*(Float(c.astype(np.float32)) for c in d))

    def image(self, values, per_side):
        """The mean over each pixel's samples: (size, size, channels)."""
        a = values.numpy() if hasattr(values, "numpy") else np.asarray(values)
        a = a.reshape(-1, self.size, self.size, per_side**2)
        return np.ascontiguousarray(a.mean(-1, dtype=np.float32).transpose(1, 2, 0))


def direct(tracer, camera, lamps, per_side, rng):
    """Direct light of each lamp: a list of (size, size, 3), and the mean albedo and normal that guide a denoiser."""
    h = tracer.hit(mi.Point3f(0), camera.rays(per_side, rng))
    dr.eval(h.__dict__)
    images = [camera.image(tracer.lit(h, lamp), per_side) for lamp in lamps]
    guides = [camera.image(dr.select(h.valid, q, 0), per_side) for q in (h.albedo, h.ns)]
    return images, guides


def indirect(tracer, camera, lamps, per_side, bounces, rng, ambient=None):
    """Light that reached the pixel over one to `bounces` other surfaces: per lamp, and the room's sky if asked."""
    d = camera.rays(per_side, rng)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(int(rng.integers(2**31)), dr.width(d))
    h = tracer.hit(mi.Point3f(0), d)
    carried = Vec3(1)
    sums = [Vec3(0) for _ in lamps]
    sky = Vec3(0)
    for bounce in range(bounces):
        l, weight, ok = bounced(h, sampler)
        carried = carried * weight
        h = tracer.hit(h.p + h.ng * h.eps, l, ok)
        if ambient:
            height = 0.5 + 0.5 * dr.dot(l, Vec3(*map(float, ambient["up"])))
            tone = dr.lerp(Vec3(*map(float, ambient["ground"])), Vec3(*map(float, ambient["sky"])), height)
            sky += dr.select(ok & ~h.valid, carried * tone, 0)
        h.rough = dr.maximum(h.rough, FLOOR_ROUGHNESS)
        dr.eval(h.__dict__, carried, sky, sampler)
        for k, lamp in enumerate(lamps):
            sums[k] += dr.select(h.valid, carried * tracer.lit(h, lamp), 0)
            dr.eval(sums[k])
    clamp = lambda s: s * dr.minimum(1, BRIGHTEST / dr.maximum(dr.max(s), 1e-6))
    images = [camera.image(clamp(s), per_side) for s in sums]
    return images, camera.image(clamp(sky), per_side) if ambient else None
