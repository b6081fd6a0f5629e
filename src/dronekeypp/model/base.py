"""Hold what every method shares.

These are its settings, a backbone, the drones it knows, and what training and evaluation ask of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Self

from torch import Tensor, nn

from dronekeypp import checkpoint
from dronekeypp.classes import DroneClass, unnamed
from dronekeypp.errors import InputError
from dronekeypp.model.inputs import check_call
from dronekeypp.settings import Settings


class PoseNetwork(nn.Module):
    """This is the base of every network that `train.fit` trains and `evaluate.evaluate` measures.

    DroneKey++ and each baseline derive from it.

    `forward(image, K, square, **truth)` returns a dict with some of keypoints (B, 4, 2) in crop units,
    class_probs (B, classes), R (B, 3, 3), t (B, 3) in metres and failed (B,) bool. A measure whose part is
    missing comes out as NaN.

    A network of your own takes `(config, load_backbone)`, keeps `self.config`, and has `method`, `Config`,
    `forward` and `losses`. Enter it in `checkpoint.METHODS`; then it trains from the command line, and its
    checkpoints can be loaded. With a `Run` in `reproduce.table3_runs.RUNS` it stands in Table 3.
    """

    method: ClassVar[str]  # its name in tables and checkpoints
    Config: ClassVar[type[Settings]]  # its settings; others are refused
    learns_from: tuple[str, ...] = ()  # the keys of a frame that its losses and `prepare` read
    truth_inputs: tuple[str, ...] = ()  # the keys of the truth that it is given beside the picture
    judged_by: ClassVar[str] = "pose"  # what chooses the best checkpoint: "pose" | "keypoints"
    defaults: ClassVar[dict[str, Any]] = {}  # settings in which it differs from a preset, unless chosen
    config: Settings
    # Whether a call outside of training looks at the values that it is given, see `model.inputs`.
    checks_inputs: bool = True

    def __init__(self) -> None:
        super().__init__()
        self.register_forward_pre_hook(check_call, with_kwargs=True)
        # The backbone may learn at a rate of its own (`TrainConfig.backbone_lr`).
        self.backbone: nn.Module | None = None
        self._drones: tuple[DroneClass, ...] | None = None

    @property
    def drones(self) -> tuple[DroneClass, ...]:
        """Return the drones behind its class indices, in their order.

        They are those of the data set that it was trained on.
        """
        return self._drones or unnamed(getattr(self.config, "classes", 7))

    def know(self, drones: Sequence[DroneClass]) -> None:
        """Take the names and hubs of its classes.

        Raises:
            InputError: there are more or fewer drones than the network has classes.
        """
        classes = getattr(self.config, "classes", len(drones))
        if len(drones) != classes:
            raise InputError(f"{len(drones)} drones for a network with {classes} classes")
        self._drones = tuple(drones)

    @classmethod
    def unused_settings(cls, values: Mapping[str, Any]) -> dict[str, str]:
        """Return the settings of network and training that do not count beside `values`, and why.

        A method that reads only a part of `TrainConfig` adds the others.
        """
        return cls.Config.unused(values)

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Return the terms of its loss as scalars, unweighted, under names of `losses.TERMS`.

        Args:
            output: what `forward` returned.
            batch: the batch that it was given, with the truth.
            keypoint_unit: side of the crop in the unit that L_2D is measured in; see `losses.loss_terms`.
        """
        raise NotImplementedError

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """Take what it needs to know of the training set before the first step.

        `annotations` hold no images. By default nothing is taken.
        """

    @property
    def idle_parameters(self) -> bool:
        """Say whether some parameters get no gradient.

        Training with several processes must know that.
        """
        return False

    def save_pretrained(self, folder: str | Path, half: bool = False) -> None:
        """Write `model.safetensors` and `config.json` into `folder`; see `checkpoint.save`."""
        checkpoint.save(self, folder, half)

    @classmethod
    def from_pretrained(cls, folder: str | Path) -> Self:
        """Read a folder that `save_pretrained` wrote, and return the network in evaluation mode.

        Raises:
            InputError: a file is missing or broken, weights and configuration do not fit, or the network is
                another method's. The message names the file.
        """
        method, config, drones = checkpoint.read_config(folder, cls)
        if method != cls.method:
            raise InputError(
                f"{folder} holds a network of {method}, not of {cls.method}; load it with that class"
            )
        state = checkpoint.read_state(folder, method)
        network = cls(config, load_backbone=False)
        checkpoint.load_state(network, state, Path(folder) / checkpoint.WEIGHTS)
        network.know(drones)
        return network.eval()
