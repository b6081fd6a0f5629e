"""Find the pose as DronePose does (Albanis et al. 2020), without its mesh.

It is one ResNet, with rotation and translation learned by MSE, as the paper re-implements it. The original
renders a silhouette of the drone's mesh and compares it with the picture. That prior is what the paper leaves
out, and so do we.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from dronekeypp import rotations
from dronekeypp.model import Backbone, BackboneConfig, PoseNetwork


@dataclass(frozen=True)
class DronePoseConfig(BackboneConfig):
    """These are the settings of DronePose."""

    use_rays: bool = False  # True: it is given where the crop was cut, and how large it was


class DronePose(PoseNetwork):
    """This network turns pooled features of the crop into a pose.

    The pose is a 6D rotation (Zhou et al. 2019) and a translation in metres.

    From the crop alone the network cannot know where in the frame the crop was cut nor how large it was.
    `config.use_rays` gives it that: the ray of the crop's centre, and the logarithm of the angle that its
    side spans. The paper does not say which it used; we measure both.
    """

    method = "DronePose"
    Config = DronePoseConfig
    learns_from = ("R", "t")
    defaults = {"use_rays": False}

    @classmethod
    def unused_settings(cls, values: Mapping[str, Any]) -> dict[str, str]:
        """Add the keypoints' unit: DronePose finds none."""
        return {**super().unused_settings(values), "keypoint_unit": "DronePose finds no keypoints"}

    def __init__(self, config: DronePoseConfig | None = None, load_backbone: bool = True) -> None:
        super().__init__()
        self.config = config or DronePoseConfig()
        self.backbone = Backbone(self.config, load=load_backbone)
        width = self.backbone.channels + (3 if self.config.use_rays else 0)
        self.head = nn.Sequential(nn.Linear(width, 256), nn.ReLU(), nn.Linear(256, 6 + 3))
        with torch.no_grad():  # start at the identity, four metres ahead
            self.head[-1].bias.copy_(torch.tensor([1.0, 0, 0, 0, 1, 0, 0, 0, 4]))

    def forward(self, image: Tensor, K: Tensor, square: Tensor) -> dict[str, Tensor]:
        """Return the pose.

        Args:
            image: (B, 3, S, S) RGB in [0, 1].
            K: (B, 3, 3) full-frame camera matrix, pixels.
            square: (B, 3) the crop's x, y, side in full-frame pixels.

        Returns:
            R (B, 3, 3) camera←body and t (B, 3) metres.
        """
        pooled = self.backbone(image).mean(dim=(2, 3))  # (B, C)
        if self.config.use_rays:
            centre = square[:, :2] + square[:, 2:] / 2
            focal = K[:, [0, 1], [0, 1]]
            ray = (centre - K[:, :2, 2]) / focal  # (B, 2)
            pooled = torch.cat([pooled, ray, (square[:, 2:] / focal[:, :1]).log()], dim=1)
        out = self.head(pooled)
        return {"R": rotations.matrix_from_6d(out[:, :6]), "t": out[:, 6:]}

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Return the MSE over the nine numbers of R and the one over the three of t.

        `keypoint_unit` is not used.
        """
        return {"L_rot": mse_loss(output["R"], batch["R"]), "L_trans": mse_loss(output["t"], batch["t"])}
