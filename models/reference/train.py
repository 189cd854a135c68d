"""`python3 -m models.reference.train shadow|decompose|synthesis TRAIN VAL --out RUN`: trains one of the three networks.

TRAIN and VAL are what `pack` wrote. RUN receives `NETWORK.pt`, the latest state, from which an interrupted run goes on;
`NETWORK.csv`, one line per look at VAL; and `NETWORK.png`, the learning curve. `synthesis` needs RUN/shadow.pt and
RUN/decompose.pt, which stay as they are. Schedule as published: batch 4, Adam, 5e-4, a tenth every two of five epochs.
"""

import argparse
import csv
import os
import time
from pathlib import Path

import numpy as np
import torch

from .frames import seen_from
from .losses import cross_entropy, squared, with_gradients
from .networks import DecomposeNet, ShadowNet, SynthesisNet, parameters
from .scenes import Scenes
from .shading import rendered

PUBLISHED = {"shadow": 5.92, "decompose": 14.70, "synthesis": 8.37}
"""Million parameters that the paper's tables give."""

VALIDATION_BATCHES = 40

arguments = argparse.ArgumentParser(prog="models.reference.train", description=__doc__.split("\n")[0])
arguments.add_argument("network", choices=PUBLISHED)
arguments.add_argument("train", type=Path)
arguments.add_argument("val", type=Path)
arguments.add_argument("--out", type=Path, required=True)
arguments.add_argument("--noisy", action="store_true", help="with the paper's depth noise")
arguments.add_argument("--epochs", type=int, default=5)
arguments.add_argument("--batch", type=int, default=4)
arguments.add_argument("--seed", type=int, default=1)
arguments.add_argument("--look-every", type=int, default=250, help="steps between looks at VAL, each of which saves")
arguments.add_argument("--minutes", type=float, default=float("inf"), help="stop, saved, after so long")


class Shadow:
    """Points seen from the light to a shadow map."""

    def __init__(self, device, _folder):
        self.network = ShadowNet().to(device)

    def answer(self, found):
        return {"shadow": self.network(seen_from(found["light"], found["cloud"]))}

    def loss(self, answer, found):
        return cross_entropy(answer["shadow"], found["shadow"], found["known"])


class Decompose:
    """Flash photograph and depth to albedo, normal and roughness."""

    def __init__(self, device, _folder):
        self.network = DecomposeNet().to(device)

    def answer(self, found):
        answers = self.network(torch.cat([found["flash"], found["near"]], 1))
        return dict(zip(("albedo", "normal", "roughness"), answers, strict=True))

    def loss(self, answer, found):
        known = found["known"]
        values = sum(with_gradients(answer[name], found[name], known) for name in ("albedo", "normal"))
        return values + cross_entropy(answer["roughness"], found["roughness"].clamp(0, 1), known)


class Synthesis:
    """All of it to the relit picture; the other two networks stay as they are."""

    def __init__(self, device, folder):
        self.network = SynthesisNet().to(device)
        self.before = [Shadow(device, folder), Decompose(device, folder)]
        for stage, name in zip(self.before, ("shadow", "decompose"), strict=True):
            path = folder / f"{name}.pt"
            if not path.exists():
                raise SystemExit(f"{path}: not there; train {name} into the same folder first")
            stage.network.load_state_dict(torch.load(path, map_location=device, weights_only=True)["network"])
            stage.network.requires_grad_(False).eval()

    def answer(self, found):
        with torch.no_grad():
            shadow, scene = (stage.answer(found) for stage in self.before)
            parts = [scene[name] for name in ("albedo", "normal", "roughness")]
            render = rendered(*parts, found["light"], found["camera"])
            cloud = seen_from(found["light"], found["cloud"])
            channels = torch.cat([shadow["shadow"], render, found["flash"], *parts, cloud], 1)
        return {"relit": self.network(channels)}

    def loss(self, answer, found):
        return with_gradients(answer["relit"], found["relit"], found["known"])


STAGES = {"shadow": Shadow, "decompose": Decompose, "synthesis": Synthesis}


