"""What a run keeps: weights, their running average, the optimizer's state and the place in the course."""

import os

import torch

DECAY = 0.999
"""Of the running average per step, less in the first steps; looks, evaluation and export use the average."""


class Average:
    """The exponential moving average of a network's weights."""

    def __init__(self, network):
        self.weights = {name: value.detach().clone() for name, value in network.state_dict().items()}
        self.steps = 0

    def follow(self, network):
        self.steps += 1
        decay = min(DECAY, (1 + self.steps) / (10 + self.steps))
        pairs = [(self.weights[name], value) for name, value in network.state_dict().items()]
        torch._foreach_lerp_(*map(list, zip(*pairs)), 1 - decay)


def path(folder, network, variant):
    return folder / f"{network}-{variant}.pt"


def saved(file, kept):
    """The file holds the old state or the new one, never a part."""
    building = file.with_suffix(".building")
    torch.save(kept, building)
    os.replace(building, file)


def weights(file):
    """The weights by name of a checkpoint (its average) or of an exported model; SystemExit where there are none."""
    if not file.exists():
        raise SystemExit(f"{file}: not there; train it first, or name where it is")
    if file.suffix == ".onnx":
        import onnx

        initializers = onnx.load(file, load_external_data=False).graph.initializer
        found = {t.name: torch.from_numpy(onnx.numpy_helper.to_array(t).copy()).float() for t in initializers}
        scale = lambda name: found[name.replace(".bytes", ".scale")] if name.endswith(".bytes") else 1
        short = lambda name: name.removesuffix(".half").removesuffix(".bytes")
        return {short(name): values * scale(name) for name, values in found.items() if not name.endswith(".scale")}
    return torch.load(file, map_location="cpu", weights_only=True)["average"]


FIRST = "encoder.layers.0.weight"
"""The only weights whose shape depends on what a variant is given."""


def warmed(network, file, other_inputs=False):
    """The network with the file's weights; SystemExit where they are another network's.

    With `other_inputs` the file's variant may be given fewer or more pictures: DecomposeNet's variants have them in the same
    order, so what they share is taken over and what is new starts at zero."""
    found = weights(file)
    own = network.state_dict()
    if other_inputs and FIRST in found and FIRST in own:
        shared, wider = min(found[FIRST].shape[1], own[FIRST].shape[1]), torch.zeros_like(own[FIRST])
        wider[:, :shared] = found[FIRST][:, :shared]
        found[FIRST] = wider
    wrong = [name for name in own if name not in found or found[name].shape != own[name].shape]
    if wrong:
        raise SystemExit(f"{file}: {wrong[0]} is missing or of another shape; these are another network's weights")
    network.load_state_dict({name: found[name] for name in own})
    return network
