"""Two named settings: `paper`, as printed, and `cpu`, which trains on a laptop. `--set key=value` reaches every key of both halves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dronekeypp.errors import InputError
from dronekeypp.model.config import ModelConfig, Settings
from dronekeypp.model.losses import SCHEDULES


@dataclass(frozen=True)
class TrainConfig(Settings):
    """How a network is trained (Sec. V-A, "Implementation details"). The defaults are the paper's where it gives one."""

    epochs: int = 100
    batch: int = 32  # frames a step, over all processes together
    lr: float = 1e-5  # Adam; a cosine takes it to 0 over the whole run
    backbone_lr: float = 1.0  # the backbone's share of lr: below 1 keeps what pretraining taught it
    warmup: int = 0  # steps of linear warm-up before the cosine; the paper has none
    clip: float = 0.0  # largest norm of the gradient; 0 leaves it alone, as the paper does
    weight_decay: float = 0.0
    keypoint_unit: float = (
        10.0  # side of the crop in the unit of y2D: the hidden weight of L_2D, see `loss_terms`
    )
    schedule: str = "equal"  # Table 6: "equal" | "tanh" | "shifted" | "biased"
    augment: bool = False  # the crop's margin and centre drawn anew; the paper has no augmentation
    degrade: bool = False  # half of the crops as a small, compressed video shows them (see `dataset.degrade`); the paper has none
    mirror: bool = (
        False  # half of the frames seen in a mirror, truth and all (see `train.mirrored`); the paper has none
    )
    frames: int = 0  # training frames seen per epoch, drawn anew each time; 0: all
    val_frames: int = 0  # validation frames, evenly spaced; 0: all
    seed: int = 0
    workers: int = 0  # data loading processes
    max_minutes: float = 0.0  # stop after the epoch in which this is reached; 0: never
    device: str = "auto"  # "auto" | "cpu" | "cuda"
    precision: str = "float32"  # of the backbone while training: "float32" | "bfloat16", faster where the processor knows it

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {
        "schedule": SCHEDULES, "device": ("auto", "cpu", "cuda"), "precision": ("float32", "bfloat16"),
    }  # fmt: skip
    LEAST: ClassVar[dict[str, float]] = {
        "epochs": 1, "batch": 1, "lr": 0, "backbone_lr": 0, "warmup": 0, "clip": 0, "weight_decay": 0, "keypoint_unit": 0, "frames": 0,
        "val_frames": 0, "seed": 0, "workers": 0, "max_minutes": 0,
    }  # fmt: skip


PRESETS: dict[str, tuple[ModelConfig, TrainConfig]] = {
    # Learning rate, batch, epochs, the cosine, ImageNet, no augmentation, raw rays and three sigmoid angles are the
    # paper's. It does not give N, d, the crop or the ResNet's depth: 6, 256, 224 px and 50 are ours, and so is the unit of
    # y2D, chosen so that L_2D starts near the other terms.
    "paper": (
        ModelConfig(
            backbone="resnet50", backbone_weights="imagenet", image_size=224, width=256, layers=6, heads=8, ffn=1024,
        ),
        TrainConfig(workers=8, keypoint_unit=10),
    ),
    # The same network made small, a hundred times the learning rate, and rays that an MLP can read (see `RayFeatures`):
    # centre, spread and shape apart. The head stays the paper's. In place of ImageNet: our own backbone, see pretrain.py,
    # which learns a tenth as fast as the rest (class accuracy on validation 96 % instead of 93 %, rotation 35° instead of 32°).
    # keypoint_unit by validation on the sample crops (data_samples/curves, medians): 1 gives 96° and 0.18 m, and keypoints
    # that are none any more; 10 gives 35°, 0.25 m, class 96 %; 96 gives 31°, 0.28 m, class 95 %.
    "cpu": (
        ModelConfig(
            backbone="compact", backbone_weights="data_samples/backbone/compact.safetensors", image_size=96, width=128,
            layers=3, heads=4, ffn=256, rays="split",
        ),
        TrainConfig(
            epochs=20, batch=64, lr=1e-3, backbone_lr=0.1, warmup=100, clip=1.0, keypoint_unit=10, augment=True, mirror=True, val_frames=1000,
        ),
    ),
}  # fmt: skip


def preset(name: str = "cpu", overrides: dict[str, Any] | None = None) -> tuple[ModelConfig, TrainConfig]:
    """The two halves of a preset, with `overrides` put in; their values may be text, as from `--set key=value`.

    Raises:
        InputError: unknown preset or key (the known ones are listed), or a value that does not fit.
    """
    if name not in PRESETS:
        raise InputError(f"unknown preset {name!r}; known: {', '.join(PRESETS)}")
    model, training = PRESETS[name]
    overrides = dict(overrides or {})
    for key in overrides:
        if key not in model.keys() + training.keys():
            raise InputError(f"unknown setting {key!r}; known: {', '.join(model.keys() + training.keys())}")
    return (
        model.replace(**{key: value for key, value in overrides.items() if key in model.keys()}),
        training.replace(**{key: value for key, value in overrides.items() if key in training.keys()}),
    )


def parse_overrides(pairs: list[str] | None) -> dict[str, str]:
    """["lr=1e-4", "rays=raw"] -> {"lr": "1e-4", "rays": "raw"}. Raises InputError for a pair without "="."""
    found = {}
    for pair in pairs or []:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise InputError(f"--set {pair!r}: write key=value, for example --set lr=1e-4")
        found[key.strip()] = value.strip()
    return found
