"""Keep on disk what changes while training: weights, Adam's moments and the history.

The settings that they belong to are stored with them.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Literal

import torch
from pydantic import ConfigDict
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from dronekeypp import checkpoint
from dronekeypp.errors import InputError
from dronekeypp.files import parse_json, write_beside
from dronekeypp.model import ModelConfig, PoseNetwork
from dronekeypp.presets import TrainConfig
from dronekeypp.schema import Count, Length, Open, Schema, check
from dronekeypp.settings import Settings

FREE_KEYS = ("workers", "max_minutes", "device")  # these may differ when a run is resumed


class BrokenState(InputError):
    """A file of a training state cannot be read, or belongs to another network.

    The message names the file and what is wrong. Whoever knows the run adds the mend.
    """


class HistoryRow(Open):
    """This is a row of metrics.csv: what was measured in an epoch. A diverged training has NaN there."""

    model_config = ConfigDict(allow_inf_nan=True)
    __pydantic_extra__: dict[str, float | str | None]

    epoch: Length
    score: float
    seconds: float


class Header(Schema):
    """This is what a training state says of itself. States of an earlier version lack `moments`."""

    model_config = ConfigDict(allow_inf_nan=True)

    epoch: Count
    moments: list[str] = []
    best_score: float
    history: list[HistoryRow]
    settings: dict[Literal["model", "train", "data"], dict[str, Any]]


class TrainState:
    """This is what changes while training: the network, Adam, the finished epochs and their history."""

    def __init__(self, model: PoseNetwork, config: TrainConfig, data: dict[str, Any] | None = None) -> None:
        self.model, self.config = model, config
        self.settings = run_settings(model.method, model.config, config, data or {})
        backbone = list(model.backbone.parameters()) if model.backbone is not None else []
        in_backbone = {id(p) for p in backbone}
        rest = [p for p in model.parameters() if id(p) not in in_backbone]
        groups = []
        for parameters, share in ((rest, 1.0), (backbone, config.backbone_lr)):
            if parameters:
                groups.append({"params": parameters, "share": share})  # share: of the learning rate
        self.optimiser = torch.optim.Adam(groups, lr=config.lr, weight_decay=config.weight_decay)
        self.epoch = 0  # finished epochs
        self.history: list[dict[str, Any]] = []
        self.best_score = math.inf
        self.is_best = False  # the epoch just finished is the best so far
        self.prepared = False  # the network has seen the truth of training frames, see `loop.prepare`

    def _names(self) -> list[str]:
        """Return the names of the parameters in Adam's order."""
        names = {id(p): name for name, p in self.model.named_parameters()}
        ordered = []
        for group in self.optimiser.param_groups:
            ordered += [names[id(p)] for p in group["params"]]
        return ordered

    def save(self, path: Path) -> None:
        """Write the state as one safetensors file.

        It is written beside its place and then renamed. Nothing is pickled.
        """
        tensors = {f"model/{key}": value for key, value in self.model.state_dict().items()}
        names = self._names()
        for i, moments in self.optimiser.state_dict()["state"].items():
            for key, value in moments.items():
                tensors[f"adam/{names[i]}/{key}"] = value
        tensors = {key: value.detach().cpu().contiguous() for key, value in tensors.items()}
        header = {
            "epoch": self.epoch,
            "moments": sorted(names[i] for i in self.optimiser.state_dict()["state"]),
            "best_score": self.best_score,
            "history": self.history,
            "settings": self.settings,
        }
        write_beside(path, save(tensors, {"state": json.dumps(header)}))

    def load(self, path: Path) -> None:
        """Go on from a file of `save`.

        Raises:
            BrokenState: the file is broken, or belongs to another network; or it holds more epochs than are
                to be trained, weights that are none, or lacks Adam's moments.
            InputError: it belongs to other settings or other data.
        """
        header, tensors = read_state_file(path)
        check_settings(header["settings"], self.settings, path)
        check_header(header, self.config.epochs, path)
        parameters = dict(self.model.named_parameters())
        places = {name: i for i, name in enumerate(self._names())}
        weights, moments = {}, {}
        try:
            for key, value in tensors.items():
                part, _, name = key.partition("/")
                if part == "model":
                    weights[checkpoint.name_of_today(name, self.model.method)] = value
                elif part == "adam":
                    parameter, _, moment = name.partition("/")
                    parameter = checkpoint.name_of_today(parameter, self.model.method)
                    # Use the memory layout of the weight: sums in another order differ in the last bit.
                    like = value if moment == "step" else parameters[parameter]
                    checkpoint.check_tensor(f"{path}: {key!r}", value, like)
                    copied = torch.empty_like(like).copy_(value).detach()
                    moments.setdefault(places[parameter], {})[moment] = copied
            names = self._names()
            check_moments({names[i]: values for i, values in moments.items()}, header, path)
            checkpoint.load_state(self.model, weights, path)
        except KeyError:
            raise BrokenState(f"{path} belongs to another network") from None
        except InputError as error:
            raise BrokenState(str(error)) from None
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": moments, "param_groups": groups})
        self.epoch, self.best_score = header["epoch"], header["best_score"]
        self.history = header["history"]


