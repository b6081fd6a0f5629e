"""Beyond the paper (`pose="geometric"`): the shape of each class is learned, and projection does the rest.

The paper's decoder is an MLP that has to rediscover projection. But the class is known, and the training annotations show where each class has
its hubs. So: (a) `SharpHead` finds the keypoints on a fine map and says how sure it is of each; (b) `ClassShapes` holds the hubs of every class;
(c) `refine` moves a pose until the hubs fall onto the keypoints, each as far as it can be trusted, with gradients through its last step; (d) a
direct branch, an MLP on well-conditioned rays, guesses the pose first. Its guess starts the search and stays in it as a prior: where keypoints
say little it carries the pose, and of the two poses a flat object has (see `pnp`) it is what decides.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from dronekeypp import camera, rotations
from dronekeypp.model.config import ModelConfig
from dronekeypp.model.decoder import EMBEDDING, RayFeatures, from_site, mlp
from dronekeypp.model.encoder import cell_centres

WIDTH = 64  # channels of the sharp head
NEAREST = 0.05  # m: a hub behind the camera is treated as this far before it, so that a search can find its way back
STEPS = 5  # of the search without gradients; one with them follows
DAMPING = 1e-3  # share of its own diagonal that is added to the normal matrix
KEYPOINT_SIGMA = (0.002, 0.5)  # crop units, of one keypoint: what may be claimed
ANGLE_SIGMA = (0.01, 3.0)  # radians, of the direct branch
DISTANCE_SIGMA = (0.005, 1.0)  # share of the depth, of the direct branch


class SharpHead(nn.Module):
    """Feature maps at three strides -> keypoints (B, 4, 2) and their standard deviation (B, 4), both in crop units.

    The coarse map knows which propeller is which, the fine one where exactly it is. Each is brought to WIDTH channels and added to the enlarged
    coarser one (feature pyramid, Lin et al., CVPR 2017). Then every cell of the fine map says how much it looks like each keypoint, and a
    keypoint is the mean place (soft-argmax). Its deviation is read from the features there and from how wide its map is.
    """

    def __init__(self, channels: tuple[int, int, int], side: int):
        super().__init__()
        self.lateral = nn.ModuleList(nn.Conv2d(c, WIDTH, 1) for c in channels)
        self.smooth = nn.ModuleList(
            nn.Sequential(nn.Conv2d(WIDTH, WIDTH, 3, padding=1, bias=False), nn.BatchNorm2d(WIDTH), nn.ReLU())
            for _ in range(2)
        )
        self.to_heatmap = nn.Conv2d(WIDTH, 4, 1, bias=False)
        self.to_sigma = nn.Sequential(nn.Linear(WIDTH + 1, 32), nn.ReLU(), nn.Linear(32, 1))
        nn.init.constant_(self.to_sigma[-1].bias, math.log(0.03))
        self.register_buffer("centres", cell_centres(side), persistent=False)  # (M, 2)
        self.to(memory_format=torch.channels_last)

    def forward(self, levels: list[Tensor]) -> dict[str, Tensor]:
        fine, middle, x = (layer(level) for layer, level in zip(self.lateral, levels, strict=True))
        x = self.smooth[0](
            middle + interpolate(x, size=middle.shape[-2:], mode="bilinear")
        )  # (B, W, s/8, s/8)
        x = self.smooth[1](fine + interpolate(x, size=fine.shape[-2:], mode="bilinear"))  # (B, W, s/4, s/4)
        heat = torch.softmax(self.to_heatmap(x).flatten(2), dim=2)  # (B, 4, M), each sums to 1
        keypoints = heat @ self.centres  # (B, 4, 2)
        apart = (self.centres - keypoints[:, :, None]).square().sum(dim=-1)  # (B, 4, M)
        spread = (heat * apart).sum(dim=-1, keepdim=True) + 1e-6  # (B, 4, 1)
        there = heat @ x.flatten(2).transpose(1, 2)  # (B, 4, W)
        log_sigma = self.to_sigma(torch.cat([there, 0.5 * spread.log()], dim=2)).squeeze(2)
        return {"keypoints": keypoints, "keypoint_sigma": bounded(log_sigma, KEYPOINT_SIGMA)}


def bounded(log_value: Tensor, limits: tuple[float, float]) -> Tensor:
    """exp(log_value), kept within `limits`."""
    return log_value.clamp(math.log(limits[0]), math.log(limits[1])).exp()


class ClassShapes(nn.Module):
    """Where each class has its hubs: (classes, 4, 3) metres in body axes. Learned, and never read off a specification sheet."""

    def __init__(self, classes: int):
        super().__init__()
        self.hubs = nn.Parameter(0.1 * torch.randn(classes, 4, 3))

    @torch.no_grad()
    def fit(self, label: Tensor, R: Tensor, keypoints_3d: Tensor) -> None:
        """Start from the training annotations: the mean of R^T (hubs about the centre, camera axes) of a class; a class without any: of all."""
        body = keypoints_3d @ R  # (F, 4, 3): rows are points, so this is R^T X
        for k in range(len(self.hubs)):
            mine = body[label == k]
            self.hubs[k] = (mine if len(mine) else body).mean(dim=0)

    def forward(self, probs: Tensor) -> Tensor:
        """Class distribution (B, classes) -> the blended shape (B, 4, 3)."""
        return (probs @ self.hubs.flatten(1)).unflatten(1, (4, 3))

    def size_deviation(self, probs: Tensor) -> Tensor:
        """How uncertain the class makes the size (B,): standard deviation of its logarithm. Distance is known no better than size."""
        log_size = (self.hubs - self.hubs.mean(dim=1, keepdim=True)).square().sum(dim=2).mean(
            dim=1
        ).log() / 2  # (classes,)
        mean = probs @ log_size
        return (probs @ log_size.square() - mean.square()).clamp(min=0).sqrt()


def from_rotation_vector(v: Tensor) -> Tensor:
    """Axis times angle (B, 3), radians, to rotations (B, 3, 3) by Rodrigues' formula; smooth at 0."""
    angle = (v.square().sum(dim=1) + 1e-16).sqrt()[:, None, None]  # (B, 1, 1)
    W = cross_matrix(v)
    eye = torch.eye(3, dtype=v.dtype, device=v.device)
    return eye + angle.sin() / angle * W + (1 - angle.cos()) / angle.square() * (W @ W)


