"""The losses of Qiu et al. 2020: means over the pixels that show a surface."""

from torch.nn import functional


def mean(values, known):
    return (values * known).sum() / (known.expand_as(values).sum()).clamp(min=1)


def cross_entropy(logits, truth, known):
    """Of a map in (0, 1) that is given before its sigmoid, which keeps its slope where the map is all but 0 or 1."""
    return mean(functional.binary_cross_entropy_with_logits(logits, truth, reduction="none"), known)


def with_gradients(picture, truth, known):
    """L1 of the values and of their differences to the right and downward."""
    loss = mean((picture - truth).abs(), known)
    for axis in (2, 3):
        both = known.narrow(axis, 1, known.shape[axis] - 1) * known.narrow(axis, 0, known.shape[axis] - 1)
        loss = loss + mean((picture.diff(dim=axis) - truth.diff(dim=axis)).abs(), both)
    return loss


def squared(picture, truth, known):
    """Mean squared error: the figure that is reported."""
    return mean((picture - truth) ** 2, known).item()
