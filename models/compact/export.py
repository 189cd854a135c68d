"""`python3 -m models.compact.export RUN --out models/weights`: ships the networks of a run.

Each becomes OUT/compact-NAME.onnx, checked against PyTorch, its entry of the manifest.toml beside OUT and its card in the folder
cards/ there. Weights are stored as halves: both files are one megabyte and a half together.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from blake3 import blake3

from ..reference import graph, manifest
from .networks import parameters
from .tasks import TASKS

TOLERANCE = 2e-3
"""Between ONNX Runtime and PyTorch."""

DOES = {
    "surfaces": "a scene in closed form to what is added to its normals, the factor of its albedo, and its roughness",
    "light": "a scene under a lamp in closed form to what is added to its shadows and bounced light",
}

arguments = argparse.ArgumentParser(prog="models.compact.export", description=__doc__.split("\n")[0])
arguments.add_argument("run", type=Path)
arguments.add_argument("--network", choices=TASKS, help="this one alone")
arguments.add_argument("--out", type=Path, default=Path("models/weights"))
arguments.add_argument("--licence", default="MIT OR Apache-2.0", help="of the weights")


def difference(task, model):
    """The largest difference between the model and the network, at two sizes; SystemExit above `TOLERANCE`."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    worst, generator = 0.0, torch.Generator().manual_seed(1)
    for height, width in ((128, 128), (96, 160)):
        given = {name: torch.rand(1, c, height, width, generator=generator) for name, c in task.given.items()}
        with torch.no_grad():
            wanted = task.network(*given.values())
        found = session.run([*task.outputs], {name: picture.numpy() for name, picture in given.items()})
        worst = max([worst, *(float(np.abs(a - b.numpy()).max()) for a, b in zip(found, wanted, strict=True))])
    if not worst <= TOLERANCE:
        raise SystemExit(f"ONNX Runtime is {worst:.1e} from PyTorch, above {TOLERANCE}; nothing was written")
    return worst


def reached(table):
    """Lines of the last look at the validation lessons: network and closed form side by side."""
    with open(table, newline="") as lines:
        last = list(csv.DictReader(lines))[-1]
    names = [name for name in last if name not in ("seconds", "steps", "loss") and " closed " not in name]
    lines = ["| validation lessons, mean squared error | network | closed form |", "|---|---|---|"]
    for name in names:
        folder, what = name.split(" ", 1)
        after, before = float(last[name]), float(last[f"{folder} closed {what}"])
        if what != "depth":  # which is not shipped
            lines.append(f"| {folder}: {what} | {100 * after:.2f}e-2 | {100 * before:.2f}e-2 |")
    return lines


def card(facts, kept, table, apart):
    """The card in Markdown."""
    lines = [f"# {facts['name']}: a compact network on a closed-form base", "", f"From {DOES[facts['name']]}."]
    lines += ["What goes in and out stands in `../manifest.toml`, how it is made in `src/relight/networks/compact`.", ""]
    lines += [f"{facts['parameters'] / 1e6:.2f} M parameters, {facts['gflop_256']} GFLOP at 256².", "", "## Training", ""]
    lines += [f"    {facts['command']}", "", f"- {len(kept['lessons'])} lessons, one a rendered capture of 256²"]
    lines += [f"- seed {kept['seed']}; {kept['steps']:,} steps in {kept['seconds'] / 60:.0f} minutes of two shared cores"]
    lines += [f"- the running average of the weights is shipped, as halves; ONNX Runtime within {apart:.0e} of PyTorch", ""]
    lines += ["## What it reaches", "", *reached(table), "", "## Licence", "", f"{facts['licence']}, as the project.", ""]
    return "\n".join(lines)


def written(asked, name):
    """One network's file, manifest entry and card."""
    file = asked.run / f"{name}.pt"
    kept = torch.load(file, weights_only=True)
    task = TASKS[name]()
    task.network.load_state_dict(kept["average"])
    task.network = task.network.shipped()
    graph.rounded(task.network.eval(), "halves")
    model = graph.exported(task, "halves")
    apart, content = difference(task, model), model.SerializeToString()
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / f"compact-{name}.onnx").write_bytes(content)
    facts = {"name": name, "variant": "compact", "tier": "compact", "file": f"{asked.out.name}/compact-{name}.onnx"}
    facts |= {"blake3": blake3(content).hexdigest(), "bytes": len(content), "parameters": parameters(task.network)}
    facts |= {"gflop_256": round(graph.billions(model), 2), "licence": asked.licence}
    facts |= {"card": f"cards/compact-{name}.md", "command": kept["command"]}
    place = asked.out.parent
    manifest.written(place / "manifest.toml", facts, task.given, task.outputs)
    (place / "cards").mkdir(exist_ok=True)
    (place / facts["card"]).write_text(card(facts, kept, file.with_suffix(".csv"), apart))
    print(f"{name}: {len(content) / 1e6:.2f} MB, {facts['parameters'] / 1e6:.2f} M parameters, {facts['gflop_256']} GFLOP at 256²")


def main():
    asked = arguments.parse_args()
    for name in TASKS:
        if asked.network in (None, name) and (asked.run / f"{name}.pt").exists():
            written(asked, name)


if __name__ == "__main__":
    main()
