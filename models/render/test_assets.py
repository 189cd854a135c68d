"""What the packaged meshes and textures claim: `pytest models/render/test_assets.py`."""

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from . import assets
from .textures import SIZE

ABSENT = [p for p, root in assets.PACKAGES.items() if not Path(root).exists()]
needs_packages = pytest.mark.skipif(bool(ABSENT), reason=f"Debian packages not installed: {', '.join(ABSENT)}")
NUMBERS = [0, 7, 18, 29, 123_456, 10_000_003]


def read_from(folder, monkeypatch):
    monkeypatch.setitem(assets.PACKAGES, "hand-made", str(folder))
    return lambda name: f"hand-made:{name}"


def test_pools_share_no_file_and_are_as_large_as_promised():
    kinds = ("shapes", "textures")
    named = {(kind, pool): [row[0] for row in assets.vetted(kind, pool)] for kind in kinds for pool in assets.POOLS}
    for kind in kinds:
        assert not set(named[kind, "train"]) & set(named[kind, "other"])
    assert len(named["shapes", "train"]) >= 60 and len(named["shapes", "other"]) >= 50
    assert len(named["textures", "train"]) >= 150 and len(named["textures", "other"]) >= 100


def test_numbers_of_training_validation_and_test_share_no_file_nor_its_variants():
    for kind in ("shapes", "textures"):
        rows = [{row[0] for row in assets.vetted(kind, "train", digit)} for digit in (None, 8, 9)]
        assert all(len(r) >= 20 for r in rows)
        assert not rows[0] & rows[1] and not rows[0] & rows[2] and not rows[1] & rows[2]
    assert assets.split("x:types/cliff_01.png.cached.dds") == assets.split("x:types/india/cliff_2.dds.cached.dds")


@needs_packages
def test_meshes_of_the_two_pools_differ_in_their_bytes():
    hashes = [{hash(assets.content(row[0])) for row in assets.vetted("shapes", pool)} for pool in assets.POOLS]
    assert not hashes[0] & hashes[1]


@needs_packages
@pytest.mark.parametrize("pool", assets.POOLS)
def test_a_mesh_is_centred_of_size_one_and_made_of_triangles_with_area(pool):
    for number in NUMBERS:
        family, vertices, faces = assets.packaged_shape(number, pool)
        assert family.split()[0] in ("sweethome3d", "redeclipse")
        assert 40 <= len(faces) <= 60_000 and faces.min() >= 0 and faces.max() < len(vertices)
        used = vertices[faces.ravel()]
        # a face without area may have been the outermost: what is left is within the box, and nearly fills it
        assert np.abs(used.min(0) + used.max(0)).max() < 2e-2 and np.ptp(used, axis=0).max() == pytest.approx(1, abs=2e-2)
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-10).all()


@needs_packages
@pytest.mark.parametrize("pool", assets.POOLS)
def test_a_texture_keeps_the_ranges_of_the_procedural_ones(pool):
    for number in NUMBERS:
        tile = assets.packaged_texture(number, pool)
        assert tile.shape == (SIZE, SIZE, 6) and tile.dtype == np.float32 and np.isfinite(tile).all()
        for channels, low, high in ((tile[..., :3], 0.01, 0.95), (tile[..., 3], 0.08, 1.0), (tile[..., 4:], -1.0, 1.0)):
            assert channels.min() >= np.float32(low) and channels.max() <= np.float32(high)
        assert tile[..., :3].std() > 1e-3


@needs_packages
def test_a_number_means_one_thing():
    for pool in assets.POOLS:
        assert np.array_equal(assets.packaged_texture(41, pool), assets.packaged_texture(41, pool))
        one, two = assets.packaged_shape(41, pool), assets.packaged_shape(41, pool)
        assert one[0] == two[0] and np.array_equal(one[1], two[1]) and np.array_equal(one[2], two[2])
        assert not np.array_equal(assets.packaged_texture(41, pool), assets.packaged_texture(42, pool))


@needs_packages
def test_other_textures_vary_in_roughness_within_one_tile():
    spread = lambda pool: np.median([np.log(assets.packaged_texture(n, pool)[..., 3]).std() for n in range(0, 120, 10)])
    assert spread("other") > 3 * spread("train")


