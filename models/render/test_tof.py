"""What the ToF camera claims, checked against sums and closed forms written down separately: `pytest models/render`."""

from dataclasses import replace

import numpy as np
import pytest

from .tof import AZURE_KINECT, Sensor, amplitude, infrared, paper_noise, sensed

LIGHT = 299_792_458.0
TRUTH = Sensor().at(0)  # no flaw at all; a test puts back the one it is about
SIZE = 64
CAMERA = (60.0, 60.0, 31.5, 31.5)
X, Y = np.meshgrid((np.arange(SIZE) - 31.5) / 60, (np.arange(SIZE) - 31.5) / 60)
LENGTH = np.sqrt(X**2 + Y**2 + 1)


def generator():
    return np.random.default_rng(5)


def toward_camera():
    return np.broadcast_to(np.float32([0, 0, 1]), (SIZE, SIZE, 3))


def wall(metres=1.0):
    return np.full((SIZE, SIZE), metres, np.float32)


def corner():
    """Two walls that meet at a right angle in a vertical edge 1.5 m away: depth, normal, and the amplitude of albedo 0.8."""
    depth = 1.5 / (1 + np.abs(X))
    normal = np.stack([-np.sign(X), 0 * X, np.ones_like(X)], -1) / np.sqrt(2)
    cosine = (np.abs(X) + 1) / np.sqrt(2) / LENGTH
    return depth.astype(np.float32), normal.astype(np.float32), (0.8 * cosine / (depth * LENGTH) ** 2).astype(np.float32)


