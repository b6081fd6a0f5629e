"""Beyond the paper: a pose that fits learned shapes to uncertain keypoints, its gradient, and what it says of its own doubt."""

import pytest
import torch
from fakes import CORNERS, FakeDrones, tiny
from torch.utils.data import default_collate

from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP, ModelConfig, geometry
from dronekeypp.model.losses import likelihood
from dronekeypp.rotations import geodesic_degrees

FAR = 100.0  # a prior that says nothing


def poses(B=16, seed=0, dtype=torch.float64):
    """hubs (B, 4, 3) of a drone 0.3 m wide, R (B, 3, 3) tilted by up to about 40 degrees, t (B, 3) 2 to 4 m ahead."""
    draw = torch.Generator().manual_seed(seed)
    hubs = (0.15 * CORNERS.to(dtype) * torch.tensor([0.9, 1.0, 1.0])).expand(B, 4, 3)
    R = geometry.from_rotation_vector(torch.randn(B, 3, generator=draw, dtype=dtype))
    t = torch.randn(B, 3, generator=draw, dtype=dtype) * torch.tensor([0.3, 0.2, 0.0]) + torch.tensor(
        [0, 0, 3.0]
    )
    return hubs, R, t + torch.rand(B, 1, generator=draw, dtype=dtype) * torch.tensor([0, 0, 1.0])


def seen(hubs, R, t):
    points = hubs @ R.transpose(1, 2) + t[:, None]
    return points[..., :2] / points[..., 2:]


def problem(hubs, rays, R0, t0, ray_sigma=1e-3, angle=FAR, distance=FAR):
    B = len(rays)
    full = lambda value, *shape: torch.full((B, *shape), value, dtype=rays.dtype)  # noqa: E731
    return geometry.Problem(hubs, rays, full(ray_sigma, 4, 2), R0, t0, full(angle), full(distance))


