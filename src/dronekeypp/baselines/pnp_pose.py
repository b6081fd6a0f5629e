"""From four keypoints and the drone's true size to a pose: the second half of every keypoint detector + PnP."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from dronekeypp import rotations
from dronekeypp.errors import InputError
from dronekeypp.pnp import solve_pnp

HYPOTHESES = ("fit", "upright")


class PnPPose(nn.Module):
    """PnP with the hubs of the drone it is told. Four hubs of a drone are coplanar, so two poses fit; `hypothesis` chooses between them:

    "fit": the lower reprojection error, which is what everybody's PnP returns · "upright": the one whose back is up (body z against
    camera up), which costs nothing: drones do not fly on their heads.

    Where no pose is found the answer is a constant (the training set's median translation and best constant rotation) and `failed`
    says so: a failure is counted, and its error too.
    """

    def __init__(self, classes: int, hypothesis: str = "fit"):
        super().__init__()
        if hypothesis not in HYPOTHESES:
            raise InputError(f"hypothesis={hypothesis!r} is not one of: {', '.join(HYPOTHESES)}")
        self.hypothesis = hypothesis
        self.register_buffer("hubs", torch.zeros(classes, 4, 3))  # body axes, metres
        self.register_buffer("fallback_R", torch.eye(3))
        self.register_buffer("fallback_t", torch.zeros(3))

    def learn(self, annotations: dict[str, Tensor]) -> None:
        """Take the true hubs of each class, and the constant answer, from training annotations (label, R, t, keypoints_3d).

        Raises:
            InputError: a class without a frame.
        """
        R, label = annotations["R"], annotations["label"]
        body = annotations["keypoints_3d"] @ R  # camera axes -> body axes, (F, 4, 3)
        for c in range(len(self.hubs)):
            if not (label == c).any():
                raise InputError(
                    f"PnP needs the size of every drone, and the training set has no frame of class {c}"
                )
            self.hubs[c] = body[label == c].median(dim=0).values
        self.fallback_R.copy_(rotations.best_constant_rotation(R))
        self.fallback_t.copy_(annotations["t"].median(dim=0).values)

    @torch.no_grad()
    def forward(self, pixels: Tensor, label: Tensor, K: Tensor) -> dict[str, Tensor]:
        """pixels (B, 4, 2) of the full frame, label (B,), K (B, 3, 3) -> R (B, 3, 3), t (B, 3) metres, failed (B,) bool. No gradients.

        Raises:
            InputError: it has not learned the hubs yet.
        """
        if not self.hubs.any():
            raise InputError(
                "PnP does not know the drones' sizes yet: call learn() with training annotations first"
            )
        R, t = self.fallback_R.repeat(len(pixels), 1, 1), self.fallback_t.repeat(len(pixels), 1)
        failed = torch.ones(len(pixels), dtype=torch.bool, device=pixels.device)
        for i, (hubs, points, camera) in enumerate(
            zip(*(x.cpu().numpy() for x in (self.hubs[label], pixels, K)), strict=True)
        ):
            found = solve_pnp(hubs, points, camera) if np.isfinite(points).all() else []
            if found:
                best = (
                    found[0] if self.hypothesis == "fit" else min(found, key=lambda s: s.R[1, 2])
                )  # camera y points down
                R[i], t[i] = torch.from_numpy(best.R), torch.from_numpy(best.t)
                failed[i] = False
        return {"R": R, "t": t, "failed": failed}
