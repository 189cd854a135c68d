"""`python3 -m models.reference.export RUN --variant clean --data TRAIN… --val VAL… --out models/weights`: ships a run.

Each network of the variant becomes OUT/paper-VARIANT-NETWORK.onnx, checked against PyTorch, its entry of the manifest.toml beside
OUT and its card in the folder cards/ there. Weights are stored as small as costs less than 0.05 dB on the validation shards.
"""

import argparse
import math
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from blake3 import blake3

from . import card, checkpoint, graph, manifest
from .evaluate import errors
from .networks import parameters
from .scenes import Scenes
from .stages import VARIANTS, Synthesis, stage

TOLERANCE = 1e-3
"""Between ONNX Runtime and PyTorch."""

COST_DECIBELS = 0.05

arguments = argparse.ArgumentParser(prog="models.reference.export", description=__doc__.split("\n")[0])
arguments.add_argument("run", type=Path)
arguments.add_argument("--variant", required=True, choices=sorted({variant for known in VARIANTS.values() for variant in known}))
arguments.add_argument("--network", choices=VARIANTS, help="this one alone")
arguments.add_argument("--data", type=Path, nargs="+", required=True, help="the folders of training shards")
arguments.add_argument("--val", type=Path, nargs="+", required=True, help="folders of validation shards")
arguments.add_argument("--out", type=Path, default=Path("models/weights"))
arguments.add_argument("--licence", default="MIT OR Apache-2.0", help="of the weights")
arguments.add_argument("--scenes", type=int, default=20, help="validation scenes that storage is judged by")


def data_hash(roots, names):
    """(BLAKE3 over name and BLAKE3 of every file, scenes, sizes) of the shards of those names, `ROOT/NNNN-MMMM`."""
    whole, scenes, sizes = blake3(), 0, set()
    by_name = {root.name: root for root in roots}
    for name in sorted(names):
        root, shard = name.split("/")
        folder = by_name.get(root, Path()) / shard
        if root not in by_name or not folder.is_dir():
            raise SystemExit(f"{name}: trained on, not in --data; name the folder {root} that holds it")
        for file in sorted(folder.glob("*.npy")):
            hexadecimal = blake3(max_threads=1).update_mmap(file).hexdigest()
            whole.update(f"{name}/{file.name} {hexadecimal}\n".encode())
        shape = np.load(folder / "depth.npy", mmap_mode="r").shape
        scenes, sizes = scenes + shape[0], sizes | {shape[-1]}
    return whole.hexdigest(), scenes, sorted(sizes)


def difference(one, model):
    """The largest difference between the model and the network, at two sizes, printed; SystemExit above `TOLERANCE`."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    worst, generator = 0.0, torch.Generator().manual_seed(1)
    for height, width in ((128, 128), (96, 160)):
        given = {name: torch.rand(1, c, height, width, generator=generator) for name, c in one.given.items()}
        with torch.no_grad():
            wanted = one.network.finished(one.network.raw(torch.cat([*given.values()], 1)))
        found = session.run([*one.outputs], {name: picture.numpy() for name, picture in given.items()})
        apart = max(float(np.abs(a - b.numpy()).max()) for a, b in zip(found, wanted, strict=True))
        print(f"  {height} × {width}: ONNX Runtime within {apart:.1e} of PyTorch")
        worst = max(worst, apart)
    if not worst <= TOLERANCE:
        raise SystemExit(f"ONNX Runtime is {worst:.1e} from PyTorch, above {TOLERANCE}; nothing was written")
    return worst


def mean_errors(one, scenes, at_most):
    """Mean squared error of each output over the first scenes, the first of each one's lights."""
    rows = scenes.samples(min(shard.size for shard in scenes.shards), one.lights, at_most)
    _, first = np.unique(rows[:, :2], axis=0, return_index=True)
    found = []
    for number in first:
        batch = scenes.batch(rows[number : number + 1], scenes.shards[rows[number][0]].size, np.random.default_rng(int(number)))
        with torch.no_grad():
            found.append(errors(one.answer(batch), batch))
    return {name: float(np.mean([line[name] for line in found])) for name in one.outputs}


def smallest(one, fresh, scenes, at_most):
    """(storage, dB): the smallest way to store the weights that costs the worst output less than `COST_DECIBELS`, and what it
    costs; the network is left as it is then stored."""
    before = mean_errors(one, scenes, at_most)
    for storage in ("bytes", "halves"):
        graph.rounded(fresh(), storage)
        after = mean_errors(one, scenes, at_most)
        cost = max(10 * math.log10(after[name] / before[name]) for name in before)
        print(f"{one.network_name}: weights as {storage} cost {cost:+.4f} dB", flush=True)
        if cost < COST_DECIBELS:
            return storage, cost
    fresh()
    return "floats", 0.0


def written(asked, network, trained):
    """One network's file, manifest entry and card."""
    file = checkpoint.path(asked.run, network, asked.variant)
    kept = torch.load(file, map_location="cpu", weights_only=True)
    fresh = lambda: checkpoint.warmed(trained.network, file).eval()
    fresh()
    scenes = Scenes(asked.val, trained.needs, asked.variant == "noisy", asked.variant == "oss")
    storage, cost = smallest(trained, fresh, scenes, asked.scenes)
    model = graph.exported(trained, storage)
    apart = difference(trained, model)
    data, count, sizes = data_hash(asked.data, kept["shards"])
    content = model.SerializeToString()
    name, folder = f"paper-{asked.variant}-{network}", asked.out.parent
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / f"{name}.onnx").write_bytes(content)
    facts = {"name": network, "variant": asked.variant, "tier": "paper", "file": f"{asked.out.name}/{name}.onnx"}
    facts |= {"blake3": blake3(content).hexdigest(), "bytes": len(content), "parameters": parameters(trained.network)}
    facts |= {"gflop_256": round(graph.billions(model), 2), "licence": asked.licence}
    facts |= {"card": f"cards/paper-{network}-{asked.variant}.md", "command": kept["command"], "data": data}
    manifest.written(folder / "manifest.toml", facts, trained.given, trained.outputs)
    training = {"scenes": count, "sizes": sizes, "shards": len(kept["shards"]), "samples": kept["samples"]}
    training |= {"minutes": kept["seconds"] / 60, "seed": kept["seed"], "storage": storage, "cost": cost, "apart": apart}
    card.written(folder, facts, trained, training, asked.run)
    costs = f"{facts['parameters'] / 1e6:.2f} M parameters, {facts['gflop_256']} GFLOP at 256²"
    print(f"  {name}.onnx: {len(content) / 1e6:.1f} MB, {costs}")


def main():
    asked = arguments.parse_args()
    found = [n for n in VARIANTS if asked.variant in VARIANTS[n] and checkpoint.path(asked.run, n, asked.variant).exists()]
    found = [network for network in found if asked.network in (None, network)]
    if not found:
        raise SystemExit(f"{asked.run}: holds no {asked.network or 'network'} {asked.variant}; train it first")
    for network in found:
        trained = stage(network, asked.variant)
        if isinstance(trained, Synthesis):
            for before in trained.before:
                checkpoint.warmed(before.network, checkpoint.path(asked.run, before.network_name, asked.variant))
        written(asked, network, trained)


if __name__ == "__main__":
    main()
