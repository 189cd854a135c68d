"""What each network is asked for and judged by."""

import torch
from torch.nn import functional

from .networks import LightNet, SurfacesNet

AMPLITUDE = slice(13, 15)
"""Planes of `sight` that a camera without infrared picture leaves empty."""

MOST_SIGMAS = 3.0
"""Depth moves by at most so many of its standard deviations."""

DEPTH_UNIT = 0.01
"""Relative error of depth that counts as much as a tenth in the others."""


def mean(error, known):
    """The mean over known pixels and all channels."""
    return (error * known).sum() / (known.sum() * error.shape[1]).clamp(min=1)


def gaussians(error, sigma):
    """Negative log-likelihood of errors under their stated sigmas."""
    return torch.log(sigma) + 0.5 * (error / sigma) ** 2


LEAST_COSINE = 0.15
"""Toward the camera, below which light is not divided by it; `surfaces.rs` has the same."""


def shaded(normal, albedo, roughness, toward, view):
    """Light of a lamp in direction `toward`, without shadows (Karis 2013, as `shading.rs`); vectors along the channels."""
    half = functional.normalize(toward + view, dim=1)
    nl, nv, nh = ((normal * other).sum(1, keepdim=True) for other in (toward, view, half))
    nl, nv, nh = nl.clamp(min=0), nv.clamp(min=1e-3), nh.clamp(0, 1)
    vh = (view * half).sum(1, keepdim=True).clamp(0, 1)
    roughness = roughness.clamp(min=0.05)
    alpha2, k = roughness**4, (roughness + 1) ** 2 / 8
    peak = alpha2 / (nh**2 * (alpha2 - 1) + 1) ** 2
    fresnel = 0.05 + 0.95 * 2 ** ((-5.55473 * vh - 6.98316) * vh)
    masked = 1 / ((nl * (1 - k) + k) * (nv * (1 - k) + k))
    return albedo * nl + peak * fresnel * masked * nl / 4


class Unsaying:
    """A network of surfaces that says nothing."""

    @staticmethod
    def taught(sight):
        none = 0 * sight[:, :1]
        return none.expand(-1, 3, -1, -1), none.expand(-1, 3, -1, -1), sight[:, 8:9], none, none + 0.01


class Surfaces:
    """Normals, albedo, roughness and depth."""

    name = "surfaces"
    given = {"sight": 16}
    outputs = {"normal": 3, "factor": 3, "roughness": 1}
    names = ["sight", "view", "toward", "closed", "direct", "seen"]
    names += [f"truth.{name}" for name in ("albedo", "normal", "roughness", "depth", "relit", "shadow")]

    def __init__(self, **shape):
        self.network = SurfacesNet(**shape)

    def drop(self, batch, dice):
        """Half of the captures lose their amplitude: its absence must be fine."""
        lost = torch.from_numpy(dice.random(len(batch["sight"])) < 0.5)
        batch["sight"][lost, AMPLITUDE] = 0

    def errors(self, batch):
        """(squared errors by name as the tables state them, what training descends)."""
        sight, view = batch["sight"], batch["view"]
        normal, albedo, roughness, depth, sigma = self.network.taught(sight)
        truth = {name: batch[f"truth.{name}"] for name in ("albedo", "normal", "roughness", "depth", "relit")}
        known = sight[:, 15:16] * torch.stack([t.isfinite().all(1) for t in truth.values()], 0).all(0)[:, None]
        truth = {name: torch.nan_to_num(t) for name, t in truth.items()}
        normal = functional.normalize(sight[:, 0:3] + normal, dim=1)
        facing = [(n * view).sum(1, keepdim=True).clamp(min=LEAST_COSINE) for n in (sight[:, 0:3], normal)]
        albedo = sight[:, 3:6] ** 2 * facing[0] / facing[1] * torch.exp(albedo.clamp(-4, 4))
        albedo = albedo.clamp(0, 1)
        toward = batch["toward"][:, :, None, None]
        bounced = torch.nan_to_num(batch["closed"]) - batch["seen"] * torch.nan_to_num(batch["direct"])
        light = batch["truth.shadow"] * shaded(normal, albedo, roughness, toward, view) + bounced
        apart = light.clamp(0, 1) - truth["relit"].clamp(0, 1)
        # No further than the closed form's own doubt: what is known exactly stays.
        doubt = MOST_SIGMAS * (torch.exp(4 * sight[:, 11:12]) - 1) / 1000
        depth = torch.minimum(torch.maximum(depth, -doubt), doubt)
        step = depth - truth["depth"].clamp(-0.1, 0.1)
        errors = {
            "albedo": mean((albedo - truth["albedo"]) ** 2, known),
            "normal": mean((0.5 * (normal - truth["normal"])) ** 2, known),
            "roughness": mean((roughness - truth["roughness"]) ** 2, known),
            "relit": mean(apart**2, known),
        }
        roots = mean((albedo.clamp(min=1e-4).sqrt() - truth["albedo"].sqrt()) ** 2, known)
        # Shape matters to shading and shadows, where a surface stands less; edges of things are others' errors.
        scaled = 0.1 * step / DEPTH_UNIT
        sides = sum(mean((scaled.diff(dim=d)).abs().clamp(max=0.5), known.narrow(d, 1, known.shape[d] - 1)) for d in (2, 3))
        depth_loss = mean(functional.huber_loss(scaled, torch.zeros_like(scaled), reduction="none", delta=0.1), known)
        sigma_loss = mean(gaussians(step.detach().abs().clamp(1e-4), sigma), known)
        loss = errors["albedo"] + roots + 2 * errors["normal"] + 0.2 * errors["roughness"]
        relit = mean(functional.huber_loss(apart, torch.zeros_like(apart), reduction="none", delta=0.2), known)
        loss = loss + 16 * relit + depth_loss + 0.2 * sides + 1e-3 * sigma_loss
        errors["depth"] = mean((step.abs() / DEPTH_UNIT).clamp(max=5), known)
        return errors, loss

    def loss(self, batch):
        """What training descends."""
        return self.errors(batch)[1]

    def before(self, batch):
        """The same errors of the closed form."""
        kept, self.network = self.network, Unsaying()
        try:
            return self.errors(batch)[0]
        finally:
            self.network = kept


