"""The stand-in for ImageNet: the compact backbone, trained alone on further flights of the training scenes, with simple heads.

A keypoint regressed from max-pooled tokens (Eq. 2) learns slowly from scratch; a heatmap per keypoint, with its centre of mass as
the answer (soft-argmax, Sun et al. 2018), learns in the first epoch. So the backbone first learns with heatmaps, a linear
classifier and a 6D rotation on pooled features. Then these heads are thrown away and the backbone is stored as float16.

The flights matter more than the frames. A backbone pretrained on the 168 training flights knows each of them by heart (drone named
in 100 % of their frames, in 78 % of unseen ones), and whatever is trained on its features afterwards learns from features that
are too good to be true. So ours is pretrained on the same scenes flown with other seeds, and never sees the flights it is used on.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn.functional import cross_entropy, mse_loss, smooth_l1_loss
from torch.utils.data import ConcatDataset, Dataset

from dronekeypp import __version__, rotations
from dronekeypp.errors import InputError
from dronekeypp.files import command_line, write_beside
from dronekeypp.model.backbone import Backbone, save_backbone
from dronekeypp.model.base import PoseNetwork
from dronekeypp.model.config import ModelConfig
from dronekeypp.model.encoder import cell_centres
from dronekeypp.train import TrainState, choose_device, describe_data, fit


class PretrainNet(PoseNetwork):
    """Backbone with three passing heads. image (B, 3, S, S) -> keypoints (B, 4, 2) crop units, class_logits, R (B, 3, 3)."""

    method = "backbone"
    judged_by = "keypoints"

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

    def forward(
        self, image: Tensor, K: Tensor | None = None, square: Tensor | None = None
    ) -> dict[str, Tensor]:
        """K and square are not looked at."""
        features = self.backbone(image)  # (B, C, s, s)
        pooled = features.mean(dim=(2, 3))  # (B, C)
        logits = self.to_class(pooled)
        return {
            "keypoints": soft_argmax(self.heatmaps(features)),
            "class_logits": logits,
            "class_probs": logits.softmax(dim=-1),
            "R": rotations.matrix_from_6d(self.to_rotation(pooled)),
        }

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Smooth L1 on keypoints in tenths of the crop (unit 10) · 0.3 cross-entropy · MSE on R: weights that start near one another."""
        return {
            "L_2D": smooth_l1_loss(keypoint_unit * output["keypoints"], keypoint_unit * batch["keypoints"]),
            "L_cls": 0.3 * cross_entropy(output["class_logits"], batch["label"]),
            "L_rot": mse_loss(output["R"], batch["R"]),
        }


def soft_argmax(logits: Tensor) -> Tensor:
    """Heatmaps (B, K, s, s) -> the centre of mass of their softmax (B, K, 2) as (x, y) in crop units.

    A centre of mass never leaves the outermost cell centres (1/12 from the border with 6x6 cells); the crop's margin keeps the hubs inside.
    """
    return logits.flatten(2).softmax(dim=-1) @ cell_centres(logits.shape[-1]).to(logits)  # (B, K, M) @ (M, 2)


class Joined(ConcatDataset):
    """Several data sets as one, for `fit`: `manifest["digest"]` joins theirs."""

    def __init__(self, datasets: Sequence[Dataset]):
        super().__init__(datasets)
        self.manifest = {"digest": "+".join(str(d.manifest["digest"]) for d in datasets)}

    def set_epoch(self, epoch: int) -> None:
        """Choose the augmentation of every part."""
        for dataset in self.datasets:
            dataset.set_epoch(epoch)

    def annotations(self) -> dict[str, Tensor]:
        """Those of every part, one after the other."""
        parts = [dataset.annotations() for dataset in self.datasets]
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
    """Pretrain the compact backbone on the training scenes of one or more data sets on disk and write it to `out_file`.

    `val_root`: the data set whose validation scenes judge it; by default the first of `dataset_roots`.
    `overrides` reach ModelConfig and TrainConfig, as in `train`.
    Until the end the state lies beside, as OUT_FILE.resume: after a kill, `resume` goes on from its last whole epoch.

    Raises:
        InputError: a setting or the data set does not fit, or `out_file` exists already.
    """
    from dronekeypp.presets import preset
    from dronekeypp.sixdronesyn.dataset import SixDroneSyn

    for key in ("schedule", "backbone_lr"):
        if key in (overrides or {}):
            raise InputError(f"--set {key}: pretraining has its own losses and no {key}; leave it out")
    changes = {
        "epochs": epochs,
        "augment": True,
        "backbone_lr": 1.0,
        "backbone_weights": None,
        **(overrides or {}),
    }
    model_config, config = preset("cpu", changes)
    size = model_config.image_size
    parts = [
        SixDroneSyn(
            root, "train", size=size, augment=config.augment, seed=config.seed + i, degrade=config.degrade
        )
        for i, root in enumerate(dataset_roots)
    ]
    train_set = parts[0] if len(parts) == 1 else Joined(parts)
    val_set = SixDroneSyn(val_root or dataset_roots[0], "val", size=size)
    command = command or command_line()
    return pretrain_to(train_set, val_set, out_file, model_config, config, resume, progress, command)


def pretrain_to(
    train_set,
    val_set,
    out_file,
    model_config,
    config,
    resume=False,
    progress=False,
    command="",
    on_epoch=None,
) -> Path:
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

    fit(state.model, train_set, val_set, config, keep, progress, state)
    metadata = {
        "command": command, "dronekeypp": __version__, "dataset_digest": str(data["digest"]),
        "train_frames": str(len(train_set)), "epochs": str(state.epoch), "seed": str(config.seed),
        "backbone_stride": str(model_config.backbone_stride), "image_size": str(model_config.image_size),
        "validation": json.dumps({k: round(v, 4) for k, v in state.history[-1].items() if v == v}),
    }  # fmt: skip
    write_beside(out_file, save(save_backbone(state.model.backbone), metadata))
    half_way.unlink(missing_ok=True)
    return out_file
