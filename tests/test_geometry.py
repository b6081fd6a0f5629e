"""The geometric decoder: a pose that fits learned shapes to uncertain keypoints.

Its gradient and its own doubt are tested too.
"""

import pytest
import torch
from fakes import CORNERS, FakeDrones, tiny
from torch.utils.data import default_collate

from dronekeypp import rotations
from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP, ModelConfig, geometry, solver
from dronekeypp.model.geometric_losses import likelihood
from dronekeypp.rotations import geodesic_degrees

FAR = 100.0  # the deviation of a prior that says nothing
SETTINGS = tiny(image_size=32, rays="split", pose="geometric")


def random_poses(B=16, seed=0, dtype=torch.float64):
    """Random poses of a drone 0.3 m wide.

    Returns:
        hubs (B, 4, 3) in metres, R (B, 3, 3) tilted by up to about 40 degrees, and t (B, 3) 2 to 4 m ahead.
    """
    draw = torch.Generator().manual_seed(seed)
    hubs = (0.15 * CORNERS.to(dtype) * torch.tensor([0.9, 1.0, 1.0])).expand(B, 4, 3)
    R = rotations.from_rotation_vector(torch.randn(B, 3, generator=draw, dtype=dtype))
    sideways = torch.randn(B, 3, generator=draw, dtype=dtype) * torch.tensor([0.3, 0.2, 0.0])
    further = torch.rand(B, 1, generator=draw, dtype=dtype) * torch.tensor([0, 0, 1.0])
    return hubs, R, sideways + torch.tensor([0, 0, 3.0]) + further


def small_turn(B, radians):
    """The rotations (B, 3, 3) by the vector (radians, radians, radians)."""
    return rotations.from_rotation_vector(radians * torch.ones(B, 3, dtype=torch.float64))


def projected(hubs, R, t):
    """Where the hubs are seen, at z = 1: (B, 4, 2)."""
    points = hubs @ R.transpose(1, 2) + t[:, None]
    return points[..., :2] / points[..., 2:]


def problem(hubs, rays, R0, t0, ray_sigma=1e-3, angle=FAR, distance=FAR):
    """A Problem whose deviations are the same for every keypoint and every frame."""
    B = len(rays)

    def full(value, *shape):
        return torch.full((B, *shape), value, dtype=rays.dtype)

    return solver.Problem(hubs, rays, full(ray_sigma, 4, 2), R0, t0, full(angle), full(distance))


def batch(n):
    return default_collate([FakeDrones(n)[i] for i in range(n)])


