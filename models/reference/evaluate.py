"""`python3 -m models.reference.evaluate RUN SHARDS… --size 256 --split-name test`: errors of a run's networks on a split.

Every scene under every light, each variant that RUN holds. Printed as a table beside the paper's figures and written to
RUN/evaluation-SPLIT.json, and one line per scene and light to RUN/evaluation-SPLIT-VARIANT.csv, PSNR by light direction.
"""

import argparse
import csv
import json
import math
from pathlib import Path

import numpy as np
import torch

from . import checkpoint
from .losses import squared
from .scenes import Scenes
from .stages import VARIANTS, Decompose, FiveLights, Shadow, Synthesis, one_bounce, stage

OUTPUTS = ("albedo", "normal", "roughness", "shadow", "relit")

PAPER = {
    "clean": {"albedo": 0.72e-2, "normal": 1.53e-2, "roughness": 4.18e-2, "shadow": 1.26e-2, "relit": 0.40e-2},
    "noisy": {"albedo": 0.48e-2, "normal": 1.85e-2, "roughness": 4.23e-2, "shadow": 5.53e-2, "relit": 0.54e-2},
    "env": {"albedo": 0.99e-2, "normal": 1.60e-2, "roughness": 4.47e-2},
    "sips": {"albedo": 4.84e-2, "normal": 3.81e-2, "roughness": 1.93e-1},
}
"""Mean squared errors of the paper's table; it does not say whether normals are on [0, 1] or [-1, 1]."""

BANDS = ((0, 20), (20, 40), (40, 60), (60, 91))
"""Degrees between the light and the view."""

arguments = argparse.ArgumentParser(prog="models.reference.evaluate", description=__doc__.split("\n")[0])
arguments.add_argument("run", type=Path)
arguments.add_argument("shards", type=Path, nargs="+", help="folders of shards")
arguments.add_argument("--size", type=int, default=256)
arguments.add_argument("--split-name", default="test")
arguments.add_argument("--variant", nargs="+", default=["clean", "noisy", "env", "sips", "oss"])
arguments.add_argument("--scenes", type=int, help="the first so many instead of all")
arguments.add_argument("--threads", type=int, default=1)
arguments.add_argument("--seed", type=int, default=0, help="of the depth noise, one map a scene")


def held(run, variant):
    """The trained stages of that variant, by network name, as far as the run has them."""
    stages = {}
    for network, variants in VARIANTS.items():
        file = checkpoint.path(run, network, variant)
        if variant in variants and file.exists():
            stages[network] = stage(network, variant)
            checkpoint.warmed(stages[network].network, file).eval()
    return stages


def answers(stages, found, inferred):
    """What the stages make of one scene under one light; `inferred` keeps what does not change with the light."""
    for one in stages.values():
        if isinstance(one, Decompose) and not inferred:
            inferred.update(one.answer(found))
    given = dict(inferred)
    for one in stages.values():
        if isinstance(one, Shadow | FiveLights):
            given |= one.answer(found)
    synthesis = stages.get("synthesis")
    if isinstance(synthesis, Synthesis) and {"albedo", "shadow"} <= given.keys():
        fed = found | given | {"render": one_bounce(given, found)}
        given["relit"] = synthesis.network(torch.cat([fed[name] for name in synthesis.given], 1))
    return given


def errors(given, found):
    """Mean squared errors over known pixels, light and albedo cut to [0, 1], normals on [-1, 1]."""
    cut = lambda name, picture: picture.clamp(0, 1) if name in ("albedo", "relit") else picture
    return {name: squared(cut(name, given[name]), cut(name, found[name]), found["known"]) for name in OUTPUTS if name in given}


