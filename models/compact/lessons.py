"""What `capturectl lessons` wrote, as batches.

Every file is a capture: arrays by name in the form of safetensors (Hugging Face, 2022): eight bytes with the length of a JSON
header, the header, the arrays.
"""

import json
from pathlib import Path

import numpy as np
import torch

KINDS = {"F16": np.float16, "F32": np.float32, "U8": np.uint8}


def arrays(file):
    """Arrays by name, mapped, not read."""
    whole = np.memmap(file, np.uint8, "r")
    length = int(whole[:8].view("<u8")[0])
    found = {}
    for name, facts in json.loads(whole[8 : 8 + length].tobytes()).items():
        if name != "__metadata__":
            first, last = facts["data_offsets"]
            kind = KINDS[facts["dtype"]]
            found[name] = whole[8 + length + first : 8 + length + last].view(kind).reshape(facts["shape"])
    return found


def files(folders):
    """Every lesson of the folders, in order; SystemExit where a folder has none."""
    found = []
    for folder in folders:
        here = sorted(Path(folder).glob("*.safetensors"))
        if not here:
            raise SystemExit(f"{folder}: holds no lesson; make some with capturectl lessons")
        found += here
    return found


class Lessons:
    """Lessons of a course; `names` of one network's arrays."""

    PER_LAMP = {"closed", "direct", "truth.relit", "seen", "thin", "thick", "truth.shadow", "toward", "distance", "told"}

    def __init__(self, folders, names):
        self.files, self.names = files(folders), names
        self.kept = [arrays(file) for file in self.files]
        for file, lesson in zip(self.files, self.kept, strict=True):
            for name in set(names) - set(lesson):
                lesson[name] = np.load(file.with_suffix(f".{name}.npy"), mmap_mode="r")
        self.lamps = sum(len(lesson["toward"]) for lesson in self.kept)

    def one(self, number, lamp, crop, mirror, turned=False):
        """Arrays of one lesson under one lamp: `crop` is (top, left, side), `mirror` a pair of truths, `turned` one of rows and columns."""
        top, left, side = crop
        found = {}
        for name in self.names:
            array = self.kept[number][name]
            if name in self.PER_LAMP:
                array = array[lamp]
            elif array.ndim == 4:
                array = array[0]
            if array.ndim == 1:
                found[name] = torch.from_numpy(array.astype(np.float32))
                continue
            array = array.reshape(-1, *array.shape[-2:])[:, top : top + side, left : left + side]
            array = torch.from_numpy(array.astype(np.float32))
            if self.kept[number][name].dtype == np.uint8:
                array /= 255
            found[name] = array
        for axis, mirrored in enumerate(mirror):
            if mirrored:
                self.mirrored(found, axis)
        return self.turned(found) if turned else found

    @staticmethod
    def mirrored(found, axis):
        """Left and right (axis 0) or up and down (axis 1) exchanged, directions too."""
        for name, array in found.items():
            if array.dim() == 3:
                found[name] = array = array.flip(2 - axis)
            if name in ("truth.normal", "sight", "ground", "toward", "view"):
                array[axis] *= -1

    @staticmethod
    def turned(found):
        """Rows and columns exchanged, so that right becomes down, and down right."""
        for name, array in found.items():
            if array.dim() == 3:
                found[name] = array = array.transpose(1, 2).contiguous()
            if name in ("truth.normal", "sight", "ground", "toward", "view"):
                array[[0, 1]] = -array[[1, 0]]
        return found

    def batch(self, dice, count, side, turned=False):
        """So many random places, one of four mirrorings each; `turned`, rows and columns are exchanged in half of them."""
        chosen = []
        for _ in range(count):
            number = int(dice.integers(len(self.kept)))
            height, width = self.kept[number]["sight"].shape[-2:]
            lamp = int(dice.integers(len(self.kept[number]["toward"])))
            crop = (2 * int(dice.integers((height - side) // 2 + 1)), 2 * int(dice.integers((width - side) // 2 + 1)), side)
            chosen.append(self.one(number, lamp, crop, dice.integers(2, size=2), turned and dice.random() < 0.5))
        return {name: torch.stack([one[name] for one in chosen]) for name in self.names}