def test_the_normal_equations_are_solved():
    """The solution by blocks is that of torch."""
    A = torch.randn(5, 6, 6, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    H, b = A @ A.transpose(1, 2) + torch.eye(6), torch.ones(5, 6, 2, dtype=torch.float64)
    torch.testing.assert_close(solver.solve(H, b), torch.linalg.solve(H, b))


def test_rotation_vectors_and_chords():
    """A rotation vector gives the matrix exponential. The chord of two rotations is 2 sin(angle/2) long."""
    v = torch.tensor([[0.0, 0, 0], [0.3, 0, 0], [0, -1.2, 0.5], [0, 0, 3.0]], dtype=torch.float64)
    R = rotations.from_rotation_vector(v)
    torch.testing.assert_close(R, torch.matrix_exp(rotations.cross_matrix(v)), atol=1e-7, rtol=0)
    eye = torch.eye(3, dtype=torch.float64).expand(4, 3, 3)
    angle = v.norm(dim=1)
    torch.testing.assert_close(rotations.chord(R, eye).norm(dim=1), 2 * (angle / 2).sin(), atol=1e-6, rtol=0)
    torch.testing.assert_close(rotations.chord(R[1:2], eye[1:2]), v[1:2], rtol=0.01, atol=0)


def test_exact_keypoints_give_the_exact_pose():
    """The search comes back from 25 degrees and a fifth of the distance off."""
    hubs, R, t = random_poses()
    R0 = small_turn(16, 0.25) @ R
    solution = solver.refine(problem(hubs, projected(hubs, R, t), R0, 1.2 * t))
    assert geodesic_degrees(solution["R"], R).max() < 1e-3
    assert (solution["t"] - t).norm(dim=1).max() < 1e-5
    assert (solution["cost"].amin(dim=1) < 1e-3).all()


def test_the_flipped_pose_looks_alike_from_far_away_and_flips_back():
    """The further away the drone is, the less the two poses differ in the picture.

    Flipping twice gives the first pose back.
    """
    hubs, R, t = random_poses()
    for distance, largest_share in ((1.0, 0.2), (30.0, 0.01)):
        far = distance * t
        other_R, other_t = solver.flipped(R, far, hubs)
        rays = projected(hubs, R, far)
        difference = (projected(hubs, other_R, other_t) - rays).norm(dim=2).amax(dim=1)
        extent = rays.std(dim=1).norm(dim=1)
        assert (difference < largest_share * extent).float().mean() > 0.8
        torch.testing.assert_close(solver.flipped(other_R, other_t, hubs)[0], R, atol=1e-9, rtol=0)
        torch.testing.assert_close(torch.linalg.det(other_R), torch.ones(16, dtype=torch.float64))


def test_started_at_the_wrong_one_of_two_poses_it_finds_the_right_one():
    hubs, R, t = random_poses(B=64)
    wrong_R, wrong_t = solver.flipped(R, t, hubs)
    solution = solver.refine(problem(hubs, projected(hubs, R, t), wrong_R, wrong_t, ray_sigma=1e-4))
    assert (geodesic_degrees(solution["R"], R) < 1).float().mean() > 0.9


def test_without_keypoints_the_prior_stays():
    """Keypoints whose deviation is huge do not move the pose away from its prior."""
    hubs, R, t = random_poses()
    R0 = small_turn(16, 0.1) @ R
    rays = projected(hubs, R, t)
    solution = solver.refine(problem(hubs, rays, R0, t + 0.1, ray_sigma=10.0, angle=0.05, distance=0.05))
    assert geodesic_degrees(solution["R"], R0).max() < 0.1
    assert (solution["t"] - t - 0.1).norm(dim=1).max() < 1e-3


def test_the_gradient_is_that_of_the_whole_search():
    """The gradient of the last step alone is that of the search from beginning to end.

    The reference is finite differences of the whole search.
    """
    hubs, R, t = random_poses(B=4)
    inputs = {"rays": projected(hubs, R, t), "hubs": hubs.clone()}
    R0 = small_turn(4, 0.05) @ R
    weights = torch.randn(4, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)

    def outcome(rays, hubs):
        solution = solver.refine(problem(hubs, rays, R0, 1.02 * t))
        turned = (solution["R"] @ weights[:, :, None]).squeeze(2) * weights
        return (turned + solution["t"] * weights).sum()

    def outcome_after_change(name, index, change):
        changed = inputs[name].clone()
        changed[index] += change
        return float(outcome(**{**inputs, name: changed}))

    for name, value in inputs.items():
        variable = value.clone().requires_grad_()
        (gradient,) = torch.autograd.grad(outcome(**{**inputs, name: variable}), variable)
        for index in ((0, 0, 0), (1, 2, 1), (3, 3, 0)):
            higher = outcome_after_change(name, index, 1e-5)
            lower = outcome_after_change(name, index, -1e-5)
            assert gradient[index] == pytest.approx((higher - lower) / 2e-5, rel=0.02, abs=1e-3)


def test_the_covariance_is_how_poses_scatter():
    """The covariance that the solver claims is the one of 2000 solutions from noisy keypoints."""
    hubs, R, t = random_poses()
    hubs, R, t = hubs[:1].expand(2000, 4, 3), R[:1].expand(2000, 3, 3), t[:1].expand(2000, 3)
    noise = 2e-4 * torch.randn(2000, 4, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    rays = projected(hubs, R, t) + noise
    solution = solver.refine(problem(hubs, rays, R, t, ray_sigma=2e-4, angle=0.5, distance=1.0))
    errors = torch.cat([rotations.chord(solution["R"], R), solution["t"] - t], dim=1)
    claimed = solution["covariance"].diagonal(dim1=1, dim2=2).mean(dim=0).sqrt()
    torch.testing.assert_close(errors.std(dim=0), claimed, rtol=0.2, atol=0)


def test_of_two_poses_the_other_keeps_its_share_of_belief():
    """Far away the two poses look alike and the other one's share is near a half; nearby it is near 0."""
    hubs, R, t = random_poses(B=32)
    far_t = 30 * t
    far = solver.refine(problem(hubs, projected(hubs, R, far_t), R, far_t, ray_sigma=1e-3, distance=30.0))
    assert (far["share"] > 0.4).all()
    assert far["apart"][:, :3].norm(dim=1).median() > 0.3
    near = solver.refine(problem(hubs, projected(hubs, R, t), R, t, ray_sigma=1e-4))
    assert near["share"].median() < 1e-3


def test_shapes_are_read_off_the_annotations():
    """Class shapes are fitted to the annotated hubs, and doubt between two classes is a doubt about size."""
    data = FakeDrones(64).annotations()
    shapes = geometry.ClassShapes(8)
    shapes.fit(data["label"], data["R"], data["keypoints_3d"])
    hubs = shapes(torch.eye(8)[data["label"]])
    torch.testing.assert_close(hubs @ data["R"].transpose(1, 2), data["keypoints_3d"], atol=1e-5, rtol=0)
    # Class 7 has no frame: it gets what is common to all.
    assert (shapes(torch.eye(8)[7:]) > 0).any()
    assert shapes.size_deviation(torch.eye(8)).abs().max() < 1e-3
    half_of_each = (torch.eye(8)[:1] + torch.eye(8)[6:7]) / 2
    two_shapes = shapes.hubs.detach()[[0, 6]]
    centred = two_shapes - two_shapes.mean(dim=1, keepdim=True)
    sizes = centred.square().sum(dim=2).mean(dim=1).sqrt()
    halfway = float((sizes[1] / sizes[0]).log()) / 2
    assert float(shapes.size_deviation(half_of_each).detach()) == pytest.approx(halfway, rel=1e-3)


@pytest.fixture
def network():
    torch.manual_seed(0)
    model = DroneKeyPP(ModelConfig.from_dict(SETTINGS))
    model.prepare(FakeDrones(64).annotations())
    return model


def test_the_network_answers_like_the_papers_and_more(network):
    """The outputs have the shapes of the paper's network; deviations and covariances are valid."""
    items = batch(4)
    out = network.eval()(items["image"], items["K"], items["square"])
    assert out["keypoints"].shape == (4, 4, 2)
    assert out["coarse_keypoints"].shape == (4, 4, 2)
    assert out["keypoint_sigma"].shape == (4, 4)
    assert out["R"].shape == (4, 3, 3)
    assert out["t"].shape == (4, 3)
    assert out["covariance"].shape == (4, 6, 6)
    eye = torch.eye(3).expand(4, 3, 3)
    torch.testing.assert_close(out["R"] @ out["R"].transpose(1, 2), eye, atol=1e-5, rtol=0)
    assert (torch.linalg.eigvalsh(out["covariance"]) > 0).all()
    low, high = geometry.KEYPOINT_SIGMA
    assert (out["keypoint_sigma"] > 0.99 * low).all()
    assert (out["keypoint_sigma"] < 1.01 * high).all()
    counts = network.parameter_counts()
    assert counts["total"] == sum(p.numel() for p in network.parameters())


def test_every_part_learns(network):
    """Every loss term is finite, and every parameter gets a finite gradient that is not zero."""
    items = batch(16)
    out = network.train()(items["image"], items["K"], items["square"])
    terms = network.losses(out, items, 10.0)
    assert set(terms) == {"L_2D", "L_cls", "L_3D", "L_rot", "L_trans"}
    for value in terms.values():
        assert torch.isfinite(value)
    sum(terms.values()).backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().max() > 0, name


def test_without_its_search_the_guess_is_the_answer():
    """With search=False the answer is the direct branch's, gradients and claimed deviations included."""
    model = DroneKeyPP(ModelConfig.from_dict({**SETTINGS, "search": False}))
    model.prepare(FakeDrones(64).annotations())
    items = batch(4)
    out = model.train()(items["image"], items["K"], items["square"])
    assert torch.equal(out["R"], out["R_direct"])
    assert torch.equal(out["t"], out["t_direct"])
    deviation = out["covariance"].diagonal(dim1=1, dim2=2).sqrt()
    size = model.decoder.shapes.size_deviation(out["class_probs"])[:, None] * out["t"]
    shift = (out["distance_sigma"] * out["t"][:, 2])[:, None]
    torch.testing.assert_close(deviation[:, :3], out["angle_sigma"][:, None].expand(4, 3))
    torch.testing.assert_close(deviation[:, 3:], (shift.square() + size.square()).sqrt())
    out["t"].sum().backward()
    assert model.decoder.mlp_pose[-1].weight.grad.abs().max() > 0


def test_doubt_does_not_pay_with_accuracy():
    """The likelihood of an error teaches the sigma and leaves the answer alone."""
    error = torch.tensor([0.04, 0.01], requires_grad=True)
    sigma = torch.tensor([0.1, 0.1], requires_grad=True)
    likelihood(error, sigma, 2).backward()
    assert error.grad is None
    assert (sigma.grad != 0).all()
    # The best sigma of two dimensions: each has half of the squared error.
    best = torch.tensor(0.05**0.5, requires_grad=True)
    likelihood(torch.full((1,), 0.1), best, 2).backward()
    assert abs(float(best.grad)) < 1e-4


def test_a_checkpoint_comes_back(network, tmp_path):
    """A network that is saved and loaded gives the same place."""
    items = batch(4)
    network.eval().save_pretrained(tmp_path)
    loaded = DroneKeyPP.from_pretrained(tmp_path)
    inputs = items["image"], items["K"], items["square"]
    torch.testing.assert_close(loaded(*inputs)["t"], network(*inputs)["t"])


def test_it_needs_a_picture():
    """True keypoints and labels cannot stand for the picture, neither in the settings nor in a call."""
    with pytest.raises(InputError, match="pose=geometric needs an encoder"):
        ModelConfig(pose="geometric", encoder="truth")
    model = DroneKeyPP(ModelConfig.from_dict(SETTINGS)).eval()
    truth = FakeDrones(2).annotations()
    with pytest.raises(InputError, match="needs the image"):
        model(None, truth["K"], truth["square"], keypoints=truth["keypoints"], label=truth["label"])


@pytest.mark.parametrize(
    "change",
    [
        {"use_class": False},
        {"use_rays": False},
        {"use_3d": False},
        {"rotation": "sixd"},
        {"translation": "site"},
    ],
)
def test_it_has_none_of_the_papers_switches(change):
    with pytest.raises(InputError, match="unknown setting .* with pose=geometric"):
        ModelConfig.from_dict({**SETTINGS, **change})
