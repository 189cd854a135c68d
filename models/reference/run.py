"""A network on its way through its course: all that a checkpoint holds, a step, a look at the validation scenes."""

import numpy as np
import torch

from . import checkpoint
from .losses import squared
from .phases import Course
from .stages import Synthesis, stage


def on(device, found):
    return {name: value.to(device) for name, value in found.items()}


class Run:
    """`asked` are the arguments of `train`."""

    def __init__(self, asked):
        self.asked = asked
        self.device = "cuda" if torch.cuda.is_available() else "cpu"
        self.stage = stage(asked.network, asked.variant)
        if isinstance(self.stage, Synthesis):
            for before in self.stage.before:
                own = checkpoint.path(asked.out, before.network_name, asked.variant)
                checkpoint.warmed(before.network, getattr(asked, before.network_name) or own).to(self.device)
        if asked.warm:
            checkpoint.warmed(self.stage.network, asked.warm, other_inputs=True)
        self.stage.network.to(self.device)
        self.course = Course(asked.phase, asked.rate, asked.drops)
        self.optimizer = torch.optim.Adam(self.stage.network.parameters(), lr=asked.rate, fused=True)
        self.average = checkpoint.Average(self.stage.network)
        self.number, self.samples, self.seconds = 0, 0, 0.0
        """The place in the course."""
        self.all_samples, self.all_seconds = 0, 0.0
        self.file = checkpoint.path(asked.out, asked.network, asked.variant)

    def resume(self):
        kept = torch.load(self.file, map_location=self.device, weights_only=True)
        self.stage.network.load_state_dict(kept["network"])
        self.optimizer.load_state_dict(kept["optimizer"])
        self.average.weights, self.average.steps = kept["average"], kept["steps"]
        self.number, self.samples, self.seconds = kept["place"]
        self.all_samples, self.all_seconds = kept["samples"], kept["seconds"]
        print(f"going on after {self.all_samples} samples, {self.all_seconds / 60:.1f} minutes")

    def save(self, shards, command):
        """`shards`, by name, and the command are published with the weights."""
        kept = {"network": self.stage.network.state_dict(), "average": self.average.weights, "steps": self.average.steps}
        kept |= {"optimizer": self.optimizer.state_dict(), "place": (self.number, self.samples, self.seconds)}
        kept |= {"samples": self.all_samples, "seconds": self.all_seconds}
        checkpoint.saved(self.file, kept | {"shards": shards, "command": command, "seed": self.asked.seed})

    def learn(self, found):
        """One step of the optimizer; returns the loss."""
        progress = self.course.progress(self.number, self.samples, self.seconds)
        self.optimizer.param_groups[0]["lr"] = self.course.rate_at(progress)
        with torch.autocast(self.device, torch.bfloat16, enabled=self.asked.bfloat16):
            raw = self.stage.raw(found)
        loss = self.stage.loss(raw, found)
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.average.follow(self.stage.network)
        return loss.item()

    def went(self, samples, seconds):
        """Counts what a step took."""
        self.samples, self.seconds = self.samples + samples, self.seconds + seconds
        self.all_samples, self.all_seconds = self.all_samples + samples, self.all_seconds + seconds

    def finished(self):
        return self.number >= len(self.course.phases)

    def phase_finished(self):
        return self.course.done(self.number, self.samples, self.seconds) >= 1

    def looked_at(self, scenes):
        """Mean squared error of each output, of the averaged weights, on the first scenes and a light of each."""
        size, errors = self.asked.look_size, {}
        viewed = stage(self.asked.network, self.asked.variant)
        viewed.network.load_state_dict(self.average.weights)
        viewed.network.to(self.device).eval()
        if isinstance(viewed, Synthesis):
            viewed.before = self.stage.before
        rows = scenes.samples(size, viewed.lights, self.asked.look_scenes)
        _, first, count = np.unique(rows[:, :2], axis=0, return_index=True, return_counts=True)
        rows = rows[first + np.arange(len(first)) % count]
        rng = np.random.default_rng(0)
        with torch.no_grad():
            for start in range(0, len(rows), 4):
                found = on(self.device, scenes.batch(rows[start : start + 4], size, rng))
                for name, answer in viewed.answer(found).items():
                    errors.setdefault(name, []).append(squared(answer, found[name], found["known"]))
        return {name: float(np.mean(values)) for name, values in errors.items()}
