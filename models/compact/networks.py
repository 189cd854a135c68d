"""SurfacesNet and LightNet: small U-Nets that correct what a closed form says; what they add starts at nothing.

Pictures are (batch, channels, height, width), height and width multiples of 16. What goes in is made by `capturectl lessons`
and described in `src/relight/networks/compact`.
"""

import copy

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
    """Half the size, three times halved further, and back to half; nothing is up-convolved."""

    def __init__(self, channels, widths, blocks):
        super().__init__()
        self.stem = nn.Conv2d(channels, widths[0], 2, 2)
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

    In training also the relative step of its depth and the sigma of that, which teach it shape. They are not shipped: the steps
    are too small to help the sweep, and with sigmas as a network states them clean depth casts soft shadows (squared error
    2.1e-2 instead of 1.3e-2 on the validation scenes)."""

    SHIPPED = 7
    AUXILIARY = 2

    def __init__(self, widths=(32, 48, 64, 96), blocks=3):
        super().__init__()
        self.hourglass = Hourglass(16, widths, blocks)
        self.head = quiet(nn.Conv2d(widths[0], 4 * (self.SHIPPED + self.AUXILIARY), 3, padding=1))

    def said(self, sight):
        return functional.pixel_shuffle(self.head(self.hourglass(sight)), 2)

    @staticmethod
    def surfaces(sight, said):
        normal, albedo = said[:, 0:3], said[:, 3:6]
        # Roughness is a step from the closed form's, in logits.
        before = sight[:, 8:9].clamp(0.02, 0.98)
        roughness = torch.sigmoid(torch.log(before / (1 - before)) + said[:, 6:7])
        return normal, albedo, roughness

    def forward(self, sight):
        return self.surfaces(sight, self.said(sight))

    def taught(self, sight):
        """(normal, albedo, roughness, depth, sigma), as training wants them."""
        said = self.said(sight)
        depth = 0.1 * torch.tanh(said[:, 7:8])
        sigma = torch.exp(said[:, 8:9].clamp(-4, 4) - 6)
        return *self.surfaces(sight, said), depth, sigma

    def shipped(self):
        """The network without what only training wants."""
        kept = copy.deepcopy(self)
        kept.head = nn.Conv2d(self.head.in_channels, 4 * self.SHIPPED, 3, padding=1)
        kept.head.load_state_dict({name: value[: 4 * self.SHIPPED] for name, value in self.head.state_dict().items()})
        return kept


class LightNet(nn.Module):
    """17 planes of a scene under a lamp to (weight, shadow, bounced): how far to believe `shadow` instead of the sweep, both in
    [0, 1], and what is added to the light that is bounced onto a surface."""

    def __init__(self, widths=(12, 24, 48, 64), blocks=3):
        super().__init__()
        self.hourglass = Hourglass(17, widths, blocks)
        self.shadow = quiet(nn.Conv2d(widths[0], 4 * 2, 3, padding=1))
        self.bounced = quiet(nn.Conv2d(widths[0], 3, 3, padding=1))

    def shipped(self):
        """All of it."""
        return copy.deepcopy(self)

    def forward(self, lamp):
        features = self.hourglass(lamp)
        said = functional.pixel_shuffle(self.shadow(features), 2)
        weight, shadow = torch.sigmoid(said[:, 0:1] - 2), torch.sigmoid(said[:, 1:2])
        bounced = functional.interpolate(0.1 * self.bounced(features), scale_factor=2, mode="nearest")
        return weight, shadow, bounced


def parameters(network):
    """How many numbers training may change."""
    return sum(weights.numel() for weights in network.parameters())
