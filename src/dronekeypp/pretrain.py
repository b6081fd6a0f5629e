"""Pretrain the compact backbone, the stand-in for ImageNet's weights.

It is trained alone, with simple heads, on random quadrotors (`generate --quadrotors A:B`).

A keypoint regressed from max-pooled tokens (Eq. 2) learns slowly from scratch. A heatmap per keypoint, with
its centre of mass as the answer (soft-argmax, Sun et al. 2018), learns sooner. So the backbone first learns
with heatmaps and with a 6D rotation on pooled features. Then these heads are thrown away and the backbone is
stored as float16.

Front and rear of a quadrotor look alike, so at first any hub may be any of four propellers. The mean of the
four is then the best answer of a soft-argmax, and the middle of the drone teaches nothing. Therefore each
heatmap is also trained as a distribution over the cells: it may hold four peaks, and finds the propellers
before it knows which is which.

It is shown no class, and random quadrotors are none of the seven drones. So a drone that is later left out of
a training is one that no part of the network has ever seen. The file names the drones it was trained on.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn.functional import mse_loss, smooth_l1_loss
from torch.utils.data import ConcatDataset, Dataset

from dronekeypp import __version__, rotations
from dronekeypp.camera import from_crop, rays
from dronekeypp.classes import DroneClass
from dronekeypp.data import FrameDataset, open_dataset
from dronekeypp.errors import InputError
from dronekeypp.files import check_replaceable, command_line, lock_file, remove_unfinished, write_beside
from dronekeypp.model.backbone import Backbone, save_backbone
from dronekeypp.model.base import PoseNetwork
from dronekeypp.model.config import BackboneConfig
from dronekeypp.model.encoder import cell_centres
from dronekeypp.presets import TrainConfig, preset
from dronekeypp.train import BrokenState, TrainState, choose_device, describe_data, fit

FEW_DRONES = 50  # from fewer, a backbone learns these drones rather than what drones look like


class PretrainNet(PoseNetwork):
    """This is the backbone with two heads that are thrown away after the pretraining.

    It turns image (B, 3, S, S), K (B, 3, 3) and square (B, 3) into heatmaps (B, 4, s, s), keypoints (B, 4, 2)
    in crop units and R (B, 3, 3), camera←body. The rotation head says how the drone looks along the ray to
    the crop's centre.
    """

    method = "backbone"
    Config = BackboneConfig
    learns_from = ("keypoints", "R")
    judged_by = "keypoints"

    def __init__(self, config: BackboneConfig) -> None:
        super().__init__()
        self.config = config
        self.backbone = Backbone(config, load=False)
        C = self.backbone.channels
        self.heatmaps = nn.Conv2d(C, 4, 1)
        self.to_rotation = nn.Linear(C, 6)
        with torch.no_grad():
            self.to_rotation.bias.copy_(torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]))

    def forward(self, image: Tensor, K: Tensor, square: Tensor) -> dict[str, Tensor]:
        """Return the answers of the two heads."""
        features = self.backbone(image)  # (B, C, s, s)
        heatmaps = self.heatmaps(features)  # (B, 4, s, s)
        pooled = features.mean(dim=(2, 3))  # (B, C)
        seen = rotations.matrix_from_6d(self.to_rotation(pooled))  # (B, 3, 3) along the ray
        centre = from_crop(square.new_full((1, 2), 0.5), square)  # (B, 1, 2) pixels
        return {
            "heatmaps": heatmaps,
            "keypoints": soft_argmax(heatmaps),
            "R": rotations.towards(rays(centre, K)[:, 0]) @ seen,
        }

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Return the two terms, with weights that let them start near one another.

        L_2D is the cross-entropy of the heatmaps and smooth L1 on keypoints in tenths of the crop (with the
        keypoint unit 10), L_rot the MSE on R.
        """
        logits = output["heatmaps"].flatten(2).log_softmax(dim=-1)  # (B, 4, s * s)
        target = cell_weights(batch["keypoints"], output["heatmaps"].shape[-1])
        cross_entropy = -(target * logits).sum(dim=-1).mean()
        distance = smooth_l1_loss(keypoint_unit * output["keypoints"], keypoint_unit * batch["keypoints"])
        return {"L_2D": cross_entropy + distance, "L_rot": mse_loss(output["R"], batch["R"])}