def test_the_normal_equations_are_solved():
    A = torch.randn(5, 6, 6, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    H, b = A @ A.transpose(1, 2) + torch.eye(6), torch.ones(5, 6, 2, dtype=torch.float64)
    torch.testing.assert_close(geometry.solve(H, b), torch.linalg.solve(H, b))


def test_rotation_vectors_and_chords():
    v = torch.tensor([[0.0, 0, 0], [0.3, 0, 0], [0, -1.2, 0.5], [0, 0, 3.0]], dtype=torch.float64)
    R = geometry.from_rotation_vector(v)
    torch.testing.assert_close(R, torch.matrix_exp(geometry.cross_matrix(v)), atol=1e-7, rtol=0)
    eye = torch.eye(3, dtype=torch.float64).expand(4, 3, 3)
    angle = v.norm(dim=1)
    torch.testing.assert_close(geometry.chord(R, eye).norm(dim=1), 2 * (angle / 2).sin(), atol=1e-6, rtol=0)
    torch.testing.assert_close(geometry.chord(R[1:2], eye[1:2]), v[1:2], rtol=0.01, atol=0)


def test_exact_keypoints_give_the_exact_pose():
    hubs, R, t = poses()
    R0 = geometry.from_rotation_vector(0.25 * torch.ones(16, 3, dtype=torch.float64)) @ R  # 25 degrees off
    found = geometry.refine(problem(hubs, seen(hubs, R, t), R0, 1.2 * t))
    assert geodesic_degrees(found["R"], R).max() < 1e-3 and (found["t"] - t).norm(dim=1).max() < 1e-5
    assert (found["cost"].amin(dim=1) < 1e-3).all()


def test_the_flipped_pose_looks_alike_from_far_away_and_flips_back():
    hubs, R, t = poses()
    for distance, most in ((1.0, 0.2), (30.0, 0.01)):
        far = distance * t
        other, moved = geometry.flipped(R, far, hubs)
        apart = (seen(hubs, other, moved) - seen(hubs, R, far)).norm(dim=2).amax(dim=1)
        assert (apart < most * seen(hubs, R, far).std(dim=1).norm(dim=1)).float().mean() > 0.8
        torch.testing.assert_close(geometry.flipped(other, moved, hubs)[0], R, atol=1e-9, rtol=0)
        torch.testing.assert_close(torch.linalg.det(other), torch.ones(16, dtype=torch.float64))


def test_started_at_the_wrong_one_of_two_poses_it_finds_the_right_one():
    hubs, R, t = poses(B=64)
    wrong, moved = geometry.flipped(R, t, hubs)
    found = geometry.refine(problem(hubs, seen(hubs, R, t), wrong, moved, ray_sigma=1e-4))
    assert (geodesic_degrees(found["R"], R) < 1).float().mean() > 0.9


def test_without_keypoints_the_prior_stays():
    hubs, R, t = poses()
    R0 = geometry.from_rotation_vector(0.1 * torch.ones(16, 3, dtype=torch.float64)) @ R
    found = geometry.refine(
        problem(hubs, seen(hubs, R, t), R0, t + 0.1, ray_sigma=10.0, angle=0.05, distance=0.05)
    )
    assert geodesic_degrees(found["R"], R0).max() < 0.1 and (found["t"] - t - 0.1).norm(dim=1).max() < 1e-3


def test_the_gradient_is_that_of_the_whole_search():
    """One step with gradients stands for all of them: against finite differences of the search from beginning to end."""
    hubs, R, t = poses(B=4)
    rays, hubs = seen(hubs, R, t), hubs.clone()
    R0 = geometry.from_rotation_vector(0.05 * torch.ones(4, 3, dtype=torch.float64)) @ R
    weights = torch.randn(4, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)

    def outcome(rays, hubs):
        found = geometry.refine(problem(hubs, rays, R0, 1.02 * t))
        return ((found["R"] @ weights[:, :, None]).squeeze(2) * weights + found["t"] * weights).sum()

    for which, inputs in enumerate((rays, hubs)):
        given = [rays, hubs]
        given[which] = inputs.clone().requires_grad_()
        (gradient,) = torch.autograd.grad(outcome(*given), given[which])
        for index in ((0, 0, 0), (1, 2, 1), (3, 3, 0)):
            up, down = ([v.clone() for v in (rays, hubs)] for _ in range(2))
            up[which][index] += 1e-5
            down[which][index] -= 1e-5
            slope = (outcome(*up) - outcome(*down)) / 2e-5
            assert gradient[index] == pytest.approx(float(slope), rel=0.02, abs=1e-3)


def test_the_covariance_is_how_poses_scatter():
    hubs, R, t = (v[:1].expand(2000, *v.shape[1:]) for v in poses())
    noise = 2e-4 * torch.randn(2000, 4, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    found = geometry.refine(
        problem(hubs, seen(hubs, R, t) + noise, R, t, ray_sigma=2e-4, angle=0.5, distance=1.0)
    )
    turn = geometry.chord(found["R"], R)
    scattered = torch.cat([turn, found["t"] - t], dim=1).std(dim=0)
    claimed = found["covariance"].diagonal(dim1=1, dim2=2).mean(dim=0).sqrt()
    torch.testing.assert_close(scattered, claimed, rtol=0.2, atol=0)


def test_of_two_poses_the_other_keeps_its_share_of_belief():
    hubs, R, t = poses(B=32)
    far = 30 * t
    found = geometry.refine(problem(hubs, seen(hubs, R, far), R, far, ray_sigma=1e-3, distance=30.0))
    assert (found["share"] > 0.4).all() and found["apart"][:, :3].norm(
        dim=1
    ).median() > 0.3  # alike at this distance: a coin
    near = geometry.refine(problem(hubs, seen(hubs, R, t), R, t, ray_sigma=1e-4))
    assert near["share"].median() < 1e-3


def test_shapes_are_read_off_the_annotations():
    data = FakeDrones(64).annotations()
    shapes = geometry.ClassShapes(8)
    shapes.fit(data["label"], data["R"], data["keypoints_3d"])
    one = torch.eye(8)[data["label"]]
    torch.testing.assert_close(
        shapes(one) @ data["R"].transpose(1, 2), data["keypoints_3d"], atol=1e-5, rtol=0
    )
    assert (shapes(torch.eye(8)[7:]) > 0).any()  # nobody flew class 7: it gets what is common to all
    assert shapes.size_deviation(torch.eye(8)).abs().max() < 1e-3
    mixed = (torch.eye(8)[:1] + torch.eye(8)[6:7]) / 2
    sizes = [
        hubs.sub(hubs.mean(dim=0)).square().sum(dim=1).mean().sqrt() for hubs in shapes.hubs.detach()[[0, 6]]
    ]
    halfway = float((sizes[1] / sizes[0]).log()) / 2
    assert float(shapes.size_deviation(mixed).detach()) == pytest.approx(halfway, rel=1e-3)


SMALL = tiny(image_size=32, rays="split", pose="geometric")


@pytest.fixture
def network():
    torch.manual_seed(0)
    net = DroneKeyPP(ModelConfig(**SMALL))
    net.prepare(FakeDrones(64).annotations())
    return net


def test_the_network_answers_like_the_papers_and_more(network):
    items = default_collate([FakeDrones(4)[i] for i in range(4)])
    out = network.eval()(items["image"], items["K"], items["square"])
    assert out["keypoints"].shape == out["coarse_keypoints"].shape == (4, 4, 2) and out[
        "keypoint_sigma"
    ].shape == (4, 4)
    assert out["R"].shape == (4, 3, 3) and out["t"].shape == (4, 3) and out["covariance"].shape == (4, 6, 6)
    torch.testing.assert_close(
        out["R"] @ out["R"].transpose(1, 2), torch.eye(3).expand(4, 3, 3), atol=1e-5, rtol=0
    )
    assert (torch.linalg.eigvalsh(out["covariance"]) > 0).all()
    low, high = geometry.KEYPOINT_SIGMA
    assert ((out["keypoint_sigma"] > 0.99 * low) & (out["keypoint_sigma"] < 1.01 * high)).all()
    counts = network.parameter_counts()
    assert counts["total"] == sum(p.numel() for p in network.parameters())


def test_every_part_learns(network):
    items = default_collate([FakeDrones(16)[i] for i in range(16)])
    out = network.train()(items["image"], items["K"], items["square"])
    terms = network.losses(out, items, 10.0)
    assert set(terms) == {"L_2D", "L_cls", "L_3D", "L_rot", "L_trans"} and all(
        torch.isfinite(v) for v in terms.values()
    )
    sum(terms.values()).backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None and torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().max() > 0, name


def test_doubt_does_not_pay_with_accuracy():
    """The likelihood of an error teaches the sigma and leaves the answer alone."""
    error, sigma = (
        torch.tensor([0.04, 0.01], requires_grad=True),
        torch.tensor([0.1, 0.1], requires_grad=True),
    )
    likelihood(error, sigma, 2).backward()
    assert error.grad is None and (sigma.grad != 0).all()
    best = torch.tensor(0.05**0.5, requires_grad=True)  # two dimensions: half of the squared error each
    likelihood(torch.full((1,), 0.1), best, 2).backward()
    assert abs(float(best.grad)) < 1e-4


def test_a_checkpoint_comes_back(network, tmp_path):
    items = default_collate([FakeDrones(4)[i] for i in range(4)])
    network.eval().save_pretrained(tmp_path)
    again = DroneKeyPP.from_pretrained(tmp_path)
    inputs = items["image"], items["K"], items["square"]
    torch.testing.assert_close(again(*inputs)["t"], network(*inputs)["t"])


def test_it_needs_a_picture():
    with pytest.raises(InputError, match="pose=geometric needs an encoder"):
        ModelConfig(pose="geometric", encoder="truth")
    net = DroneKeyPP(ModelConfig(**SMALL)).eval()
    truth = FakeDrones(2).annotations()
    with pytest.raises(InputError, match="needs the image"):
        net(None, truth["K"], truth["square"], keypoints=truth["keypoints"], label=truth["label"])


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
    with pytest.raises(InputError, match="pose=geometric has no such switch"):
        ModelConfig(**{**SMALL, **change})
