"""Train into a run folder that survives being killed: `python -m dronekeypp train`.

A run folder holds:

    config.json        every setting, and what the data was
    best/              the checkpoint with the lowest validation score: `checkpoint.load(run)` takes it
    last.safetensors   everything needed to go on: weights, Adam's moments, the history as JSON in the header
    metrics.csv        one row per epoch

`torchrun --nproc-per-node 2 -m dronekeypp train …` runs the same code in several processes. `batch` is then
the sum of theirs.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
import torch.distributed as dist
from torch.utils.data import Dataset

from dronekeypp import checkpoint, data, presets
from dronekeypp.checkpoint import BEST, CONFIG, WEIGHTS
from dronekeypp.errors import InputError
from dronekeypp.files import (
    LOCK,
    digest,
    holds_nothing,
    is_unfinished,
    lock_folder,
    make_folder,
    read_json,
    remove_unfinished,
    write_beside,
)
from dronekeypp.model import DroneKeyPP, PoseNetwork
from dronekeypp.model.backbone import find_weights
from dronekeypp.presets import TrainConfig
from dronekeypp.settings import Settings
from dronekeypp.train.loop import check_sets, choose_device, fit, prepare
from dronekeypp.train.memory import check_memory
from dronekeypp.train.state import BrokenState, TrainState, check_settings, run_settings

LAST, METRICS = "last.safetensors", "metrics.csv"
FILES = (CONFIG, LAST, METRICS)  # of a run; those of best/ are a checkpoint's


def train(
    dataset_root: str | Path,
    out: str | Path,
    preset: str = "cpu",
    overrides: Mapping[str, Any] | None = None,
    resume: bool = False,
    progress: bool = True,
    method: str = DroneKeyPP.method,
) -> Path:
    """Train a method on a data set on disk.

    The number of classes is that of the data set's drones.

    Args:
        dataset_root: the data set; its splits "train" and "val" are used.
        out: the run folder.
        preset: a key of `presets.PRESETS`.
        overrides: settings that replace the preset's.
        resume: go on with the run that `out` holds.
        progress: show a bar and one line per epoch.
        method: a key of `checkpoint.METHODS`.

    Returns:
        the folder of the best checkpoint.

    Raises:
        InputError: a setting, the data set or the run folder does not fit; see `train_on` and
            `presets.preset`.
    """
    network = checkpoint.network_class(method)
    model_config, config = presets.preset(preset, overrides, network)
    size = model_config.image_size
    train_set = data.open_dataset(
        dataset_root, "train", size=size, augment=config.augment, degrade=config.degrade, seed=config.seed
    )
    val_set = data.open_dataset(dataset_root, "val", size=size)
    for dataset in (train_set, val_set):
        if progress and dataset.left_out:
            print(
                f"{dataset_root} {dataset.split}: {dataset.left_out} drones left out, "
                "the middle of whose box is not in the picture"
            )
    drones = len(train_set.drones)
    if hasattr(model_config, "classes"):
        if "classes" in (overrides or {}) and model_config.classes != drones:
            raise InputError(
                f"classes={model_config.classes}: {dataset_root} has {drones} drones; leave the setting out"
            )
        model_config = model_config.replace(classes=drones)
        if progress and not set(train_set.labels) & set(val_set.labels):
            print(
                f"{dataset_root}: no drone of val is in train, so a class learned there says nothing in val; "
                "such a data set is meant for `pretrain`"
            )
    return train_on(train_set, val_set, out, model_config, config, resume, progress, network=network)


def train_on(
    train_set: Dataset,
    val_set: Dataset,
    out: str | Path,
    model_config: Settings,
    config: TrainConfig,
    resume: bool = False,
    progress: bool = False,
    on_epoch: Callable[[TrainState], None] | None = None,
    network: type[PoseNetwork] = DroneKeyPP,
) -> Path:
    """Do what `train` does, for any network and any two data sets that keep the frame contract.

    The contract is that of `dronekeypp.data`.

    Raises:
        InputError: `out` holds something and `resume` is off; or with `resume`, the settings or the data are
            not those that `out` was made with; or another process trains there; or the network has more or
            fewer classes than the data set has drones; or a loss is not finite.
    """
    out = Path(out)
    with process_group(config), contextlib.ExitStack() as held:
        described = describe_data(train_set, val_set)
        described["backbone_digest"] = weights_digest(model_config)
        settings = run_settings(network.method, model_config, config, described)
        main = not dist.is_initialized() or dist.get_rank() == 0
        if main:
            check_folder(out, settings, resume)
        resuming = resume and (out / LAST).is_file()
        device = choose_device(config)
        check_memory(network, model_config, config, len(train_set), device)
        torch.manual_seed(config.seed)  # the network's first weights
        model = network(model_config, load_backbone=not resuming).to(device)
        drones = data.drones_of(train_set)
        if drones is not None:
            model.know(drones)
        state = TrainState(model, config, described)
        check_sets(model, train_set, val_set, config)
        if not resuming:
            prepare(state, train_set)  # what cannot be learned from leaves no folder behind
        if main:
            out.mkdir(parents=True, exist_ok=True)
            held.enter_context(lock_folder(out))
        if dist.is_initialized():
            dist.barrier()
        if resuming:
            _load(state, out)
        if main:
            remove_unfinished(out, FILES)
            remove_unfinished(out / BEST, (CONFIG, WEIGHTS))
            if resuming and state.history:  # a kill may have come between the state and its row
                write_beside(out / METRICS, to_csv(state.history).encode())

        def keep(state: TrainState) -> None:
            if main:
                if not resuming and len(state.history) == 1:
                    # Not before: what is refused in the first epoch must not bind the corrected settings.
                    write_beside(out / CONFIG, (json.dumps(settings, indent=2) + "\n").encode())
                if state.is_best:
                    make_folder(out / BEST)
                    checkpoint.save(model, out / BEST)
                state.save(out / LAST)
                write_beside(out / METRICS, to_csv(state.history).encode())
            if on_epoch:
                on_epoch(state)

        fit(model, train_set, val_set, config, keep, progress, state)
    return out / BEST


def _load(state: TrainState, out: Path) -> None:
    """Go on from the last state in a run folder.

    Raises:
        InputError: it cannot be read or belongs to something else. The message says what is left of the run.
    """
    try:
        state.load(out / LAST)
    except BrokenState as error:
        whole = ""
        with contextlib.suppress(InputError):
            checkpoint.load(out / BEST)
            whole = f"; {out / BEST} is whole"
        raise InputError(f"{error}: remove the folder {out} or choose another{whole}") from None


def describe_data(train_set: Dataset, val_set: Dataset) -> dict[str, Any]:
    """Return what a run must find again when it is resumed.

    It is the numbers of frames, the digest of the training data (None where they have none), and the number
    of processes.
    """
    processes = dist.get_world_size() if dist.is_initialized() else 1
    return {
        "train_frames": len(train_set),
        "val_frames": len(val_set),
        "digest": getattr(train_set, "digest", None),
        "processes": processes,
    }


def weights_digest(config: Settings) -> str | None:
    """Return what tells pretrained weights from others of the same name.

    It is None for ImageNet's weights and where there are none.
    """
    weights = getattr(config, "backbone_weights", None)
    if weights in (None, "imagenet"):
        return None
    return digest(find_weights(weights).read_bytes())


def check_folder(out: Path, settings: dict, resume: bool) -> None:
    """Check that a run can be begun in a folder or, with `resume`, go on there.

    A folder in which no epoch was finished is as good as an empty one.

    Raises:
        InputError: it holds something else, or a run with other settings or of other data.
    """
    if not out.exists() or (out.is_dir() and not _is_begun(out) and _is_empty(out)):
        return
    if resume and (out / CONFIG).is_file() and _is_begun(out):
        old = read_json(out / CONFIG, mend="start again in another folder")
        check_settings(old, settings, out / CONFIG)
        return
    is_run = out.is_dir() and (out / CONFIG).is_file()
    mend = (
        "add --resume to go on, or choose another folder"
        if is_run and not resume
        else "choose another folder"
    )
    raise InputError(f"{out} is not empty{'' if is_run else ' and not a run'}: {mend}")


def _is_begun(out: Path) -> bool:
    """Tell whether a folder holds a run of which an epoch was finished."""
    return (out / LAST).is_file() or (out / METRICS).is_file()


def _is_empty(out: Path) -> bool:
    """Tell whether a folder holds nothing but what a kill in the first epoch leaves of a run."""
    if holds_nothing(out, FILES):
        return True
    others = [path for path in out.iterdir() if path.name not in (CONFIG, BEST, LOCK)]
    return _is_config(out / CONFIG) and all(is_unfinished(path, FILES) for path in others)


def _is_config(path: Path) -> bool:
    """Tell whether a file is the config.json of a run."""
    try:
        content = read_json(path)
    except (InputError, OSError):
        return False
    return isinstance(content, dict) and {"model", "train", "data"} <= content.keys()


def to_csv(history: list[dict[str, Any]]) -> str:
    """Return the text of metrics.csv, with numbers of six digits."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(history[0]), lineterminator="\n")
    writer.writeheader()
    for row in history:
        cells = {}
        for name, value in row.items():
            cells[name] = f"{value:.6g}" if isinstance(value, float) else value
        writer.writerow(cells)
    return text.getvalue()


