"""What relighting under environment maps claims, checked against forms written down separately."""

import os

import cv2
import numpy as np
import pytest
import trimesh

os.environ.setdefault("DRJIT_LIBLLVM_PATH", "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1")
mi = pytest.importorskip("mitsuba")
mi.set_variant("llvm_ad_rgb")

import drjit as dr  # noqa: E402

dr.set_thread_count(1)

from . import tracer as tr  # noqa: E402
from .environment import Environment, lit, traced  # noqa: E402
from .environment_maps import areas, counted, procedural, read_map, toward, write_map  # noqa: E402
from .scene import Scene  # noqa: E402
from .textures import SIZE  # noqa: E402


def scene_of(corners, normals, albedo, rough):
    tile = np.zeros((1, SIZE, SIZE, 6), np.float32)
    tile[..., :3], tile[..., 3] = albedo, rough
    return Scene(corners, normals, np.zeros((len(corners), 3, 2)), np.zeros(len(corners), int), tile, 50.0,
                 np.zeros((0, 3)), np.zeros(3), {}, {})


def plane(albedo, rough):
    """Facing the camera one metre away, wider than the picture."""
    corners = np.array([[[-9, -9, 1], [9, -9, 1], [9, 9, 1]], [[-9, -9, 1], [9, 9, 1], [-9, 9, 1.0]]])
    return scene_of(corners, np.broadcast_to([0, 0, -1.0], corners.shape), albedo, rough)


def ball(albedo, rough, extra=()):
    """Of radius 0.35 m, one metre away, with smooth normals; `extra` triangles are flat."""
    round_one = trimesh.creation.icosphere(4, 0.35)
    corners = round_one.vertices[round_one.faces]
    normals = corners / 0.35
    corners = corners + [0, 0, 1]
    if len(extra):
        flat = np.cross(extra[:, 1] - extra[:, 0], extra[:, 2] - extra[:, 0])
        flat /= np.linalg.norm(flat, axis=1, keepdims=True)
        corners, normals = np.concatenate([corners, extra]), np.concatenate([normals, np.repeat(flat[:, None], 3, 1)])
    return scene_of(corners, normals, albedo, rough)


def reflected(n, v, l, albedo, rough):
    """BRDF times cosine in float64 (Karis 2013), 0 below the horizon."""
    h = (v + l) / np.linalg.norm(v + l, axis=-1, keepdims=True)
    dot = lambda a, b: np.sum(a * b, -1)
    nl, nv, nh, vh = np.maximum(dot(n, l), 0), dot(n, v), dot(n, h), dot(v, h)
    alpha, k = rough**2, (rough + 1) ** 2 / 8
    d = alpha**2 / (np.pi * (nh**2 * (alpha**2 - 1) + 1) ** 2)
    f = 0.05 + 0.95 * 2 ** ((-5.55473 * vh - 6.98316) * vh)
    return albedo / np.pi * nl + d * f * nl / (4 * (nl * (1 - k) + k) * (nv * (1 - k) + k))


def viewers(camera):
    """Unit vectors from what a pixel shows to the lens, (size, size, 3)."""
    y, x = np.mgrid[: camera.size, : camera.size]
    v = -np.stack([(x - camera.c) / camera.f, (y - camera.c) / camera.f, np.ones(x.shape)], -1)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def expected(n, v, pixels, albedo, rough):
    """Light that a point with nothing in the way sends on: the sum over the map's pixels."""
    l = toward(len(pixels)).reshape(-1, 3)
    share = (counted(pixels) * areas(len(pixels))[:, None, None]).reshape(-1, 3)
    return reflected(n, v, l, albedo, rough) @ share


