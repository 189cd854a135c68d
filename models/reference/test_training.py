"""Claims about how rendered shards become what the networks are fed, and about a run's course."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from . import feeding  # noqa: E402
from .checkpoint import Average, warmed  # noqa: E402
from .frames import basis  # noqa: E402
from .phases import Course, Phase, batches  # noqa: E402
from .scenes import FIVE, Scenes  # noqa: E402
from .stages import VARIANTS, stage  # noqa: E402
from .train import arguments, command, main  # noqa: E402

EVERYTHING = ("flash", "ambient", "intensity", "albedo", "normal", "roughness", "shadow", "relit")


def written(root, count=2, size=64, lights=6, relit=True, seed=0):
    """A shard of smooth random scenes, the top quarter of each without surface."""
    rng, folder = np.random.default_rng(seed), root / f"0000-{count - 1:04}"
    folder.mkdir(parents=True)
    smooth = lambda *shape: np.kron(rng.random((*shape, 4, 4)), np.ones((size // 4, size // 4)))
    depth = 1 + smooth(count, 1) + np.linspace(0, 1, size)
    depth[:, :, : size // 4] = np.nan
    known = np.isfinite(depth)
    normal = smooth(count, 3) - 0.5
    normal[:, 2] += 1
    light = rng.standard_normal((count, lights, 3))
    light[..., 2] = np.abs(light[..., 2])
    channels = {name: smooth(count, c) * known for name, c in (("flash", 3), ("ambient", 3), ("albedo", 3), ("roughness", 1))}
    channels = {name: picture.astype(np.float16) for name, picture in channels.items()}
    channels["normal"] = (normal / np.linalg.norm(normal, axis=1, keepdims=True) * known).astype(np.float16)
    channels["depth"] = depth.astype(np.float32)
    channels["light"] = (light / np.linalg.norm(light, axis=2, keepdims=True)).astype(np.float32)
    channels["shadow"] = np.uint8(255 * (smooth(count, lights, 1) > 0.3))
    channels["camera"] = np.tile(np.float32([size, size, size / 2 - 0.5, size / 2 - 0.5]), (count, 1))
    channels["intensity"] = np.full(count, 0.5, np.float32)
    if relit:
        channels["relit"] = smooth(count, lights, 3).astype(np.float16)
    for name, channel in channels.items():
        np.save(folder / f"{name}.npy", channel)
    return folder


def test_a_white_wall_facing_the_flash_is_fed_as_one_whatever_its_distance_and_exposure():
    for distance, intensity in ((0.5, 0.2), (2.0, 3.0)):
        depth = torch.full((1, 1, 8, 8), distance)
        depth[..., 0] = torch.nan
        flash = torch.full((1, 3, 8, 8), intensity / distance**2)
        fed = feeding.scaled(flash, torch.tensor([intensity]), depth)
        assert torch.allclose(fed[..., 1:], torch.ones(1, 3, 8, 7)) and fed[..., 0].abs().sum() == 0
        assert feeding.scaled(flash * 5, torch.tensor([intensity]), depth).max() == 2


def test_nearness_is_one_at_the_nearest_and_zero_at_the_farthest_and_where_nothing_is():
    depth = torch.tensor([[[[1.0, 2.0], [3.0, torch.nan]]]])
    assert torch.allclose(feeding.nearness(depth), torch.tensor([[[[1.0, 0.5], [0.0, 0.0]]]]))


def test_noise_on_depth_in_metres_is_the_papers_over_the_scenes_span():
    depth = torch.full((1, 1, 256, 256), 2.0)
    depth[..., 0, 0], depth[..., 0, 1] = 1.5, 3.5
    dirty = feeding.noisy_depth(depth, np.random.default_rng(2))[..., 8:, :]
    assert abs(float(dirty.std()) - 2.0 * 6.25e-2 * 0.2821) < 2e-3 and abs(float(dirty.mean()) - 2.0) < 2e-3


def test_shards_of_two_sizes_make_one_batch_and_cheap_ones_train_no_relighting(tmp_path):
    written(tmp_path / "large", size=64)
    written(tmp_path / "small", size=32, relit=False)
    roots = [tmp_path / "large", tmp_path / "small"]
    shadows = Scenes(roots, stage("shadow", "clean").needs)
    rows = shadows.samples(32)
    assert len(rows) == 2 * 2 * 6 and len(shadows.samples(64)) == 2 * 6
    assert shadows.batch(rows[[0, -1]], 32, np.random.default_rng(0))["cloud"].shape == (2, 3, 32, 32)
    assert len(Scenes(roots, stage("synthesis", "clean").needs).samples(32)) == 2 * 6
    with pytest.raises(SystemExit, match=r"\[32, 64\]"):
        shadows.samples(96)


def test_a_channel_that_is_missing_is_named(tmp_path):
    (written(tmp_path / "a") / "intensity.npy").unlink()
    with pytest.raises(SystemExit, match="intensity.npy"):
        Scenes([tmp_path / "a"], ("flash", "intensity"))
    with pytest.raises(SystemExit, match="no shards"):
        Scenes([tmp_path / "b"], ())


def test_reduced_and_cut_pictures_see_points_of_the_same_surface(tmp_path):
    folder = written(tmp_path / "a", count=1, size=64)
    y, x = np.mgrid[:64, :64]
    wall = (2 / (1 + 0.3 * (x - 31.5) / 64 + 0.2 * (y - 31.5) / 64)).astype(np.float32)[None, None]  # a slanted plane
    np.save(folder / "depth.npy", wall)
    for crops, tolerance in ((0.0, 0.03), (1.0, 1e-5)):  # a reduced depth is of the middle sample, half a pixel off
        scenes = Scenes([tmp_path / "a"], (), crops=crops)
        found = scenes.batch(scenes.samples(32)[:1], 32, np.random.default_rng(3))
        right, up, back = feeding.points(found["depth"], found["camera"])[0]
        assert torch.allclose(-back + 0.3 * right - 0.2 * up, torch.full_like(back, 2.0), atol=tolerance)


def test_a_mirrored_scene_is_the_scene_in_a_mirror(tmp_path):
    written(tmp_path / "a", count=1)
    plain = Scenes([tmp_path / "a"], EVERYTHING, five=True)
    turned = Scenes([tmp_path / "a"], EVERYTHING, five=True, mirrored=True)
    row, rng = plain.samples(64)[:1], lambda: np.random.default_rng(3)
    assert rng().random() < 0.5  # this seed mirrors
    one, other = plain.batch(row, 64, rng()), turned.batch(row, 64, rng())
    assert torch.equal(other["relit"], one["relit"].flip(-1)) and torch.equal(other["flash"], one["flash"].flip(-1))
    flip = torch.tensor([-1.0, 1, 1])
    assert torch.equal(other["normal"], one["normal"].flip(-1) * flip.view(1, 3, 1, 1))
    assert torch.allclose(basis(other["light"]), flip.diag() @ basis(one["light"]) @ flip.diag(), atol=1e-5)
    assert torch.allclose(other["cloud"], one["cloud"].flip(-1) * flip.view(1, 3, 1, 1), atol=1e-5)
    assert torch.equal(other["pictures"][:, 3:6], one["pictures"][:, 6:9].flip(-1))


def test_the_five_lights_are_distinct_near_their_pattern_and_never_the_one_asked_for(tmp_path):
    folder = written(tmp_path / "a", count=1, lights=12)
    light = np.load(folder / "light.npy")
    light[0, [7, 3, 9, 0, 11]] = FIVE
    np.save(folder / "light.npy", light)
    scenes = Scenes([tmp_path / "a"], ("relit",), five=True)
    assert scenes.shards[0].five(0) == [7, 3, 9, 0, 11]
    assert sorted(scenes.samples(64, "others")[:, 2]) == [1, 2, 4, 5, 6, 8, 10]


@pytest.mark.parametrize("network,variant", [(network, variant) for network in VARIANTS for variant in VARIANTS[network]])
def test_every_variant_learns_from_a_batch(tmp_path, network, variant):
    torch.manual_seed(1)
    written(tmp_path / "a")
    one = stage(network, variant)
    scenes = Scenes([tmp_path / "a"], one.needs, variant == "noisy", variant == "oss")
    found = scenes.batch(scenes.samples(32, one.lights)[:2], 32, np.random.default_rng(0))
    assert {name: picture.shape[1] for name, picture in one.inputs(found).items()} == one.given
    optimizer, losses = torch.optim.Adam(one.network.parameters(), 1e-3), []
    for _ in range(6):
        loss = one.loss(one.raw(found), found)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < losses[0]
    assert {name: picture.shape[1] for name, picture in one.answer(found).items()} == one.outputs


def test_a_course_changes_size_by_samples_or_minutes_and_drops_its_rate_by_the_whole():
    course = Course([Phase.read("64:16:300"), Phase.read("128:4:100")], 5e-4, [0.5, 0.9])
    assert course.rate_at(course.progress(0, 199, 0)) == 5e-4
    assert course.rate_at(course.progress(0, 200, 0)) == pytest.approx(5e-5)
    assert course.rate_at(course.progress(1, 60, 0)) == pytest.approx(5e-6)
    timed = Course([Phase.read("64:16:30m"), Phase.read("128:4:10m")], 5e-4, [])
    assert timed.done(0, 10**6, 900) == 0.5 and timed.progress(1, 0, 300) == 0.875
    with pytest.raises(SystemExit, match="one kind"):
        Course([Phase.read("64:16:30m"), Phase.read("128:4:10")], 5e-4, [])
    with pytest.raises(ValueError, match="multiple of 32"):
        Phase.read("100:4:10")


def test_a_round_shows_everything_once_and_a_resumed_one_goes_on_with_the_same_batches(tmp_path):
    written(tmp_path / "a", count=2, lights=6)
    one = stage("shadow", "clean")
    scenes, phase = Scenes([tmp_path / "a"], one.needs), Phase.read("32:4:100")
    source = batches(scenes, one, phase, 0, 7, 0)
    seen = [next(source) for _ in range(5)]
    lights = torch.cat([found["light"] for found in seen[:3]])
    assert len(torch.unique(lights, dim=0)) == 12
    resumed = batches(scenes, one, phase, 0, 7, 16)
    assert torch.equal(next(resumed)["cloud"], seen[4]["cloud"])


def test_the_average_follows_and_weights_start_another_network(tmp_path):
    torch.manual_seed(1)
    network = stage("shadow", "clean").network
    average = Average(network)
    first = average.weights["head.1.bias"].clone()
    with torch.no_grad():
        network.head[1].bias += 1
    average.follow(network)
    assert torch.allclose(average.weights["head.1.bias"] - first, torch.tensor(9 / 11))  # 1 − 2/11 of the way in its first step
    torch.save({"average": average.weights}, tmp_path / "shadow.pt")
    other = warmed(stage("shadow", "noisy").network, tmp_path / "shadow.pt")
    assert torch.equal(other.head[1].bias, average.weights["head.1.bias"])
    with pytest.raises(SystemExit, match="another network"):
        warmed(stage("synthesis", "clean").network, tmp_path / "shadow.pt")


def test_a_variant_with_other_inputs_starts_from_what_it_shares(tmp_path):
    torch.manual_seed(1)
    clean = stage("decompose", "clean").network
    torch.save({"average": clean.state_dict()}, tmp_path / "clean.pt")
    env = warmed(stage("decompose", "env").network, tmp_path / "clean.pt", other_inputs=True)
    picture = torch.rand(1, 5, 32, 32)
    with torch.no_grad():
        assert all(torch.allclose(a, b, atol=1e-5) for a, b in zip(env(picture), clean(picture[:, :4]), strict=True))


def test_a_run_that_was_stopped_goes_on_to_the_same_weights_and_tells_its_command(tmp_path, monkeypatch):
    written(tmp_path / "private" / "shards")
    ran = {}
    for name, stops in (("whole", 1), ("halves", 2)):
        out = tmp_path / name
        given = ["shadow", "--train", tmp_path / "private" / "shards", "--val", tmp_path / "private" / "shards", "--out", out]
        given += ["--look-scenes", 1, "--look-size", 32, "--crops", 0, "--drops", "1,1", "--threads", 1]
        for phases in ((["32:2:4"], ["32:2:4", "64:2:4"]) if stops == 2 else (["32:2:4", "64:2:4"],)):
            options = [part for phase in phases for part in ("--phase", phase)]
            argv = [str(part) for part in [*given, *options]]
            monkeypatch.setattr("sys.argv", ["train", *argv])
            main()
        ran[name] = torch.load(out / "shadow-clean.pt", weights_only=True)
        looks = (out / "shadow-clean.csv").read_text().splitlines()
        assert len(looks) == 3 and (out / "shadow-clean.png").exists()
    weights = [run["network"].values() for run in ran.values()]
    assert all(torch.allclose(a, b, atol=1e-6) for a, b in zip(*weights, strict=True))
    assert ran["halves"]["samples"] == ran["whole"]["samples"] == 8 and ran["whole"]["shards"] == ["shards/0000-0001"]
    told = command(arguments.parse_args(argv))
    assert told == ran["whole"]["command"].replace("--out whole", "--out halves")
    assert told.endswith("--drops 1,1 --crops 0 --look-scenes 1 --look-size 32 --phase 32:2:4 --phase 64:2:4")
    assert "private" not in told
