"""DecomposeNet, ShadowNet and SynthesisNet: Qiu et al., "Towards Geometry Guided Neural Relighting with Flash
Photography", 3DV 2020, from the paper's layer tables.

Pictures are (batch, channels, height, width), height and width multiples of 32. Albedo and light are linear; normals are
unit vectors, x right, y up, z toward the camera; shadow 0 = in shadow, 1 = lit.
"""

import torch
from torch import nn
from torch.nn import functional

SLOPE = 0.1
"""Of LeakyReLU below zero."""


class Encoder(nn.Module):
    """Five convolutions of stride 2: the first 6×6, the others 4×4."""

    def __init__(self, channels):
        super().__init__()
        kernels = [6, 4, 4, 4, 4]
        pairs = zip(channels, channels[1:], kernels)
        # Padding keeps each output exactly half as large.
        self.layers = nn.ModuleList(nn.Conv2d(a, b, kernel, 2, kernel // 2 - 1) for a, b, kernel in pairs)

    def forward(self, picture):
        """Features from half to 1/32 of the size, finest first."""
        features = []
        for layer in self.layers:
            picture = functional.leaky_relu(layer(picture), SLOPE)
            features.append(picture)
        return features


class Decoder(nn.Module):
    """Five 4×4 up-convolutions; from the second on the encoder's feature of the same size is laid beside the input."""

    def __init__(self, encoder, channels):
        super().__init__()
        beside = [0, *reversed(encoder[1:-1])]
        before = [encoder[-1], *channels[:-1]]
        self.layers = nn.ModuleList(
            nn.ConvTranspose2d(a + b, c, 4, 2, 1) for a, b, c in zip(before, beside, channels, strict=True)
        )

    def forward(self, features):
        """From the encoder's features to a picture of the input's size."""
        picture, beside = features[-1], [None, *reversed(features[:-1])]
        for layer, feature in zip(self.layers, beside, strict=True):
            if feature is not None:
                picture = torch.cat([picture, feature], 1)
            picture = functional.leaky_relu(layer(picture), SLOPE)
        return picture


def he_initialised(network):
    """He's initialisation for every convolution, zero for every bias."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            nn.init.kaiming_normal_(module.weight, SLOPE)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
    return network


class SamePad(nn.Module):
    """A 6×6 convolution of stride 1 that keeps the size: two pixels before, three behind."""

    def forward(self, picture):
        return functional.pad(picture, (2, 3, 2, 3))


class DecomposeNet(nn.Module):
    """Flash photograph and depth, 4 channels, to (albedo, normal, roughness); 5 channels with a mask, 3 without depth."""

    def __init__(self, channels=4):
        super().__init__()
        encoder, decoder = [channels, 32, 64, 128, 256, 512], [256, 128, 128, 64, 64]
        self.encoder = Encoder(encoder)
        self.decoders = nn.ModuleList(Decoder(encoder, decoder) for _ in range(3))
        self.albedo = nn.Conv2d(64, 3, 5, padding=2, bias=False)
        self.normal = nn.Conv2d(64, 3, 5, padding=2)
        self.roughness = nn.Conv2d(64, 1, 5, padding=2)
        he_initialised(self)

    def raw(self, picture):
        """Albedo, normal of any length, roughness before the sigmoid: what the losses want."""
        features = self.encoder(picture)
        albedo, normal, roughness = (decoder(features) for decoder in self.decoders)
        return self.albedo(albedo), self.normal(normal), self.roughness(roughness)

    @staticmethod
    def finished(raw):
        albedo, normal, roughness = raw
        return albedo, functional.normalize(normal, dim=1), torch.sigmoid(roughness)

    def forward(self, picture):
        return self.finished(self.raw(picture))


class ShadowNet(nn.Module):
    """Points seen from the light, 3 channels (see `frames.seen_from`), to the cast-shadow map, 1 channel in (0, 1)."""

    def __init__(self):
        super().__init__()
        encoder, decoder = [3, 32, 64, 128, 256, 256], [256, 256, 128, 64, 32]
        self.encoder, self.decoder = Encoder(encoder), Decoder(encoder, decoder)
        self.head = nn.Sequential(SamePad(), nn.Conv2d(32, 1, 6))
        he_initialised(self)

    def raw(self, points):
        """Before the sigmoid: what the loss wants."""
        return (self.head(self.decoder(self.encoder(points))),)

    @staticmethod
    def finished(raw):
        return (torch.sigmoid(raw[0]),)

    def forward(self, points):
        return self.finished(self.raw(points))[0]


class SynthesisNet(nn.Module):
    """17 channels (shadow 1, one-bounce render 3, flash 3, albedo 3, normal 3, roughness 1, points 3) to the relit
    picture, 3 channels. The OSS stand-in is the same network with 33 channels: five lit pictures, their lights, the light."""

    def __init__(self, channels=17):
        super().__init__()
        encoder, decoder = [channels, 64, 128, 128, 256, 256], [512, 256, 128, 64, 32]
        self.encoder, self.decoder = Encoder(encoder), Decoder(encoder, decoder)
        self.head = nn.Conv2d(32, 3, 5, padding=2, bias=False)
        he_initialised(self)

    def raw(self, channels):
        """The relit picture: this network has nothing to finish."""
        return (self.head(self.decoder(self.encoder(channels))),)

    @staticmethod
    def finished(raw):
        return raw

    def forward(self, channels):
        return self.raw(channels)[0]


def parameters(network):
    """How many numbers training may change."""
    return sum(weights.numel() for weights in network.parameters())
