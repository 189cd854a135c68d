"""What the renderer claims, checked against forms written down separately: `pytest models/render`."""

import os
import tomllib

import cv2
import numpy as np
import pytest

os.environ.setdefault("DRJIT_LIBLLVM_PATH", "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1")
mi = pytest.importorskip("mitsuba")
mi.set_variant("llvm_ad_rgb")

import drjit as dr  # noqa: E402

dr.set_thread_count(1)

from . import tracer as tr  # noqa: E402
from .capture_folder import rendered, write  # noqa: E402
from . import shards  # noqa: E402
from .contact_sheet import exr  # noqa: E402
from .pack import folder_arrays  # noqa: E402
from .scene import FLIP, Scene, scene  # noqa: E402
from .textures import SIZE  # noqa: E402

FLOATS = 2e-3  # relative: float32 through a dozen operations of a peaked function


def plane_scene(albedo, rough, z=1.0, tilt=0.0, half=50.0, extra=None):
    """A uniform plane through (0, 0, z), its normal tilted from the camera's axis about y."""
    c, s = np.cos(tilt), np.sin(tilt)
    a, b, n = np.array([c, 0, s]), np.array([0, 1.0, 0]), np.array([s, 0, -c])
    at = lambda i, j: np.array([0, 0, z]) + half * (i * a + j * b)
    corners = np.array([[at(-1, -1), at(1, -1), at(1, 1)], [at(-1, -1), at(1, 1), at(-1, 1)]])
    if extra is not None:
        corners = np.concatenate([corners, extra])
        ns = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.repeat((ns / np.linalg.norm(ns, axis=1, keepdims=True))[:, None], 3, 1)
    else:
        normals = np.broadcast_to(n, corners.shape)
    tile = np.zeros((1, SIZE, SIZE, 6), np.float32)
    tile[..., :3], tile[..., 3] = albedo, rough
    return Scene(corners, normals, np.zeros((len(corners), 3, 2)), np.zeros(len(corners), int), tile, 50.0,
                 np.zeros((0, 3)), np.zeros(3), {}, {}), n


def karis(n, v, l, albedo, rough):
    """The closed forms in float64 numpy: irradiance pi, so a facing white Lambertian gives 1."""
    h = (v + l) / np.linalg.norm(v + l, axis=-1, keepdims=True)
    dot = lambda a, b: np.sum(a * b, -1)
    nl, nv, nh, vh = dot(n, l), dot(n, v), dot(n, h), dot(v, h)
    alpha, k = rough**2, (rough + 1) ** 2 / 8
    d = alpha**2 / (np.pi * (nh**2 * (alpha**2 - 1) + 1) ** 2)
    g = (nl / (nl * (1 - k) + k)) * (nv / (nv * (1 - k) + k))
    f = 0.05 + 0.95 * 2 ** ((-5.55473 * vh - 6.98316) * vh)
    return (albedo / np.pi + d * f * g / (4 * nl * nv)) * nl * np.pi


