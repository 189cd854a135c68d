"""`python3 -m models.compact.infrared RUN --val DIR…`: what the depth camera's infrared picture tells the network of surfaces.

Its errors with the infrared picture and with that left out, on the same lessons; half of the captures it was trained on had none.
"""

import argparse
from pathlib import Path

import torch

from .tasks import AMPLITUDE, Surfaces
from .train import looked_at

arguments = argparse.ArgumentParser(prog="models.compact.infrared", description=__doc__.split("\n")[0])
arguments.add_argument("run", type=Path, help="folder of a run")
arguments.add_argument("--val", nargs="+", required=True, help="folders of validation lessons, each measured by itself")


class WithoutInfrared(Surfaces):
    """The same network, of captures without infrared picture."""

    def errors(self, batch):
        sight = batch["sight"].clone()
        sight[:, AMPLITUDE] = 0
        return super().errors({**batch, "sight": sight})


def main():
    asked = arguments.parse_args()
    weights = torch.load(asked.run / "surfaces.pt", weights_only=True)["average"]
    found = [looked_at(task(), asked.val, weights) for task in (Surfaces, WithoutInfrared)]
    print("| lessons | closed form | with infrared | without |")
    print("|---|---|---|---|")
    for name in found[0]:
        folder, what = name.split(" ", 1)
        if not what.startswith("closed"):
            figures = (found[0][f"{folder} closed {what}"], found[0][name], found[1][name])
            print(f"| {name} | " + " | ".join(f"{100 * figure:.3f}e-2" for figure in figures) + " |")


if __name__ == "__main__":
    main()
