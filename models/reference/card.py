"""The card of a shipped model: what it was trained on and how, what it reaches beside the paper, where it fails."""

import json
import shutil

from . import checkpoint
from .evaluate import PAPER
from .stages import PUBLISHED

DOES = {
    "shadow": "points seen from the light to the cast-shadow map",
    "decompose": "the flash photograph and depth to albedo, normals and roughness",
    "synthesis": "shadow map, one-bounce picture, flash photograph, materials and points to the relit picture",
}
VARIANT = {
    "clean": "clean depth",
    "noisy": "depth with the paper's noise (σ = 6.25e-2 of its span, then a blur of one pixel)",
    "env": "the room's light left in the photograph, a mask given (the paper's Env variant)",
    "sips": "the photograph alone, no depth (stands for Li et al. 2018)",
    "oss": "five pictures under five lights in place of all else (stands for Xu et al. 2018)",
}


def figures(name, value, paper):
    told = f"{100 * paper:.2f}e-2" if paper else "–"
    return f"| {name} | {100 * value:.2f}e-2 | {told} |"


def reached(facts, trained, report):
    """Lines of the table of one report, and of its failures."""
    found = report["variants"][facts["variant"]]
    mse, paper = found["mse"], PAPER.get(facts["variant"], {})
    names = [name for name in trained.outputs if name in mse]
    about = f"{found['scenes']} scenes of the {report['split']} split at {found['size']}², {found['pictures']} pictures"
    lines = [f"Mean squared errors on {about}; light and albedo cut to [0, 1], surface alone:", ""]
    lines += ["| | here | the paper |", "|---|---|---|"]
    for name in names:
        if name == "normal":
            lines.append(figures("normal, [0, 1]", mse["normal_01"], paper.get("normal")))
        lines.append(figures("normal, [-1, 1]" if name == "normal" else name, mse[name], paper.get(name)))
    lines += ["", "## Where it fails", ""]
    for band, values in found["by_degrees"].items():
        lines += [f"- lights {band}° off the view: {name} {100 * values[name]:.2f}e-2" for name in names if name in values]
    for name in names:
        for line in found["worst"][name]:
            lit = f", {100 * line['shadowed']:.0f} % in shadow" if "shadowed" in line else ""
            at = f", light {line['degrees']:.0f}° off the view" if name in ("shadow", "relit") else ""
            fills = f"surface on {100 * line['known']:.0f} % of the picture"
            lines.append(f"- {name} {100 * line[name]:.2f}e-2 in scene {line['scene']}{at}{lit}, {fills}")
    return lines


def text(facts, trained, training, run):
    """The card in Markdown."""
    network, variant = facts["name"], facts["variant"]
    sizes = " and ".join(f"{size}²" for size in training["sizes"])
    lines = [f"# {network}, {variant}: the paper's network trained on our renders", ""]
    does = "five relit pictures and a light to the relit picture" if variant == "oss" else DOES[network]
    lines += [f"From {does}; {VARIANT[variant]}."]
    lines += ["Qiu et al. 2020; what goes in and out stands in `../manifest.toml`, how it is made in"]
    lines += ["`../reference/README.md`.", ""]
    tables = f"{facts['parameters'] / 1e6:.2f} M parameters (the paper's table: {PUBLISHED[network]:.2f} M)"
    lines += [f"{tables}, {facts['gflop_256']} GFLOP at 256².", ""]
    lines += ["## Training", "", f"    {facts['command']}", ""]
    lines += [f"- data: {training['scenes']} scenes in {training['shards']} shards of {sizes} pixels, rendered by `../render`"]
    lines += [f"- BLAKE3 of the data: `{facts['data']}`"]
    lines += [f"- seed {training['seed']}; {training['samples']:,} samples in {training['minutes']:.0f} minutes"]
    lines += ["- the running average of the weights is shipped"]
    lines += [f"- weights stored as {training['storage']}, which costs {training['cost']:+.4f} dB on validation scenes"]
    lines += [f"- ONNX Runtime within {training['apart']:.0e} of PyTorch", ""]
    lines += [f"![learning curve](paper-{network}-{variant}.png)", ""]
    lines += ["## What it reaches", ""]
    reports = [json.loads(file.read_text()) for file in sorted(run.glob("evaluation-*.json"))]
    measures = lambda report: report["variants"].get(variant, {}).get("mse", {}).keys()
    reports = [report for report in reports if set(trained.outputs) <= measures(report)]
    for report in reports:
        lines += [*reached(facts, trained, report), ""]
    if not reports:
        lines += ["Not measured on a test split; the curve shows the validation scenes.", ""]
    return "\n".join([*lines, "## Licence", "", f"{facts['licence']}, as the project.", ""])


def written(folder, facts, trained, training, run):
    """The card and its learning curve below the folder."""
    place = folder / facts["card"]
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(text(facts, trained, training, run))
    curve = checkpoint.path(run, facts["name"], facts["variant"]).with_suffix(".png")
    if curve.exists():
        shutil.copyfile(curve, place.with_suffix(".png"))
