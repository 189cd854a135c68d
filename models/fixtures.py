"""`python3 -m models.fixtures`: the tiny models of tests/models, good and evil, and their manifest.

Each good one has the inputs and outputs of a network of the paper and a single 1 × 1 convolution per output, with weights
that a test can follow by hand. Needs `onnx`, `numpy` and `blake3`.
"""

from pathlib import Path

import blake3
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

OUT = Path(__file__).parent.parent / "tests" / "models"

SHAPES = {
    "flash": 3,
    "near": 1,
    "mask": 1,
    "cloud": 3,
    "shadow": 1,
    "render": 3,
    "albedo": 3,
    "normal": 3,
    "roughness": 1,
    "relit": 3,
}
"""Channels by name."""

DECOMPOSE = (("flash", "near"), ("albedo", "normal", "roughness"))
ENV = (("flash", "near", "mask"), DECOMPOSE[1])
SIPS = (("flash",), DECOMPOSE[1])
SHADOW = (("cloud",), ("shadow",))
SYNTHESIS = (("shadow", "render", "flash", "albedo", "normal", "roughness", "cloud"), ("relit",))


def signals(names, element=TensorProto.FLOAT, height="height", width="width"):
    return [helper.make_tensor_value_info(name, element, [1, SHAPES[name], height, width]) for name in names]


def model(nodes, weights, inputs, outputs, opsets=()):
    graph = helper.make_graph(nodes, "tiny", inputs, outputs, weights)
    opsets = [helper.make_opsetid("", 17), *opsets]
    made = helper.make_model(graph, opset_imports=opsets, producer_name="captured", ir_version=8)
    return made


def halves(name, values):
    """Weights as the real networks store them: 16 bits, widened in the graph."""
    return numpy_helper.from_array(np.asarray(values, np.float16), f"{name}_16")


def widened(name):
    return helper.make_node("Cast", [f"{name}_16"], [name], to=TensorProto.FLOAT)


def decompose(given=DECOMPOSE[0]):
    """albedo = flash / 2, normal = (l, 0, 1) brought to length 1, roughness = sigmoid(2 l), l being the last channel given."""
    count = sum(SHAPES[name] for name in given)
    albedo = np.zeros((3, count, 1, 1))
    albedo[range(3), range(3), 0, 0] = 0.5
    normal = np.zeros((3, count, 1, 1))
    normal[0, -1, 0, 0] = 1
    roughness = np.zeros((1, count, 1, 1))
    roughness[0, -1, 0, 0] = 2
    together = [] if len(given) == 1 else [helper.make_node("Concat", list(given), ["all"], axis=1)]
    everything = "all" if together else given[0]
    nodes = [
        *(widened(name) for name in ("a", "n", "n_bias", "r")),
        *together,
        helper.make_node("Conv", [everything, "a"], ["albedo"]),
        helper.make_node("Conv", [everything, "n", "n_bias"], ["steep"]),
        helper.make_node("ReduceL2", ["steep"], ["length"], axes=[1], keepdims=1),
        helper.make_node("Div", ["steep", "length"], ["normal"]),
        helper.make_node("Conv", [everything, "r"], ["rough"]),
        helper.make_node("Sigmoid", ["rough"], ["roughness"]),
    ]
    weights = [halves("a", albedo), halves("n", normal), halves("n_bias", [0, 0, 1]), halves("r", roughness)]
    return model(nodes, weights, signals(given), signals(DECOMPOSE[1]))


def shadow():
    """sigmoid(x − y + z / 2) of the points as the light sees them."""
    kernel = np.array([1, -1, 0.5]).reshape(1, 3, 1, 1)
    nodes = [
        widened("k"),
        helper.make_node("Conv", ["cloud", "k"], ["sum"]),
        helper.make_node("Sigmoid", ["sum"], ["shadow"]),
    ]
    return model(nodes, [halves("k", kernel)], signals(SHADOW[0]), signals(SHADOW[1]))