def read_state_file(path: Path) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    """Return the header and the tensors of a file of `TrainState.save`.

    Raises:
        BrokenState: the file cannot be read.
    """
    try:
        with safe_open(path, "pt") as file:
            text = file.metadata()["state"]
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 (not a dict)
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise BrokenState(f"{path} is not a readable training state ({error})") from None
    try:
        header = parse_json(text, path)
        check(Header, header, path)
    except InputError as error:
        raise BrokenState(str(error)) from None
    return header, tensors


def check_header(header: dict[str, Any], epochs: int, path: Path) -> None:
    """Check what a training state says of itself.

    Args:
        header: that of `read_state_file`.
        epochs: how many are to be trained.
        path: the file, for messages.

    Raises:
        BrokenState: the finished epochs are beyond the end, or not those of the history.
    """
    epoch, history = header["epoch"], header["history"]
    if epoch > epochs:
        raise BrokenState(f"{path}: {epoch} epochs are done, and {epochs} are to be trained")
    if [row["epoch"] for row in history] != list(range(1, epoch + 1)):
        raise BrokenState(f"{path}: {epoch} epochs are done, and its history is of others")
    for row in history:
        if row.keys() != history[0].keys():
            raise BrokenState(f"{path}: its history has other columns in epoch {row['epoch']}")
    if math.isnan(header["best_score"]):
        raise BrokenState(f"{path}: best_score is NaN")


def check_moments(moments: dict[str, dict[str, torch.Tensor]], header: dict[str, Any], path: Path) -> None:
    """Check that Adam's moments are all there; without them it would begin anew with a warm network.

    Args:
        moments: {parameter: {"step", "exp_avg", "exp_avg_sq"}}.
        header: that of `read_state_file`. States of an earlier version do not say which parameters have
            moments.
        path: the file, for messages.

    Raises:
        BrokenState: some are missing, or are not what Adam computes.
    """
    wanted = header.get("moments", list(moments))
    missing = sorted(set(wanted) - set(moments))
    if missing or (header["epoch"] > 0 and not moments):
        of = f" of {missing[0]!r}" if missing else ""
        raise BrokenState(f"{path}: Adam's moments{of} are missing")
    for name, values in moments.items():
        if set(values) != {"step", "exp_avg", "exp_avg_sq"}:
            raise BrokenState(f"{path}: of {name!r} Adam has {', '.join(sorted(values))}")
        if (values["exp_avg_sq"] < 0).any() or values["step"].dim() or values["step"] < 1:
            raise BrokenState(f"{path}: Adam's moments of {name!r} are none")


def run_settings(method: str, model: Settings, config: TrainConfig, data: dict[str, Any]) -> dict[str, dict]:
    """Return what config.json of a run holds, and what must be the same when it is resumed."""
    return {"model": {"method": method, **model.to_dict()}, "train": config.to_dict(), "data": data}


def check_settings(old: dict, new: dict, where: Path) -> None:
    """Check that a run that was begun with the settings `old` can go on with `new`.

    FREE_KEYS may differ. A setting that did not exist when the run began stands for its default, which does
    what was done before there was a choice. A setting that its method never used does not count.

    Raises:
        InputError: it cannot. The message names the setting and `where` the old one stands.
    """
    usual = {"model": ModelConfig().to_dict(), "train": TrainConfig().to_dict(), "data": {}}
    for part, now in new.items():
        begun = old.get(part) if isinstance(old, dict) else None
        if not isinstance(begun, dict):
            raise InputError(f"{where} is broken (no {part!r}); start again in another folder")
        for key in {**begun, **now}:
            ignored = part == "model" and key not in now and key in checkpoint.FIRST_FORMAT
            if key in FREE_KEYS or ignored:
                continue
            was = begun.get(key, usual[part].get(key))
            if was != now.get(key):
                raise InputError(
                    f"cannot resume {where}: {part}.{key} was {was!r} and is now {now.get(key)!r}; "
                    "use the old one or another folder"
                )