@pytest.mark.parametrize("rough", [0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("light", [(0, 0, 1), (0.5, 0.3, 0.8), (-0.9, 0.2, 0.3)])
def test_a_plane_under_a_directional_lamp_is_the_closed_form(rough, light):
    light = np.array(light) / np.linalg.norm(light)
    made, n = plane_scene(0.4, rough, tilt=0.3)
    camera = tr.Camera(32, 50.0)
    t, lamp = tr.Tracer(made), tr.Lamp(light * FLIP, False)
    image = tr.direct(t, camera, [lamp], 1, np.random.default_rng(0))[0][0]
    y, x = np.mgrid[:32, :32]
    v = -np.stack([(x - camera.c) / camera.f, (y - camera.c) / camera.f, np.ones((32, 32))], -1)
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    wanted = karis(n, v, light * FLIP, 0.4, rough)
    assert wanted.min() > 0.005
    np.testing.assert_allclose(image[..., 0], wanted, rtol=FLOATS)


def test_a_white_matte_patch_facing_the_flash_at_one_metre_is_one():
    # what is left of the microfacet term at roughness 1 is known in closed form too
    made, n = plane_scene(1.0, 1.0)
    camera, t = tr.Camera(33, 50.0), tr.Tracer(made)
    image = tr.direct(t, camera, [tr.Lamp([0, 0, 0], True)], 1, np.random.default_rng(0))[0][0]
    v = np.array([0, 0, -1.0])
    np.testing.assert_allclose(image[16, 16], 1.0 + karis(n, v, v, 0.0, 1.0), rtol=FLOATS)
    assert image[16, 16, 0] < 1.02


def test_a_plane_alone_has_no_indirect_light():
    made, _ = plane_scene(0.9, 0.5)
    more, _ = tr.indirect(tr.Tracer(made), tr.Camera(16, 50.0), [tr.Lamp([0, 0, -1], False)], 2, 3, np.random.default_rng(0))
    assert more[0].max() == 0


def test_indirect_light_in_a_corner_agrees_with_mitsubas_own_path_tracer():
    # matte only (the microfacet term is ours alone): subtracting it isolates Lambert on both sides
    wall = np.array([[[-1, -1, 1.5], [-1, 1, 1.5], [-1, 1, 0.2]], [[-1, -1, 1.5], [-1, 1, 0.2], [-1, -1, 0.2]]]) * [0.4, 3, 1]
    made, _ = plane_scene(0.8, 1.0, z=1.5, half=3.0, extra=wall)
    light = np.array([0.7, 0.1, 0.7]) / np.linalg.norm([0.7, 0.1, 0.7])
    camera, t, lamp = tr.Camera(16, 50.0), tr.Tracer(made), tr.Lamp(light * FLIP, False)
    keep, tr.specular = tr.specular, lambda n, v, l, rough: 0.0
    try:
        rng = np.random.default_rng(1)
        ours = tr.direct(t, camera, [lamp], 8, rng)[0][0] + tr.indirect(t, camera, [lamp], 24, 2, rng)[0][0]
    finally:
        tr.specular = keep
    material = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.8}}}
    mesh = mi.Mesh("m", 3 * len(made.corners), len(made.corners), props=_with(material))
    p = mi.traverse(mesh)
    p["vertex_positions"], p["faces"] = mi.Float(made.corners.astype(np.float32).ravel()), dr.arange(mi.UInt32, 3 * len(made.corners))
    p.update()
    reference = mi.load_dict({
        "type": "scene", "mesh": mesh, "integrator": {"type": "path", "max_depth": 4, "rr_depth": 100},
        "sun": {"type": "directional", "direction": list(-light * FLIP), "irradiance": {"type": "rgb", "value": np.pi}},
        "sensor": {"type": "perspective", "fov": 50.0, "near_clip": 0.001, "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, -1, 0]),
                   "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}, "pixel_format": "rgb"}},
    })
    theirs = np.array(mi.render(reference, spp=1024, seed=3))
    assert np.mean(theirs) > 0.2
    np.testing.assert_allclose(ours.mean(), theirs.mean(), rtol=0.01)  # Monte Carlo noise of the mean, some 0.3 %
    assert np.mean((ours - theirs) ** 2) < 2e-3  # pixels cut by the wall's edge are sampled differently


def _with(material):
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(material)
    return properties


def test_the_second_bounce_of_a_white_furnace_keeps_its_energy():
    # under a uniform sky a matte plane of albedo a, seen over one bounce, has radiance a times the sky (plus its gloss)
    made, _ = plane_scene(0.5, 1.0, half=1e3)
    sky = {"up": np.array([0, 0, -1.0]), "sky": np.ones(3), "ground": np.ones(3)}
    keep, tr.specular = tr.specular, lambda n, v, l, rough: 0.0
    try:
        _, seen = tr.indirect(tr.Tracer(made), tr.Camera(16, 30.0), [], 16, 1, np.random.default_rng(0), sky)
    finally:
        tr.specular = keep
    np.testing.assert_allclose(seen.mean(), 0.5, rtol=0.01)


def test_a_box_in_front_of_a_wall_casts_its_shadow_away_from_the_lamp():
    square = np.array([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]]) * 0.1 + [0, 0, 1.0]
    made, _ = plane_scene(0.5, 1.0, z=1.5, extra=square)
    camera, t = tr.Camera(64, 50.0), tr.Tracer(made)
    for light, dark, bright in [((1, 0, 1), (32, 12), (32, 52)), ((0, 1, 1), (52, 32), (12, 32))]:
        lamp = tr.Lamp(np.array(light) / np.sqrt(2) * FLIP, False)
        h = t.hit(mi.Point3f(0), camera.rays(1, np.random.default_rng(0)))
        seen = t.visible(h, lamp).numpy().reshape(64, 64)
        rows, columns = np.nonzero(~seen)
        assert len(rows) > 20
        centre = np.array([rows.mean(), columns.mean()])
        assert np.linalg.norm(centre - dark) < np.linalg.norm(centre - bright)


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_relief_tilts_the_normal_by_its_slope_and_mirrors_with_the_tile(offset):
    # a height that grows with u, and u with the picture's x: the surface leans toward -x; mirrored tiles lean back
    made, _ = plane_scene(0.5, 1.0)
    made.tiles[..., 4] = 0.5
    made.uv = made.corners[..., :2] / 100 + 0.5 + offset
    t, camera = tr.Tracer(made), tr.Camera(8, 20.0)
    h = t.hit(mi.Point3f(0), camera.rays(1, np.random.default_rng(0)))
    wanted = np.array([-0.5 * (1 if offset == 0 else -1), 0, -1]) / np.sqrt(1.25)
    np.testing.assert_allclose(camera.image(h.ns, 1), np.broadcast_to(wanted, (8, 8, 3)), atol=1e-5)


