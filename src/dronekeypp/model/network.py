"""DroneKey++ as a whole (Sec. III, Fig. 2): backbone, keypoint encoder, pose decoder."""

from __future__ import annotations

from collections.abc import Iterable

from torch import Tensor, nn
from torch.nn.functional import one_hot

from dronekeypp.errors import InputError
from dronekeypp.model.backbone import Backbone
from dronekeypp.model.base import PoseNetwork
from dronekeypp.model.config import ModelConfig
from dronekeypp.model.decoder import PoseDecoder
from dronekeypp.model.encoder import KeypointEncoder
from dronekeypp.model.geometry import GeometricDecoder, SharpHead
from dronekeypp.model.losses import geometric_loss_terms, loss_terms


class DroneKeyPP(PoseNetwork):
    """From a crop, the full frame's camera matrix and the crop's square to keypoints, class and 6-DoF pose.

    `load_backbone=False` skips the file or download that `config.backbone_weights` names.
    """

    method = "DroneKey++"

    def __init__(self, config: ModelConfig | None = None, load_backbone: bool = True):
        super().__init__()
        self.config = config or ModelConfig()
        self.truth_inputs = ("keypoints", "label") if self.config.encoder == "truth" else ()
        self.backbone = self.encoder = self.classifier = None
        if self.config.encoder == "learned":
            self.backbone = Backbone(self.config, load=load_backbone)
            self.encoder = KeypointEncoder(self.config, self.backbone.channels)
            if self.config.classifier == "features":
                self.classifier = nn.Linear(self.backbone.channels, self.config.classes)
        if self.config.pose == "geometric":
            self.head = SharpHead(self.backbone.pyramid_channels, self.config.image_size // 4)
            self.decoder = GeometricDecoder(self.config)
        else:
            self.head, self.decoder = None, PoseDecoder(self.config)

    def encode(self, image: Tensor) -> dict[str, Tensor | list[Tensor] | None]:
        """The picture's part: image (B, 3, S, S) -> keypoints, class_logits and what else `forward` returns of the encoder.

        With `pose="geometric"` the keypoints are the sharp head's, with their keypoint_sigma; the encoder's own are coarse_keypoints.

        With `classifier="features"` a linear layer names the drone from the backbone's pooled features, and its loss stops there: a backbone that
        is taught the class on a few hundred flights soon knows these flights by heart, and others less well than before.
        """
        levels = self.backbone.pyramid(image)
        encoded = self.encoder(levels[-1])
        if self.classifier is not None:
            encoded = {**encoded, "class_logits": self.classifier(levels[-1].detach().mean(dim=(2, 3)))}
        if self.head is not None:
            encoded = {**encoded, "coarse_keypoints": encoded["keypoints"], **self.head(levels)}
        return encoded

    def decode(
        self, encoded: dict[str, Tensor], probs: Tensor, K: Tensor, square: Tensor
    ) -> dict[str, Tensor | None]:
        """The geometry's part: what `encode` found, and class probabilities (B, classes), to the pose."""
        if self.head is None:
            return self.decoder(encoded["keypoints"], probs, K, square)
        return self.decoder(
            encoded["keypoints"], probs, K, square, encoded["keypoint_sigma"], encoded["ir"][:, -1]
        )

    def forward(
        self,
        image: Tensor | None,
        K: Tensor,
        square: Tensor,
        keypoints: Tensor | None = None,
        label: Tensor | None = None,
    ) -> dict[str, Tensor | list[Tensor] | None]:
        """
        Args:
            image: (B, 3, S, S) RGB in [0, 1]; may be None where nothing needs it.
            K: (B, 3, 3) full-frame camera matrix A, pixels.
            square: (B, 3) the crop's x, y, side in full-frame pixels.
            keypoints: (B, 4, 2) crop units, given to the decoder *instead of* the encoder's.
            label: (B,) class indices, given to the decoder as one-hot *instead of* the encoder's distribution. With
                encoder="truth" both are required (Table 4); otherwise they answer "what if": a wrong class, say.

        Returns:
            A dict: keypoints (B, 4, 2) crop units · keypoints_px (B, 4, 2) full-frame pixels · gate (B, N) ·
            ir (B, N, d) · cr (B, N, 4, 2) · attention, N tensors (B, heads, 1+M, 1+M) · class_logits, class_probs (B, classes) ·
            rays (B, 4, 3) · e_ray, e_cls (B, 64) · keypoints_3d (B, 4, 3) metres, camera axes, about the centre ·
            angles (B, 3) turns · R (B, 3, 3) camera<-body · t (B, 3) metres. What the configuration leaves out is None.
            With pose="geometric" also what `SharpHead` and `GeometricDecoder` return: keypoint_sigma, covariance and more.

        Raises:
            InputError: shapes that do not fit, encoder="truth" without the truth, or pose="geometric" without an image.
        """
        self._check(image, K, square, keypoints, label)
        if self.encoder is not None and (image is not None or keypoints is None or label is None):
            encoded = self.encode(image)
        else:
            encoded = dict.fromkeys(("keypoints", "class_logits", "gate", "ir", "cr", "attention"))
        if keypoints is not None:
            encoded["keypoints"] = keypoints
        if label is not None:
            probs = one_hot(label, self.config.classes).to(K.dtype)
            encoded["class_logits"] = (
                probs + 1e-9
            ).log()  # so that a softmax gives the one-hot back and L_cls is 0
        else:
            probs = encoded["class_logits"].softmax(dim=-1)  # Eq. 5
        encoded["class_probs"] = probs
        return {**encoded, **self.decode(encoded, probs, K, square)}

    def _check(self, image, K, square, keypoints, label) -> None:
        B, S = K.shape[0], self.config.image_size
        wanted = {"K": (K, (B, 3, 3)), "square": (square, (B, 3)), "image": (image, (B, 3, S, S)),
                  "keypoints": (keypoints, (B, 4, 2)), "label": (label, (B,))}  # fmt: skip
        for name, (value, shape) in wanted.items():
            if value is not None and tuple(value.shape) != shape:
                raise InputError(f"{name} has shape {tuple(value.shape)}, the network needs {shape}")
        if self.config.encoder == "truth" and (keypoints is None or label is None):
            raise InputError('this network has encoder="truth": give it the true keypoints and label')
        if image is None and (keypoints is None or label is None):
            raise InputError("without an image the network needs both keypoints and label")
        if image is None and self.head is not None:
            raise InputError(
                'a network with pose="geometric" needs the image: how sure it is of each keypoint comes from it'
            )

    def fit_rays(self, batches: Iterable[dict[str, Tensor]]) -> None:
        """Set the decoder's ray statistics from training batches (keypoints, square, K). See `RayFeatures`."""
        self.decoder.fit_rays(batches)

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """The ray statistics are part of the network, and so are the classes' shapes: truth of the training frames, no images."""
        self.fit_rays([annotations])
        if self.head is not None:
            self.decoder.shapes.fit(
                *(
                    annotations[name].to(self.decoder.shapes.hubs.device)
                    for name in ("label", "R", "keypoints_3d")
                )
            )

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Eq. 9 and 11; see `loss_terms`, and `geometric_loss_terms` for `pose="geometric"`."""
        return (loss_terms if self.head is None else geometric_loss_terms)(output, batch, keypoint_unit)

    @property
    def idle_parameters(self) -> bool:
        return (
            self.config.idle_layers or self.classifier is not None
        )  # the [cls] token's own answer is then not asked for

    def parameter_counts(self) -> dict[str, int]:
        """Learnable numbers by part: {"backbone", "encoder", "decoder", "total"}, and "classifier" and "head" where there are any."""
        parts = {"backbone": self.backbone, "encoder": self.encoder, "decoder": self.decoder}
        parts |= {
            name: part
            for name, part in (("classifier", self.classifier), ("head", self.head))
            if part is not None
        }
        counts = {
            name: sum(p.numel() for p in part.parameters()) if part else 0 for name, part in parts.items()
        }
        return {**counts, "total": sum(counts.values())}
