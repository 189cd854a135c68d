"""The light's own view of the scene: T(p) = Rᵀ p + t, t = (0, 0, 1), the third column of R being the light's direction."""

import torch


def basis(light):
    """Orthonormal R, (..., 3, 3), of unit directions toward the light, (..., 3), z ≥ 0 toward the camera.

    Continuous over the whole hemisphere, where a null-space routine turns neighbouring lights by any angle: R is the
    shortest turn of the z axis onto the light (Frisvad 2012; Duff et al. 2017).
    """
    x, y, z = light.unbind(-1)
    a = -1.0 / (1.0 + z)
    b = x * y * a
    first = torch.stack([1.0 + x * x * a, b, -x], -1)
    second = torch.stack([b, 1.0 + y * y * a, -y], -1)
    return torch.stack([first, second, light], -1)


def points(depth, intrinsics):
    """Point-cloud picture (batch, 3, height, width) from depth (batch, 1, height, width) in metres and
    (fx, fy, cx, cy) in pixels (batch, 4); x right, y up, z toward the camera. Unknown depth (NaN) becomes the origin."""
    height, width = depth.shape[-2:]
    fx, fy, cx, cy = (value.view(-1, 1, 1, 1) for value in intrinsics.unbind(-1))
    x = torch.arange(width, device=depth.device, dtype=depth.dtype).view(1, 1, 1, -1)
    y = torch.arange(height, device=depth.device, dtype=depth.dtype).view(1, 1, -1, 1)
    known = torch.nan_to_num(depth)
    return torch.cat([(x - cx) / fx * known, -(y - cy) / fy * known, -known], 1)


def seen_from(light, cloud):
    """T(ω, P): the cloud (batch, 3, height, width) in the frame of each light (batch, 3)."""
    turned = torch.einsum("bij,bihw->bjhw", basis(light), cloud)
    return turned + torch.tensor([0.0, 0.0, 1.0], device=cloud.device, dtype=cloud.dtype).view(1, 3, 1, 1)
