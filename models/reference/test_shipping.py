"""Claims about evaluation, export and answers for capture folders."""

import json
import tomllib

import numpy as np
import pytest

torch = pytest.importorskip("torch")
onnx = pytest.importorskip("onnx")
runtime = pytest.importorskip("onnxruntime")
cv2 = pytest.importorskip("cv2")

from . import answer, capture, evaluate, export, graph, manifest  # noqa: E402
from .checkpoint import path, saved, warmed  # noqa: E402
from .stages import VARIANTS, stage  # noqa: E402
from .test_training import written  # noqa: E402


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of three networks with fresh weights and a root of shards it says it was trained on."""
    root = tmp_path_factory.mktemp("run")
    written(root / "shards", count=2, size=64, lights=3)
    torch.manual_seed(1)
    for network in VARIANTS:
        kept = {"average": stage(network, "clean").network.state_dict(), "shards": ["shards/0000-0001"], "seed": 1, "samples": 0}
        saved(path(root, network, "clean"), kept | {"seconds": 0.0, "command": "python3 -m models.reference.train …"})
    return root


def test_errors_are_means_over_the_surface_of_values_cut_to_their_range():
    known = torch.tensor([[[[1.0, 1.0, 0.0]]]])
    found = {"relit": torch.tensor([[[[0.5, 3.0, 0.0]]]]), "normal": torch.tensor([[[[1.0, 0.0, 0.0]]]]), "known": known}
    given = {"relit": torch.tensor([[[[0.7, 1.5, 9.0]]]]), "normal": torch.tensor([[[[-1.0, 0.0, 5.0]]]])}
    made = evaluate.errors(given, found)
    assert made["relit"] == pytest.approx(0.2**2 / 2) and made["normal"] == pytest.approx(2.0)
    line = {"scene": "a/0", "light": 0, "degrees": 30.0, **made}
    assert evaluate.summary([line])["mse"]["normal_01"] == pytest.approx(0.5)


def test_every_scene_and_light_is_measured_once_and_synthesis_is_fed_what_was_inferred(run):
    lines = evaluate.measured(run, [run / "shards"], "clean", 64)
    assert [(line["scene"], line["light"]) for line in lines] == [(f"0000-0001/{s}", k) for s in range(2) for k in range(3)]
    scenes = export.Scenes([run / "shards"], ("flash", "intensity", "relit"))
    together = stage("synthesis", "clean")
    for one in (together, *together.before):
        warmed(one.network, path(run, one.network_name, "clean")).eval()
    found = scenes.batch(scenes.samples(64)[4:5], 64, np.random.default_rng(0))
    with torch.no_grad():
        wanted = evaluate.errors(together.answer(found), found)["relit"]
    assert lines[4]["relit"] == pytest.approx(wanted, abs=1e-5)
    report = evaluate.summary(lines)
    assert report["scenes"] == 2 and report["pictures"] == 6 and "| clean |" in evaluate.table({"clean": report})
    assert len({line["scene"] for line in report["worst"]["shadow"]}) == 2


def test_what_is_exported_answers_as_the_network_does_and_the_manifest_tells_its_hash(run, tmp_path):
    folder = tmp_path / "models"
    folder.mkdir()
    (folder / "manifest.toml").write_text('# kept\nformat = 1\n\n[[model]]\nname = "shadow"\nvariant = "other"\n')
    options = ["--variant", "clean", "--data", run / "shards", "--val", run / "shards", "--out", folder / "weights"]
    asked = export.arguments.parse_args([*map(str, [run, *options])])
    trained = stage("shadow", "clean")
    export.written(asked, "shadow", trained)
    export.written(asked, "shadow", trained)
    text = (folder / "manifest.toml").read_text()
    models = tomllib.loads(text)["model"]
    assert text.startswith("# kept\n") and [model["variant"] for model in models] == ["other", "clean"]
    content = (folder / models[1]["file"]).read_bytes()
    assert models[1]["blake3"] == export.blake3(content).hexdigest() and models[1]["bytes"] == len(content)
    # 6×6·3·32 at 128² and so on by the paper's table: 7.09 GFLOP with the head.
    assert models[1]["gflop_256"] == pytest.approx(7.09, abs=0.01) and models[1]["parameters"] == 5920705
    assert models[1]["input"] == [
        {"name": "cloud", "shape": ["1", "3", "height", "width"], "unit": manifest.SIGNALS["cloud"][0], "range": [-1.8, 2.8]}
    ]
    card = (folder / models[1]["card"]).read_text()
    assert models[1]["data"] in card and "2 scenes in 1 shards of 64²" in card
    other = warmed(stage("shadow", "noisy").network, folder / models[1]["file"])
    stored = "bytes" if "stored as bytes" in card else "halves"
    wanted = graph.rounded(warmed(stage("shadow", "clean").network, path(run, "shadow", "clean")), stored)
    assert all(torch.allclose(a, b, rtol=1e-3, atol=1e-6) for a, b in zip(other.state_dict().values(), wanted.state_dict().values()))


def test_a_hash_changes_with_the_data_and_missing_data_is_named(tmp_path):
    folder = written(tmp_path / "shards", count=1, size=32)
    first, count, sizes = export.data_hash([tmp_path / "shards"], ["shards/0000-0000"])
    assert (count, sizes) == (1, [32])
    light = np.load(folder / "light.npy")
    np.save(folder / "light.npy", -light)
    assert export.data_hash([tmp_path / "shards"], ["shards/0000-0000"])[0] != first
    with pytest.raises(SystemExit, match="elsewhere/0000-0000"):
        export.data_hash([tmp_path / "shards"], ["elsewhere/0000-0000"])


@pytest.mark.parametrize("storage", ["bytes", "halves"])
def test_weights_come_back_from_a_model_as_they_were_stored(tmp_path, storage):
    one = graph.rounded(stage("shadow", "clean").network, storage)
    other = stage("shadow", "clean")
    other.network.load_state_dict(one.state_dict())
    onnx.save(graph.exported(other, storage), tmp_path / "m.onnx")
    back = warmed(stage("shadow", "clean").network, tmp_path / "m.onnx").state_dict()
    for name, values in one.state_dict().items():
        assert torch.allclose(back[name], values, rtol=1e-3, atol=1e-6), name


def test_a_graph_that_answers_otherwise_is_refused(run):
    one = stage("shadow", "clean")
    model = graph.exported(one, "bytes")
    with torch.no_grad():
        one.network.head[1].bias += 0.1
    with pytest.raises(SystemExit, match="nothing was written"):
        export.difference(one, model)


def captured(folder, size=64, **changes):
    """A capture folder of a white wall at 2 m, half of it hidden by the mask, room light of 0.1 in both photographs."""
    folder.mkdir()
    color = {"width": size, "height": size, "fx": 80.0, "fy": 80.0, "cx": 31.5, "cy": 31.5} | changes
    declared = "\n".join(f"{name} = {json.dumps(value)}" for name, value in color.items())
    rest = "[flash]\nintensity = 2.0\n[depth]\ndepth_unit_metres = 0.002\n"
    (folder / "capture.toml").write_text(f"format = 1\n[color]\n{declared}\n{rest}")
    wall, room = (np.full((size, size, 3), round(light * 65535), np.uint16) for light in (0.6, 0.1))
    mask = np.full((size, size), 255, np.uint8)
    mask[:, : size // 2] = 0
    pictures = {"flash": wall, "ambient": room, "depth": np.full((size, size), 1000, np.uint16), "mask": mask}
    for name, picture in pictures.items():
        cv2.imwrite(str(folder / f"{name}.png"), picture)
    return folder


def test_a_capture_folder_is_fed_without_its_room_light_and_mask(tmp_path):
    found, _ = capture.fed(captured(tmp_path / "shot"), [answer.direction("0,0,1"), answer.direction("1,0,1")])
    # Half a unit of flash light of a wall at 2 m; intensity / distance² is 0.5.
    assert torch.allclose(found["flash"][..., 32:], torch.ones(1, 3, 64, 32), atol=1e-3)
    assert found["flash"][..., :32].abs().sum() == 0
    assert found["known"].mean() == 0.5
    for change, field in (({"transfer": "srgb"}, "transfer"), ({"width": 65}, "width")):
        with pytest.raises(SystemExit, match=field):
            capture.plain(captured(tmp_path / field, **change))


def test_exported_models_answer_a_folder_as_the_run_does(run, tmp_path):
    folder, weights = captured(tmp_path / "shot"), tmp_path / "weights"
    weights.mkdir()
    for network in VARIANTS:
        one = stage(network, "clean")
        warmed(one.network, path(run, network, "clean"))
        onnx.save(graph.exported(one, "floats"), weights / f"paper-clean-{network}.onnx")
    found = capture.fed(folder, [answer.direction("1,2,2")])[0]
    with torch.no_grad():
        one, other = (evaluate.answers(answer.networks(*source, "clean"), found, {}) for source in ((run, None), (None, weights)))
    assert one.keys() == set(evaluate.OUTPUTS)
    assert all(torch.allclose(one[name], other[name], atol=1e-4) for name in one)


def test_a_capture_folder_is_fed_as_the_shard_of_the_same_scene(tmp_path):
    shards = written(tmp_path / "shards", count=1, size=64)
    scenes = capture_of(shards, tmp_path / "shot")
    one = stage("decompose", "env")
    wanted = export.Scenes([tmp_path / "shards"], one.needs).batch([(0, 0, 2)], 64, np.random.default_rng(0))
    light = ",".join(map(str, np.load(shards / "light.npy")[0, 2]))
    found = capture.fed(scenes, [answer.direction(light)])[0]
    for name in ("flash", "near", "mask", "cloud", "ambient"):
        assert torch.allclose(found[name], wanted[name], atol=1e-3), name


def capture_of(shards, folder):
    """The first scene of a shard as a capture folder, in EXR."""
    folder.mkdir()
    load = lambda name: torch.from_numpy(np.load(shards / f"{name}.npy")[:1].astype(np.float32))
    fx, fy, cx, cy = load("camera")[0].tolist()
    color = f"width = 64\nheight = 64\nfx = {fx}\nfy = {fy}\ncx = {cx}\ncy = {cy}"
    (folder / "capture.toml").write_text(f"format = 1\n[color]\n{color}\n[flash]\nintensity = {float(load('intensity'))}\n")
    everywhere = torch.ones(1, 1, 64, 64)
    answer.exr(folder / "flash.exr", load("flash") + load("ambient"), everywhere)
    answer.exr(folder / "ambient.exr", load("ambient"), everywhere)
    answer.exr(folder / "depth.exr", load("depth"), everywhere)
    return folder