def white_plane():
    """A white matte plane, squarely at two metres, smaller than the picture, in a lit room: every expected number is known."""
    made, _ = plane_scene(1.0, 1.0, z=2.0, half=0.5)
    made.lights, made.facts = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]), {"seed": 1, "index": 0}
    made.ambient = {"share": 0.5, "up": np.array([0, -1.0, 0]), "sky": np.ones(3), "ground": np.ones(3), "lamps": []}
    return made


GLOSS = 1.02  # what the microfacet term may add at roughness 1


def test_a_written_folder_holds_what_its_files_say(tmp_path):
    made = white_plane()
    write(made, rendered(made, 32, 2, 2, 1, with_ambient=True), tmp_path / "0000", 32)
    assert [p.name for p in tmp_path.iterdir()] == ["0000"]
    folder, truth = tmp_path / "0000", tmp_path / "0000" / "truth"
    capture = tomllib.loads((folder / "capture.toml").read_text())
    assert capture["color"]["cx"] == 15.5 and abs(capture["color"]["fx"] - 16 / np.tan(np.radians(25))) < 1e-4
    depth, mask = exr(folder / "depth.exr"), cv2.imread(str(folder / "mask.png"), 0)
    assert depth[16, 16] == pytest.approx(2.0, rel=1e-5) and np.isnan(depth[0, 0])
    assert np.array_equal(np.isfinite(depth), mask > 0)
    np.testing.assert_allclose(exr(truth / "normal.exr")[16, 16], [0, 0, 1], atol=1e-6)
    flash = (exr(folder / "flash.exr") - exr(folder / "ambient.exr"))[16, 16]
    assert 1 <= flash[0] * 2.0**2 / capture["flash"]["intensity"] <= GLOSS
    assert 1 <= exr(folder / "amplitude.exr")[16, 16] * 2.0**2 <= GLOSS
    for light in tomllib.loads((truth / "lights.toml").read_text())["light"]:
        assert light["direction"][2] <= exr(truth / light["image"])[16, 16, 0] <= light["direction"][2] + 0.03
        assert (cv2.imread(str(truth / light["shadow"]), 0) == 255).all()


@pytest.mark.parametrize("noise", ["paper", "tof"])
def test_noise_is_in_the_depth_and_never_in_the_truth(tmp_path, noise):
    write(white_plane(), rendered(white_plane(), 32, 1, 1, 0), tmp_path / "0", 32, noise)
    depth, truth = exr(tmp_path / "0" / "depth.exr"), exr(tmp_path / "0" / "truth" / "depth.exr")
    np.testing.assert_allclose(truth[truth > 0], 2.0, rtol=1e-5)
    # the paper's noise is a share of the scene's extent, and a plane has none
    assert np.nanstd(depth) < 1e-4 if noise == "paper" else 1e-4 < np.nanstd(depth) < 0.02


