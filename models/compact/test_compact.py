"""What training takes for granted."""

import json
import struct

import numpy as np
import torch

from .lessons import Lessons
from .networks import LightNet, SurfacesNet, parameters
from .tasks import TASKS, shaded

SIDE = 64


def lesson(folder, seed):
    """A made-up capture under two lamps, as `capturectl lessons` writes it."""
    dice, kinds = np.random.default_rng(seed), {np.dtype("f2"): "F16", np.dtype("f4"): "F32", np.dtype("u1"): "U8"}
    plane = lambda *shape: dice.random((*shape, SIDE, SIDE)).astype(np.float16)
    share = lambda: dice.integers(256, size=(2, SIDE, SIDE), dtype=np.uint8)
    found = {"sight": plane(16), "ground": plane(7), "albedo": plane(1, 3), "toward": dice.random((2, 3)).astype(np.float32)}
    found |= {name: share() for name in ("seen", "thin", "thick", "truth.shadow")}
    found["view"] = plane(3)
    found |= {name: plane(2, 3) for name in ("closed", "direct", "truth.relit")}
    found |= {"truth.albedo": plane(1, 3), "truth.normal": plane(1, 3), "truth.roughness": plane(1), "truth.depth": plane(1)}
    header, at = {}, 0
    for name, array in found.items():
        header[name] = {"dtype": kinds[array.dtype], "shape": list(array.shape), "data_offsets": [at, at + array.nbytes]}
        at += array.nbytes
    text = json.dumps(header).encode()
    content = struct.pack("<Q", len(text)) + text + b"".join(array.tobytes() for array in found.values())
    (folder / f"{seed:04}.safetensors").write_bytes(content)
    return found


def test_a_lesson_is_read_as_it_was_written(tmp_path):
    written = lesson(tmp_path, 3)
    one = Lessons([tmp_path], TASKS["light"].names).one(0, 1, (8, 4, 32), (0, 0))
    assert np.array_equal(one["closed"].numpy(), written["closed"][1][:, 8:40, 4:36].astype(np.float32))
    assert np.allclose(255 * one["seen"].numpy(), written["seen"][1][None, 8:40, 4:36])


def test_what_is_mirrored_is_lit_from_the_other_side(tmp_path):
    lesson(tmp_path, 4)
    lessons = Lessons([tmp_path], TASKS["light"].names)
    for mirror in ((1, 0), (0, 1), (1, 1)):
        both = [lessons.one(0, 0, (0, 0, SIDE), m) for m in ((0, 0), mirror)]
        plain, other = (TASKS["light"]().lamp({k: v[None] for k, v in one.items()})[0] for one in both)
        back = other.flip([2 - axis for axis, mirrored in enumerate(mirror) if mirrored])
        # Whatever is no direction is the same picture; n·l, plane 3, is one of it.
        same = [0, 1, 2, 3, 4, 5, 6, 12, 13, 14, 15, 16]
        assert torch.allclose(back[same], plain[same], atol=1e-5)
        for axis, mirrored in enumerate(mirror):
            sign = -1 if mirrored else 1
            assert torch.allclose(back[[7 + axis, 10 + axis]], sign * plain[[7 + axis, 10 + axis]])


def test_rows_and_columns_exchanged_are_lit_from_the_exchanged_side(tmp_path):
    lesson(tmp_path, 4)
    lessons = Lessons([tmp_path], TASKS["light"].names)
    both = [lessons.one(0, 0, (0, 0, SIDE), (0, 0), turned) for turned in (False, True)]
    plain, other = (TASKS["light"]().lamp({k: v[None] for k, v in one.items()})[0] for one in both)
    back = other.transpose(1, 2)
    same = [0, 1, 2, 3, 4, 5, 6, 9, 12, 13, 14, 15, 16]
    assert torch.allclose(back[same], plain[same], atol=1e-5)
    assert torch.allclose(back[[7, 8, 10, 11]], -plain[[8, 7, 11, 10]])


def test_an_untrained_network_leaves_the_closed_form_nearly_as_it_is(tmp_path):
    lesson(tmp_path, 5)
    # Roughness stays within [0.02, 0.98]; an eighth of a shadow is already the network's, or nothing would teach it.
    for name, most in (("surfaces", 0.01), ("light", 0.15)):
        task = TASKS[name]()
        batch = Lessons([tmp_path], task.names).batch(np.random.default_rng(1), 2, 32)
        after, before = task.errors(batch)[0], task.before(batch)
        for name in before:
            assert torch.isclose(after[name], before[name], rtol=most), name


def test_what_is_shipped_says_the_same():
    network, sight = SurfacesNet(), torch.rand(1, 16, 32, 32)
    torch.nn.init.normal_(network.head.weight)
    for one, other in zip(network.taught(sight)[:3], network.shipped()(sight), strict=True):
        assert torch.allclose(one, other, atol=1e-5)


def test_both_networks_together_are_small_and_answer_in_the_size_they_are_given():
    surfaces, light = SurfacesNet(), LightNet()
    assert parameters(surfaces) + parameters(light) < 1_000_000
    sizes = [tuple(said.shape) for said in surfaces.shipped()(torch.rand(1, 16, 48, 80))]
    assert sizes == [(1, c, 48, 80) for c in (3, 3, 1)]
    assert [tuple(said.shape) for said in light(torch.rand(1, 17, 64, 96))] == [(1, c, 64, 96) for c in (1, 1, 3)]


def test_what_is_shaded_is_matte_where_nothing_shines():
    toward_camera = torch.tensor([0.0, 0.0, 1.0])[None, :, None, None]
    for slope in (0.0, 0.5, 0.9):
        toward = torch.tensor([slope, 0.0, (1 - slope**2) ** 0.5])[None, :, None, None]
        rough, smooth = (shaded(toward_camera, torch.full((1, 3, 1, 1), 0.5), torch.full((1, 1, 1, 1), r), toward, toward_camera) for r in (1.0, 0.05))
        matte = 0.5 * toward[:, 2:]
        assert (rough > matte).all() and (rough < 1.1 * matte + 0.01).all(), slope
        # At the mirror's angle alone does a smooth surface shine.
        assert (smooth > 10).all() if slope == 0 else torch.allclose(smooth, matte.expand_as(smooth), atol=0.05), slope
