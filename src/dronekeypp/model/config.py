"""Hold the settings of the part of a network that looks at the picture (Sec. III-A).

It consists of the backbone and the keypoint encoder. Every ablation of the paper is a setting; there is one
network. The paper does not give N, the width d, the heads or the sizes of the MLPs (its Fig. 2b is an image);
these are ours. What belongs to a pose decoder stands in that decoder's own settings, beside the decoder.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dronekeypp.errors import InputError
from dronekeypp.settings import Settings

# Of the encoder, far above any useful size: each setting may be allowed, and all of them together ask for all
# the memory there is.
MOST_WEIGHTS = 500_000_000
MOST_ATTENTION = 500_000_000  # of one frame in one layer


@dataclass(frozen=True)
class BackboneConfig(Settings):
    """These are the settings of what turns a crop into a feature map."""

    backbone: str = "compact"  # "compact" (ours, 96-128 px) | "resnet18" | "resnet34" | "resnet50"
    backbone_weights: str | None = None  # None: from scratch | "imagenet" | path of a safetensors file
    backbone_stride: int = 16  # compact only: pixels per token, 8 or 16 (96 px: 12x12 or 6x6 tokens)
    image_size: int = 96  # side of the crop, pixels

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {
        "backbone": ("compact", "resnet18", "resnet34", "resnet50"),
    }
    LEAST: ClassVar[dict[str, float]] = {"image_size": 32}
    MOST: ClassVar[dict[str, float]] = {"image_size": 4096}
    ONLY_WITH: ClassVar[dict[str, tuple[tuple[str, Any], ...]]] = {
        "backbone_stride": (("backbone", "compact"),),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.backbone_stride not in (8, 16):
            raise InputError(f"backbone_stride={self.backbone_stride} is not one of: 8, 16")
        if self.image_size % self.stride:
            raise InputError(
                f"image_size={self.image_size} must be a multiple of {self.stride} ({self.backbone})"
            )
        if self.backbone == "compact" and self.backbone_weights == "imagenet":
            raise InputError(
                "backbone_weights=imagenet needs a torchvision backbone: set backbone=resnet18, 34 or 50"
            )

    @property
    def stride(self) -> int:
        """Return how many pixels of the crop there are per token."""
        return self.backbone_stride if self.backbone == "compact" else 32


@dataclass(frozen=True)
class EncoderConfig(BackboneConfig):
    """These are the settings of what turns a feature map into keypoints and a class."""

    width: int = 128  # d, width of a token
    layers: int = 3  # N, self-attention layers
    heads: int = 4
    ffn: int = 256  # hidden width of the feed-forward part of a layer
    norm: str = "pre"  # where a layer normalises: "pre" (before each part) | "post" (after each residual sum)
    dropout: float = 0.0
    pool: str = "max"  # over image tokens: "max" (this paper) | "mean" (DroneKey's released code)
    gate: str = "learned"  # Eq. 3 "learned" | "last" layer only | "uniform"
    keypoint_head: str = "linear"  # Eq. 2: "linear" in the pooled tokens (paper) | "heatmap", soft-argmax
    layer_input: str = "previous"  # Eq. 1 "previous" layer's output | "same" X^(0) (DroneKey's code)
    classes: int = 7  # how many drones there are to tell apart

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {
        **BackboneConfig.CHOICES,
        "norm": ("pre", "post"),
        "pool": ("max", "mean"),
        "gate": ("learned", "last", "uniform"),
        "keypoint_head": ("linear", "heatmap"),
        "layer_input": ("previous", "same"),
    }
    LEAST: ClassVar[dict[str, float]] = {
        **BackboneConfig.LEAST,
        "width": 4,
        "layers": 1,
        "heads": 1,
        "ffn": 1,
        "dropout": 0,
        "classes": 1,
    }
    # Far above any useful value: without a limit a typing error would ask for all the memory there is.
    MOST: ClassVar[dict[str, float]] = {
        **BackboneConfig.MOST,
        "width": 8192,
        "layers": 256,
        "heads": 256,
        "ffn": 65536,
        "classes": 1000,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width % self.heads or self.width % 4:
            raise InputError(f"width={self.width} must be a multiple of heads={self.heads} and of 4")
        if self.dropout >= 1:
            raise InputError(f"dropout={self.dropout:g} must be below 1")
        weights = self.layers * self.width * (4 * self.width + 2 * self.ffn)
        if weights > MOST_WEIGHTS:
            raise InputError(
                f"layers={self.layers} width={self.width} ffn={self.ffn}: {weights / 1e6:.0f} million "
                f"weights, at most {MOST_WEIGHTS / 1e6:.0f} million; choose smaller ones"
            )
        attention = self.heads * self.tokens**2
        if attention > MOST_ATTENTION:
            raise InputError(
                f"image_size={self.image_size} heads={self.heads}: {attention / 1e6:.0f} million attention "
                f"weights a layer, at most {MOST_ATTENTION / 1e6:.0f} million; choose smaller ones"
            )

    @property
    def idle_layers(self) -> bool:
        """Say whether some layers get no gradient.

        That is so where only the last layer counts and the others do not feed it.
        """
        return self.gate == "last" and self.layer_input == "same"

    @property
    def tokens(self) -> int:
        """Return M, the number of image tokens."""
        return (self.image_size // self.stride) ** 2
