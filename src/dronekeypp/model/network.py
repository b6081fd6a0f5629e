"""Put DroneKey++ together (Sec. III, Fig. 2).

It consists of a backbone, the keypoint encoder, and one of the pose decoders.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from torch import Tensor, nn
from torch.nn.functional import one_hot

from dronekeypp.errors import InputError
from dronekeypp.model.backbone import Backbone
from dronekeypp.model.base import PoseNetwork
from dronekeypp.model.config import EncoderConfig
from dronekeypp.model.contract import Decoder, PictureShape
from dronekeypp.model.decoder import PoseDecoder
from dronekeypp.model.encoder import KeypointEncoder
from dronekeypp.model.geometry import GeometricDecoder
from dronekeypp.settings import Settings, check_mapping

# The pose decoders, by the word that the setting `pose` chooses them by.
DECODERS: dict[str, type[Decoder]] = {
    "mlp": PoseDecoder,  # the paper's (Eq. 7-8)
    "geometric": GeometricDecoder,  # a sharp keypoint head, learned shapes and a solver (notebook 12)
}

# The settings that only a network with an encoder uses.
SEEING = (*(set(EncoderConfig.keys()) - {"image_size", "classes"}), "classifier")
# The outputs that are None where there is no encoder.
FROM_ENCODER = ("keypoints", "class_logits", "gate", "ir", "cr", "attention")


@dataclass(frozen=True)
class ModelConfig(EncoderConfig):
    """These are the settings of the whole network (Sec. III).

    `pose` names the decoder, and `decoder` holds that decoder's own settings. In a dict, in JSON and on the
    command line all settings stand side by side: `ModelConfig.from_dict({"layers": 6, "rotation": "sixd"})`.
    """

    encoder: str = "learned"  # "truth": no encoder, true keypoints and class go to the decoder (Table 4)
    classifier: str = "cls"  # Eq. 5: the "cls" token's (paper) | "features": the backbone's, see `encode`
    pose: str = "mlp"  # the decoder, one of DECODERS
    decoder: Settings | None = None  # its settings; None: as they come

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {
        **EncoderConfig.CHOICES,
        "encoder": ("learned", "truth"),
        "classifier": ("cls", "features"),
    }
    ONLY_WITH: ClassVar[dict[str, tuple[tuple[str, Any], ...]]] = {
        **dict.fromkeys(SEEING, (("encoder", "learned"),)),
        "backbone_stride": (("encoder", "learned"), ("backbone", "compact")),
    }

    def __post_init__(self) -> None:
        kind = decoder_class(self.pose)
        if self.decoder is None:
            object.__setattr__(self, "decoder", kind.Config())
        if not isinstance(self.decoder, kind.Config):
            raise InputError(
                f"pose={self.pose} needs settings of {kind.Config.__name__}, "
                f"not of {type(self.decoder).__name__}"
            )
        super().__post_init__()
        if self.encoder == "truth" and kind.needs_image:
            raise InputError(f"pose={self.pose} needs an encoder: it looks at the picture")

    @classmethod
    def own_keys(cls) -> list[str]:
        """Return the names of the settings that are not the decoder's."""
        return [name for name in cls.keys() if name != "decoder"]

    @classmethod
    def known_keys(cls, values: Mapping[str, Any]) -> list[str]:
        return cls.own_keys() + decoder_class(values.get("pose", cls.pose)).Config.keys()

    @classmethod
    def unused(cls, values: Mapping[str, Any]) -> dict[str, str]:
        decoder = decoder_class(values.get("pose", cls.pose)).Config
        return {**super().unused(values), **decoder.unused(values)}

    def to_dict(self) -> dict[str, Any]:
        own = {name: getattr(self, name) for name in self.own_keys()}
        return {**own, **self.decoder.to_dict()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Build the settings from a dict that holds the network's and the decoder's side by side.

        Raises:
            InputError: neither has such a key, or a value does not fit.
        """
        check_mapping(values, cls.__name__)
        known = cls.known_keys(values)
        for key in values:
            if key not in known:
                pose = values.get("pose", cls.pose)
                raise InputError(f"unknown setting {key!r} with pose={pose}; known: {', '.join(known)}")
        own, rest = {}, {}
        for key, value in values.items():
            part = own if key in cls.own_keys() else rest
            part[key] = value
        decoder = decoder_class(values.get("pose", cls.pose)).Config.from_dict(rest)
        return cls(**own, decoder=decoder)


def decoder_class(name: Any) -> type[Decoder]:
    """Return the decoder that `pose=name` stands for.

    Raises:
        InputError: there is no such decoder; the known ones are listed.
    """
    if not isinstance(name, str) or name not in DECODERS:
        raise InputError(f"pose={name!r} is not one of: {', '.join(DECODERS)}")
    decoder = DECODERS[name]
    shared = set(decoder.Config.keys()) & set(ModelConfig.own_keys())
    if shared:
        raise InputError(f"{decoder.__name__}: its setting {sorted(shared)[0]!r} is one of the network's")
    return decoder


class DroneKeyPP(PoseNetwork):
    """This network finds keypoints, class and 6-DoF pose of a drone.

    It takes a crop, the full frame's camera matrix and the crop's square. `load_backbone=False` skips the
    file or the download that `config.backbone_weights` names.
    """

    method = "DroneKey++"
    Config = ModelConfig

    def __init__(self, config: ModelConfig | None = None, load_backbone: bool = True) -> None:
        super().__init__()
        self.config = config = config or ModelConfig()
        self.truth_inputs = ("keypoints", "label") if config.encoder == "truth" else ()
        self.backbone = self.encoder = self.classifier = picture = None
        if config.encoder == "learned":
            self.backbone = Backbone(config, load=load_backbone)
            self.encoder = KeypointEncoder(config, self.backbone.channels)
            picture = PictureShape(config.width, self.backbone.pyramid_channels, config.image_size)
            if config.classifier == "features":
                self.classifier = nn.Linear(self.backbone.channels, config.classes)
        self.decoder = decoder_class(config.pose)(config.decoder, config.classes, picture)

    @property
    def learns_from(self) -> tuple[str, ...]:
        """Return what the decoder reads of a frame's truth; it has the losses."""
        return self.decoder.learns_from

    @classmethod
    def unused_settings(cls, values: Mapping[str, Any]) -> dict[str, str]:
        """Add what concerns the picture alone, where there is no encoder."""
        unused = super().unused_settings(values)
        if values.get("encoder") == "truth":
            reason = "it needs encoder=learned"
            unused |= {"backbone_lr": reason, "precision": reason, "degrade": reason}
        return unused

    def encode(self, image: Tensor) -> dict[str, Tensor | list[Tensor] | None]:
        """Return what can be read from the picture (B, 3, S, S).

        It is keypoints, class_logits and the rest of the encoder's answers. A decoder may look at the picture
        as well and put sharper keypoints in their place (`Decoder.look`).

        With `classifier="features"` a linear layer names the drone from the backbone's pooled features, and
        its loss stops there. A backbone that is taught the class on a few hundred flights soon knows these
        flights by heart, and others less well than before.
        """
        levels = self.backbone.pyramid(image)
        encoded = self.encoder(levels[-1])
        if self.classifier is not None:
            pooled = levels[-1].detach().mean(dim=(2, 3))  # (B, C)
            encoded = {**encoded, "class_logits": self.classifier(pooled)}
        return self.decoder.look(levels, encoded)

    def decode(self, encoded: dict, probs: Tensor, K: Tensor, square: Tensor) -> dict[str, Tensor | None]:
        """Return the pose from what `encode` returned and from class probabilities (B, classes).

        This is the part of the network that does geometry.
        """
        return self.decoder.decode(encoded, probs, K, square)

    def forward(
        self,
        image: Tensor | None,
        K: Tensor,
        square: Tensor,
        keypoints: Tensor | None = None,
        label: Tensor | None = None,
    ) -> dict[str, Tensor | list[Tensor] | None]:
        """Return keypoints, class and pose, and what lies between them.

        The result is a dict. What the configuration leaves out is None. A decoder may add outputs of its own:
        `GeometricDecoder` adds keypoint_sigma, covariance and more.

        Args:
            image: (B, 3, S, S) RGB in [0, 1]; may be None where nothing needs it.
            K: (B, 3, 3) full-frame camera matrix A, pixels.
            square: (B, 3) the crop's x, y, side in full-frame pixels.
            keypoints: (B, 4, 2) crop units, given to the decoder *instead of* the encoder's.
            label: (B,) class indices, given to the decoder as one-hot *instead of* the encoder's
                distribution. With encoder="truth" both are required (Table 4). Otherwise they answer "what
                if": a wrong class, for example.

        Returns:
            keypoints: (B, 4, 2) crop units.
            keypoints_px: (B, 4, 2) full-frame pixels.
            gate: (B, N), Eq. 3.
            ir: (B, N, d), the layers' pooled tokens.
            cr: (B, N, 4, 2) crop units, the layers' keypoints of Eq. 2.
            attention: N tensors (B, heads, 1+M, 1+M).
            class_logits, class_probs: (B, classes).
            rays: (B, 4, 3), Eq. 6.
            e_ray, e_cls: (B, 64).
            keypoints_3d: (B, 4, 3) metres, camera axes, relative to the drone's centre.
            angles: (B, 3) turns.
            R: (B, 3, 3) camera←body.
            t: (B, 3) metres.

        Raises:
            InputError: the truth is missing with encoder="truth", or there is no image for a decoder that
                looks at it. A call also checks shapes and values, see `model.inputs`.
        """
        self._check_truth(image, keypoints, label)
        if self.encoder is not None and (image is not None or keypoints is None or label is None):
            encoded = self.encode(image)
        else:
            encoded = dict.fromkeys(FROM_ENCODER)
        if keypoints is not None:
            encoded["keypoints"] = keypoints
        if label is not None:
            probs = one_hot(label, self.config.classes).to(K.dtype)
            # With these a softmax gives the one-hot back, and L_cls is 0.
            encoded["class_logits"] = (probs + 1e-9).log()
        else:
            probs = encoded["class_logits"].softmax(dim=-1)  # Eq. 5
        encoded["class_probs"] = probs
        return {**encoded, **self.decode(encoded, probs, K, square)}

    def _check_truth(self, image: Tensor | None, keypoints: Tensor | None, label: Tensor | None) -> None:
        """Check that the inputs of `forward` hold all that this configuration needs.

        Raises:
            InputError: as described there.
        """
        without_truth = keypoints is None or label is None
        if self.config.encoder == "truth" and without_truth:
            raise InputError('this network has encoder="truth": give it the true keypoints and label')
        if image is None and without_truth:
            raise InputError("without an image the network needs both keypoints and label")
        if image is None and self.decoder.needs_image:
            raise InputError(
                f'a network with pose="{self.config.pose}" needs the image: '
                "how sure it is of each keypoint comes from it"
            )

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """Let the decoder learn from the truth of training frames.

        Decoders learn ray statistics and shapes.
        """
        self.decoder.prepare(annotations)

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Return the decoder's terms of the loss: Eq. 9 and 11, or its own in their place."""
        return self.decoder.losses(output, batch, keypoint_unit)

    @property
    def idle_parameters(self) -> bool:
        # With a classifier on the features the [cls] token's own answer is not asked for.
        return self.config.idle_layers or self.classifier is not None

    def parameter_counts(self) -> dict[str, int]:
        """Return how many learnable numbers each part has.

        The parts are "backbone", "encoder", "decoder", "classifier" if there is one, and "total".
        """
        parts = {"backbone": self.backbone, "encoder": self.encoder, "decoder": self.decoder}
        if self.classifier is not None:
            parts["classifier"] = self.classifier
        counts = {}
        for name, part in parts.items():
            counts[name] = 0 if part is None else sum(p.numel() for p in part.parameters())
        return {**counts, "total": sum(counts.values())}