def soft_argmax(logits: Tensor) -> Tensor:
    """Return the centre of mass of each heatmap's softmax.

    A centre of mass never leaves the outermost cell centres (1/12 from the border with 6x6 cells); the crop's
    margin keeps the hubs inside.

    Args:
        logits: (B, K, s, s) heatmaps.

    Returns:
        (B, K, 2) as (x, y) in crop units.
    """
    return logits.flatten(2).softmax(dim=-1) @ cell_centres(logits.shape[-1]).to(logits)  # (B, K, M) @ (M, 2)


def cell_weights(keypoints: Tensor, side: int) -> Tensor:
    """Return keypoints as distributions over the cells of a heatmap: the opposite of `soft_argmax`.

    Each of the four cells around a keypoint has its bilinear weight, so that the centre of mass is the
    keypoint, or the nearest point within the outermost cell centres.

    Args:
        keypoints: (B, K, 2) as (x, y) in crop units.
        side: s, the cells along a side, at least 2.

    Returns:
        (B, K, s * s), row by row.
    """
    centres = (torch.arange(side, device=keypoints.device) + 0.5).to(keypoints)
    position = (keypoints * side).clamp(0.5, side - 0.5)
    x, y = (1 - (position[..., None] - centres).abs()).clamp(min=0).unbind(dim=-2)  # (B, K, s) each
    return (y[..., :, None] * x[..., None, :]).flatten(2)


class Joined(ConcatDataset):
    """This class joins several data sets into one, for `fit`.

    The classes of each part come behind those of the part before. `digest` joins the digests of the parts.
    """

    def __init__(self, datasets: Sequence[FrameDataset]) -> None:
        super().__init__(datasets)
        self.keys = datasets[0].keys
        self.digest = "+".join(str(dataset.digest) for dataset in datasets)
        self.drones: tuple[DroneClass, ...] = ()
        self._first_class = []  # of each part
        for dataset in datasets:
            self._first_class.append(len(self.drones))
            self.drones += dataset.drones

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        index = range(len(self))[index]
        part = bisect_right(self.cumulative_sizes, index)
        item = super().__getitem__(index)
        return {**item, "label": item["label"] + self._first_class[part]}

    def set_epoch(self, epoch: int) -> None:
        """Choose the augmentation of every part."""
        for dataset in self.datasets:
            dataset.set_epoch(epoch)

    def annotations(self) -> dict[str, Tensor]:
        """Return the annotations of every part, one after the other."""
        parts = []
        for dataset, first_class in zip(self.datasets, self._first_class, strict=True):
            part = dataset.annotations()
            parts.append({**part, "label": part["label"] + first_class})
        return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}


def pretrain(
    dataset_roots: Sequence[str | Path],
    out_file: str | Path,
    val_root: str | Path | None = None,
    epochs: int = 7,
    overrides: dict[str, Any] | None = None,
    resume: bool = False,
    progress: bool = True,
    command: str | None = None,
) -> Path:
    """Pretrain the compact backbone on data sets on disk and write it to `out_file`.

    Until the end, the state lies beside as OUT_FILE.resume. After a kill, `resume` goes on from its last
    whole epoch.

    Args:
        dataset_roots: one or more data sets, whose training scenes are used.
        out_file: the safetensors file to write.
        val_root: the data set whose validation scenes judge the backbone; by default the first of
            `dataset_roots`.
        epochs: epochs to train.
        overrides: settings of BackboneConfig and TrainConfig, as in `train`.
        resume: go on from OUT_FILE.resume.
        progress: show a bar and one line per epoch.
        command: the command that is recorded in the file; None for that of this process.

    Returns:
        the path of the file.

    Raises:
        InputError: a setting or a data set does not fit, or `out_file` exists already.
    """
    for key in ("schedule", "backbone_lr", "frozen_stages", "rotation_weight"):
        if key in (overrides or {}):
            raise InputError(f"--set {key}: pretraining has its own losses and no {key}; leave it out")
    changes = {
        "epochs": epochs,
        "augment": True,
        "backbone_lr": 1.0,
        "frozen_stages": 0,
        "backbone_weights": None,
        **(overrides or {}),
    }
    model_config, config = preset("cpu", changes, PretrainNet)
    size = model_config.image_size
    parts = []
    for i, root in enumerate(dataset_roots):
        part = open_dataset(
            root, "train", size=size, augment=config.augment, seed=config.seed + i, degrade=config.degrade
        )
        parts.append(part)
    train_set = parts[0] if len(parts) == 1 else Joined(parts)
    val_set = _validation_set(dataset_roots[0], val_root, size)
    seen = {part.drones[label].name for part in parts for label in set(part.labels)}
    if progress and len(seen) < FEW_DRONES:
        print(
            f"{len(seen)} drones to learn from: the backbone will know these, and hardly what drones look "
            "like; ours saw 480 (generate --quadrotors 0:600)"
        )
    facts = {"command": command or command_line(), "drones": ", ".join(sorted(seen))}
    return pretrain_to(train_set, val_set, out_file, model_config, config, resume, progress, facts)