@contextlib.contextmanager
def process_group(config: TrainConfig) -> Iterator[None]:
    """Join the other processes under torchrun (WORLD_SIZE > 1), and leave them at the end.

    They talk by NCCL on GPUs and by gloo on CPUs. Without torchrun nothing is done.

    Raises:
        InputError: WORLD_SIZE is set, and not by torchrun, so that the others would never come.
    """
    if dist.is_initialized() or processes_of_torchrun() < 2:
        yield
        return
    device = choose_device(config)
    if device.type == "cuda":
        torch.cuda.set_device(device)
    dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield
    finally:
        dist.destroy_process_group()


def processes_of_torchrun() -> int:
    """Return how many processes torchrun has started, or 1 without it.

    Raises:
        InputError: its variables do not fit together, or some of them are missing.
    """
    numbers = {}
    for name in ("WORLD_SIZE", "RANK", "LOCAL_RANK"):
        value = os.environ.get(name)
        if value is None:
            continue
        if not value.isdecimal():
            raise InputError(f"{name}={value!r} in the environment: torchrun sets a number; unset it")
        numbers[name] = int(value)
    world = numbers.get("WORLD_SIZE", 1)
    if world < 2:
        return 1
    for name in ("RANK", "LOCAL_RANK", "MASTER_ADDR", "MASTER_PORT"):
        if name not in os.environ:
            raise InputError(
                f"WORLD_SIZE={world} in the environment without {name}: start the processes with "
                f"`torchrun --nproc-per-node {world} -m dronekeypp train …`, or unset WORLD_SIZE"
            )
    if numbers["RANK"] >= world:
        raise InputError(
            f"RANK={numbers['RANK']} of WORLD_SIZE={world} in the environment: they count from 0"
        )
    return world
