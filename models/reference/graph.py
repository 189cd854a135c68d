"""A network as an ONNX graph: opset 17, any height and width in steps of 32, named inputs and outputs, weights stored small
and widened by the graph itself.

Weights are stored as `bytes` (signed, one scale an output channel), `halves` or `floats`; biases and small arrays as floats.
"""

import io

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper, shape_inference

FEWEST = 64
"""Arrays of no more numbers stay float."""

PRODUCER = "captured models.reference"


class Named(torch.nn.Module):
    """The network with its inputs apart, as the graph has them."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, *given):
        return self.network(torch.cat(given, 1))


def exported(stage, storage):
    """The stage's network as a checked ONNX model, each weight under its own name."""
    given = tuple(torch.rand(1, channels, 64, 64) for channels in stage.given.values())
    names = [*stage.given, *stage.outputs]
    built = io.BytesIO()
    torch.onnx.export(
        Named(stage.network).eval(),
        given,
        built,
        input_names=[*stage.given],
        output_names=[*stage.outputs],
        opset_version=17,
        dynamo=False,
        dynamic_axes={name: {2: "height", 3: "width"} for name in names},
    )
    model = onnx.load_from_string(built.getvalue())
    for output in model.graph.output:  # the exporter leaves what it could not infer under names of its own
        for axis, name in ((2, "height"), (3, "width")):
            output.type.tensor_type.shape.dim[axis].dim_param = name
    named(model.graph, stage.network)
    model.producer_name, model.producer_version = PRODUCER, ""
    if storage != "floats":
        packed(model.graph, storage)
    onnx.checker.check_model(model, full_check=True)
    return model


def named(graph, network):
    """The graph with each of the network's arrays under its own name, those too that the exporter found to be alike."""
    for node in [*graph.node]:
        node.input[:] = [name.removeprefix("network.") for name in node.input]
        if node.op_type == "Identity" and node.output[0].startswith("network."):
            graph.node.remove(node)
    del graph.initializer[:]
    graph.initializer.extend(numpy_helper.from_array(value.numpy(), name) for name, value in network.state_dict().items())


def packed(graph, storage):
    """The graph with its larger arrays as `NAME.half`, or as `NAME.bytes` times `NAME.scale`, widened to NAME by its first nodes."""
    outputs = {node.input[1]: 0 if node.op_type == "Conv" else 1 for node in graph.node if "Conv" in node.op_type}
    weights, widening = [], []

    def stored(values, name):
        weights.append(numpy_helper.from_array(values, name))
        return name

    for tensor in [*graph.initializer]:
        values, name = numpy_helper.to_array(tensor), tensor.name
        if values.dtype != np.float32 or values.size <= FEWEST:
            weights.append(tensor)
        elif storage == "halves" or name not in outputs:
            halves = stored(values.astype(np.float16), f"{name}.half")
            widening.append(helper.make_node("Cast", [halves], [name], to=TensorProto.FLOAT))
        else:
            whole, scale = in_bytes(torch.from_numpy(values.copy()), outputs[name])
            given = stored(whole.numpy(), f"{name}.bytes"), stored(scale.numpy(), f"{name}.scale")
            widening.append(helper.make_node("Cast", [given[0]], [f"{name}.wide"], to=TensorProto.FLOAT))
            widening.append(helper.make_node("Mul", [f"{name}.wide", given[1]], [name]))
    nodes = [*graph.node]
    for field, values in ((graph.initializer, weights), (graph.node, [*widening, *nodes])):
        del field[:]
        field.extend(values)


def in_bytes(values, axis):
    """Signed bytes and the scale of each output channel, which lie along that axis."""
    others = [other for other in range(values.dim()) if other != axis]
    scale = values.abs().amax(others, keepdim=True).clamp(min=1e-12) / 127
    return (values / scale).round().to(torch.int8), scale


def rounded(network, storage):
    """The network with the weights that `packed` stores: what the exported model is."""
    if storage == "floats":
        return network
    with torch.no_grad():
        for module in network.modules():
            for name, values in module.named_parameters(recurse=False):
                if values.numel() <= FEWEST:
                    continue
                if storage == "bytes" and name == "weight":
                    whole, scale = in_bytes(values, 1 if isinstance(module, torch.nn.ConvTranspose2d) else 0)
                    values.copy_(whole * scale)
                else:
                    values.copy_(values.half().float())
    return network


def billions(model, size=256):
    """Operations of the convolutions at size × size, a multiplication and its addition being two, in 10⁹."""
    sized = onnx.ModelProto()
    sized.CopyFrom(model)
    for signal in [*sized.graph.input, *sized.graph.output]:
        for axis in (2, 3):
            signal.type.tensor_type.shape.dim[axis].dim_value = size
    graph = shape_inference.infer_shapes(sized, data_prop=True).graph
    sides = lambda signal: [side.dim_value for side in signal.type.tensor_type.shape.dim]
    shapes = {signal.name: sides(signal) for signal in [*graph.value_info, *graph.input, *graph.output]}
    sizes = {t.name.removesuffix(".half").removesuffix(".bytes"): t.dims for t in graph.initializer}
    total = 0
    for node in graph.node:
        if node.op_type in ("Conv", "ConvTranspose"):
            # Each weight meets every pixel of a convolution's output, of an up-convolution's input.
            picture = shapes[(node.output if node.op_type == "Conv" else node.input)[0]]
            total += 2 * int(np.prod(sizes[node.input[1]])) * picture[2] * picture[3]
    return total / 1e9