def cross_matrix(v: Tensor) -> Tensor:
    """(…, 3) -> (…, 3, 3) with cross_matrix(v) @ x = v × x."""
    x, y, z = v.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).unflatten(-1, (3, 3))


def chord(R: Tensor, R0: Tensor) -> Tensor:
    """The turn from R0 to R as a vector (B, 3): its axis times 2 sin(angle / 2). Like the rotation vector for small turns, and bounded."""
    M = R @ R0.transpose(1, 2)
    axis = (
        torch.stack([M[:, 2, 1] - M[:, 1, 2], M[:, 0, 2] - M[:, 2, 0], M[:, 1, 0] - M[:, 0, 1]], dim=1) / 2
    )  # times sin(angle)
    half = ((1 + M.diagonal(dim1=1, dim2=2).sum(dim=1)) / 4).clamp(min=1e-3).sqrt()  # cos(angle / 2)
    return axis / half[:, None]


def flipped(R: Tensor, t: Tensor, hubs: Tensor) -> tuple[Tensor, Tensor]:
    """The other pose of a flat object: R (B, 3, 3), t (B, 3), hubs (B, 4, 3) -> R, t.

    Seen from far away, four points in a plane look the same when the plane is mirrored along the line of sight. Mirror the body in its own plane,
    then the world along the ray: two mirrors make a rotation, and the points' middle stays where it is.
    """
    middle = hubs.mean(dim=1)  # (B, 3)
    normal = torch.linalg.cross(hubs[:, 2] - hubs[:, 0], hubs[:, 3] - hubs[:, 1])
    ray = t + (R @ middle[:, :, None]).squeeze(2)
    other = mirror(ray) @ R @ mirror(normal)
    return other, t + ((R - other) @ middle[:, :, None]).squeeze(2)


