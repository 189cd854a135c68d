"""What the reconstruction row claims: `pytest models/reconstruction`."""

import argparse
import os

import numpy as np
import pytest

os.environ.setdefault("DRJIT_LIBLLVM_PATH", "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1")
mi = pytest.importorskip("mitsuba")
pytest.importorskip("pymeshlab")
mi.set_variant("llvm_ad_rgb")

from ..render.tracer import Camera, Lamp, Tracer  # noqa: E402
from .scene import meshed  # noqa: E402
from .tracing import traced  # noqa: E402

SIZE, FOCAL = 48, 50.0
ASKED = argparse.Namespace(direct_side=3, indirect_side=1, bounces=1)


def answered(depth, light):
    """Picture and shadow of matte grey surfaces with the normals of a wall that faces the camera."""
    surface = {"albedo": np.full((SIZE, SIZE, 3), 0.5, np.float32), "roughness": np.ones((SIZE, SIZE), np.float32)}
    surface["normal"] = np.broadcast_to(np.float32([0, 0, 1]), (SIZE, SIZE, 3))
    scene = meshed(depth, surface, FOCAL, (SIZE - 1) / 2)
    camera = Camera(SIZE, 2 * np.degrees(np.arctan(SIZE / 2 / FOCAL)))
    lamp = Lamp(np.array(light) / np.linalg.norm(light) * [1, -1, -1], False)
    pictures, shadows = traced(Tracer(scene), camera, [lamp], ASKED)
    return pictures[0], shadows[0]


def test_a_wall_comes_back_whole_and_as_bright_as_its_albedo_and_cosine():
    picture, lit = answered(np.full((SIZE, SIZE), 1.0, np.float32), [0, 0.6, 0.8])
    inner = picture[2:-2, 2:-2]
    assert np.isfinite(inner).all() and lit.all()
    np.testing.assert_allclose(inner, 0.5 * 0.8, atol=0.02)  # and the gloss of roughness 1


def test_a_slab_before_the_wall_shades_it_and_what_is_unknown_stays_unknown():
    depth = np.full((SIZE, SIZE), 1.0, np.float32)
    depth[18:30, 18:30] = 0.8
    depth[:6] = np.nan
    picture, lit = answered(depth, [1, 0, 1])
    assert np.isnan(picture[:5]).all()
    assert not lit[20:28, 10:14].any() and lit[20:28, 34:44].all()  # the lamp is on the right
    assert lit[20:28, 20:28].all()