def test_a_white_matte_wall_facing_the_camera_under_ones_is_one():
    camera = tr.Camera(64, 10.0)
    image = lit(tr.Tracer(plane(1.0, 1.0)), camera, Environment(np.ones((64, 128, 3))), 8, 0, np.random.default_rng(0))
    # what the microfacet term adds to a matte surface at roughness 1 is known in closed form as well
    gloss = expected(np.array([0, 0, -1.0]), np.array([0, 0, -1.0]), np.ones((256, 512, 3)), 0.0, 1.0)
    assert gloss.max() < 0.04
    error = np.abs(image - 1 - gloss)
    assert abs(image.mean() - 1 - gloss[0]) < 0.002 and np.quantile(error, 0.99) < 0.01
    assert error.max() < 0.03  # up to the very rim


def test_a_ball_under_ones_misses_only_the_light_far_behind_it():
    camera, made = tr.Camera(32, 50.0), ball(1.0, 1.0)
    image = traced(tr.Tracer(made), camera, Environment(np.ones((64, 128, 3))), 20, 0, np.random.default_rng(0))[0][..., 0]
    v = viewers(camera)
    middle = v[..., 2] < -np.cos(np.arcsin(0.35) * 0.9)  # not the rim, where a pixel mixes many normals
    near = -v[..., 2] - np.sqrt(np.maximum(v[..., 2] ** 2 - 1 + 0.35**2, 0))
    n = (-v * near[..., None] - [0, 0, 1]) / 0.35
    wanted = np.array([expected(n[y, x], v[y, x], np.ones((64, 128, 3)), 1.0, 1.0)[0] for y, x in np.argwhere(middle)])
    assert wanted.min() < 0.99 < 1 < wanted.max()  # the light left out is missed toward the rim
    np.testing.assert_allclose(image[middle], wanted, rtol=0.04)  # noise of 400 samples of a pixel
    assert abs(image[middle].mean() / wanted.mean() - 1) < 0.003


def test_one_bright_pixel_is_a_lamp_of_its_irradiance():
    blade = np.array([[[-0.9, -0.9, 0.75], [-0.2, -0.9, 0.75], [-0.2, 0.1, 0.75]]])
    wall = np.array([[[-9, -9, 1.6], [9, -9, 1.6], [9, 9, 1.6]], [[-9, -9, 1.6], [9, 9, 1.6], [-9, 9, 1.6]]])
    camera, t = tr.Camera(64, 50.0), tr.Tracer(ball(np.array([0.8, 0.5, 0.2]), 0.5, np.concatenate([blade, wall])))
    row, column, power = 90, 80, np.array([2.0, 1.0, 0.5])
    pixels = np.zeros((256, 512, 3))
    pixels[row, column] = power * np.pi / areas(256)[row]
    direct, indirect, *_ = traced(t, camera, Environment(pixels), 4, 2, np.random.default_rng(0))
    lamp = tr.Lamp(toward(256)[row, column], False)
    (wanted,), _ = tr.direct(t, camera, [lamp], 4, np.random.default_rng(0))
    assert 0.03 < (wanted == 0).all(-1).mean() < 0.5  # there is shadow in it
    difference = np.abs(direct - wanted * power).max(-1)
    # the pixel is 0.7 degrees wide: edges of shadows and the middle of the highlight may differ a little
    assert np.quantile(difference, 0.95) < 0.01 and difference.mean() < 0.004
    (more,), _ = tr.indirect(t, camera, [lamp], 8, 2, np.random.default_rng(1))
    np.testing.assert_allclose(indirect.mean((0, 1)), (more * power).mean((0, 1)), rtol=0.05)


@pytest.mark.parametrize("rough", [0.12, 0.4, 1.0])
def test_a_wall_is_the_sum_over_the_map(rough):
    pixels, camera = procedural(7), tr.Camera(6, 40.0)
    assert pixels.max() > 100 * np.median(pixels)
    image = traced(tr.Tracer(plane(0.3, rough)), camera, Environment(pixels), 40, 0, np.random.default_rng(0))[0]
    times = 6 if rough < 0.2 else 2  # lobes are narrower than the map's pixels
    fine = np.repeat(np.repeat(counted(pixels), times, 0), times, 1)
    v = viewers(camera)
    for y, x in [(0, 0), (5, 3)]:
        steps = (np.arange(3) + 0.5) / 3 - 0.5  # the samples of a pixel see the lobe from slightly different places
        rays = [-np.array([(x + i - camera.c) / camera.f, (y + j - camera.c) / camera.f, 1]) for i in steps for j in steps]
        wanted = np.mean([expected(np.array([0, 0, -1.0]), r / np.linalg.norm(r), fine, 0.3, rough) for r in rays], 0)
        np.testing.assert_allclose(image[y, x], wanted, rtol=0.04)


