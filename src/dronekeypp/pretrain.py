"""The stand-in for ImageNet: the compact backbone, trained alone on the training scenes with simple heads.

A keypoint regressed from max-pooled tokens (Eq. 2) learns slowly from scratch; a heatmap per keypoint, with its centre of mass as
the answer (soft-argmax, Sun et al. 2018), learns in the first epoch. So the backbone first learns with heatmaps, a linear
classifier and a 6D rotation on pooled features. Then these heads are thrown away and the backbone is stored as float16.
"""

from __future__ import annotations

import json
import math
import shlex
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn.functional import cross_entropy, mse_loss, smooth_l1_loss
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from dronekeypp import __version__, rotations
from dronekeypp.errors import InputError
from dronekeypp.model.backbone import Backbone, save_backbone
from dronekeypp.model.config import ModelConfig
from dronekeypp.model.network import write_beside
from dronekeypp.presets import TrainConfig
from dronekeypp.train import (
    TrainState,
    check_finite,
    choose_device,
    coin,
    describe_data,
    epoch_order,
    learning_rate,
    mirrored,
    spaced,
    to_device,
)


class PretrainNet(nn.Module):
    """Backbone with three passing heads. image (B, 3, S, S) -> keypoints (B, 4, 2) crop units, class_logits, R (B, 3, 3)."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        self.backbone = Backbone(config, load=False)
        C = self.backbone.channels
        self.heatmaps = nn.Conv2d(C, 4, 1)
        self.to_class = nn.Linear(C, config.classes)
        self.to_rotation = nn.Linear(C, 6)
        with torch.no_grad():
            self.to_rotation.bias.copy_(torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]))

    def forward(self, image: Tensor) -> dict[str, Tensor]:
        features = self.backbone(image)  # (B, C, s, s)
        pooled = features.mean(dim=(2, 3))  # (B, C)
        return {
            "keypoints": soft_argmax(self.heatmaps(features)),
            "class_logits": self.to_class(pooled),
            "R": rotations.matrix_from_6d(self.to_rotation(pooled)),
        }


def soft_argmax(logits: Tensor) -> Tensor:
    """Heatmaps (B, K, s, s) -> the centre of mass of their softmax (B, K, 2) as (x, y) in crop units.

    A centre of mass never leaves the outermost cell centres (1/12 from the border with 6x6 cells); the crop's margin keeps the hubs inside.
    """
    s = logits.shape[-1]
    weights = logits.flatten(2).softmax(dim=-1).unflatten(2, (s, s))  # (B, K, s, s)
    axis = (torch.arange(s, device=logits.device) + 0.5) / s
    return torch.stack([(weights.sum(dim=2) * axis).sum(-1), (weights.sum(dim=3) * axis).sum(-1)], dim=-1)


def pretrain_terms(output: dict, batch: dict) -> dict[str, Tensor]:
    """Smooth L1 on keypoints in tenths of the crop · 0.3 cross-entropy · MSE on R: weights that start near one another."""
    return {
        "keypoints": smooth_l1_loss(10 * output["keypoints"], 10 * batch["keypoints"]),
        "class": 0.3 * cross_entropy(output["class_logits"], batch["label"]),
        "rotation": mse_loss(output["R"], batch["R"]),
    }


def pretrain_on(
    state: TrainState,
    train_set: Dataset,
    val_set: Dataset,
    on_epoch: Callable[[TrainState], None] | None = None,
    progress: bool = False,
) -> TrainState:
    """Train the `PretrainNet` of `state` in memory, from where it stands; returns the state with its history.

    Of `TrainConfig` it leaves out what belongs to the whole network: keypoint_unit, schedule, backbone_lr.

    Raises:
        InputError: an empty set, or a loss that is not finite.
    """
    for name, dataset in (("training", train_set), ("validation", val_set)):
        if len(dataset) == 0:
            raise InputError(f"the {name} set has no frames; were its scenes generated?")
    config = state.config
    device, started = choose_device(config), time.monotonic()
    net = state.model.to(device)
    val_set = spaced(val_set, config.val_frames)
    per_epoch = math.ceil(len(epoch_order(len(train_set), config, 0)) / config.batch)
    hidden = not (progress and sys.stderr.isatty())
    for epoch in range(state.epoch, config.epochs):
        tic = time.monotonic()
        if hasattr(train_set, "set_epoch"):
            train_set.set_epoch(epoch)
        order = epoch_order(len(train_set), config, epoch)
        loader = DataLoader(train_set, config.batch, sampler=order, num_workers=config.workers, generator=torch.Generator())
        net.train()
        total, flips = 0.0, coin(config, epoch)
        for number, items in enumerate(tqdm(loader, f"epoch {epoch + 1}/{config.epochs}", disable=hidden, leave=False)):
            lr = learning_rate(config, epoch * per_epoch + number, per_epoch * config.epochs)
            for group in state.optimiser.param_groups:
                group["lr"] = lr
            items = to_device(items, device)
            if config.mirror:
                items = mirrored(items, (torch.rand(len(items["t"]), generator=flips) < 0.5).to(device))
            terms = pretrain_terms(net(items["image"]), items)
            check_finite(terms, items, epoch + 1, number + 1)
            loss = sum(terms.values())
            state.optimiser.zero_grad(set_to_none=True)
            loss.backward()
            if config.clip:
                nn.utils.clip_grad_norm_(net.parameters(), config.clip)
            state.optimiser.step()
            total += loss.item() * len(items["t"])
        row = {"epoch": epoch + 1, "train_loss": total / len(order), **pretrain_errors(net, val_set, config)}
        row["seconds"] = round(time.monotonic() - tic, 2)
        state.epoch = epoch + 1
        state.history.append(row)
        if progress:
            print(
                f"epoch {row['epoch']:3d}/{config.epochs}  loss {row['train_loss']:.4f}  keypoints {row['keypoint_crop_px']:.2f} px of "
                f"the crop  class {100 * row['class_accuracy']:.1f} %  R {row['R_medae_deg']:.1f}°  {row['seconds']:.0f} s",
                flush=True,
            )
        if on_epoch:
            on_epoch(state)
        if config.max_minutes and time.monotonic() - started > 60 * config.max_minutes:
            break
    return state


def pretrain_errors(net: PretrainNet, val_set: Dataset, config: TrainConfig) -> dict[str, float]:
    """Mean keypoint error (pixels of the crop), class accuracy and median rotation error (degrees) on the validation frames."""
    device = next(net.parameters()).device
    net.eval()
    found: dict[str, list[np.ndarray]] = {"px": [], "class": [], "R": []}
    with torch.inference_mode():
        for items in DataLoader(val_set, config.batch, num_workers=config.workers, generator=torch.Generator()):
            items = to_device(items, device)
            output = net(items["image"])
            px = (output["keypoints"] - items["keypoints"]).norm(dim=-1).mean(-1) * items["image"].shape[-1]
            found["px"].append(px.cpu().numpy())
            found["class"].append((output["class_logits"].argmax(-1) == items["label"]).cpu().numpy())
            found["R"].append(rotations.geodesic_degrees(output["R"], items["R"]).cpu().numpy())
    px, correct, R = (np.concatenate(found[name]) for name in ("px", "class", "R"))
    return {"keypoint_crop_px": float(px.mean()), "class_accuracy": float(correct.mean()), "R_medae_deg": float(np.median(R))}


def pretrain(
    dataset_root: str | Path,
    out_file: str | Path,
    epochs: int = 9,
    minutes: float = 0.0,
    overrides: dict[str, Any] | None = None,
    resume: bool = False,
    progress: bool = True,
    command: str | None = None,
) -> Path:
    """Pretrain the compact backbone on the training scenes of a data set on disk and write it to `out_file`.

    `minutes` stops after the epoch in which it is reached. `overrides` reach ModelConfig and TrainConfig, as in `train`.
    Until the end the state lies beside, as OUT_FILE.resume: after a kill, `resume` goes on from its last whole epoch.

    Raises:
        InputError: a setting or the data set does not fit, or `out_file` exists already.
    """
    from dronekeypp.presets import preset
    from dronekeypp.sixdronesyn.dataset import SixDroneSyn

    for key in ("keypoint_unit", "schedule", "backbone_lr"):
        if key in (overrides or {}):
            raise InputError(f"--set {key}: pretraining has its own losses and no {key}; leave it out")
    changes = {"epochs": epochs, "max_minutes": minutes, "augment": True, "backbone_lr": 1.0, "backbone_weights": None, **(overrides or {})}
    model_config, config = preset("cpu", changes)
    size = model_config.image_size
    train_set = SixDroneSyn(dataset_root, "train", size=size, augment=config.augment, seed=config.seed)
    val_set = SixDroneSyn(dataset_root, "val", size=size)
    command = command or f"python -m dronekeypp {shlex.join(sys.argv[1:])}"
    return pretrain_to(train_set, val_set, out_file, model_config, config, resume, progress, command)


def pretrain_to(train_set, val_set, out_file, model_config, config, resume=False, progress=False, command="", on_epoch=None) -> Path:
    """`pretrain` for any two data sets whose items are those of `SixDroneSyn`."""
    out_file = Path(out_file)
    if out_file.exists():
        raise InputError(f"{out_file} exists already; choose another name or remove it")
    half_way = out_file.with_name(out_file.name + ".resume")
    if half_way.exists() and not resume:
        raise InputError(f"{half_way} is left from an earlier run; add --resume to go on, or remove it")
    torch.manual_seed(config.seed)
    data = describe_data(train_set, val_set)
    state = TrainState(PretrainNet(model_config).to(choose_device(config)), config, data)
    if half_way.exists():
        state.load(half_way)
    out_file.parent.mkdir(parents=True, exist_ok=True)

    def keep(state: TrainState) -> None:
        state.save(half_way)
        if on_epoch:
            on_epoch(state)

    pretrain_on(state, train_set, val_set, keep, progress)
    metadata = {
        "command": command, "dronekeypp": __version__, "dataset_digest": str(data["digest"]),
        "train_frames": str(len(train_set)), "epochs": str(state.epoch), "seed": str(config.seed),
        "backbone_stride": str(model_config.backbone_stride), "image_size": str(model_config.image_size),
        "validation": json.dumps({k: round(v, 4) for k, v in state.history[-1].items()}),
    }  # fmt: skip
    write_beside(out_file, save(save_backbone(state.model.backbone), metadata))
    half_way.unlink(missing_ok=True)
    return out_file