def test_a_map_lights_a_white_plane_with_its_mean(tmp_path):
    made = white_plane()
    channels = rendered(made, 32, 3, 2, 1, environments=1)
    write(made, channels, tmp_path / "0", 32)
    (pixels, picture), truth = channels["environments"][0], tmp_path / "0" / "truth"
    assert pixels.shape[1] == 2 * pixels.shape[0] and (truth / "environment_000.hdr").exists()
    np.testing.assert_array_equal(exr(truth / "environment_000.exr"), picture)
    # what reaches a plane that faces the camera: the half in front, weighted by the cosine
    y, x = (np.mgrid[: len(pixels), : 2 * len(pixels)] + 0.5) * np.pi / len(pixels)
    cosine = np.sin(y) * np.cos(x)  # the map's middle is what the camera looks at, so the light comes from its edges
    weight = np.where(cosine > 0, cosine, 0) * np.sin(y)
    wanted = (pixels * weight[..., None]).sum((0, 1)) / weight.sum()
    np.testing.assert_allclose(picture[14:18, 14:18].mean((0, 1)), wanted, rtol=0.06)  # gloss and noise


def test_a_shard_holds_what_its_scenes_hold(tmp_path):
    made = white_plane()
    channels = rendered(made, 32, 2, 2, 1, with_ambient=True)
    kept = shards.arrays(made, channels)
    shards.write([kept, kept], tmp_path / "0000-0001")
    assert [p.name for p in tmp_path.iterdir()] == ["0000-0001"]
    found = {p.stem: np.load(p) for p in (tmp_path / "0000-0001").glob("*.npy")}
    assert found["relit"].shape == (2, 2, 3, 32, 32) and found["shadow"].shape == (2, 2, 1, 32, 32)
    assert found["depth"][1, 0, 16, 16] == pytest.approx(2.0, rel=1e-5) and np.isnan(found["depth"][1, 0, 0, 0])
    assert found["flash"][0, :, 0, 0].max() == 0 and found["albedo"][0, 0, 16, 16] == 1
    facing = found["flash"][0, 0, 16, 16] * 2.0**2 / found["intensity"][0]
    assert 0.999 <= facing <= GLOSS and 0.8 <= found["relit"][0, 1, 0, 16, 16] <= 0.83
    share = found["ambient"][0][:, 2:-2, 2:-2].mean() / found["flash"][0][:, 2:-2, 2:-2].mean()
    assert share == pytest.approx(0.5, rel=0.1)


def test_a_folder_packs_into_the_shard_its_scene_would_have_made(tmp_path):
    made = white_plane()
    channels = rendered(made, 32, 2, 2, 1, with_ambient=True)
    write(made, channels, tmp_path / "0000", 32)
    packed, straight = folder_arrays(tmp_path / "0000"), shards.arrays(made, channels)
    assert packed.keys() == straight.keys()
    for name in packed:
        assert packed[name].shape == np.shape(straight[name]), name
        np.testing.assert_allclose(packed[name], straight[name], rtol=1e-5, atol=1e-5, err_msg=name)


def test_splits_share_no_shape_and_no_texture():
    seen = {split: set() for split in ("train", "val", "test")}
    for split in seen:
        for index in range(2):
            facts = scene(split, index, 1, 8).facts
            seen[split] |= {o["shape"] for o in facts["objects"]} | set(facts["textures"])
    assert all(len(s) > 10 for s in seen.values())
    assert not (seen["train"] & seen["val"] or seen["train"] & seen["test"] or seen["val"] & seen["test"])


def test_a_scene_is_a_function_of_its_numbers():
    a, b = scene("val", 1, 5, 8), scene("val", 1, 5, 8)
    assert np.array_equal(a.corners, b.corners) and np.array_equal(a.tiles, b.tiles) and np.array_equal(a.lights, b.lights)


def test_lights_reach_large_angles_and_stay_in_the_hemisphere_toward_the_camera():
    z = np.concatenate([scene("val", i, 2, 12).lights[:, 2] for i in range(2)])
    assert z.min() >= np.cos(np.radians(80)) - 1e-9 and (z < np.cos(np.radians(60))).mean() > 0.2
