"""Find the pose as DroneKey does (Hwang et al. 2025): keypoints, then PnP with the drone's true size.

The keypoints come from a gated transformer keypoint encoder. Against DroneKey++ it has no class and no
decoder, it mean-pools its tokens, and it is told which drone it looks at. The tokens, layers and gate are
those of `model/encoder.py`: the paper builds DroneKey++ on them. Its own loss, a Mahalanobis distance that
adapts to the pose, is left out: both are trained on the same L_2D.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor
from torch.nn.functional import mse_loss

from dronekeypp.baselines.pnp_pose import PnPPose
from dronekeypp.camera import from_crop
from dronekeypp.errors import InputError
from dronekeypp.model import Backbone, EncoderConfig, KeypointEncoder, PoseNetwork


class DroneKey(PoseNetwork):
    """This network finds keypoints as DroneKey++ does, and the pose by PnP.

    Against DroneKey++ its tokens are mean-pooled, and it is trained on L_2D alone.

    `network.pnp.hypothesis = "upright"` may be set at any time: see `PnPPose`.
    """

    method = "DroneKey"
    Config = EncoderConfig
    learns_from = ("R", "t", "keypoints", "keypoints_3d", "label")
    truth_inputs = ("label",)  # the drone, hence its true size
    judged_by = "keypoints"
    defaults = {"pool": "mean"}

    @classmethod
    def unused_settings(cls, values: Mapping[str, Any]) -> dict[str, str]:
        """Add the weight of the rotation: DroneKey learns none."""
        return {**super().unused_settings(values), "rotation_weight": "DroneKey learns no rotation"}

    def __init__(self, config: EncoderConfig | None = None, load_backbone: bool = True) -> None:
        super().__init__()
        self.config = config or EncoderConfig(**self.defaults)
        self.backbone = Backbone(self.config, load=load_backbone)
        self.encoder = KeypointEncoder(self.config, self.backbone.channels)
        # DroneKey has no classifier; its [cls] is one more token to look at.
        self.encoder.to_class.requires_grad_(False)
        self.pnp = PnPPose(self.config.classes)

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """Learn the true hub geometry, which PnP needs."""
        self.pnp.learn(annotations, self.drones)

    def forward(
        self, image: Tensor, K: Tensor, square: Tensor, label: Tensor | None = None
    ) -> dict[str, Tensor]:
        """Return keypoints and, outside training, the pose.

        Args:
            image: (B, 3, S, S) RGB in [0, 1].
            K: (B, 3, 3) full-frame camera matrix, pixels.
            square: (B, 3) the crop's x, y, side in full-frame pixels.
            label: (B,) class indices, needed outside training.

        Returns:
            keypoints (B, 4, 2) in crop units and gate (B, N); outside training also R, t and failed.

        Raises:
            InputError: there is no label outside training: without the true size there is no pose.
        """
        encoded = self.encoder(self.backbone(image))
        answer = {"keypoints": encoded["keypoints"], "gate": encoded["gate"]}
        if self.training:
            return answer
        if label is None:
            raise InputError("DroneKey needs the drone's label (B,): its PnP must know the true size")
        return {**answer, **self.pnp(from_crop(answer["keypoints"], square), label, K)}

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Return L_2D, the first term of Eq. 9."""
        return {"L_2D": mse_loss(output["keypoints"], batch["keypoints"]) * keypoint_unit**2}

    @property
    def idle_parameters(self) -> bool:
        return self.config.idle_layers