def test_drawing_from_the_map_changes_noise_but_not_light():
    camera, t, environment = tr.Camera(24, 50.0), tr.Tracer(ball(0.5, 0.3)), Environment(procedural(2))
    sampler = mi.load_dict({"type": "independent"})
    d = camera.rays(64, np.random.default_rng(1))
    sampler.seed(3, dr.width(d))
    h = t.hit(mi.Point3f(0), d)
    l, weight, ok = tr.bounced(h, sampler)
    free = ok & ~t.scene.ray_test(mi.Ray3f(h.lifted + h.ng * h.eps, l), active=ok)
    alone = camera.image(dr.select(free, weight * environment.radiance(l), 0), 64)
    shared = traced(t, camera, environment, 24, 0, np.random.default_rng(2))[0]
    np.testing.assert_allclose(shared.mean((0, 1)), alone.mean((0, 1)), rtol=0.015)
    clear = cv2.blur(alone, (4, 4)), cv2.blur(shared, (4, 4))
    assert np.abs(clear[0] - clear[1]).mean() < 0.02 * shared.mean()


def test_light_right_of_the_maps_middle_and_above_comes_from_the_right_and_above():
    pixels = np.zeros((32, 64, 3))
    pixels[6, 52] = 1.0
    camera = tr.Camera(32, 50.0)
    image = traced(tr.Tracer(ball(0.8, 1.0)), camera, Environment(pixels), 2, 0, np.random.default_rng(0))[0].mean(-1)
    y, x = (np.mgrid[:32, :32] * image).sum((1, 2)) / image.sum()
    assert x > 18 and y < 13


def test_nothing_far_behind_the_scene_lights_it():
    pixels = np.zeros((32, 64, 3))
    pixels[16, 32] = 1e3
    with pytest.raises(ValueError, match="no light"):
        Environment(pixels)


@pytest.mark.parametrize("pixels, said", [(np.ones((8, 8, 3)), "shape"), (np.full((8, 16, 3), np.nan), "finite"),
                                          (-np.ones((8, 16, 3)), "negative")])
def test_maps_that_cannot_be_environments_are_refused(pixels, said):
    with pytest.raises(ValueError, match=said):
        Environment(pixels)


def test_the_sky_of_a_map_stands_where_up_is():
    up = np.array([0.6, -0.64, -0.48])
    overcast = [n for n in range(30) if procedural(n).max() < 8]  # no lamp or sun that could stand anywhere
    assert len(overcast) > 2
    for number in overcast:
        light = (procedural(number, up).mean(-1) * areas(64)[:, None])[..., None] * toward(64)
        assert light.sum((0, 1)) @ up > 0, number


def test_a_numbered_map_is_always_the_same_and_survives_its_file(tmp_path):
    seen = []
    for number in range(12):
        pixels = procedural(number)
        assert pixels.shape == (64, 128, 3) and pixels.dtype == np.float32
        assert np.isfinite(pixels).all() and pixels.min() >= 0 and pixels.max() <= 1000
        np.testing.assert_array_equal(pixels, procedural(number))
        write_map(tmp_path / "map.hdr", pixels)
        np.testing.assert_array_equal(read_map(tmp_path / "map.hdr"), pixels)
        seen.append(pixels.max() / np.median(pixels))
    assert max(seen) > 1000 > 100 > min(seen)  # from overcast skies to single lamps
