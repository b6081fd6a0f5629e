"""DroneKey (Hwang et al. 2025): the gated transformer keypoint encoder, then PnP with the drone's true size.

Against DroneKey++ it has no class and no decoder, it mean-pools its tokens, and it is told which drone it looks at. The tokens, layers and
gate are those of `model/encoder.py`: the paper builds DroneKey++ on them. Its own loss, a Mahalanobis distance that adapts to the pose, is
left out: both are trained on the same L_2D.
"""

from __future__ import annotations

from torch import Tensor
from torch.nn.functional import mse_loss

from dronekeypp.baselines.pnp_pose import PnPPose
from dronekeypp.camera import from_crop
from dronekeypp.errors import InputError
from dronekeypp.model import Backbone, KeypointEncoder, ModelConfig, PoseNetwork


class DroneKey(PoseNetwork):
    """Keypoints as DroneKey++ finds them, but mean-pooled, trained on L_2D alone; pose by PnP.

    `config`'s decoder settings are not read. `hypothesis` may be changed at any time: `network.pnp.hypothesis = "upright"`.
    """

    method = "DroneKey"
    truth_inputs = ("label",)  # the drone, hence its true size
    judged_by = "keypoints"
    defaults = {"pool": "mean"}

    def __init__(self, config: ModelConfig | None = None, load_backbone: bool = True):
        super().__init__()
        self.config = config or ModelConfig(**self.defaults)
        self.backbone = Backbone(self.config, load=load_backbone)
        self.encoder = KeypointEncoder(self.config, self.backbone.channels)
        self.encoder.to_class.requires_grad_(
            False
        )  # it has no classifier; its [cls] is one more token to look at
        self.pnp = PnPPose(self.config.classes)

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """The true hub geometry, which PnP needs."""
        self.pnp.learn(annotations)

    def forward(
        self, image: Tensor, K: Tensor, square: Tensor, label: Tensor | None = None
    ) -> dict[str, Tensor]:
        """image (B, 3, S, S), K (B, 3, 3), square (B, 3), label (B,) -> keypoints (B, 4, 2) crop units; not in training: R, t, failed.

        Raises:
            InputError: no label outside training: without the true size there is no pose.
        """
        found = {
            name: value
            for name, value in self.encoder(self.backbone(image)).items()
            if name in ("keypoints", "gate")
        }
        if self.training:
            return found
        if label is None:
            raise InputError("DroneKey needs the drone's label (B,): its PnP must know the true size")
        return {**found, **self.pnp(from_crop(found["keypoints"], square), label, K)}

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """L_2D, the first term of Eq. 9."""
        return {"L_2D": mse_loss(output["keypoints"], batch["keypoints"]) * keypoint_unit**2}

    @property
    def idle_parameters(self) -> bool:
        return self.config.idle_layers
