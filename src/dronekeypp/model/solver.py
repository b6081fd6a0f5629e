"""Search for the pose that fits best (notebook 12).

It is a Gauss-Newton search from both poses that a flat object has. It uses only few operations, all of which
ONNX knows, and works on a whole batch at once.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

from dronekeypp.rotations import chord, cross_matrix, from_rotation_vector

# Metres. A hub behind the camera is treated as if it were this far in front of it, so that a search can find
# its way back.
NEAREST = 0.05
STEPS = 5  # steps of the search without gradients; one step with them follows
DAMPING = 1e-3  # share of its own diagonal that is added to the normal matrix


def flipped(R: Tensor, t: Tensor, hubs: Tensor) -> tuple[Tensor, Tensor]:
    """Return the other pose of a flat object.

    Seen from far away, four points in a plane look the same when the plane is mirrored along the line of
    sight. So the body is mirrored in its own plane, and then the world along the ray. Two mirrors make a
    rotation, and the middle of the points stays where it is.

    Args:
        R: (B, 3, 3) camera←body.
        t: (B, 3) metres.
        hubs: (B, 4, 3) metres, body axes.

    Returns:
        R (B, 3, 3) and t (B, 3) of the other pose.
    """
    middle = hubs.mean(dim=1)  # (B, 3)
    normal = torch.linalg.cross(hubs[:, 2] - hubs[:, 0], hubs[:, 3] - hubs[:, 1])
    ray = t + (R @ middle[:, :, None]).squeeze(2)
    other = mirror(ray) @ R @ mirror(normal)
    return other, t + ((R - other) @ middle[:, :, None]).squeeze(2)


def mirror(v: Tensor) -> Tensor:
    """Return the reflection (B, 3, 3) in the plane that v (B, 3) is perpendicular to."""
    n = nn.functional.normalize(v, dim=1)
    return torch.eye(3, dtype=v.dtype, device=v.device) - 2 * n[:, :, None] * n[:, None, :]


def solve(H: Tensor, b: Tensor) -> Tensor:
    """Solve H x = b by blocks of 3.

    Args:
        H: (B, 6, 6) symmetric positive definite.
        b: (B, 6, m).

    Returns:
        (B, 6, m).
    """
    A, across, C = H[:, :3, :3], H[:, :3, 3:], H[:, 3:, 3:]
    inverse_A = inverse(A)
    down = across.transpose(1, 2) @ inverse_A  # (B, 3, 3)
    complement = C - down @ across  # the Schur complement of A
    second = inverse(complement) @ (b[:, 3:] - down @ b[:, :3])
    return torch.cat([inverse_A @ (b[:, :3] - across @ second), second], dim=1)


def inverse(M: Tensor) -> Tensor:
    """Return the inverse of matrices (B, 3, 3).

    Its columns are the cross products of the rows, divided by the determinant.
    """
    # Slices, not lists of row numbers: those would be copied from the CPU, which a CUDA graph cannot hold.
    following = torch.cat([M[:, 1:], M[:, :1]], dim=1)  # row i: row i+1
    last = torch.cat([M[:, 2:], M[:, :2]], dim=1)  # row i: row i+2
    crosses = torch.linalg.cross(following, last)
    return crosses.transpose(1, 2) / (M[:, :1] * crosses[:, :1]).sum(dim=2, keepdim=True)


class Problem:
    """This is what a pose has to fit: the keypoints as rays, and a guess as a prior.

    Args:
        hubs: (B, 4, 3) metres, body axes.
        rays: (B, 4, 2) x and y of the keypoints' rays at z = 1.
        ray_sigma: (B, 4, 2) their standard deviations.
        R0: (B, 3, 3) rotation of the guess.
        t0: (B, 3) translation of the guess, metres.
        angle_sigma: (B,) standard deviation of the guessed rotation, radians.
        distance_sigma: (B,) standard deviation of the guessed translation, metres.
    """

    def __init__(
        self,
        hubs: Tensor,
        rays: Tensor,
        ray_sigma: Tensor,
        R0: Tensor,
        t0: Tensor,
        angle_sigma: Tensor,
        distance_sigma: Tensor,
    ) -> None:
        self.hubs, self.rays, self.R0, self.t0 = hubs, rays, R0, t0
        prior = torch.stack([angle_sigma] * 3 + [distance_sigma] * 3, dim=1)  # (B, 6)
        self.weights = torch.cat([ray_sigma.flatten(1), prior], dim=1).pow(-2)  # (B, 8 + 6)

    def twice(self) -> Problem:
        """Return the same problems twice, one copy behind the other, as a batch of 2 B.

        So each can be searched from two starts.
        """
        double = copy.copy(self)
        double.hubs = torch.cat([self.hubs, self.hubs])
        double.rays = torch.cat([self.rays, self.rays])
        double.R0 = torch.cat([self.R0, self.R0])
        double.t0 = torch.cat([self.t0, self.t0])
        double.weights = torch.cat([self.weights, self.weights])
        return double

    def residuals(self, R: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
        """Return the residuals (B, 14) of a pose, and their derivative (B, 14, 6).

        The derivative is by a small turn on the left of R and a shift of t.
        """
        turned = self.hubs @ R.transpose(1, 2)  # (B, 4, 3)
        x, y, z = (turned + t[:, None]).unbind(2)
        z = z.clamp(min=NEAREST)
        zero = torch.zeros_like(z)
        seen = torch.stack([x, y], dim=2) / z[..., None]  # (B, 4, 2)
        by_point = torch.stack([1 / z, zero, -x / z.square(), zero, 1 / z, -y / z.square()], dim=2)
        by_point = by_point.unflatten(2, (2, 3))  # (B, 4, 2, 3)
        by_pose = torch.cat([-(by_point @ cross_matrix(turned)), by_point], dim=3).flatten(1, 2)  # (B, 8, 6)
        eye = torch.eye(6, dtype=t.dtype, device=t.device).expand(t.shape[0], 6, 6)
        residual = torch.cat([(seen - self.rays).flatten(1), chord(R, self.R0), t - self.t0], dim=1)
        return residual, torch.cat([by_pose, eye], dim=1)

    def normal_equations(self, R: Tensor, t: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the cost, its gradient and the normal matrix at a pose.

        The cost (B,) is half the sum of the weighted squares. The gradient is (B, 6, 1), the normal matrix
        (B, 6, 6).
        """
        r, J = self.residuals(R, t)
        weighted = J.transpose(1, 2) * self.weights[:, None]  # (B, 6, 14)
        return 0.5 * (self.weights * r.square()).sum(dim=1), weighted @ r[:, :, None], weighted @ J

    def step(self, R: Tensor, t: Tensor, damping: float) -> tuple[Tensor, Tensor]:
        """Return the pose after one damped Gauss-Newton step."""
        _, gradient, H = self.normal_equations(R, t)
        change = -solve(H + damping * torch.diag_embed(H.diagonal(dim1=1, dim2=2)), gradient).squeeze(2)
        return from_rotation_vector(change[:, :3]) @ R, t + change[:, 3:]


