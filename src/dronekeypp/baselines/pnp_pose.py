"""This module goes from four keypoints and the true size to a pose.

It is the second half of every keypoint detector + PnP.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from dronekeypp import rotations
from dronekeypp.classes import DroneClass
from dronekeypp.data import hubs_of
from dronekeypp.errors import InputError
from dronekeypp.pnp import Solution, check_coplanar, solve_pnp

HYPOTHESES = ("fit", "upright")


class PnPPose(nn.Module):
    """Run PnP with the hubs of the drone whose class it is given.

    The four hubs of a drone lie in one plane, so two poses fit. `hypothesis` chooses between them:

    "fit" takes the pose with the lower reprojection error. Every PnP library does the same.
    "upright" takes the pose whose back is up (body z against camera up). It costs nothing, because drones do
    not fly on their heads.

    Where PnP finds no pose, the answer is a constant: the training set's median translation and its best
    constant rotation. Then `failed` is true, so the failure is counted, and its error too.

    Args:
        classes: the number of drones.
        hypothesis: one of HYPOTHESES. It may be changed at any time.

    Raises:
        InputError: the hypothesis is unknown.
    """

    def __init__(self, classes: int, hypothesis: str = "fit") -> None:
        super().__init__()
        if hypothesis not in HYPOTHESES:
            raise InputError(f"hypothesis={hypothesis!r} is not one of: {', '.join(HYPOTHESES)}")
        self.hypothesis = hypothesis
        self.register_buffer("hubs", torch.zeros(classes, 4, 3))  # body axes, metres
        self.register_buffer("fallback_R", torch.eye(3))
        self.register_buffer("fallback_t", torch.zeros(3))

    def learn(self, annotations: dict[str, Tensor], drones: Sequence[DroneClass] | None = None) -> None:
        """Take the true hubs of each class, and the constant answer, from the truth of the training frames.

        Args:
            annotations: label (F,), R (F, 3, 3), t (F, 3) metres and keypoints_3d (F, 4, 3) metres, stacked.
            drones: the classes. A class without a frame gets the hubs that are known of it.

        Raises:
            InputError: a class has no frame and no known hubs, or hubs do not lie in one plane.
        """
        for c in range(len(self.hubs)):
            name = drones[c].name if drones else f"class {c}"
            hubs = hubs_of(annotations, c)
            if hubs is None and drones and drones[c].hubs is not None:
                hubs = torch.tensor(drones[c].hubs, dtype=torch.float32)
            if hubs is None:
                raise InputError(
                    f"PnP needs the size of every drone, and the training set has no frame of {name}"
                )
            try:
                check_coplanar(hubs.numpy())
            except InputError:
                raise InputError(f"PnP needs hubs that lie in one plane; those of {name} do not") from None
            self.hubs[c] = hubs
        self.fallback_R.copy_(rotations.best_constant_rotation(annotations["R"]))
        self.fallback_t.copy_(annotations["t"].median(dim=0).values)

    @torch.no_grad()
    def forward(self, pixels: Tensor, label: Tensor, K: Tensor) -> dict[str, Tensor]:
        """Solve one pose for each frame, without gradients.

        Args:
            pixels: (B, 4, 2) keypoints in pixels of the full frame. A frame with NaN counts as failed.
            label: (B,) class indices.
            K: (B, 3, 3) camera matrices of the full frame.

        Returns:
            R (B, 3, 3) camera←body, t (B, 3) metres, failed (B,) bool.

        Raises:
            InputError: `learn` was not called yet.
        """
        if not self.hubs.any():
            raise InputError(
                "PnP does not know the drones' sizes yet: call learn() with training annotations first"
            )
        count = len(pixels)
        R, t = self.fallback_R.repeat(count, 1, 1), self.fallback_t.repeat(count, 1)
        failed = torch.ones(count, dtype=torch.bool, device=pixels.device)
        hubs = self.hubs[label].cpu().numpy()  # (B, 4, 3)
        points = pixels.cpu().numpy()
        cameras = K.cpu().numpy()
        for i in range(count):
            if not np.isfinite(points[i]).all():
                continue
            solutions = solve_pnp(hubs[i], points[i], cameras[i])
            if solutions:
                best = self.choose(solutions)
                R[i], t[i] = torch.from_numpy(best.R), torch.from_numpy(best.t)
                failed[i] = False
        return {"R": R, "t": t, "failed": failed}

    def choose(self, solutions: list[Solution]) -> Solution:
        """Return the solution that `hypothesis` asks for.

        `solutions` are sorted by their reprojection error.
        """
        if self.hypothesis == "fit":
            return solutions[0]
        return min(solutions, key=lambda solution: solution.R[1, 2])  # camera y points down
