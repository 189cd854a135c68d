"""`python3 -m models.compact.told LESSONS --captures DIR --program CAPTURECTL`: shadows of the paper's networks, LESSON.told.npy
beside every lesson, to learn from (`train.py --told`): bytes (lamps, height, width), 255 = lit.

They are told of the clean capture, however the lesson was spoiled.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from .lessons import arrays, files

arguments = argparse.ArgumentParser(prog="models.compact.told", description=__doc__.split("\n")[0])
arguments.add_argument("lessons", type=Path)
arguments.add_argument("--captures", type=Path, required=True, help="folder of the captures that the lessons were made of")
arguments.add_argument("--program", type=Path, required=True)
arguments.add_argument("--runtime", type=Path, help="ONNX Runtime's shared library")

asked = arguments.parse_args()
for file in files([asked.lessons]):
    if (done := file.with_suffix(".told.npy")).exists():
        continue
    lesson = arrays(file)
    with tempfile.TemporaryDirectory() as work:
        out = Path(work) / "relit"
        command = [asked.program, "relight", asked.captures / file.stem, "--tier", "paper", "--out", out]
        command += [f"--light={x},{y},{z}" for x, y, z in lesson["toward"]]
        command += ["--runtime", asked.runtime] if asked.runtime else []
        subprocess.run(command, check=True, capture_output=True)
        shadows = [np.array(Image.open(picture).convert("L")) for picture in sorted(out.glob("shadow_*.png"))]
    assert np.shape(shadows) == lesson["seen"].shape, file
    np.save(done, np.stack(shadows).astype(np.uint8))
