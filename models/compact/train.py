"""`python3 -m models.compact.train surfaces --lessons DIR… --val DIR… --out RUN --minutes 20`: trains, or goes on.

RUN/NAME.pt is the whole state: the same command goes on with it. RUN/NAME.csv has a line for every look at the validation lessons.
"""

import argparse
import csv
import math
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import torch

from ..reference.checkpoint import Average, saved
from .lessons import Lessons
from .networks import parameters
from .tasks import TASKS

arguments = argparse.ArgumentParser(prog="models.compact.train", description=__doc__.split("\n")[0])
arguments.add_argument("network", choices=TASKS)
arguments.add_argument("--lessons", nargs="+", required=True, help="folders of lessons")
arguments.add_argument("--val", nargs="+", required=True, help="folders of validation lessons, each measured by itself")
arguments.add_argument("--out", type=Path, required=True, help="folder of the run")
course = arguments.add_mutually_exclusive_group(required=True)
course.add_argument("--minutes", type=float, help="of the whole course; the rate falls to nothing toward its end")
course.add_argument("--steps", type=int, help="of the whole course, where courses are to be compared whatever else the machine does")
arguments.add_argument("--rate", type=float, default=2e-3, help="highest learning rate")
arguments.add_argument("--batch", type=int, default=8)
arguments.add_argument("--side", type=int, default=128, help="pixels on a side of what is cut out")
arguments.add_argument("--widths", type=int, nargs="+", help="channels at every size, from the largest [default: the network's own]")
arguments.add_argument("--patch", type=int, help="light: pixels on a side that become one at the largest size")
arguments.add_argument("--threads", type=int, default=2)
arguments.add_argument("--seed", type=int, default=1)
arguments.add_argument("--look-minutes", type=float, default=3.0)
arguments.add_argument("--turned", action="store_true", help="exchange rows and columns in half of the pictures")
arguments.add_argument("--without", nargs="+", default=[], help="light: arrays that the network is not shown")
arguments.add_argument("--with-distance", action="store_true", help="light: show the network how far off what casts a shadow is")
arguments.add_argument("--teacher", type=Path, help="light: learn half from what the network of this .pt says")
arguments.add_argument("--told", action="store_true", help="light: learn half from the shadows of another method, LESSON.told.npy")
arguments.add_argument("--warm", type=Path, help="start from the weights of this .pt")


def looked_at(task, folders, weights):
    """Errors on every validation folder, each scene's first two lamps, and those of the closed form, by folder and name."""
    network, found = task.network, {}
    # What another method told is learned from, and never measured by.
    names = [name for name in task.names if name != "told"]
    own = {name: value.clone() for name, value in network.state_dict().items()}
    network.load_state_dict(weights)
    network.eval()
    for folder in folders:
        lessons, sums = Lessons([folder], names), []
        for number in range(len(lessons.kept)):
            side = min(lessons.kept[number]["sight"].shape[-2:])
            for lamp in (0, 7) if "toward" in names else (0,):
                lamp = min(lamp, len(lessons.kept[number]["toward"]) - 1)
                batch = {k: v[None] for k, v in lessons.one(number, lamp, (0, 0, side), (0, 0)).items()}
                with torch.no_grad():
                    after, before = task.errors(batch)[0], task.before(batch)
                sums.append({**{k: float(v) for k, v in after.items()}, **{f"closed {k}": float(v) for k, v in before.items()}})
        for name in sums[0]:
            found[f"{Path(folder).name} {name}"] = float(np.mean([line[name] for line in sums]))
    network.load_state_dict(own)
    network.train()
    return found


def main():
    asked = arguments.parse_args()
    torch.manual_seed(asked.seed)
    torch.set_num_threads(asked.threads)
    asked.out.mkdir(parents=True, exist_ok=True)
    shape = {"widths": tuple(asked.widths) if asked.widths else None, "patch": asked.patch}
    task = TASKS[asked.network](**{name: value for name, value in shape.items() if value})
    if asked.network == "light":
        task.studies(asked.without, asked.with_distance, asked.teacher, asked.told)
    network = task.network.to(memory_format=torch.channels_last)
    average, optimizer = Average(network), torch.optim.AdamW(network.parameters(), asked.rate, weight_decay=1e-4)
    file, done, steps = asked.out / f"{asked.network}.pt", 0.0, 0
    if asked.warm and not file.exists():
        network.load_state_dict(torch.load(asked.warm, weights_only=True)["average"])
        average = Average(network)
    if file.exists():
        kept = torch.load(file, weights_only=True)
        network.load_state_dict(kept["weights"])
        optimizer.load_state_dict(kept["optimizer"])
        average.weights, average.steps = kept["average"], kept["steps"]
        done, steps = kept["seconds"], kept["steps"]
    lessons, dice = Lessons(asked.lessons, task.names), np.random.default_rng([asked.seed, steps])
    print(f"{asked.network}: {parameters(network) / 1e6:.3f} M parameters, {len(lessons.files)} lessons, {lessons.lamps} lamps")
    losses, looked = [], time.monotonic()
    over = lambda: steps / asked.steps if asked.steps else done / (60 * asked.minutes)

    def look():
        line = {"seconds": round(done), "steps": steps, "loss": round(float(np.mean(losses or [0])), 5)}
        line |= {k: round(v, 6) for k, v in looked_at(task, asked.val, average.weights).items()}
        losses.clear()
        table = file.with_suffix(".csv")
        fresh = not table.exists()
        with open(table, "a", newline="") as out:
            writer = csv.DictWriter(out, line)
            if fresh:
                writer.writeheader()
            writer.writerow(line)
        state = {"weights": network.state_dict(), "average": average.weights, "optimizer": optimizer.state_dict()}
        state |= {"seconds": done, "steps": steps, "seed": asked.seed, "lessons": [f.stem for f in lessons.files]}
        saved(file, state | {"command": "python3 -m models.compact.train " + " ".join(sys.argv[1:])})
        print(" | ".join(f"{name} {value}" for name, value in line.items()), flush=True)

    with ThreadPoolExecutor(1) as hand:
        made = lambda: lessons.batch(dice, asked.batch, asked.side, asked.turned)
        waiting = hand.submit(made)
        while over() < 1:
            batch, waiting = waiting.result(), hand.submit(made)
            began = time.monotonic()
            for group in optimizer.param_groups:
                group["lr"] = asked.rate * min(1.0, (steps + 1) / 200) * 0.5 * (1 + math.cos(math.pi * over()))
            task.drop(batch, dice)
            loss = task.loss(batch)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
            average.follow(network)
            losses.append(float(loss.detach()))
            done, steps = done + time.monotonic() - began, steps + 1
            if time.monotonic() > looked + 60 * asked.look_minutes:
                look()
                looked = time.monotonic()
        waiting.cancel()
    look()


if __name__ == "__main__":
    main()
