"""SurfacesNet and LightNet: small U-Nets that correct what a closed form says; what they add starts at nothing.

Pictures are (batch, channels, height, width), height and width multiples of 32. What goes in is made by `capturectl lessons`
and described in `src/relight/networks/compact`.
"""

import torch
from torch import nn
from torch.nn import functional

SLOPE = 0.1
"""Of LeakyReLU below zero."""


def active(picture):
    return functional.leaky_relu(picture, SLOPE)


class Residual(nn.Module):
    """One 3×3 convolution beside the way straight on."""

    def __init__(self, width):
        super().__init__()
        self.layer = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, picture):
        return picture + active(self.layer(picture))


class Hourglass(nn.Module):
    """A part of the size (1/`patch`), halved further once a width, and back; nothing is up-convolved."""

    def __init__(self, channels, widths, blocks, patch=2):
        super().__init__()
        self.stem = nn.Conv2d(channels, widths[0], patch, patch)
        self.before = nn.ModuleList(Residual(width) for width in widths[:-1])
        self.down = nn.ModuleList(nn.Conv2d(a, b, 3, 2, 1) for a, b in zip(widths, widths[1:]))
        self.deepest = nn.Sequential(*(Residual(widths[-1]) for _ in range(blocks)))
        self.up = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in zip(widths, widths[1:]))
        self.after = nn.ModuleList(Residual(width) for width in widths[:-1])

    def forward(self, picture):
        picture, kept = active(self.stem(picture)), []
        for before, down in zip(self.before, self.down, strict=True):
            picture = before(picture)
            kept.append(picture)
            picture = active(down(picture))
        picture = self.deepest(picture)
        for up, after, beside in reversed(list(zip(self.up, self.after, kept, strict=True))):
            picture = after(functional.interpolate(up(picture), scale_factor=2, mode="nearest") + beside)
        return picture


def quiet(layer):
    """A last layer that starts by saying nothing."""
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
    return layer


class SurfacesNet(nn.Module):
    """16 planes of a scene to what is added to its normals, the logarithm of the factor of its albedo, and its roughness.

    The closed form's albedo is the flash's light over the cosine of its own normal; with another normal it is divided anew, and the
    factor is of what that gives. In training also the relative step of its depth and the sigma of that, which teach it shape. They
    are not shipped: steps in depth are too small to help the sweep, and stated sigmas soften the shadows of clean depth."""

    SHIPPED = slice(0, 7)
    SAID = 9

    def __init__(self, widths=(32, 48, 64, 96), blocks=3):
        super().__init__()
        self.hourglass = Hourglass(16, widths, blocks)
        self.head = quiet(nn.Conv2d(widths[0], 4 * self.SAID, 3, padding=1))

    def said(self, sight):
        return functional.pixel_shuffle(self.head(self.hourglass(sight)), 2)

    @staticmethod
    def finished(sight, said):
        """(normal, factor, roughness) of seven planes said."""
        # All of it as far as depth is in doubt; roughness is a step from the closed form's in logits. Where depth is exact the network
        # betters albedo by a tenth on rendered scenes, and without this gate three photographed things lost
        # 0.2, 1.1 and 0.3 dB of relit light against the closed form.
        before, doubt = sight[:, 8:9].clamp(0.02, 0.98), (8 * sight[:, 11:12]).clamp(0, 1)
        roughness = torch.sigmoid(torch.log(before / (1 - before)) + doubt * said[:, 6:7])
        return doubt * said[:, 0:3], doubt * said[:, 3:6], roughness

    def taught(self, sight):
        """(normal, factor, roughness, depth, sigma), as training wants them."""
        said = self.said(sight)
        depth = 0.1 * torch.tanh(said[:, 7:8])
        sigma = torch.exp(said[:, 8:9].clamp(-4, 4) - 6)
        return *self.finished(sight, said[:, self.SHIPPED]), depth, sigma

    def shipped(self):
        """The network without what only training wants."""
        return Shipped(self)


class Shipped(nn.Module):
    """SurfacesNet with a head for what is asked of it in use."""

    def __init__(self, network):
        super().__init__()
        kept = range(4 * network.SHIPPED.start, 4 * network.SHIPPED.stop)
        self.hourglass = network.hourglass
        self.head = nn.Conv2d(network.head.in_channels, len(kept), 3, padding=1)
        self.head.load_state_dict({name: value[kept] for name, value in network.head.state_dict().items()})

    def forward(self, sight):
        said = functional.pixel_shuffle(self.head(self.hourglass(sight)), 2)
        return SurfacesNet.finished(sight, said)


class LightNet(nn.Module):
    """17 planes of a scene under a lamp to (weight, shadow, bounced): how far to believe `shadow` instead of the sweep, both in
    [0, 1], and what is added to the light that is bounced onto a surface."""

    def __init__(self, widths=(24, 48, 64, 96), blocks=3, channels=17, patch=4):
        super().__init__()
        self.patch = patch
        self.hourglass = Hourglass(channels, widths, blocks, patch)
        self.shadow = quiet(nn.Conv2d(widths[0], patch * patch * 2, 3, padding=1))
        self.bounced = quiet(nn.Conv2d(widths[0], 3, 3, padding=1))

    @classmethod
    def of(cls, weights):
        """A network of these weights."""
        stem, downs = weights["hourglass.stem.weight"], [name for name in weights if name.startswith("hourglass.down") and "bias" in name]
        blocks = sum(name.startswith("hourglass.deepest") and name.endswith("bias") for name in weights)
        network = cls((len(stem), *(len(weights[name]) for name in downs)), blocks, stem.shape[1], stem.shape[2])
        network.load_state_dict(weights)
        return network

    def shipped(self):
        """All of it."""
        return self

    def forward(self, lamp):
        features = self.hourglass(lamp)
        said = functional.pixel_shuffle(self.shadow(features), self.patch)
        weight, shadow = torch.sigmoid(said[:, 0:1] - 2), torch.sigmoid(said[:, 1:2])
        bounced = functional.interpolate(0.1 * self.bounced(features), scale_factor=self.patch, mode="nearest")
        return weight, shadow, bounced


def parameters(network):
    """How many numbers training may change."""
    return sum(weights.numel() for weights in network.parameters())