def measured(run, shards, variant, size, at_most=None, seed=0):
    """A list of dicts, one per scene and light; empty where the run has nothing of the variant."""
    stages = held(run, variant)
    needs = {name for one in stages.values() for name in one.needs}
    if not stages:
        return []
    scenes = Scenes(shards, sorted(needs), variant == "noisy", variant == "oss")
    lines, last, inferred = [], None, {}
    each = next((one.lights for one in stages.values() if one.lights != "one"), "one")
    for number, (shard, scene, light) in enumerate(rows := scenes.samples(size, each, at_most)):
        if (shard, scene) != last:
            last, inferred = (shard, scene), {}
        # The same generator for every light: one noisy depth map a scene.
        found = scenes.batch(rows[number : number + 1], size, np.random.default_rng([seed, shard, scene]))
        with torch.no_grad():
            made = errors(answers(stages, found, inferred), found)
        folder = scenes.shards[shard].folder
        x, y, z = (float(v) for v in found["light"][0])
        line = {"scene": f"{folder.name}/{scene}", "light": int(light), "x": x, "y": y, "z": z}
        line |= {"degrees": math.degrees(math.acos(min(z, 1))), "known": float(found["known"].mean())}
        if "shadow" in found:
            line["shadowed"] = 1 - float((found["shadow"] * found["known"]).sum() / found["known"].sum())
        line |= made
        line |= {f"{name}_psnr": -10 * math.log10(max(made[name], 1e-10)) for name in ("shadow", "relit") if name in made}
        lines.append({name: round(value, 6) if isinstance(value, float) else value for name, value in line.items()})
        if number % 50 == 49 or number + 1 == len(rows):
            print(f"\r{variant}: {number + 1}/{len(rows)} pictures", end="", flush=True)
    print()
    return lines


def summary(lines):
    """Means over all lines, means by the light's angle, and the worst by each error."""
    names = [name for name in OUTPUTS if name in lines[0]]
    mean = lambda name, chosen: float(np.mean([line[name] for line in chosen]))
    means = {name: mean(name, lines) for name in names}
    if "normal" in means:
        means["normal_01"] = means["normal"] / 4
    bands = {}
    for low, high in BANDS:
        chosen = [line for line in lines if low <= line["degrees"] < high]
        if chosen:
            lit = [name for name in names if name in ("shadow", "relit")]
            bands[f"{low}-{min(high, 90)}"] = {name: mean(name, chosen) for name in lit} | {"pictures": len(chosen)}
    worst = {}
    for name in names:
        of_scenes = {}
        for line in sorted(lines, key=lambda line: -line[name]):
            of_scenes.setdefault(line["scene"], line)
        worst[name] = list(of_scenes.values())[:3]
    scenes = len({line["scene"] for line in lines})
    return {"mse": means, "scenes": scenes, "pictures": len(lines), "by_degrees": bands, "worst": worst}


def table(found):
    """The report as Markdown, errors times 100, the paper's in brackets."""
    lines = ["| variant | albedo | normal, [0,1] | normal, [-1,1] | roughness | shadow | relit |", "|---" * 7 + "|"]
    for variant, result in found.items():
        cells = []
        for name in ("albedo", "normal_01", "normal", "roughness", "shadow", "relit"):
            value, paper = result["mse"].get(name), PAPER.get(variant, {}).get(name.removesuffix("_01"))
            told = "–" if value is None else f"{100 * value:.2f}e-2"
            cells.append(told + (f" ({100 * paper:.2f}e-2)" if paper else ""))
        lines.append(f"| {variant} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main():
    asked = arguments.parse_args()
    torch.set_num_threads(asked.threads)
    file = asked.run / f"evaluation-{asked.split_name}.json"
    report = json.loads(file.read_text()) if file.exists() else {"split": asked.split_name, "variants": {}}
    for variant in asked.variant:
        lines = measured(asked.run, asked.shards, variant, asked.size, asked.scenes, asked.seed)
        if not lines:
            continue
        with open(asked.run / f"evaluation-{asked.split_name}-{variant}.csv", "w", newline="") as out:
            writer = csv.DictWriter(out, lines[0])
            writer.writeheader()
            writer.writerows(lines)
        report["variants"][variant] = summary(lines) | {"size": asked.size}
        file.write_text(json.dumps(report, indent=1) + "\n")
    if not report["variants"]:
        raise SystemExit(f"{asked.run}: holds no trained network; train one with `python3 -m models.reference.train`")
    print(table(report["variants"]))


if __name__ == "__main__":
    main()
