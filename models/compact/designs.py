"""`python3 -m models.compact.designs RUNS --val DIR… --out docs/eval/designs`: designs of LightNet against each other.

RUNS holds one folder a design, as `train.py` left it. Prints a line for each, and writes OUT.png: squared errors of shadows and
relit light over every lamp of the validation lessons, against what an answer costs at 256 × 256 in ONNX Runtime on one thread.
"""

import argparse
import io
import time
from pathlib import Path

import matplotlib
import numpy as np
import onnx
import onnxruntime
import torch

from ..reference import graph
from .lessons import Lessons
from .networks import LightNet, parameters
from .tasks import Light

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402

ROUNDS = 15

arguments = argparse.ArgumentParser(prog="models.compact.designs", description=__doc__.split("\n")[0])
arguments.add_argument("runs", type=Path)
arguments.add_argument("--val", nargs="+", required=True, help="folders of validation lessons")
arguments.add_argument("--out", type=Path, required=True)


def design(run):
    """The task of a run, with its trained network, its number of steps and the options that make it a design."""
    state = torch.load(run / "light.pt", weights_only=True)
    words = state["command"].split()
    task = Light()
    task.network = LightNet.of(state["average"]).eval()
    listed = words[words.index("--without") + 1 :] if "--without" in words else []
    task.without = [word for word in listed if word in Light.names]
    if task.network.hourglass.stem.in_channels > 17:
        task.names = [*Light.names, "distance"]
    return task, state["steps"]


def cost(network):
    """GFLOP and the network as a session of ONNX Runtime."""
    given = torch.zeros(1, network.hourglass.stem.in_channels, 256, 256)
    model, options = io.BytesIO(), onnxruntime.SessionOptions()
    torch.onnx.export(network, (given,), model, input_names=["lamp"], dynamo=False)
    options.intra_op_num_threads = 1
    return graph.billions(onnx.load_from_string(model.getvalue())), onnxruntime.InferenceSession(model.getvalue(), options, providers=["CPUExecutionProvider"])


def milliseconds(sessions):
    """Of every session, the median of turns that they take one after another, so that what else the machine does hits all."""
    spent = {name: [] for name in sessions}
    for _ in range(ROUNDS):
        for name, session in sessions.items():
            given = {"lamp": np.zeros([1, session.get_inputs()[0].shape[1], 256, 256], np.float32)}
            session.run(None, given)
            began = time.perf_counter()
            session.run(None, given)
            spent[name].append(1e3 * (time.perf_counter() - began))
    return {name: float(np.median(all_of_it)) for name, all_of_it in spent.items()}


def errors(task, folder):
    """(shadow, relit) of the network and (shadow, relit) of the closed form: means over every lamp of every lesson."""
    lessons, found = Lessons([folder], task.names), []
    for number, lesson in enumerate(lessons.kept):
        side = min(lesson["sight"].shape[-2:])
        for lamp in range(len(lesson["toward"])):
            batch = {k: v[None] for k, v in lessons.one(number, lamp, (0, 0, side), (0, 0)).items()}
            with torch.no_grad():
                after, before = task.errors(batch)[0], task.before(batch)
            found.append([float(one[name]) for one in (after, before) for name in ("shadow", "relit")])
    return np.mean(found, 0)


def main():
    asked = arguments.parse_args()
    torch.set_num_threads(1)
    runs = sorted(file.parent for file in asked.runs.glob("*/light.pt"))
    tasks = {run.name: design(run) for run in runs}
    costs = {name: cost(task.network) for name, (task, _) in tasks.items()}
    spent = milliseconds({name: session for name, (_, session) in costs.items()})
    folders = [Path(folder) for folder in asked.val]
    print("| design | steps | M parameters | GFLOP | ms | " + " | ".join(f"{f.name}: shadow, relit" for f in folders) + " |")
    print("|---" * (5 + len(folders)) + "|")
    figure, axes = pyplot.subplots(1, len(folders), figsize=(4.6 * len(folders), 4.4), constrained_layout=True)
    for name, (task, steps) in tasks.items():
        of = [errors(task, folder) for folder in folders]
        words = [name, str(steps), f"{parameters(task.network) / 1e6:.2f}", f"{costs[name][0]:.2f}", f"{spent[name]:.1f}"]
        print("| " + " | ".join(words + [f"{1e2 * one[0]:.3f}, {1e2 * one[1]:.4f}" for one in of]) + " |", flush=True)
        for axis, folder, one in zip(np.atleast_1d(axes), folders, of, strict=True):
            axis.plot(spent[name], 1e2 * one[0], "o")
            axis.annotate(name, (spent[name], 1e2 * one[0]), textcoords="offset points", xytext=(5, 4), fontsize=7)
            axis.set_title(f"{folder.name}; closed form {1e2 * one[2]:.2f}", fontsize=9)
            axis.set_xlabel("ms an answer, 256 × 256, one thread")
            axis.set_ylabel("squared error of shadows, 1e-2")
            axis.set_xlim(left=0)
    figure.savefig(asked.out.with_suffix(".png"), dpi=110)


if __name__ == "__main__":
    main()