def untidy():
    """Random surface with holes, some of it black or turned away."""
    rng = np.random.default_rng(2)
    depth = rng.uniform(0.3, 6, (SIZE, SIZE)).astype(np.float32)
    depth[rng.random((SIZE, SIZE)) < 0.1] = np.nan
    normal = rng.normal(size=(SIZE, SIZE, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return depth, (rng.random((SIZE, SIZE)) < 0.9).astype(np.float32) / depth**2, normal


@pytest.mark.parametrize("sensor", [Sensor(shift_pixels=(3, 1), reduce=4, spread_most=0.01), AZURE_KINECT])
def test_at_severity_zero_every_camera_answers_with_the_truth(sensor):
    depth, light, normal = untidy()
    found = sensed(depth, light, normal, CAMERA, generator(), sensor.at(0))
    np.testing.assert_allclose(found.metres, depth, rtol=3e-6)  # float32 through some ten operations; NaN equals NaN
    np.testing.assert_allclose(found.amplitude, np.where(np.isnan(depth), np.nan, light), rtol=1e-5, atol=2e-6)
    assert found.camera == CAMERA and np.nanmax(found.sigma) == 0


def test_white_facing_the_camera_at_one_metre_is_one_and_light_falls_with_distance_squared_and_cosine():
    tilted = np.broadcast_to(np.float32([0, 0.6, 0.8]), (SIZE, SIZE, 3))
    ways = np.stack([-X, Y, np.ones_like(X)], -1) / LENGTH[..., None]
    white = np.ones((SIZE, SIZE, 3))
    near, far = (amplitude(white, tilted, wall(z), CAMERA, 3) for z in (1.0, 2.5))
    np.testing.assert_allclose(near, np.maximum(ways @ [0, 0.6, 0.8], 0) / LENGTH**2, rtol=1e-5)
    np.testing.assert_allclose(far, near / 6.25, rtol=1e-5)
    middle = amplitude(white[:1, :1], toward_camera()[:1, :1], wall()[:1, :1], (60, 60, 0, 0), 3)
    assert middle.item() == pytest.approx(1.0, rel=1e-6)
    assert np.isnan(amplitude(white, tilted, wall() * np.nan, CAMERA, 3)).all()


def test_gloss_adds_the_closed_form_of_the_renderers_lobe_seen_along_the_light():
    # n = v = l: D = 1 / (pi alpha^2), G = 1, F = 0.05 + 0.95 * 2^-12.53789; pi D F / 4 beside the matte 1
    shiny = amplitude(np.ones((1, 1, 3)), toward_camera()[:1, :1], wall()[:1, :1], (60, 60, 0, 0), 3, np.full((1, 1), 0.5))
    assert shiny.item() == pytest.approx(1 + (0.05 + 0.95 * 2**-12.53789) / (4 * 0.5**4), rel=1e-5)


def test_infrared_follows_color_but_is_not_luminance():
    colors = np.random.default_rng(0).random((50, 50, 3))
    luminance = colors @ [0.2126, 0.7152, 0.0722]
    seen = np.stack([infrared(colors, seed) for seed in range(40)])
    alike = [np.corrcoef(luminance.ravel(), s.ravel())[0, 1] for s in seen]
    assert 0.4 < np.mean(alike) < 0.9 and max(alike) < 0.99
    assert seen.min() >= 0 and seen.max() <= 1 and np.std(seen, axis=0).mean() > 0.05
    black = np.array([infrared(np.full((1, 1, 3), 0.03), seed).item() for seed in range(200)])
    assert (black < 0.1).mean() > 0.3 and (black > 0.25).mean() > 0.05
    step = np.abs(infrared(colors + 1e-3, 0) - infrared(colors, 0))
    assert step.max() < 0.05  # smooth


def test_the_scatter_of_many_frames_is_the_sigma_that_is_reported():
    ramp = np.geomspace(0.02, 10, SIZE * SIZE).reshape(SIZE, SIZE).astype(np.float32)
    sensor = replace(TRUTH, jitter_metres=0.0008, shot_metres=0.002, background_metres=0.0005)
    rng = generator()
    frames = [sensed(wall(2.0), ramp, toward_camera(), CAMERA, rng, sensor) for _ in range(200)]
    scatter = np.std([f.metres - 2.0 for f in frames], axis=0, ddof=1)
    along_ray = np.sqrt(0.0008**2 + 0.002**2 / ramp + (0.0005 / ramp) ** 2)
    np.testing.assert_allclose(frames[0].sigma, along_ray / LENGTH, rtol=1e-4)
    # the standard deviation of 200 draws is known to 5 %, its mean over 4096 pixels to 0.08 %
    assert np.mean(scatter / frames[0].sigma) == pytest.approx(1 - 1 / (4 * 199), abs=0.004)
    assert np.abs(np.mean([f.metres for f in frames], axis=0) - 2.0).max() < 5 * frames[0].sigma.max() / np.sqrt(200)


@pytest.mark.parametrize("depth", [wall(), (1.2 / (1 - 0.8 * X)).astype(np.float32)], ids=["facing", "slanted"])
def test_a_flat_wall_has_no_flying_pixels(depth):
    light = np.full((SIZE, SIZE), 0.5, np.float32)
    found = sensed(depth, light, toward_camera(), CAMERA, generator(), replace(TRUTH, footprint_pixels=0.7))
    inside = np.s_[3:-3, 3:-3]
    # on the slant a pixel's mean differs from its middle by half the curvature of depth times the footprint's variance
    np.testing.assert_allclose(found.metres[inside], depth[inside], rtol=4e-4)


def test_a_step_gives_depths_in_between_and_only_at_the_step():
    depth = wall(1.0)
    depth[:, 32:] = 1.3
    light = np.where(depth > 1.1, 0.4, 1.0).astype(np.float32)
    found = sensed(depth, light, toward_camera(), CAMERA, generator(), replace(TRUTH, footprint_pixels=0.5))
    between = (found.metres > 1.02) & (found.metres < 1.28)
    assert between[:, 31:33].any(1).all() and not np.delete(between, [30, 31, 32, 33], 1).any()
    # the row through the middle: two phasors weighed by the taps 1, e^2, 1 of the footprint
    tap = 1 / (2 + np.exp(2))
    turn = np.exp(4j * np.pi * 80e6 / LIGHT * np.array([1.0, 1.3]) * LENGTH[32, 32])
    mixed = (1 - tap) * 0.4 * turn[1] + tap * 1.0 * turn[0]
    expected = np.angle(mixed / turn[1]) / (4 * np.pi * 80e6 / LIGHT) / LENGTH[32, 32] + 1.3
    assert found.metres[32, 32] == pytest.approx(expected, abs=2e-4)
    assert found.amplitude[32, 32] == pytest.approx(abs(mixed), rel=1e-3)
    given_up = sensed(depth, light, toward_camera(), CAMERA, generator(), replace(TRUTH, footprint_pixels=0.5, spread_most=0.02))
    assert np.isnan(given_up.metres[:, 31:33]).any(1).all() and np.isfinite(np.delete(given_up.metres, [31, 32], 1)).all()


def test_a_corner_looks_farther_away_by_what_every_pixel_sends_to_every_other():
    depth, normal, light = corner()
    found = sensed(depth, light, normal, CAMERA, generator(), replace(TRUTH, multipath=1.0))
    points = (np.stack([X, -Y, -np.ones_like(X)], -1) * depth[..., None]).reshape(-1, 3).astype(float)
    normals, k = normal.reshape(-1, 3).astype(float), 4 * np.pi * 80e6 / LIGHT
    reach = np.linalg.norm(points, axis=1)
    cosine = -(points * normals).sum(1) / reach
    area = reach**2 / cosine / (60 * 60 * LENGTH.ravel() ** 3)
    for column in (4, 14, 22):
        i = 32 * SIZE + column
        way = points - points[i]
        apart = np.linalg.norm(way, axis=1) + 1e-9
        form = np.maximum(way @ normals[i], 0) * np.maximum(-(way * normals).sum(1), 0) / (np.pi * apart**4) * area
        more = (0.8 * light.ravel() * form * np.exp(0.5j * k * (reach + apart - reach[i]))).sum()
        expected = np.angle(light.ravel()[i] + more) / k / LENGTH.ravel()[i]
        assert expected > 0.01
        assert found.metres[32, column] - depth[32, column] == pytest.approx(expected, rel=0.1)
    flat = sensed(wall(), light, toward_camera(), CAMERA, generator(), replace(TRUTH, multipath=1.0))
    np.testing.assert_allclose(flat.metres, 1.0, rtol=1e-5)  # a plane sends itself nothing


def test_unknown_background_does_not_silence_what_is_in_front_of_it():
    depth, normal, light = corner()
    outside = np.hypot(X, Y) > 0.3
    for values in (depth, normal, light):
        values[outside] = np.nan
    found = sensed(depth, light, normal, CAMERA, generator())
    assert np.isfinite(found.metres[~outside]).all() and np.isnan(found.metres[outside]).all()


def test_there_is_no_answer_where_it_is_black_grazing_or_too_bright():
    light, normal = np.full((SIZE, SIZE), 0.5, np.float32), np.array(toward_camera())
    light[:20, :20], light[:20, 40:] = 0.005, 40
    way = np.stack([-X, Y, np.ones_like(X)], -1) / LENGTH[..., None]
    along = np.stack([way[..., 2], 0 * X, -way[..., 0]], -1) / np.hypot(way[..., 0], way[..., 2])[..., None]
    leaning = lambda cosine: cosine * way + np.sqrt(1 - cosine**2) * along
    normal[40:, :20], normal[40:, 40:60] = leaning(0.07)[40:, :20], leaning(0.09)[40:, 40:60]  # the limit is 0.08
    hole = np.zeros((SIZE, SIZE), bool)
    hole[:20, :20] = hole[:20, 40:] = hole[40:, :20] = True
    found = sensed(wall(), light, normal, CAMERA, generator(), replace(Sensor(), footprint_pixels=0.0, multipath=0.0))
    missing = np.isnan(found.metres)
    assert np.array_equal(missing, hole) and np.array_equal(np.isnan(found.sigma), missing) and np.isfinite(found.amplitude).all()


def test_beyond_the_range_distances_start_again():
    light, sensor = np.ones((SIZE, SIZE), np.float32), replace(TRUTH, range_metres=1.87)
    found = sensed(wall(2.0), light, toward_camera(), CAMERA, generator(), sensor)
    np.testing.assert_allclose(found.metres, (2.0 * LENGTH % 1.87) / LENGTH, atol=1e-5)


def test_a_shift_moves_the_answer_right_and_down():
    depth = (1 + 0.3 * X + 0.2 * Y).astype(np.float32)
    sensor = replace(TRUTH, shift_pixels=(1.5, 4.0))
    found = sensed(depth, np.ones_like(depth), toward_camera(), (1e6, 1e6, 31.5, 31.5), generator(), sensor)
    inside = np.s_[6:-6, 6:-6]
    np.testing.assert_allclose(found.metres[inside], (depth - 0.3 * 1.5 / 60 - 0.2 * 4 / 60)[inside], rtol=1e-5)


def test_a_coarser_grid_keeps_the_place_of_a_point_in_space():
    depth = (1.2 / (1 - 0.3 * X)).astype(np.float32)  # the plane z = 1.2 + 0.3 x
    found = sensed(depth, np.ones_like(depth), toward_camera(), CAMERA, generator(), replace(TRUTH, reduce=4))
    assert found.metres.shape == (16, 16)
    fx, _, cx, _ = found.camera
    x = (np.arange(16) - cx) / fx * found.metres
    np.testing.assert_allclose(found.metres, 1.2 + 0.3 * x, rtol=5e-4)
    with pytest.raises(ValueError, match="64 x 64.*reduce = 5"):
        sensed(depth, np.ones_like(depth), toward_camera(), CAMERA, generator(), Sensor(reduce=5))


def test_the_same_generator_gives_the_same_answer_and_another_another():
    depth, light, normal = untidy()
    a, b = (sensed(depth, light, normal, CAMERA, np.random.default_rng(1)) for _ in range(2))
    c = sensed(depth, light, normal, CAMERA, np.random.default_rng(2))
    assert all(np.array_equal(p, q, equal_nan=True) for p, q in zip(a[:3], b[:3]))
    assert not np.array_equal(a.metres, c.metres, equal_nan=True)


def test_the_papers_noise_has_the_spread_of_blurred_noise_and_keeps_what_is_unknown():
    size = 256
    depth = np.full((size, size), 3.0, np.float32)
    depth[0, 0], depth[:, 200:] = 1.0, np.nan  # a span of two metres
    found = paper_noise(depth, generator())
    assert np.array_equal(np.isnan(found), np.isnan(depth))
    inside = found[8:, 8:192]
    # a Gaussian blur of one pixel leaves 1 / (2 sqrt(pi)) of white noise; about 250 x 180 / 12 values are independent
    assert inside.std() == pytest.approx(2.0 * 6.25e-2 / (2 * np.sqrt(np.pi)), rel=0.05)
    assert inside.mean() == pytest.approx(3.0, abs=0.003)
    assert 0.5 < np.corrcoef(inside[:, 1:].ravel(), inside[:, :-1].ravel())[0, 1] < 0.95  # exp(-1/4) for neighbours
