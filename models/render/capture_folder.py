"""Rendering one scene and writing it as a capture folder with truth."""

import json
import os
import shutil
from pathlib import Path

import cv2
import drjit as dr
import mitsuba as mi
import numpy as np
import OpenEXR

from . import environment
from .environment_maps import procedural, write_map
from .exposure import exposed
from .scene import FLIP
from .tof import amplitude, paper_noise, sensed
from .tracer import Camera, Lamp, Tracer, direct, indirect


def rendered(scene, size, direct_side=3, indirect_side=2, bounces=3, with_ambient=False, with_relit=True, environments=0):
    """Every channel of the scene as numpy arrays, NaN where a ray left the scene; radiance 0 there.

    Without relit pictures the lamps cost one shadow map each. `environments` maps, each a number of the scene's, light it too."""
    rng = np.random.default_rng([scene.facts["seed"], scene.facts["index"], 7])
    tracer, camera = Tracer(scene), Camera(size, scene.fov_degrees)
    lamps, flash = [Lamp(light * FLIP, False) for light in scene.lights], Lamp(scene.flash_position, True)
    room = [Lamp(at, True, power) for at, power in scene.ambient["lamps"]] if with_ambient else []
    h = tracer.hit(mi.Point3f(0), camera.rays(1, rng))
    dr.eval(h.__dict__)
    known = h.valid.numpy().reshape(size, size)
    truth = lambda q: np.where(known[..., None], camera.image(q, 1), np.nan).astype(np.float32)
    channels = {
        "mask": known,
        "depth": truth(h.p.z)[..., 0],
        "normal": truth(h.ns) * FLIP.astype(np.float32),
        "normal_smooth": truth(h.smooth) * FLIP.astype(np.float32),  # before relief; beyond what the folder format lists
        "albedo": truth(h.albedo),
        "roughness": truth(h.rough)[..., 0],
        "shadow": [tracer.visible(h, lamp).numpy().reshape(size, size) | ~known for lamp in lamps],
    }
    shining = [*(lamps if with_relit else []), flash, *room]
    lit, (albedo, normal) = direct(tracer, camera, shining, direct_side, rng)
    sky = None
    if bounces:
        more, sky = indirect(tracer, camera, shining, indirect_side, bounces, rng, scene.ambient if with_ambient else None)
        # only the smooth indirect part is denoised: shadow edges and highlights stay as traced
        clean = lambda image: environment.denoised(image, albedo, normal)
        covered = albedo.max(-1, keepdims=True) > 0
        lit = [a + clean(b) * covered for a, b in zip(lit, more)]
        sky = clean(sky) * covered if with_ambient else None
    at = shining.index(flash)
    channels["relit"], channels["flash"] = lit[:at], lit[at]
    if with_ambient:
        channels["ambient"] = sum(lit[at + 1 :]) + (sky if sky is not None else 0)
    facts = scene.facts
    numbers = [1000 * facts["index"] + 100 * k + facts["seed"] for k in range(environments)]
    maps = [procedural(number, scene.ambient["up"]) for number in numbers]
    under = lambda pixels: environment.lit(tracer, camera, environment.Environment(pixels), direct_side, bounces, rng)
    channels["environments"] = [(pixels, under(pixels)) for pixels in maps]
    channels["focal"], channels["centre"] = float(camera.f), float(camera.c)
    return channels


def measured(scene, channels, noise):
    """Depth (H, W) metres and amplitude as a depth camera delivers them: `none` is perfect, `paper` has the paper's noise on
    depth alone, `tof` is what `tof.Sensor` makes of both."""
    facts, depth = scene.facts, channels["depth"]
    camera = (channels["focal"], channels["focal"], channels["centre"], channels["centre"])
    clean = amplitude(channels["albedo"], channels["normal"], depth, camera, facts["index"], channels["roughness"])
    rng = np.random.default_rng([facts["seed"], facts["index"], 11])
    if noise == "tof":
        answer = sensed(depth, clean, channels["normal_smooth"], camera, rng)
        return answer.metres, answer.amplitude
    return (paper_noise(depth, rng) if noise == "paper" else depth), clean


def write(scene, channels, folder, size, depth_noise="none"):
    """The folder, complete or not there at all: it is written beside its place and renamed."""
    folder = Path(folder)
    building = folder.with_name(f".{folder.name}.{os.getpid()}")
    shutil.rmtree(building, ignore_errors=True)
    (building / "truth").mkdir(parents=True)
    known, light = channels["mask"], exposed(scene, channels)
    flash, intensity = light["flash"], light["intensity"]
    if "ambient" in light:
        exr(building / "ambient.exr", light["ambient"])
        flash = flash + light["ambient"]
    exr(building / "flash.exr", flash)
    depth, infrared = measured(scene, channels, depth_noise)
    exr(building / "depth.exr", depth)
    exr(building / "amplitude.exr", infrared)
    if not known.all():
        png(building / "mask.png", known)
    truth = building / "truth"
    for name in ("depth", "normal", "normal_smooth", "albedo", "roughness"):
        exr(truth / f"{name}.exr", channels[name])
    lines = ["# directions: x right, y up, z toward the camera, pointing toward the light"]
    for k, light in enumerate(scene.lights):
        exr(truth / f"relit_{k:03}.exr", channels["relit"][k])
        png(truth / f"shadow_{k:03}.png", channels["shadow"][k])
        at = ", ".join(f"{c:.6f}" for c in light)
        lines += ["[[light]]", f"direction = [{at}]", f'image = "relit_{k:03}.exr"', f'shadow = "shadow_{k:03}.png"', "intensity = [1.0, 1.0, 1.0]"]
    for k, (pixels, picture) in enumerate(channels["environments"]):
        write_map(truth / f"environment_{k:03}.hdr", pixels)
        exr(truth / f"environment_{k:03}.exr", picture)
    (truth / "lights.toml").write_text("\n".join(lines) + "\n")
    (truth / "scene.json").write_text(json.dumps(scene.facts, indent=1) + "\n")
    position = ", ".join(f"{c:.6f}" for c in scene.flash_position)
    f, c = channels["focal"], channels["centre"]
    (building / "capture.toml").write_text(
        f"""format = 1
[color]
width = {size}
height = {size}
fx = {f:.6f}
fy = {f:.6f}
cx = {c}
cy = {c}
distortion = {{ model = "none" }}
transfer = "linear"
black_level = 0.0
white_level = 1.0
[flash]
position_metres = [{position}]
intensity = {intensity:.8g}
"""
    )
    os.replace(building, folder)


def exr(path, image):
    """A float EXR: RGB for three channels, Y for one."""
    image = np.ascontiguousarray(image, np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB" if image.ndim == 3 else "Y": image}).write(str(path))


def png(path, yes):
    """An 8-bit PNG, 255 where true."""
    cv2.imwrite(str(path), np.where(yes, 255, 0).astype(np.uint8))
