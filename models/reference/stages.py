"""The networks as they are trained: what each variant is given, what it answers, what it is held to.

Variants: `clean` and `noisy` depth; `env`, DecomposeNet with the room's light left in and a mask; `sips`, DecomposeNet
without depth; `oss`, SynthesisNet's size on five lit pictures.
"""

import torch

from .feeding import BRIGHTEST
from .losses import cross_entropy, with_gradients
from .networks import DecomposeNet, ShadowNet, SynthesisNet
from .shading import rendered

PUBLISHED = {"shadow": 5.92, "decompose": 14.70, "synthesis": 8.37}
"""Million parameters that the paper's tables give."""

VARIANTS = {"shadow": ("clean", "noisy"), "decompose": ("clean", "noisy", "env", "sips"), "synthesis": ("clean", "noisy", "oss")}


class Stage:
    """One network. `given` and `outputs` are channels by name in the network's order, also the names in ONNX."""

    lights = "each"
    """Which lights of a scene make a sample of their own (see `Shard.lights_of`)."""
    network_name: str
    given: dict
    outputs: dict
    needs: tuple

    def __init__(self, network):
        self.network = network.to(memory_format=torch.channels_last)

    def inputs(self, found):
        """What is given, by name, from a batch of `Scenes`."""
        return {name: found[name] for name in self.given}

    def raw(self, found):
        given = torch.cat([*self.inputs(found).values()], 1).contiguous(memory_format=torch.channels_last)
        return tuple(answer.float() for answer in self.network.raw(given))

    def answer(self, found):
        """The network's outputs by name."""
        return dict(zip(self.outputs, self.network.finished(self.raw(found)), strict=True))


class Shadow(Stage):
    network_name = "shadow"
    given, outputs = {"cloud": 3}, {"shadow": 1}
    needs = ("shadow",)

    def __init__(self, variant):
        super().__init__(ShadowNet())

    def loss(self, raw, found):
        return cross_entropy(raw[0], found["shadow"], found["known"])


class Decompose(Stage):
    network_name = "decompose"
    outputs = {"albedo": 3, "normal": 3, "roughness": 1}
    lights = "one"

    def __init__(self, variant):
        self.given = {"flash": 3, **({} if variant == "sips" else {"near": 1}), **({"mask": 1} if variant == "env" else {})}
        self.lit = "ambient" if variant == "env" else "flash"
        self.needs = ("flash", "intensity", "albedo", "normal", "roughness", *(["ambient"] if variant == "env" else []))
        super().__init__(DecomposeNet(sum(self.given.values())))

    def inputs(self, found):
        return super().inputs(found | {"flash": found[self.lit]})

    def loss(self, raw, found):
        known, (albedo, normal, _) = found["known"], self.network.finished(raw)
        values = with_gradients(albedo, found["albedo"], known) + with_gradients(normal, found["normal"], known)
        return values + cross_entropy(raw[2], found["roughness"].clamp(0, 1), known)


class Synthesis(Stage):
    """The other two networks, `shadow` and `decompose`, stay as they are."""

    network_name = "synthesis"
    given = {"shadow": 1, "render": 3, "flash": 3, "albedo": 3, "normal": 3, "roughness": 1, "cloud": 3}
    outputs = {"relit": 3}
    needs = ("flash", "intensity", "relit")

    def __init__(self, variant):
        super().__init__(SynthesisNet(sum(self.given.values())))
        self.before = [Shadow(variant), Decompose(variant)]
        for stage in self.before:
            stage.network.requires_grad_(False).eval()

    def inputs(self, found):
        with torch.no_grad():
            inferred = self.before[0].answer(found) | self.before[1].answer(found)
            return super().inputs(found | inferred | {"render": one_bounce(inferred, found)})

    def loss(self, raw, found):
        return with_gradients(raw[0], found["relit"], found["known"])


class FiveLights(Stage):
    """OSS: five pictures of the scene and their lights to the picture under another."""

    network_name = "synthesis"
    given, outputs = {"pictures": 15, "lights": 15, "light": 3}, {"relit": 3}
    lights = "others"
    needs = ("relit",)

    def __init__(self, variant):
        super().__init__(SynthesisNet(sum(self.given.values())))

    def inputs(self, found):
        planes = lambda light: light.flatten(1)[..., None, None].expand(-1, -1, *found["pictures"].shape[-2:])
        return {"pictures": found["pictures"], "lights": planes(found["five"]), "light": planes(found["light"])}

    loss = Synthesis.loss


def one_bounce(inferred, found):
    """The closed-form picture under the light from inferred materials, cut like every light the networks see."""
    parts = [inferred[name] for name in ("albedo", "normal", "roughness")]
    return rendered(*parts, found["light"], found["camera"]).clamp(0, BRIGHTEST)


def stage(network, variant):
    """The stage of that name with fresh weights; SystemExit where the network has no such variant."""
    if variant not in VARIANTS[network]:
        raise SystemExit(f"{network} has no variant {variant}: choose from {', '.join(VARIANTS[network])}")
    if variant == "oss":
        return FiveLights(variant)
    return {"shadow": Shadow, "decompose": Decompose, "synthesis": Synthesis}[network](variant)