def pairs(scenes, seed, epoch):
    """Every scene under every light, in an order of its own for each epoch."""
    order = np.random.default_rng([seed, epoch]).permutation(scenes.count * scenes.lights)
    return np.stack([order // scenes.lights, order % scenes.lights], 1)


def looked_at(stage, scenes, batch, device):
    """Mean squared error of each output on the first scenes and a light of each."""
    errors = {}
    rng = np.random.default_rng(0)
    stage.network.eval()
    with torch.no_grad():
        for start in range(0, min(scenes.count, VALIDATION_BATCHES * batch), batch):
            indices = np.arange(start, min(start + batch, scenes.count))
            found = {name: value.to(device) for name, value in scenes.batch(indices, indices % scenes.lights, rng).items()}
            for name, answer in stage.answer(found).items():
                errors.setdefault(name, []).append(squared(answer, found[name], found["known"]))
    stage.network.train()
    return {name: float(np.mean(values)) for name, values in errors.items()}


def drawn(table, path):
    """The learning curve of a table of looks."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with open(table) as file:
        looks = list(csv.DictReader(file))
    figure, axes = pyplot.subplots(figsize=(7, 4))
    for name in looks[0]:
        if name not in ("step", "samples", "seconds"):
            axes.plot([int(look["samples"]) for look in looks], [float(look[name]) for look in looks], label=name)
    axes.set(xlabel="training samples seen", yscale="log", title=f"{table.stem}: on the validation scenes")
    axes.legend()
    figure.savefig(path, dpi=120, bbox_inches="tight")
    pyplot.close(figure)


def main():
    asked = arguments.parse_args()
    torch.manual_seed(asked.seed)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    train, val = Scenes(asked.train, asked.noisy), Scenes(asked.val, asked.noisy)
    asked.out.mkdir(parents=True, exist_ok=True)
    stage = STAGES[asked.network](device, asked.out)
    millions = parameters(stage.network) / 1e6
    print(f"{asked.network}: {millions:.2f} M parameters (paper's tables: {PUBLISHED[asked.network]:.2f} M), {device}")
    optimizer = torch.optim.Adam(stage.network.parameters(), lr=5e-4)
    schedule = torch.optim.lr_scheduler.StepLR(optimizer, step_size=2, gamma=0.1)
    state, table = asked.out / f"{asked.network}.pt", asked.out / f"{asked.network}.csv"
    step, spent = 0, 0.0
    if state.exists():
        saved = torch.load(state, map_location=device, weights_only=True)
        stage.network.load_state_dict(saved["network"])
        optimizer.load_state_dict(saved["optimizer"])
        schedule.load_state_dict(saved["schedule"])
        step, spent = saved["step"], saved["seconds"]
        print(f"going on from step {step}")
    per_epoch = train.count * train.lights // asked.batch
    began, losses = time.monotonic() - spent, []

    def save():
        errors = looked_at(stage, val, asked.batch, device)
        look = {"step": step, "samples": step * asked.batch, "seconds": round(time.monotonic() - began)}
        look |= {"loss": float(np.mean(losses)) if losses else float("nan"), **errors}
        new = not table.exists()
        with open(table, "a", newline="") as file:
            writer = csv.DictWriter(file, look)
            if new:
                writer.writeheader()
            writer.writerow(look)
        kept = {"network": stage.network.state_dict(), "optimizer": optimizer.state_dict()}
        kept |= {"schedule": schedule.state_dict(), "step": step, "seconds": time.monotonic() - began}
        torch.save(kept, state.with_suffix(".building"))
        os.replace(state.with_suffix(".building"), state)
        drawn(table, state.with_suffix(".png"))
        shown = " ".join(f"{name} {value:.4f}" for name, value in look.items() if name not in ("step", "samples", "seconds"))
        print(f"epoch {step / per_epoch:.2f}/{asked.epochs} {look['seconds']} s: {shown}", flush=True)
        losses.clear()

    stop = time.monotonic() + 60 * asked.minutes
    epoch, order = None, None
    while step < asked.epochs * per_epoch:
        if step // per_epoch != epoch:
            epoch = step // per_epoch
            order = pairs(train, asked.seed, epoch)
        chosen = order[step % per_epoch * asked.batch :][: asked.batch]
        rng = np.random.default_rng([asked.seed, step])
        found = {name: value.to(device) for name, value in train.batch(*chosen.T, rng).items()}
        loss = stage.loss(stage.answer(found), found)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
        step += 1
        if step % per_epoch == 0:
            schedule.step()
        if step % asked.look_every == 0 or step == asked.epochs * per_epoch or time.monotonic() > stop:
            save()
        if time.monotonic() > stop:
            return


if __name__ == "__main__":
    main()