def mirror(v: Tensor) -> Tensor:
    """The reflection (B, 3, 3) in the plane across v (B, 3)."""
    n = nn.functional.normalize(v, dim=1)
    return torch.eye(3, dtype=v.dtype, device=v.device) - 2 * n[:, :, None] * n[:, None, :]


def solve(H: Tensor, b: Tensor) -> Tensor:
    """x with H x = b for symmetric positive definite H (B, 6, 6) and b (B, 6, m), by blocks of 3: few steps, all of which ONNX knows."""
    A, across, C = H[:, :3, :3], H[:, :3, 3:], H[:, 3:, 3:]
    inverse_A = inverse(A)
    down = across.transpose(1, 2) @ inverse_A  # (B, 3, 3)
    second = inverse(C - down @ across) @ (
        b[:, 3:] - down @ b[:, :3]
    )  # C - down @ across: the Schur complement of A
    return torch.cat([inverse_A @ (b[:, :3] - across @ second), second], dim=1)


def inverse(M: Tensor) -> Tensor:
    """Of 3 x 3 matrices (B, 3, 3): the cross products of their rows, as columns, over the determinant."""
    rows, following = M, M[:, [1, 2, 0]]
    crosses = torch.linalg.cross(following, M[:, [2, 0, 1]])  # row i: rows i+1 and i+2
    return crosses.transpose(1, 2) / (rows[:, :1] * crosses[:, :1]).sum(dim=2, keepdim=True)