class Light:
    """Cast shadows and bounced light under one lamp."""

    name = "light"
    given = {"lamp": 17}
    outputs = {"weight": 1, "shadow": 1, "bounced": 3}
    names = ["ground", "albedo", "toward", "closed", "direct", "seen", "thin", "thick", "truth.shadow", "truth.relit"]

    def __init__(self, **shape):
        self.network, self.shape = LightNet(**shape), shape
        self.without, self.teacher = [], None

    def studies(self, without, with_distance, teacher, told):
        """Makes it a design that is only compared: fed less, or the distance to what casts a shadow too, or taught by another method."""
        self.without, self.names = without, list(self.names)
        if with_distance:
            self.names.append("distance")
            self.network = LightNet(channels=18, **self.shape)
        if teacher:
            self.teacher = LightNet.of(torch.load(teacher, weights_only=True)["average"]).eval()
        if told:
            self.names.append("told")

    def drop(self, batch, dice):
        """Nothing here may be absent."""

    def loss(self, batch):
        """What training descends; where there is a teacher, half of it is being unlike the teacher."""
        _, loss = self.errors(batch)
        told = batch.get("told")
        if self.teacher:
            with torch.no_grad():
                weight, shadow, _ = self.teacher(self.lamp(batch))
            told = batch["seen"] + weight * (shadow - batch["seen"])
        if told is None:
            return loss
        weight, shadow, _ = self.network(self.lamp(batch))
        own = batch["seen"] + weight * (shadow - batch["seen"])
        facing = (torch.nan_to_num(batch["direct"]).sum(1, keepdim=True) > 0).float()
        return 0.5 * loss + 0.5 * mean((own - told) ** 2, batch["ground"][:, 6:7] * facing)

    def lamp(self, batch):
        """What `Correction::given` makes of the same."""
        batch = {**batch, **{name: 0 * batch[name] for name in self.without}}
        ground, seen = batch["ground"], batch["seen"]
        toward = batch["toward"][:, :, None, None]
        known = ground[:, 6:7]
        cosine = (ground[:, 0:3] * toward).sum(1, keepdim=True)
        lit = torch.nan_to_num(batch["direct"] * seen).clamp(0, 2) * known
        toward = toward.expand(-1, -1, *ground.shape[-2:]) * known
        more = [batch["distance"] * known] if "distance" in batch else []
        return torch.cat([seen * known, batch["thin"] * known, batch["thick"] * known, cosine, lit, toward, ground, *more], 1)

    def errors(self, batch):
        """(squared errors by name as the tables state them, what training descends)."""
        weight, told, bounced = self.network(self.lamp(batch))
        seen, direct = batch["seen"], torch.nan_to_num(batch["direct"])
        known = batch["ground"][:, 6:7] * batch["truth.relit"].isfinite().all(1, keepdim=True)
        step = weight * (told - seen)
        light = torch.nan_to_num(batch["closed"]) + step * direct + torch.nan_to_num(batch["albedo"]) * bounced
        truth = torch.nan_to_num(batch["truth.relit"])
        # What faces away is dark whatever the network says.
        facing = (direct.sum(1, keepdim=True) > 0).float()
        shadow = mean((seen + step - batch["truth.shadow"]) ** 2, known * facing)
        apart = light.clamp(min=0) - truth
        errors = {
            "shadow": mean((seen + step * facing - batch["truth.shadow"]) ** 2, known),
            "relit": mean((light.clamp(0, 1) - truth.clamp(0, 1)) ** 2, known),
        }
        huber = functional.huber_loss(apart, torch.zeros_like(apart), reduction="none", delta=0.2)
        return errors, shadow + 8 * mean(huber, known)

    def before(self, batch):
        """The same errors of the closed form."""
        kept, self.network = self.network, lambda s: (0 * s[:, :1], 0 * s[:, :1], 0 * s[:, :3])
        try:
            return self.errors(batch)[0]
        finally:
            self.network = kept


TASKS = {"surfaces": Surfaces, "light": Light}
