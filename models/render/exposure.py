"""What exposure a shot of a rendered scene is taken at."""

import numpy as np


def exposed(scene, channels):
    """The photographs at the exposure of a shot: flash alone, the room's light if it is lit, and the flash's intensity.

    One surface pixel in a hundred is above 0.7 in the light of the flash."""
    known = channels["mask"]
    bright = np.percentile(channels["flash"][known].max(-1), 99) if known.any() else 1.0
    intensity = float(np.float32(0.7 / max(bright, 1e-6)))
    found = {"flash": channels["flash"] * intensity, "intensity": intensity}
    if "ambient" in channels:
        ambient = channels["ambient"]
        found["ambient"] = ambient * (scene.ambient["share"] * found["flash"][known].mean() / max(ambient[known].mean(), 1e-9))
    return found