class Problem:
    """What a pose has to fit: the keypoints as rays, and the direct branch's guess as a prior. All but `hubs` in ray units, radians, metres.

    hubs (B, 4, 3) · rays (B, 4, 2) · ray_sigma (B, 4, 2) · R0 (B, 3, 3), t0 (B, 3) · angle_sigma, distance_sigma (B,) radians and metres.
    """

    def __init__(self, hubs, rays, ray_sigma, R0, t0, angle_sigma, distance_sigma):
        self.hubs, self.rays, self.R0, self.t0 = hubs, rays, R0, t0
        prior = torch.stack([angle_sigma] * 3 + [distance_sigma] * 3, dim=1)  # (B, 6)
        self.weights = torch.cat([ray_sigma.flatten(1), prior], dim=1).pow(-2)  # (B, 8 + 6)

    def twice(self) -> Problem:
        """The same problems once more behind themselves, (2 B), for a second start each."""
        other = object.__new__(Problem)
        for name, value in vars(self).items():
            setattr(other, name, torch.cat([value, value]))
        return other

    def residuals(self, R: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
        """Residuals (B, 14) and their derivative (B, 14, 6) by a small turn on the left of R and a small shift of t."""
        turned = self.hubs @ R.transpose(1, 2)  # (B, 4, 3)
        x, y, z = (turned + t[:, None]).unbind(2)
        z = z.clamp(min=NEAREST)
        zero = torch.zeros_like(z)
        seen = torch.stack([x, y], dim=2) / z[..., None]  # (B, 4, 2)
        by_point = torch.stack([1 / z, zero, -x / z.square(), zero, 1 / z, -y / z.square()], dim=2).unflatten(
            2, (2, 3)
        )  # (B, 4, 2, 3)
        by_pose = torch.cat([-(by_point @ cross_matrix(turned)), by_point], dim=3).flatten(1, 2)  # (B, 8, 6)
        eye = torch.eye(6, dtype=t.dtype, device=t.device).expand(t.shape[0], 6, 6)
        residual = torch.cat([(seen - self.rays).flatten(1), chord(R, self.R0), t - self.t0], dim=1)
        return residual, torch.cat([by_pose, eye], dim=1)

    def normal_equations(self, R: Tensor, t: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Cost (B,), gradient (B, 6, 1) and normal matrix (B, 6, 6) of half the weighted squares."""
        r, J = self.residuals(R, t)
        weighted = J.transpose(1, 2) * self.weights[:, None]  # (B, 6, 14)
        return 0.5 * (self.weights * r.square()).sum(dim=1), weighted @ r[:, :, None], weighted @ J

    def step(self, R: Tensor, t: Tensor, damping: float) -> tuple[Tensor, Tensor]:
        """One damped Gauss-Newton step."""
        _, gradient, H = self.normal_equations(R, t)
        change = -solve(H + damping * torch.diag_embed(H.diagonal(dim1=1, dim2=2)), gradient).squeeze(2)
        return from_rotation_vector(change[:, :3]) @ R, t + change[:, 3:]


def refine(problem: Problem) -> dict[str, Tensor]:
    """The pose that fits best, searched from the prior and from its flipped twin.

    Only the last step carries gradients. At the minimum the gradient of the cost is zero, so that one step moves by exactly what a change of
    keypoints, deviations or shape would move the minimum (the implicit function theorem); there is no need to go back through the search.

    Returns R (B, 3, 3), t (B, 3), cost (B, 2) of both ends, covariance (B, 6, 6) of turn and shift around the better one; apart (B, 6), the turn
    and shift to the other one, and the share (B,) of belief that it deserves.
    """
    with torch.no_grad():
        starts = zip((problem.R0, problem.t0), flipped(problem.R0, problem.t0, problem.hubs), strict=True)
        (R, t), both = (torch.cat(pair) for pair in starts), problem.twice()
        for _ in range(STEPS):
            R, t = both.step(R, t, DAMPING)
        B, ends = problem.t0.shape[0], both.normal_equations(R, t)[0]
        cost = torch.stack([ends[:B], ends[B:]], dim=1)  # (B, 2)
        ends_R, ends_t = (R[:B], R[B:]), (t[:B], t[B:])
        second = (cost[:, 1] < cost[:, 0])[:, None]
        R, other_R = (torch.where(second[..., None] == turn, *ends_R) for turn in (False, True))
        t, other_t = (torch.where(second == turn, *ends_t) for turn in (False, True))
        apart = torch.cat([chord(other_R, R), other_t - t], dim=1)  # (B, 6)
        share = torch.sigmoid(
            -(cost[:, 0] - cost[:, 1]).abs()
        )  # of the other pose, if both costs are log-likelihoods
    R, t = problem.step(R, t, 0.0)
    _, _, H = problem.normal_equations(R, t)
    covariance = solve(H, torch.eye(6, dtype=t.dtype, device=t.device).expand_as(H))
    return {"R": R, "t": t, "cost": cost, "covariance": covariance, "apart": apart, "share": share}


class GeometricDecoder(nn.Module):
    """Keypoints (B, 4, 2) and their sigma (B, 4) in crop units, class probabilities (B, classes), K, square, look (B, d) -> pose.

    `look` is what the encoder made of the picture, the last layer's pooled tokens; the direct branch sees the drone as well as its keypoints.

    Returns keypoints_px, rays, keypoints_3d, R, t as `PoseDecoder` does, and: R_direct, t_direct, angle_sigma (B,) radians and distance_sigma
    (B,) of the direct branch, cost (B, 2), covariance (B, 6, 6) of (turn in radians, shift in metres), camera axes.
    """

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        self.shapes = ClassShapes(config.classes)
        self.ray_features = RayFeatures(config.rays)
        self.embed_rays = nn.Linear(self.ray_features.size, EMBEDDING)
        self.embed_class = nn.Linear(config.classes, EMBEDDING)
        self.embed_look = nn.Linear(config.width, EMBEDDING)
        self.mlp_pose = mlp(3 * EMBEDDING, 6 + 3 + 2, config)
        with torch.no_grad():  # the identity, 0.2 m large, 20 degrees and a tenth of the distance uncertain
            self.mlp_pose[-1].bias.copy_(
                torch.tensor([1.0, 0, 0, 0, 1, 0, 0, 0, math.log(0.2), math.log(0.35), math.log(0.1)])
            )
        self.register_buffer(
            "calibration", torch.ones(2)
        )  # what the covariance's deviations are multiplied with: turn, shift

    def fit_rays(self, batches: Iterable[dict[str, Tensor]]) -> None:
        """Set the ray statistics from batches with true keypoints, square and K."""
        found = [camera.rays(camera.from_crop(b["keypoints"], b["square"]), b["K"]).cpu() for b in batches]
        self.ray_features.fit(torch.cat(found))

    def forward(
        self, keypoints: Tensor, probs: Tensor, K: Tensor, square: Tensor, sigma: Tensor, look: Tensor
    ) -> dict[str, Tensor | None]:
        pixels = camera.from_crop(keypoints, square)  # (B, 4, 2)
        rays = camera.rays(pixels, K)  # (B, 4, 3), Eq. 6
        given = (
            rays.detach()
        )  # keypoints learn to be where the hubs are, not where the direct branch would like them
        fused = torch.cat(
            [self.embed_rays(self.ray_features(given)), self.embed_class(probs), self.embed_look(look)], dim=1
        )
        direct = self.mlp_pose(torch.relu(fused))
        R0 = rotations.towards(given.mean(dim=1)) @ rotations.matrix_from_6d(direct[:, :6])
        t0 = from_site(direct[:, 6:9], given)
        angle_sigma, distance_sigma = (
            bounded(direct[:, 9], ANGLE_SIGMA),
            bounded(direct[:, 10], DISTANCE_SIGMA),
        )
        hubs = self.shapes(probs)
        focal = torch.stack([K[:, 0, 0], K[:, 1, 1]], dim=1)  # (B, 2)
        ray_sigma = sigma[:, :, None] * (square[:, 2:] / focal)[:, None]  # (B, 4, 2)
        depth = t0[:, 2].detach().clamp(min=NEAREST)
        found = refine(
            Problem(
                hubs, rays[..., :2], ray_sigma, R0.detach(), t0.detach(), angle_sigma, distance_sigma * depth
            )
        )
        R, t = found["R"], found["t"]
        return {
            "keypoints_px": pixels, "rays": rays, "e_ray": None, "e_cls": None, "angles": None, "R": R, "t": t,
            "keypoints_3d": hubs @ R.transpose(1, 2), "R_direct": R0, "t_direct": t0, "angle_sigma": angle_sigma,
            "distance_sigma": distance_sigma, "cost": found["cost"], "covariance": self.total_covariance(found, probs),
        }  # fmt: skip

    def total_covariance(self, found: dict[str, Tensor], probs: Tensor) -> Tensor:
        """The covariance (B, 6, 6) with what one fit cannot know.

        The other pose of the two that a flat object has, with the belief it deserves. How uncertain the class makes the size, and with it the
        distance. And a fit that is bad: 14 residuals less 6 unknowns, so half the weighted squares should be about 4; where they are more, the
        drone is not of the shape we think.
        """
        misfit = (found["cost"].amin(dim=1) / 4).clamp(min=1)[:, None, None]
        along = self.shapes.size_deviation(probs)[:, None] * found["t"]  # (B, 3)
        size = torch.cat([torch.zeros_like(along), along], dim=1)  # (B, 6)
        other = (found["share"] * (1 - found["share"])).sqrt()[:, None] * found[
            "apart"
        ]  # of two poses with these shares
        spreads = torch.stack([size, other], dim=2)  # (B, 6, 2)
        scale = self.calibration.repeat_interleave(3)
        return (misfit * found["covariance"] + spreads @ spreads.transpose(1, 2)) * scale[:, None] * scale
