"""Settings as plain dataclasses: checked values, a JSON round trip, one clear line for a key or value that is wrong."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Any, ClassVar

from dronekeypp.errors import InputError


class Settings:
    """What every settings dataclass can do: `to_dict`, `from_dict`, `to_json`, `from_json`, `replace`, checked values.

    A subclass lists the allowed words of a text field in `CHOICES` and the smallest value of a number in `LEAST`,
    the largest in `MOST`.
    Every field is int, float, bool, str or "str | None".
    """

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {}
    LEAST: ClassVar[dict[str, float]] = {}
    MOST: ClassVar[dict[str, float]] = {}

    def __post_init__(self):
        for field in dataclasses.fields(self):
            object.__setattr__(
                self, field.name, _coerce(field.name, str(field.type), getattr(self, field.name))
            )
        for name, words in self.CHOICES.items():
            if getattr(self, name) not in words:
                raise InputError(f"{name}={getattr(self, name)!r} is not one of: {', '.join(words)}")
        for name, most in self.MOST.items():
            if not getattr(self, name) <= most:
                raise InputError(f"{name}={getattr(self, name)!r} must be at most {most:g}")
        for name, least in self.LEAST.items():
            if not getattr(self, name) >= least:
                raise InputError(f"{name}={getattr(self, name)!r} must be at least {least:g}")

    @classmethod
    def keys(cls) -> list[str]:
        return [field.name for field in dataclasses.fields(cls)]

    def to_dict(self) -> dict[str, Any]:
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]):
        """Build from a dict; a key that does not exist raises InputError naming it and listing the known ones."""
        if not isinstance(values, dict):
            raise InputError(f"{cls.__name__} needs a mapping of settings, got {type(values).__name__}")
        unknown = sorted(set(values) - set(cls.keys()))
        if unknown:
            raise InputError(f"unknown setting {unknown[0]!r}; known: {', '.join(cls.keys())}")
        return cls(**values)

    def to_json(self) -> str:
        return json.dumps(self.to_dict(), indent=2)

    @classmethod
    def from_json(cls, text: str):
        try:
            values = json.loads(text)
        except json.JSONDecodeError as error:
            raise InputError(f"{cls.__name__} is not valid JSON: {error}") from None
        return cls.from_dict(values)

    def replace(self, **changes):
        return type(self).from_dict({**self.to_dict(), **changes})


def _coerce(name: str, kind: str, value: Any) -> Any:
    """`value` as the field's type. Text from a command line ("1e-3", "true", "none") is read; the rest must fit."""
    try:
        if kind == "bool":
            if isinstance(value, str):
                return {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}[
                    value.lower()
                ]
            if value in (0, 1):
                return bool(value)
        elif kind == "int" and not isinstance(value, bool):
            if isinstance(value, str) or float(value) == int(value):
                return int(value)
        elif kind == "float" and not isinstance(value, bool):
            if float(value) == float(value) and abs(float(value)) != float("inf"):
                return float(value)
        elif kind.startswith("str"):
            if "None" in kind and (value is None or str(value).lower() in ("none", "null", "")):
                return None
            if isinstance(value, str):
                return value
            if hasattr(value, "__fspath__"):
                return str(value)
    except (KeyError, ValueError, TypeError, OverflowError):
        pass
    raise InputError(f"{name}={value!r} does not fit: expected {kind}")


