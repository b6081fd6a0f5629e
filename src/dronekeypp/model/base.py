"""What every method shares: settings, a backbone, what training and evaluation ask of it, and its checkpoint on disk."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor, nn

from dronekeypp.errors import InputError
from dronekeypp.files import read_json, write_beside
from dronekeypp.model.backbone import load_state
from dronekeypp.model.config import ModelConfig

WEIGHTS, CONFIG = "model.safetensors", "config.json"


class PoseNetwork(nn.Module):
    """A network that `train.fit` trains and `evaluate.evaluate` measures: DroneKey++, and each baseline.

    `forward(image, K, square, **truth)` returns a dict with some of keypoints (B, 4, 2) crop units, class_probs (B, classes),
    R (B, 3, 3), t (B, 3) and failed (B,) bool; a measure whose part is missing comes out as NaN.

    A network of your own takes `(config, load_backbone)`, keeps `self.config`, and has `method`, `forward` and `losses`. Put it into
    `baselines.NETWORKS` under its method's name, and checkpoints of it can be loaded; with a `Run` in `reproduce.table3.RUNS` it stands in Table 3.
    """

    method: ClassVar[str]  # its name in tables and checkpoints
    truth_inputs: tuple[str, ...] = ()  # what of the truth it is handed beside the picture, by name
    judged_by: ClassVar[str] = "pose"  # what chooses the best checkpoint: "pose" | "keypoints"
    defaults: ClassVar[
        dict[str, Any]
    ] = {}  # settings in which it differs from a preset, unless told otherwise
    config: ModelConfig

    def __init__(self):
        super().__init__()
        self.backbone: nn.Module | None = (
            None  # it may learn at a rate of its own (`TrainConfig.backbone_lr`)
        )

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """The terms of its loss as scalars, unweighted; their names are of `losses.TERMS`."""
        raise NotImplementedError

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """Take what it needs to know of the training set (no images) before the first step. By default nothing."""

    @property
    def idle_parameters(self) -> bool:
        """Whether some parameters get no gradient: several processes must be told."""
        return False

    def save_pretrained(self, folder: str | Path, half: bool = False) -> None:
        """Write `model.safetensors` and `config.json` into `folder` (made if needed), each beside and then renamed.

        `half` stores float16: half the size, read back as float32.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        state = {
            key: (value.half() if half and value.is_floating_point() else value).detach().cpu().contiguous()
            for key, value in self.state_dict().items()
        }
        write_beside(folder / WEIGHTS, save(state))
        settings = {"method": self.method, **self.config.to_dict()}
        write_beside(folder / CONFIG, (json.dumps(settings, indent=2) + "\n").encode())

    @classmethod
    def from_pretrained(cls, folder: str | Path):
        """Read a folder that `save_pretrained` wrote; the network comes back in evaluation mode.

        Raises:
            InputError: a file is missing or broken, weights and configuration do not fit, or it is another method's. It names the file.
        """
        method, config = read_config(folder)
        if method != cls.method:
            raise InputError(
                f"{folder} holds a network of {method}, not of {cls.method}; load it with that class"
            )
        weights = Path(folder) / WEIGHTS
        try:
            state = {
                key: value.float() if value.dtype == torch.half else value
                for key, value in load_file(weights).items()
            }
        except (SafetensorError, OSError) as error:
            raise InputError(f"{weights} is not a readable safetensors file ({error})") from None
        model = cls(config, load_backbone=False)
        load_state(model, state, weights)
        return model.eval()


def read_config(folder: str | Path) -> tuple[str, ModelConfig]:
    """The method's name and the settings of a checkpoint. Raises InputError naming the file that is missing or broken."""
    folder = Path(folder)
    for name in (CONFIG, WEIGHTS):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder / name} not found: a checkpoint is a folder with {CONFIG} and {WEIGHTS}"
            )
    try:
        settings = read_json(folder / CONFIG)
        method = settings.pop("method", "DroneKey++") if isinstance(settings, dict) else ""
        return str(method), ModelConfig.from_dict(settings)
    except InputError as error:
        raise InputError(f"{folder / CONFIG}: {str(error).removeprefix(f'{folder / CONFIG}: ')}") from None
