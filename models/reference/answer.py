"""`python3 -m models.reference.answer FOLDER --light x,y,z --run RUN | --onnx models/weights --out DIR`: a capture folder relit.

What inference elsewhere is held against: DIR receives albedo.exr, normal.exr, roughness.exr and, numbered in the order of the
lights, shadow_NNN.exr and relit_NNN.exr, at the folder's own size, NaN where no surface is known.
"""

import argparse
from pathlib import Path

import numpy as np
import OpenEXR
import torch

from . import capture, checkpoint
from .evaluate import answers
from .stages import VARIANTS, stage


def direction(text):
    """A unit vector toward the light from `x,y,z`; x right, y up, z toward the camera."""
    light = torch.tensor([float(value) for value in text.split(",")])
    if light.shape != (3,) or not 0 < light.norm() < torch.inf or light[2] < 0:
        raise argparse.ArgumentTypeError(f"{text}: a light is x,y,z with z ≥ 0, not all zero")
    return light / light.norm()


arguments = argparse.ArgumentParser(prog="models.reference.answer", description=__doc__.split("\n")[0])
arguments.add_argument("folder", type=Path)
arguments.add_argument("--light", type=direction, action="append", required=True, help="x,y,z; repeat it")
source = arguments.add_mutually_exclusive_group(required=True)
source.add_argument("--run", type=Path, help="checkpoints, run by PyTorch")
source.add_argument("--onnx", type=Path, help="exported models, run by ONNX Runtime")
arguments.add_argument("--variant", default="clean", choices=("clean", "noisy"))
arguments.add_argument("--out", type=Path, required=True)


class Exported(torch.nn.Module):
    """An ONNX model in a network's place."""

    def __init__(self, file, given):
        import onnxruntime

        super().__init__()
        if not file.exists():
            raise SystemExit(f"{file}: not there; export it with `python3 -m models.reference.export`")
        self.session, self.given = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"]), given

    def raw(self, picture):
        parts = picture.contiguous().split([*self.given.values()], 1)
        found = self.session.run(None, {name: part.numpy() for name, part in zip(self.given, parts, strict=True)})
        return tuple(torch.from_numpy(answer) for answer in found)

    @staticmethod
    def finished(raw):
        return raw

    def forward(self, picture):
        return self.raw(picture)[0]


def networks(run, onnx, variant):
    """The three stages of the variant with weights from a run or from exported models."""
    stages = {network: stage(network, variant) for network in VARIANTS}
    for network, one in stages.items():
        if onnx:
            one.network = Exported(onnx / f"paper-{variant}-{network}.onnx", one.given)
        else:
            checkpoint.warmed(one.network, checkpoint.path(run, network, variant)).eval()
    return stages


def exr(path, picture, known):
    """A float EXR, RGB or Y, of (1, channels, height, width)."""
    pixels = np.where(known[0, 0, ..., None] > 0, picture[0].permute(1, 2, 0), np.nan).astype(np.float32)
    pixels = np.ascontiguousarray(pixels if pixels.shape[2] == 3 else pixels[..., 0])
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB" if pixels.ndim == 3 else "Y": pixels}).write(str(path))


def main():
    asked = arguments.parse_args()
    stages, inferred = networks(asked.run, asked.onnx, asked.variant), {}
    asked.out.mkdir(parents=True, exist_ok=True)
    for number, found in enumerate(capture.fed(asked.folder, asked.light)):
        with torch.no_grad():
            given = answers(stages, found, inferred)
        exr(asked.out / f"shadow_{number:03}.exr", given["shadow"], found["known"])
        exr(asked.out / f"relit_{number:03}.exr", given["relit"].clamp(min=0), found["known"])
    exr(asked.out / "albedo.exr", inferred["albedo"].clamp(0, 1), found["known"])
    exr(asked.out / "normal.exr", inferred["normal"], found["known"])
    exr(asked.out / "roughness.exr", inferred["roughness"], found["known"])


if __name__ == "__main__":
    main()
