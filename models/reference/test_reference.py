"""Claims about the reference networks; the paper's numbers are from its text and layer tables."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from .feeding import noisy, normalised  # noqa: E402
from .frames import basis, points, seen_from  # noqa: E402
from .losses import cross_entropy, squared, with_gradients  # noqa: E402
from .networks import DecomposeNet, ShadowNet, SynthesisNet, parameters  # noqa: E402
from .shading import rendered  # noqa: E402


def test_the_tables_give_29_million_parameters_with_skips_laid_beside():
    counts = [parameters(network()) for network in (DecomposeNet, ShadowNet, SynthesisNet)]
    assert [round(count / 1e6, 2) for count in counts] == [14.70, 5.92, 8.37]


@pytest.mark.parametrize("size", [(64, 64), (96, 160)])
def test_every_output_has_the_size_and_range_of_its_meaning(size):
    torch.manual_seed(1)
    with torch.no_grad():
        albedo, normal, roughness = DecomposeNet()(torch.rand(2, 4, *size))
        shadow = ShadowNet()(torch.rand(2, 3, *size))
        relit = SynthesisNet()(torch.rand(2, 17, *size))
    assert albedo.shape == normal.shape == relit.shape == (2, 3, *size)
    assert roughness.shape == shadow.shape == (2, 1, *size)
    assert torch.allclose(normal.norm(dim=1), torch.ones(2, *size), atol=1e-4)
    assert 0 < shadow.min() and shadow.max() < 1 and 0 < roughness.min() and roughness.max() < 1


def hemisphere(count):
    generator = torch.Generator().manual_seed(2)
    light = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    light[:, 2] = light[:, 2].abs()
    return light / light.norm(dim=1, keepdim=True)


def test_the_basis_is_orthonormal_and_its_third_column_is_the_light():
    light = hemisphere(500)
    frame = basis(light)
    identity = torch.eye(3, dtype=torch.float64).expand(500, 3, 3)
    assert torch.allclose(frame.transpose(1, 2) @ frame, identity, atol=1e-12)
    assert torch.allclose(frame[:, :, 2], light) and torch.allclose(torch.linalg.det(frame), torch.ones(500).double())


def test_neighbouring_lights_have_neighbouring_bases():
    light = hemisphere(500)
    moved = light + 1e-4 * torch.randn(500, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    moved[:, 2] = moved[:, 2].clamp(min=0)
    moved = moved / moved.norm(dim=1, keepdim=True)
    step = (moved - light).norm(dim=1)
    turn = (basis(moved) - basis(light)).flatten(1).norm(dim=1)
    assert (turn < 4 * step + 1e-12).all()


def test_points_lie_where_a_pinhole_sees_them_and_the_frontal_light_only_shifts_them():
    depth = torch.full((1, 1, 4, 6), 2.0)
    depth[0, 0, 0, 0] = float("nan")
    cloud = points(depth, torch.tensor([[3.0, 3.0, 2.5, 1.5]]))
    assert torch.allclose(cloud[0, :, 3, 5], torch.tensor([2.5 / 3 * 2, -1.5 / 3 * 2, -2.0]))
    assert cloud[0, :, 0, 0].abs().sum() == 0
    shifted = seen_from(torch.tensor([[0.0, 0.0, 1.0]]), cloud)
    assert torch.allclose(shifted - cloud, torch.tensor([0.0, 0, 1]).view(1, 3, 1, 1).expand_as(cloud))


def test_shading_head_on_is_the_formula_worked_out_by_hand():
    size, roughness = 3, 0.5
    normal = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1).expand(1, 3, size, size)
    albedo, rough = torch.full((1, 3, size, size), 0.4), torch.full((1, 1, size, size), roughness)
    light, camera = torch.tensor([[0.0, 0.0, 1.0]]), torch.tensor([[100.0, 100.0, 1.0, 1.0]])
    middle = rendered(albedo, normal, rough, light, camera)[0, :, 1, 1]
    fresnel = 0.05 + 0.95 * 2 ** (-5.55473 - 6.98316)
    assert torch.allclose(middle, torch.full((3,), 0.4 + fresnel / (4 * roughness**4)), rtol=1e-4)
    behind = rendered(albedo, normal, rough, torch.tensor([[0.6, 0.0, -0.8]]), camera)
    assert behind.abs().max() == 0


def test_noise_is_the_papers_and_averages_out():
    dirty = noisy(torch.full((1, 1, 256, 256), 0.5), np.random.default_rng(1))
    # Blur by one pixel leaves 1 / (2 √π) of white noise.
    assert abs(dirty.mean() - 0.5) < 2e-3 and abs(dirty.std() - 6.25e-2 * 0.2821) < 2e-3


def test_clouds_fill_the_unit_cube_whatever_their_scale():
    depth = 3 + torch.rand(2, 1, 16, 16, generator=torch.Generator().manual_seed(4))
    known = (torch.arange(256).view(1, 1, 16, 16) > 20).float().expand(2, 1, 16, 16)
    cloud = points(torch.where(known > 0, depth, torch.nan), torch.tensor([[20.0, 20.0, 7.5, 7.5]]).expand(2, 4))
    unit = normalised(cloud, known)
    assert torch.allclose(unit.abs().amax((1, 2, 3)), torch.ones(2)) and (unit * (1 - known)).abs().sum() == 0


def test_pixels_without_surface_count_in_no_loss():
    generator = torch.Generator().manual_seed(5)
    truth, guess = (torch.rand(1, 1, 8, 8, generator=generator) for _ in range(2))
    known = torch.ones(1, 1, 8, 8)
    known[..., :3, :] = 0
    other = torch.where(known > 0, guess, 1 - guess)
    for loss in (cross_entropy, with_gradients, squared):
        assert float(loss(guess, truth, known)) == float(loss(other, truth, known)) > 0