def _validation_set(first: str | Path, val_root: str | Path | None, size: int) -> FrameDataset:
    """Open the frames that judge the backbone: those of `val_root` or, without it, of the first data set.

    Raises:
        InputError: there are none.
    """
    try:
        return open_dataset(val_root or first, "val", size=size)
    except InputError as error:
        if val_root is not None:
            raise
        raise InputError(
            f"{error}; name another data set with --val (of random quadrotors, those whose number ends in 8 "
            "fly in the validation scenes: generate --quadrotors 0:10 has one)"
        ) from None


def pretrain_to(
    train_set: Dataset,
    val_set: Dataset,
    out_file: str | Path,
    model_config: BackboneConfig,
    config: TrainConfig,
    resume: bool = False,
    progress: bool = False,
    facts: dict[str, str] | None = None,
    on_epoch: Callable[[TrainState], None] | None = None,
) -> Path:
    """Do what `pretrain` does, for any two data sets that keep the frame contract.

    The contract is that of `dronekeypp.data`. `facts` is written into the file beside what the training
    itself knows.
    """
    out_file = Path(out_file)
    out_file.parent.mkdir(parents=True, exist_ok=True)
    busy = f"another process is at work on {out_file}: let it finish, or choose another name"
    with lock_file(out_file.with_name(f".{out_file.name}.lock"), busy):
        return _pretrain_to(
            train_set, val_set, out_file, model_config, config, resume, progress, facts, on_epoch
        )


def _pretrain_to(
    train_set: Dataset,
    val_set: Dataset,
    out_file: Path,
    model_config: BackboneConfig,
    config: TrainConfig,
    resume: bool,
    progress: bool,
    facts: dict[str, str] | None,
    on_epoch: Callable[[TrainState], None] | None,
) -> Path:
    """Do the work of `pretrain_to` while it holds the place of the file."""
    if out_file.exists() or out_file.is_symlink():
        raise InputError(f"{out_file} exists already; choose another name or remove it")
    half_way = out_file.with_name(out_file.name + ".resume")
    if half_way.exists() and not resume:
        raise InputError(f"{half_way} is left from an earlier run; add --resume to go on, or remove it")
    torch.manual_seed(config.seed)
    check_replaceable(half_way)
    data = describe_data(train_set, val_set)
    state = TrainState(PretrainNet(model_config).to(choose_device(config)), config, data)
    if half_way.exists():
        try:
            state.load(half_way)
        except BrokenState as error:
            raise InputError(f"{error}: remove it, and start again without --resume") from None
    remove_unfinished(out_file.parent, (out_file.name, half_way.name))

    def keep(state: TrainState) -> None:
        state.save(half_way)
        if on_epoch:
            on_epoch(state)

    fit(state.model, train_set, val_set, config, keep, progress, state)
    last = {}
    for name, value in state.history[-1].items():
        if not math.isnan(value):
            last[name] = round(value, 4)
    metadata = {
        **(facts or {}),
        "dronekeypp": __version__,
        "dataset_digest": str(data["digest"]),
        "train_frames": str(len(train_set)),
        "epochs": str(state.epoch),
        "minutes": str(round(sum(row["seconds"] for row in state.history) / 60)),
        "seed": str(config.seed),
        "backbone_stride": str(model_config.backbone_stride),
        "image_size": str(model_config.image_size),
        "validation": json.dumps(last),
    }
    write_beside(out_file, save(save_backbone(state.model.backbone), metadata))
    half_way.unlink(missing_ok=True)
    return out_file
