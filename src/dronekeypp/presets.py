"""Name two groups of settings: `paper`, as printed, and `cpu`, which trains on a laptop.

`--set key=value` reaches every key of both halves: the network's settings and those of the training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP, PoseNetwork
from dronekeypp.model.losses import SCHEDULES
from dronekeypp.settings import Settings, usable


@dataclass(frozen=True)
class TrainConfig(Settings):
    """These are the settings of the training (Sec. V-A, "Implementation details").

    The defaults are the paper's where it gives one.
    """

    epochs: int = 100
    batch: int = 32  # frames a step, over all processes together
    lr: float = 1e-5  # Adam; a cosine takes it to 0 over the whole run
    backbone_lr: float = 1.0  # the backbone's share of lr: below 1 keeps what pretraining taught it
    frozen_stages: int = 0  # first stages of a pretrained backbone that do not learn: 1 the stem, 2 one more
    warmup: int = 0  # steps of linear warm-up before the cosine; the paper has none
    clip: float = 0.0  # largest norm of the gradient; 0 leaves it alone, as the paper does
    weight_decay: float = 0.0
    keypoint_unit: float = 10.0  # side of the crop in the unit of y2D: the hidden weight of L_2D
    rotation_weight: float = 1.0  # what L_rot is multiplied with; the paper's is 1
    schedule: str = "equal"  # Table 6: "equal" | "tanh" | "shifted" | "biased"
    augment: bool = False  # the crop's margin and centre drawn anew; the paper has no augmentation
    degrade: bool = False  # half of the crops as a small, compressed video shows them; the paper has none
    mirror: bool = False  # half of the frames seen in a mirror, truth and all; the paper has none
    frames: int = 0  # training frames seen per epoch, drawn anew each time; 0: all
    val_frames: int = 0  # validation frames, evenly spaced; 0: all
    seed: int = 0
    workers: int = 0  # data loading processes
    max_minutes: float = 0.0  # stop after the epoch in which this is reached; 0: never
    device: str = "auto"  # "auto" | "cpu" | "cuda"
    precision: str = "float32"  # of what looks at the picture: "float32" | "bfloat16", faster on some CPUs

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {
        "schedule": SCHEDULES,
        "device": ("auto", "cpu", "cuda"),
        "precision": ("float32", "bfloat16"),
    }
    LEAST: ClassVar[dict[str, float]] = {
        "epochs": 1,
        "batch": 1,
        "lr": 0,
        "backbone_lr": 0,
        "frozen_stages": 0,
        "warmup": 0,
        "clip": 0,
        "weight_decay": 0,
        "keypoint_unit": 0,
        "rotation_weight": 0,
        "frames": 0,
        "val_frames": 0,
        "seed": 0,
        "workers": 0,
        "max_minutes": 0,
    }


@dataclass(frozen=True)
class Preset:
    """These are the settings of a network, as far as a method uses them, and of its training."""

    model: Mapping[str, Any]
    training: TrainConfig


PRESETS: dict[str, Preset] = {
    # Learning rate, batch, epochs, the cosine, ImageNet, no augmentation, raw rays and three sigmoid angles
    # are the paper's. It does not give N, d, the size of the crop or the ResNet's depth: 6, 256, 224 px and
    # 50 are ours. So is the unit of y2D, chosen so that L_2D starts near the other terms.
    "paper": Preset(
        {
            "backbone": "resnet50",
            "backbone_weights": "imagenet",
            "image_size": 224,
            "width": 256,
            "layers": 6,
            "heads": 8,
            "ffn": 1024,
        },
        TrainConfig(workers=8, keypoint_unit=10),
    ),
    # The same network made small, with a hundred times the learning rate, and with rays that an MLP can read
    # (see `RayFeatures`): centre, spread and shape apart. The head stays the paper's. In place of ImageNet's
    # weights it has those of our own backbone (see pretrain.py). They learn a tenth as fast as the rest: so
    # the class accuracy on validation is 96 % instead of 93 %, and the rotation error 35° instead of 32°.
    # keypoint_unit was chosen by validation on the sample crops (data_samples/curves, medians): 1 gives 96°
    # and 0.18 m, and keypoints that no longer mean anything; 10 gives 35°, 0.25 m and a class accuracy of
    # 96 %; 96 gives 31°, 0.28 m and 95 %.
    "cpu": Preset(
        {
            "backbone": "compact",
            "backbone_weights": "data_samples/backbone/compact.safetensors",
            "image_size": 96,
            "width": 128,
            "layers": 3,
            "heads": 4,
            "ffn": 256,
            "rays": "split",
        },
        TrainConfig(
            epochs=20,
            batch=64,
            lr=1e-3,
            backbone_lr=0.1,
            warmup=100,
            clip=1.0,
            keypoint_unit=10,
            augment=True,
            mirror=True,
            val_frames=1000,
        ),
    ),
}


def preset(
    name: str = "cpu",
    overrides: Mapping[str, Any] | None = None,
    network: type[PoseNetwork] = DroneKeyPP,
) -> tuple[Settings, TrainConfig]:
    """Return the settings of a network and of its training: a preset, with `overrides` put in.

    What the preset sets and this network does not have is left out. Where the network itself differs from the
    preset (`PoseNetwork.defaults`), its own value replaces the preset's, and an override replaces both.

    Args:
        name: a key of PRESETS.
        overrides: settings of either half. Their values may be text, as from `--set key=value`.
        network: the class of the network.

    Raises:
        InputError: the preset is unknown, a value does not fit, or an override is not used: by this method,
            by the decoder that is chosen, or beside another override.
    """
    if name not in PRESETS:
        raise InputError(f"unknown preset {name!r}; known: {', '.join(PRESETS)}")
    usual, chosen = PRESETS[name], dict(overrides or {})
    own = {**network.defaults, **chosen}
    known = network.Config.known_keys(own)
    for key in chosen:
        if key not in known and key not in TrainConfig.keys():
            settings = ", ".join([*known, *TrainConfig.keys()])
            raise InputError(f"unknown setting {key!r} for {network.method}; known: {settings}")
    own = {key: value for key, value in own.items() if key in known}
    unused = network.unused_settings({**usual.model, **own})
    for key in chosen:
        if key in unused:
            raise InputError(f"{key}={chosen[key]} is not used: {unused[key]}")
    model = network.Config.from_dict({**usable(network.Config, usual.model, own), **own})
    training_keys = TrainConfig.keys()
    changes = {key: value for key, value in chosen.items() if key in training_keys}
    return model, usual.training.replace(**changes)


def parse_overrides(pairs: Sequence[str] | None) -> dict[str, str]:
    """Turn ["lr=1e-4", "rays=raw"] into {"lr": "1e-4", "rays": "raw"}.

    Raises:
        InputError: a pair has no "=" or no key.
    """
    overrides = {}
    for pair in pairs or []:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise InputError(f"--set {pair!r}: write key=value, for example --set lr=1e-4")
        overrides[key.strip()] = value.strip()
    return overrides