@dataclass(frozen=True)
class ModelConfig(Settings):
    """Shape of the network (Sec. III). Every ablation of the paper is a setting here; there is one network.

    The paper does not give N, the width d, the heads or the MLPs' sizes (its Fig. 2b is an image); these are ours.
    """

    backbone: str = "compact"  # "compact" (ours, 96-128 px) | "resnet18" | "resnet34" | "resnet50"
    backbone_weights: str | None = None  # None: from scratch | "imagenet" | path of a safetensors file
    backbone_stride: int = 16  # compact only: pixels per token, 8 or 16 (96 px: 12x12 or 6x6 tokens)
    image_size: int = 96  # side of the crop, pixels
    width: int = 128  # d, width of a token
    layers: int = 3  # N, self-attention layers
    heads: int = 4
    ffn: int = 256  # hidden width of the feed-forward part of a layer
    norm: str = "pre"  # where a layer normalises: "pre" (before each part) | "post" (after each residual sum)
    dropout: float = 0.0
    pool: str = "max"  # over image tokens: "max" (this paper) | "mean" (DroneKey's released code)
    gate: str = "learned"  # Eq. 3 "learned" | "last" layer only | "uniform"
    keypoint_head: str = (
        "linear"  # Eq. 2: "linear" in the pooled tokens (paper) | "heatmap" over the tokens, soft-argmax
    )
    layer_input: str = (
        "previous"  # Eq. 1 "previous" layer's output | "same" X^(0) for every layer (DroneKey's code)
    )
    encoder: str = (
        "learned"  # "truth": no encoder, true keypoints and one-hot class go to the decoder (Table 4)
    )
    classifier: str = "cls"  # Eq. 5: the "cls" token's (paper) | "features": the backbone's, pooled, which it may not change (see network.py)
    use_rays: bool = True  # False: the decoder sees the crop coordinates, flattened (Table 5, row 1)
    use_class: bool = True  # False: no class embedding (Table 5, rows 1-3)
    use_3d: bool = True  # False: no MLP_3D (Table 5, rows 1-2)
    rays: str = "raw"  # what the ray embedding is fed: "raw" (paper) | "standardised" | "split"
    rotation: str = "euler"  # head: "euler" (paper: three sigmoid angles) | "sixd" (Zhou et al. 2019) | "allocentric": 6D, seen along the ray
    translation: str = "metres"  # head: "metres" (paper) | "site": against centre and spread of the rays (SITE, Li et al. 2019)
    pose: str = "mlp"  # Eq. 7-8: "mlp" (paper) | "geometric": a sharp keypoint head, learned shapes and PnP, see geometry.py
    angle_zero: str = (
        "middle"  # euler only: 0° at the "middle" of the sigmoid, seam at 180° | at its "edge", seam at 0°
    )
    decoder_width: int = 256  # hidden width of MLP_3D and MLP_pose
    decoder_layers: int = 3  # their hidden layers
    classes: int = 7

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {
        "backbone": ("compact", "resnet18", "resnet34", "resnet50"),
        "norm": ("pre", "post"),
        "pool": ("max", "mean"),
        "gate": ("learned", "last", "uniform"),
        "keypoint_head": ("linear", "heatmap"),
        "layer_input": ("previous", "same"),
        "encoder": ("learned", "truth"),
        "classifier": ("cls", "features"),
        "rays": ("raw", "standardised", "split"),
        "rotation": ("euler", "sixd", "allocentric"),
        "translation": ("metres", "site"),
        "angle_zero": ("middle", "edge"),
        "pose": ("mlp", "geometric"),
    }
    LEAST: ClassVar[dict[str, float]] = {
        "image_size": 32, "width": 4, "layers": 1, "heads": 1, "ffn": 1, "dropout": 0,
        "decoder_width": 1, "decoder_layers": 1, "classes": 2,
    }  # fmt: skip
    MOST: ClassVar[dict[str, float]] = {  # beyond any use: a slip of the finger would ask for all the memory there is
        "image_size": 4096, "width": 8192, "layers": 256, "heads": 256, "ffn": 65536, "decoder_width": 65536, "decoder_layers": 64, "classes": 1000,
    }  # fmt: skip

    def __post_init__(self):
        super().__post_init__()
        if self.width % self.heads or self.width % 4:
            raise InputError(f"width={self.width} must be a multiple of heads={self.heads} and of 4")
        if self.dropout >= 1:
            raise InputError(f"dropout={self.dropout:g} must be below 1")
        if self.backbone_stride not in (8, 16):
            raise InputError(f"backbone_stride={self.backbone_stride} is not one of: 8, 16")
        if self.image_size % self.stride:
            raise InputError(
                f"image_size={self.image_size} must be a multiple of {self.stride} ({self.backbone})"
            )
        if self.pose == "geometric":
            if self.encoder == "truth":
                raise InputError("pose=geometric needs an encoder: it looks at the picture")
            for name in ("use_rays", "use_3d", "use_class", "rotation", "translation", "angle_zero"):
                if getattr(self, name) != getattr(type(self), name):
                    raise InputError(
                        f"{name}={getattr(self, name)} belongs to the paper's decoder; pose=geometric has no such switch"
                    )
        if self.backbone == "compact" and self.backbone_weights == "imagenet":
            raise InputError(
                "backbone_weights=imagenet needs a torchvision backbone: set backbone=resnet18, 34 or 50"
            )

    @property
    def stride(self) -> int:
        """Pixels of the crop per token."""
        return self.backbone_stride if self.backbone == "compact" else 32

    @property
    def idle_layers(self) -> bool:
        """Whether layers of the encoder get no gradient: the last alone counts and is not fed by the others."""
        return self.gate == "last" and self.layer_input == "same"

    @property
    def tokens(self) -> int:
        """M, the number of image tokens."""
        return (self.image_size // self.stride) ** 2
