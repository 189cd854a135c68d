"""Training by phases: the picture's size and the batch change along the way, and the learning rate with the whole."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Phase:
    """Pictures of `size` pixels in batches of `batch`, for `share` samples, or minutes where `timed`."""

    size: int
    batch: int
    share: float
    timed: bool

    @classmethod
    def read(cls, text):
        """`SIZE:BATCH:SAMPLES` or `SIZE:BATCH:MINUTESm`; ValueError otherwise."""
        size, batch, share = text.split(":")
        phase = cls(int(size), int(batch), float(share.removesuffix("m")), share.endswith("m"))
        if phase.size % 32 or phase.size <= 0 or phase.batch <= 0 or phase.share <= 0:
            raise ValueError(f"{text}: the size is a multiple of 32, batch and share are above zero")
        return phase


class Course:
    """The phases in a row. A place in it is (phase, samples in it, seconds in it)."""

    def __init__(self, phases, rate, drops):
        """`rate`: learning rate at first, a tenth of what it was from each of `drops` on, fractions of the whole."""
        if len({phase.timed for phase in phases}) > 1:
            raise SystemExit("--phase: all shares are samples or all are minutes; give one kind")
        self.phases, self.rate, self.drops = phases, rate, drops

    def done(self, number, samples, seconds):
        """The fraction of that phase that is behind."""
        phase = self.phases[number]
        return (seconds / 60 if phase.timed else samples) / phase.share

    def progress(self, number, samples, seconds):
        """The fraction of the whole that is behind."""
        before = sum(phase.share for phase in self.phases[:number])
        here = min(self.done(number, samples, seconds), 1) * self.phases[number].share
        return (before + here) / sum(phase.share for phase in self.phases)

    def rate_at(self, progress):
        return self.rate * 0.1 ** sum(progress >= drop for drop in self.drops)


def batches(scenes, stage, phase, number, seed, samples):
    """Batches of a phase without end, from the place where so many samples are behind: every scene under every light once
    in an order of its own, then anew. A pure function of its arguments and the data."""
    everything = scenes.samples(phase.size, stage.lights)
    if len(everything) < phase.batch:
        found = f"{len(everything)} samples of {phase.size} pixels make no batch of {phase.batch}"
        raise SystemExit(f"{found}; render more, or lower --phase's batch")
    per_round = len(everything) // phase.batch
    step, order, current = samples // phase.batch, None, None
    while True:
        if step // per_round != current:
            current = step // per_round
            order = np.random.default_rng([seed, number, current]).permutation(len(everything))
        chosen = everything[order[step % per_round * phase.batch :][: phase.batch]]
        yield scenes.batch(chosen, phase.size, np.random.default_rng([seed, number, step, 1]))
        step += 1
