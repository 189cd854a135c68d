"""Karis 2013 with the misprints of Qiu et al. 2020 corrected: light sent to the camera under a lamp of color 1."""

import torch

F0 = 0.05


def rendered(albedo, normal, roughness, light, camera):
    """One bounce without shadow, linear, (batch, 3, height, width): albedo · n·l + π f n·l, 0 where n·l ≤ 0."""
    height, width = albedo.shape[-2:]
    fx, fy, cx, cy = (value.view(-1, 1, 1, 1) for value in camera.unbind(-1))
    x = (torch.arange(width, device=albedo.device).view(1, 1, 1, -1) - cx) / fx
    y = (torch.arange(height, device=albedo.device).view(1, 1, -1, 1) - cy) / fy
    x, y = torch.broadcast_tensors(x, y)
    view = torch.nn.functional.normalize(torch.cat([-x, y, torch.ones_like(x)], 1), dim=1)
    light = light.view(-1, 3, 1, 1)
    half = torch.nn.functional.normalize(light + view, dim=1)
    dot = lambda a, b: (a * b).sum(1, keepdim=True)
    n_l, n_v = dot(normal, light).clamp(min=0), dot(normal, view).clamp(min=1e-3)
    n_h, v_h = dot(normal, half).clamp(min=0), dot(view, half).clamp(min=0)
    roughness = roughness.clamp(min=0.03)
    alpha2, k = roughness**4, (roughness + 1) ** 2 / 8
    lobe = alpha2 / (n_h**2 * (alpha2 - 1) + 1).clamp(min=1e-6) ** 2
    fresnel = F0 + (1 - F0) * 2 ** ((-5.55473 * v_h - 6.98316) * v_h)
    masking = (n_l * (1 - k) + k) * (n_v * (1 - k) + k)
    # D carries 1/π and the lamp's color π; n·l of the cosine and n·v cancel against G.
    return albedo * n_l + lobe * fresnel * n_l / (4 * masking)
