"""Scenes as plain arrays that train fast: one folder a shard, one .npy a channel, scene by scene.

A shard NNNN-MMMM holds scenes NNNN to MMMM and appears whole or not at all. N scenes, S pixels on a side, L lamps:

| file | shape | meaning |
|---|---|---|
| flash, ambient | N, 3, S, S half | light of the flash alone; room light at the same exposure, 0 where the room is dark |
| albedo, normal, normal_smooth | N, 3, S, S half | linear; unit, x right, y up, z toward the camera, with relief and before it |
| roughness | N, 1, S, S half | Karis', alpha = roughness² |
| amplitude | N, 1, S, S half | infrared picture of a perfect ToF camera, see `tof.amplitude` |
| depth | N, 1, S, S float | z in metres, NaN = no surface; every other channel is 0 there |
| light | N, L, 3 float | unit vectors toward the lamps |
| shadow | N, L, 1, S, S byte | 0 = the lamp's light does not reach the surface, 255 = it does, or no surface |
| relit | N, L, 3, S, S half | linear, indirect light included, white Lambertian facing the lamp = 1; not in cheap shards |
| camera | N, 4 float | fx, fy, cx, cy in pixels |
| intensity | N float | value in flash of a white Lambertian patch facing it at one metre |
"""

import os
import shutil
from pathlib import Path

import numpy as np

from .exposure import exposed
from .tof import amplitude

KINDS = {"depth": np.float32, "light": np.float32, "camera": np.float32, "intensity": np.float32, "shadow": np.uint8}
HIGHEST = 60000.0  # half precision ends at 65504


def arrays(scene, channels):
    """What a shard keeps of one scene, by name, channels first."""
    exposed_light = exposed(scene, channels)
    first = lambda picture: np.nan_to_num(picture if picture.ndim == 3 else picture[..., None]).transpose(2, 0, 1)
    kept = {name: first(channels[name]) for name in ("albedo", "normal", "normal_smooth", "roughness")}
    kept["flash"] = first(exposed_light["flash"])
    kept["ambient"] = first(exposed_light.get("ambient", np.zeros_like(channels["flash"])))
    kept["depth"] = channels["depth"][None]
    camera = np.array([channels["focal"], channels["focal"], channels["centre"], channels["centre"]])
    surface = (channels[name] for name in ("albedo", "normal", "depth"))
    kept["amplitude"] = first(amplitude(*surface, camera, scene.facts["index"], channels["roughness"]))
    kept["light"] = scene.lights
    kept["shadow"] = np.stack([np.where(lit, 255, 0)[None] for lit in channels["shadow"]])
    if channels["relit"]:
        kept["relit"] = np.stack([first(picture) for picture in channels["relit"]])
    kept["camera"] = camera
    kept["intensity"] = np.array(exposed_light["intensity"])
    return kept


def write(scenes, folder):
    """The shard of those scenes (what `arrays` gave), complete or not there at all."""
    folder = Path(folder)
    building = folder.with_name(f".{folder.name}.{os.getpid()}")
    shutil.rmtree(building, ignore_errors=True)
    building.mkdir(parents=True)
    for name in scenes[0]:
        stacked = np.stack([scene[name] for scene in scenes])
        kind = KINDS.get(name, np.float16)
        np.save(building / f"{name}.npy", (stacked.clip(-HIGHEST, HIGHEST) if kind is np.float16 else stacked).astype(kind))
    os.replace(building, folder)
