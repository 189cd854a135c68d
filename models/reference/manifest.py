"""Entries of models/manifest.toml, which lists every model that captured accepts."""

import json
import re
import tomllib

SIGNALS = {
    "flash": ("linear light, white Lambertian facing the flash at the median distance = 1", 0, 2),
    "near": ("1 = nearest known surface, 0 = farthest and unknown", 0, 1),
    "mask": ("1 = surface", 0, 1),
    "cloud": ("half the scene's longest side, in the light's frame, about (0, 0, 1)", -1.8, 2.8),
    "shadow": ("share of the light that arrives directly", 0, 1),
    "render": ("linear light, white Lambertian facing the lamp = 1", 0, 2),
    "pictures": ("linear light, white Lambertian facing the lamp = 1; red, green, blue of five", 0, 2),
    "lights": ("unit vectors toward the five lamps, constant planes; x right, y up, z toward the camera", -1, 1),
    "light": ("unit vector toward the lamp, constant planes; x right, y up, z toward the camera", -1, 1),
    "albedo": ("linear reflectance; what leaves [0, 1] is to be cut when used", 0, 1),
    "normal": ("unit vector; x right, y up, z toward the camera", -1, 1),
    "roughness": ("Karis 2013", 0, 1),
    "sight": ("a scene in closed form, see src/relight/networks/compact/sight.rs; what leaves 0 to 1 is a normal, depth or amplitude", -2, 2),
    "lamp": ("a scene under a lamp in closed form, see src/relight/networks/compact/light.rs; what leaves 0 to 1 is a direction or depth", -2, 2),
    "factor": ("logarithm of what the albedo is multiplied with", -4, 4),
    "weight": ("how far to believe `shadow` instead of the sweep", 0, 1),
    "bounced": ("what is added to the light that is bounced onto a surface; white Lambertian facing the lamp = 1", -1, 1),
    "relit": ("linear light, white Lambertian facing the lamp = 1; what is below 0 is to be cut", 0, 2),
}
"""Unit, least and most of what goes in and out, by name."""


def entry(facts, given, outputs):
    """The text of one `[[model]]`: facts by key, then inputs and outputs as channels by name."""
    lines = ["[[model]]", *(f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in facts.items())]
    for kind, signals in (("input", given), ("output", outputs)):
        for name, channels in signals.items():
            unit, least, most = SIGNALS[name]
            shape = json.dumps(["1", str(channels), "height", "width"])
            lines += [f"[[model.{kind}]]", f"name = {json.dumps(name)}", f"shape = {shape}", f"unit = {json.dumps(unit)}"]
            lines += [f"range = [{least}, {most}]"]
    return "\n".join(lines) + "\n"


def written(path, facts, given, outputs):
    """The manifest with that model's entry put in place of the one of its name, variant and tier, or at the end."""
    text = path.read_text() if path.exists() else "format = 1\n"
    head, *models = re.split(r"(?m)^(?=\[\[model\]\]$)", text)
    which = lambda model: [model.get(key) for key in ("name", "variant", "tier")]
    kept = [model for model in models if which(tomllib.loads(model)["model"][0]) != which(facts)]
    place = next((i for i, model in enumerate(models) if model not in kept), len(kept))
    kept.insert(place, entry(facts, given, outputs))
    path.write_text("\n\n".join(part.strip() for part in [head, *kept]) + "\n")