def refine(problem: Problem) -> dict[str, Tensor]:
    """Search for the pose that fits best, from the prior and from its flipped twin.

    Only the last step carries gradients. At the minimum the gradient of the cost is zero. So that one step
    moves the pose by exactly what a change of keypoints, deviations or shape would move the minimum (the
    implicit function theorem). There is no need to go back through the search. The result is a dict.

    Returns:
        R: (B, 3, 3) of the better pose.
        t: (B, 3) of the better pose, metres.
        cost: (B, 2) of both poses that the search ended at.
        covariance: (B, 6, 6) of turn and shift around the better one.
        apart: (B, 6) the turn and shift from it to the other one.
        share: (B,) the belief that the other one deserves.
    """
    with torch.no_grad():
        twin_R, twin_t = flipped(problem.R0, problem.t0, problem.hubs)
        R, t = torch.cat([problem.R0, twin_R]), torch.cat([problem.t0, twin_t])  # both starts, (2 B)
        both = problem.twice()
        for _ in range(STEPS):
            R, t = both.step(R, t, DAMPING)
        B = problem.t0.shape[0]
        ends, _, _ = both.normal_equations(R, t)
        cost = torch.stack([ends[:B], ends[B:]], dim=1)  # (B, 2)
        twin_wins = (cost[:, 1] < cost[:, 0])[:, None]  # (B, 1)
        first_R, second_R, first_t, second_t = R[:B], R[B:], t[:B], t[B:]
        R = torch.where(twin_wins[..., None], second_R, first_R)
        other_R = torch.where(twin_wins[..., None], first_R, second_R)
        t = torch.where(twin_wins, second_t, first_t)
        other_t = torch.where(twin_wins, first_t, second_t)
        apart = torch.cat([chord(other_R, R), other_t - t], dim=1)  # (B, 6)
        # The share of the other pose, if both costs are log-likelihoods.
        share = torch.sigmoid(-(cost[:, 0] - cost[:, 1]).abs())
    R, t = problem.step(R, t, 0.0)
    _, _, H = problem.normal_equations(R, t)
    covariance = solve(H, torch.eye(6, dtype=t.dtype, device=t.device).expand_as(H))
    return {"R": R, "t": t, "cost": cost, "covariance": covariance, "apart": apart, "share": share}


def unrefined(R0: Tensor, t0: Tensor, angle_sigma: Tensor, distance_sigma: Tensor) -> dict[str, Tensor]:
    """Return a guess in the form of `refine`'s answer, as if the search had moved it nowhere.

    Its covariance is what the guess claims, its cost 0, and there is no other pose. For the arguments see
    `Problem`.
    """
    nowhere = torch.zeros(len(t0), 6, dtype=t0.dtype, device=t0.device)
    prior = torch.stack([angle_sigma] * 3 + [distance_sigma] * 3, dim=1)  # (B, 6)
    return {
        "R": R0,
        "t": t0,
        "cost": nowhere[:, :2],
        "covariance": torch.diag_embed(prior.square()),
        "apart": nowhere,
        "share": nowhere[:, 0],
    }