@needs_packages
def test_relief_rises_where_height_maps_shipped_beside_it_rise():
    """0 A.D. keeps heights in the alpha of its normal maps, Red Eclipse in pictures of their own."""
    wrong = []
    for albedo, normal, _, green in assets.vetted("textures", "train") + assets.vetted("textures", "other"):
        folder = albedo.rsplit("/", 1)[0]
        if normal and albedo.startswith("0ad"):
            whole = np.asarray(Image.open(io.BytesIO(assets.content(f"{folder}/{normal}"))).convert("RGBA"))
            whole = cv2.resize(whole, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
            normals, height = whole[..., :3], whole[..., 3]
        elif "/wicked" in albedo or ":wicked" in albedo:
            beside = f"{folder}/{normal}".replace("n.jpg", "z.jpg")
            try:
                height = cv2.imdecode(np.frombuffer(assets.content(beside), np.uint8), cv2.IMREAD_GRAYSCALE)
            except assets.AssetsMissing:
                continue
            normals = assets.picture(f"{folder}/{normal}")
        else:
            continue
        if height.std() < 5 or height.shape != normals.shape[:2]:
            continue
        smooth = lambda field: cv2.GaussianBlur(field.astype(np.float32), (0, 0), 1.5)
        rise = np.gradient(smooth(height))[::-1]
        found = assets.slopes(normals, green)
        likeness = [np.corrcoef(rise[k].ravel(), smooth(found[..., k]).ravel())[0, 1] for k in range(2)]
        wrong.append(min(likeness) <= 0)
    assert len(wrong) > 100
    assert np.mean(wrong) < 0.05  # heights drawn apart from the normals exist


def test_slopes_and_window_keep_a_known_relief_however_it_is_turned():
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    height = 40 * np.sin(2 * np.pi * x) * np.cos(3 * np.pi * y + 0.4)
    sy, sx = np.gradient(height)
    normal = np.stack([-sx, -sy, np.ones_like(sx)], -1)  # y down the picture: green is DirectX's
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    encoded = np.round((normal + 1) * 127.5).astype(np.uint8)
    for bits in range(8):
        turn = np.array([bits & 1, bits & 2, bits & 4], bool)
        window = lambda image: assets._window(image, 1.0, [0.0, 0.0], turn)
        got = assets._turned(assets.slopes(window(encoded), -1), turn)
        expected = np.stack(np.gradient(window(height.astype(np.float32)))[::-1], -1)
        inner = slice(2, -2)
        assert np.abs(got - expected)[inner, inner].max() < 0.03  # bytes: 1/127 in each of two components, and their ratio


def test_an_obj_file_is_triangulated_turned_upright_and_cleaned(tmp_path, monkeypatch):
    lines = ["v 0 0 0", "v 2 0 0", "v 2 4 0", "v 0 4 0", "v 1 1 -1",
             "f 1/1 2/2 3/3 4/4", "f -5 -4 -1", "f 1 1 2", "f 5 2 1"]  # a quad; back-counted; without area; the second's back
    (tmp_path / "hand.obj").write_text("\n".join(lines))
    vertices, faces = assets.mesh(read_from(tmp_path, monkeypatch)("hand.obj"))
    assert len(faces) == 3 and len(vertices) == 5
    # height 4 becomes z from -1/2 to 1/2; depth -1 becomes y: 1/4 of the height, the front on the smaller y
    assert np.allclose(np.ptp(vertices, axis=0), [0.5, 0.25, 1.0], atol=1e-6)
    tip = vertices[np.abs(vertices - [0, 0.125, -0.25]).max(1) < 1e-5]
    assert len(tip) == 1


@needs_packages
def test_a_smaller_level_of_a_dds_file_is_the_whole_picture():
    place = next(r[0] for r in assets.vetted("textures", "train") if assets.content(r[0])[12:20] == b"\0\x08\0\0" * 2)
    whole = np.asarray(Image.open(io.BytesIO(assets.content(place))).convert("RGB"))
    level = assets.picture(place)
    assert whole.shape[0] == 2048 and level.shape == (1024, 1024, 3)
    shrunk = cv2.resize(whole, (64, 64), interpolation=cv2.INTER_AREA).astype(float)
    assert np.abs(cv2.resize(level, (64, 64), interpolation=cv2.INTER_AREA) - shrunk).mean() < 3


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(assets.PACKAGES, "sweethome3d-furniture", "/nonexistent")
    with pytest.raises(assets.AssetsMissing, match="apt-get install sweethome3d-furniture"):
        assets.packaged_shape(0, "train")