def synthesis():
    """render × 1/2 + flash × 1/4, and shadow × 1/8 in every channel."""
    kernel = np.zeros((3, 17, 1, 1))
    for channel in range(3):
        kernel[channel, 0] = 0.125
        kernel[channel, 1 + channel] = 0.5
        kernel[channel, 4 + channel] = 0.25
    nodes = [
        widened("k"),
        helper.make_node("Concat", list(SYNTHESIS[0]), ["all"], axis=1),
        helper.make_node("Conv", ["all", "k"], ["relit"]),
    ]
    return model(nodes, [halves("k", kernel)], signals(SYNTHESIS[0]), signals(SYNTHESIS[1]))


def external():
    """Its weights lie in a file of its own."""
    made = shadow()
    made.graph.initializer[0].ClearField("raw_data")
    made.graph.initializer[0].data_location = TensorProto.EXTERNAL
    entry = made.graph.initializer[0].external_data.add()
    entry.key, entry.value = "location", "../../../etc/passwd"
    return made


def named_otherwise():
    """Takes `points`, where the manifest states `cloud`."""
    made = shadow()
    made.graph.input[0].name = made.graph.node[1].input[0] = "points"
    return made


def shaped_otherwise():
    """Takes pictures of 64 × 64 and no others."""
    made = shadow()
    del made.graph.input[:]
    made.graph.input.extend(signals(["cloud"], height=64, width=64))
    return made


def typed_otherwise():
    """Takes 16-bit floats."""
    made = shadow()
    del made.graph.input[:]
    made.graph.input.extend(signals(["cloud"], TensorProto.FLOAT16))
    return made


def foreign():
    """Has an operator that could read files of its own."""
    nodes = [helper.make_node("EPContext", ["cloud"], ["shadow"], domain="com.microsoft", ep_cache_context="/etc/passwd")]
    opsets = [helper.make_opsetid("com.microsoft", 1)]
    return model(nodes, [], signals(SHADOW[0]), signals(SHADOW[1]), opsets)


def lying():
    """States one channel and gives three: its signals are right, its graph is not."""
    nodes = [helper.make_node("Identity", ["cloud"], ["shadow"])]
    return model(nodes, [], signals(SHADOW[0]), signals(SHADOW[1]))


MODELS = [
    ("decompose", "clean", decompose, DECOMPOSE),
    ("decompose", "env", lambda: decompose(ENV[0]), ENV),
    ("decompose", "sips", lambda: decompose(SIPS[0]), SIPS),
    ("shadow", "clean", shadow, SHADOW),
    ("synthesis", "clean", synthesis, SYNTHESIS),
    *(("shadow", evil.__name__, evil, SHADOW) for evil in (external, named_otherwise, shaped_otherwise, typed_otherwise)),
    *(("shadow", evil.__name__, evil, SHADOW) for evil in (foreign, lying)),
]


def entry(name, variant, data, sides):
    lines = ["[[model]]", f'name = "{name}"', f'variant = "{variant}"', 'tier = "paper"', f'file = "{name}-{variant}.onnx"']
    lines += [f'blake3 = "{blake3.blake3(data).hexdigest()}"', f"bytes = {len(data)}", "parameters = 3", "gflop_256 = 0.001"]
    for side, names in zip(("input", "output"), sides, strict=True):
        for signal in names:
            lines += [f"[[model.{side}]]", f'name = "{signal}"', f'shape = ["1", "{SHAPES[signal]}", "height", "width"]']
    return "\n".join(lines) + "\n"


def main():
    entries = ["# Written by `python3 -m models.fixtures`.\nformat = 1\n"]
    for name, variant, make, sides in MODELS:
        data = make().SerializeToString(deterministic=True)
        (OUT / f"{name}-{variant}.onnx").write_bytes(data)
        entries.append(entry(name, variant, data, sides))
    (OUT / "manifest.toml").write_text("\n".join(entries))


if __name__ == "__main__":
    main()
