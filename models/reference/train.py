"""`python3 -m models.reference.train shadow|decompose|synthesis --train ROOT… --val ROOT… --out RUN`: trains a network.

The roots hold rendered shards. RUN receives `NETWORK-VARIANT.pt`, from which an interrupted run goes on, `.csv`, a line per
look at the validation scenes, and `.png`, the learning curve. `synthesis` needs the other two networks' weights, which stay as
they are: from RUN, or from --shadow and --decompose. README.md has the schedules, the published one among them.
"""

import argparse
import os
import signal
import time
from pathlib import Path

# Two threads that wait by spinning take the time of those that work; read when torch is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numpy as np  # noqa: E402
import torch  # noqa: E402

from . import curves, loading  # noqa: E402
from .networks import parameters  # noqa: E402
from .phases import Phase, batches  # noqa: E402
from .run import Run, on  # noqa: E402
from .scenes import Scenes  # noqa: E402
from .stages import PUBLISHED, VARIANTS  # noqa: E402

DEFAULT = ("64:4:200000", "128:4:60000", "256:2:4000")
"""Phases where none are given."""

fractions = lambda text: [float(value) for value in text.split(",") if value]

arguments = argparse.ArgumentParser(prog="models.reference.train", description=__doc__.split("\n")[0])
arguments.add_argument("network", choices=VARIANTS)
arguments.add_argument("--variant", default="clean", help="clean, noisy, env, sips (decompose) or oss (synthesis)")
arguments.add_argument("--train", type=Path, nargs="+", required=True, help="folders of training shards")
arguments.add_argument("--val", type=Path, nargs="+", required=True, help="folders of validation shards")
arguments.add_argument("--out", type=Path, required=True)
arguments.add_argument("--phase", type=Phase.read, action="append", help="SIZE:BATCH:SAMPLES or SIZE:BATCH:MINUTESm")
arguments.add_argument("--rate", type=float, default=5e-4, help="learning rate at first")
arguments.add_argument("--drops", type=fractions, default=[0.7, 0.9], help="fractions of the course from which it is a tenth")
arguments.add_argument("--bfloat16", action="store_true", help="convolutions in bfloat16; weights and losses stay float")
arguments.add_argument("--crops", type=float, default=0.25, help="share of larger pictures that are cut, not only reduced")
arguments.add_argument("--no-mirror", action="store_true", help="do not mirror half of the samples left to right")
arguments.add_argument("--warm", type=Path, help="start from the weights of a .pt or .onnx file")
arguments.add_argument("--shadow", type=Path, help="synthesis: ShadowNet's weights, .pt or .onnx")
arguments.add_argument("--decompose", type=Path, help="synthesis: DecomposeNet's weights, .pt or .onnx")
arguments.add_argument("--minutes", type=float, default=float("inf"), help="stop, saved, after so long")
arguments.add_argument("--look-minutes", type=float, default=4, help="between looks at the validation scenes, which save")
arguments.add_argument("--look-scenes", type=int, default=40)
arguments.add_argument("--look-size", type=int, default=128)
arguments.add_argument("--threads", type=int, default=os.cpu_count())
arguments.add_argument("--seed", type=int, default=1)


def command(asked):
    """The invocation with folders by their own names alone: it is published with the weights."""
    kept = ["python3 -m models.reference.train", asked.network]
    for name, value in vars(asked).items():
        if name in ("network", "phase", "threads") or value is None or value is False or value == arguments.get_default(name):
            continue
        shown = [v.name if isinstance(v, Path) else f"{v:g}" if isinstance(v, float) else str(v) for v in np.ravel(value)]
        kept.append(f"--{name.replace('_', '-')}")
        if value is not True:
            kept.append(("," if name == "drops" else " ").join(shown))
    for phase in asked.phase:
        kept.append(f"--phase {phase.size}:{phase.batch}:{phase.share:g}{'m' if phase.timed else ''}")
    return " ".join(kept)


def main():
    asked = arguments.parse_args()
    asked.phase = asked.phase or [Phase.read(text) for text in DEFAULT]
    torch.manual_seed(asked.seed)
    torch.set_num_threads(asked.threads)
    asked.out.mkdir(parents=True, exist_ok=True)
    run = Run(asked)
    if run.file.exists():
        run.resume()
    noisy, five = asked.variant == "noisy", asked.variant == "oss"
    train = Scenes(asked.train, run.stage.needs, noisy, five, asked.crops, not asked.no_mirror)
    val = Scenes(asked.val, run.stage.needs, noisy, five)
    shards = [f"{shard.folder.parent.name}/{shard.folder.name}" for shard in train.shards]
    millions, scenes = parameters(run.stage.network) / 1e6, sum(shard.count for shard in train.shards)
    told = f"{millions:.2f} M parameters (the paper's tables: {PUBLISHED[asked.network]:.2f} M)"
    print(f"{asked.network} {asked.variant}: {told}")
    print(f"{scenes} training scenes in {len(shards)} shards; {run.device}, {asked.threads} threads", flush=True)

    stopped = []
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: stopped.append(True))
    stop, looked = time.monotonic() + 60 * asked.minutes, time.monotonic()
    table, losses = run.file.with_suffix(".csv"), []

    def look(phase, waiting):
        errors = run.looked_at(val)
        line = {"phase": run.number, "size": phase.size, "samples": run.all_samples, "seconds": round(run.all_seconds)}
        line |= {"rate": f"{run.optimizer.param_groups[0]['lr']:.1e}", "waiting": round(waiting, 3)}
        line |= {"loss": round(float(np.mean(losses)), 5), **{name: round(error, 6) for name, error in errors.items()}}
        losses.clear()
        curves.written(table, line)
        curves.drawn(table, table.with_suffix(".png"), f"{asked.network} {asked.variant}, validation at {asked.look_size}²")
        run.save(shards, command(asked))
        print(" ".join(f"{name} {value}" for name, value in line.items()), flush=True)

    while not run.finished():
        phase = run.course.phases[run.number]
        source = batches(train, run.stage, phase, run.number, asked.seed, run.samples)
        with loading.Prefetched(source) as ready:
            trained = 0.0
            while not run.phase_finished():
                began = time.monotonic()
                losses.append(run.learn(on(run.device, ready.next())))
                now = time.monotonic()
                run.went(phase.batch, now - began)
                trained += now - began
                ended = stopped or now > stop
                if ended or run.phase_finished() or now > looked + 60 * asked.look_minutes:
                    look(phase, ready.waited / trained)
                    looked = time.monotonic()
                    run.went(0, looked - now)
                if ended:
                    return print("stopped, saved; the same command goes on")
        run.number, run.samples, run.seconds = run.number + 1, 0, 0.0
        run.save(shards, command(asked))
    print("the course is finished")


if __name__ == "__main__":
    main()
