"""Run the training loop (Sec. V-A), plain PyTorch, the same for every `PoseNetwork`.

The *score* of an epoch is the median rotation error / 90° + the median translation error / the median
distance, on the validation frames. For a method that only finds keypoints it is their mean error in crop
units. The paper says only "best validation checkpoint". The total loss would not do: its keypoint term
depends on the unit of y2D, and its class term rises long after the poses stopped getting worse.

Every random number of an epoch follows from (seed, epoch). So a resumed run gives the same bits as one that
never stopped.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader, Dataset, Subset
from tqdm import tqdm

from dronekeypp import data
from dronekeypp.augment import mirrored
from dronekeypp.classes import are_named
from dronekeypp.errors import InputError
from dronekeypp.evaluate import apply_model, evaluate, loading, measure, to_device
from dronekeypp.frame_dataset import FrameDataset
from dronekeypp.model import PoseNetwork, loss_weights, total_loss
from dronekeypp.model.backbone import Backbone
from dronekeypp.model.inputs import INPUTS, check_input_shapes, check_label, check_placed, check_values
from dronekeypp.presets import PRESETS, TrainConfig
from dronekeypp.train.precision import set_precision
from dronekeypp.train.state import TrainState

PREPARED_ON = 2048  # frames, evenly spaced, whose truth a network may look at before the first step


def epoch_order(n: int, config: TrainConfig, epoch: int, rank: int = 0, world: int = 1) -> list[int]:
    """Return the indices of one epoch for one process.

    They are every `world`-th of a permutation that follows from (seed, epoch). The first few are repeated at
    the end where `world` does not divide their number, so that no process waits for another.

    Args:
        n: the number of training frames.
        config: its seed, and how many frames an epoch sees.
        epoch: counted from 0.
        rank: the number of the process, from 0.
        world: the number of processes.
    """
    seed = np.random.SeedSequence([config.seed, epoch]).generate_state(1, np.uint64)[0]
    order = torch.randperm(n, generator=torch.Generator().manual_seed(int(seed >> 1))).tolist()
    order = order[: config.frames or n]
    order += order[: -len(order) % world]
    return order[rank::world]


def mirror_generator(config: TrainConfig, epoch: int, rank: int = 0) -> torch.Generator:
    """Return the generator that decides which frames of an epoch are mirrored."""
    seed = np.random.SeedSequence([config.seed, epoch, rank, 1]).generate_state(1)[0]
    return torch.Generator().manual_seed(int(seed))


def learning_rate(config: TrainConfig, step: int, steps: int) -> float:
    """Return the learning rate of a step.

    It is a cosine from lr to 0 over all steps, after a linear warm-up (the paper has none).
    """
    warm = min(1.0, (step + 1) / (config.warmup + 1))
    return config.lr * warm * 0.5 * (1 + math.cos(math.pi * step / steps))


def check_finite(terms: dict[str, Tensor], values: Tensor, items: dict, epoch: int, number: int) -> None:
    """Check that every term of the loss is finite.

    Args:
        terms: the terms by name.
        values: the same terms, stacked, so that one look tells of all of them.
        items: the batch that they came from.
        epoch: counted from 1, for the message.
        number: of the batch, counted from 1, for the message.

    Raises:
        InputError: a term is not finite. The message names epoch, batch, term, and the frame if an annotation
            is to blame.
    """
    finite = torch.isfinite(values)
    if finite.all():
        return
    term = list(terms)[int((~finite).int().argmax())]
    for name, value in items.items():
        if value.is_floating_point() and not torch.isfinite(value).all():
            i = int((~torch.isfinite(value.flatten(1))).any(dim=1).int().argmax())
            where = f"scene {int(items['scene'][i])} frame {int(items['frame'][i])}"
            raise InputError(
                f"epoch {epoch} batch {number}: {term} is not finite, because {name} of {where} is not; "
                "mend the data"
            )
    raise InputError(f"epoch {epoch} batch {number}: {term} is not finite; lower lr, or set clip=1")


def choose_device(config: TrainConfig) -> torch.device:
    """Return the device that `config.device` stands for.

    Raises:
        InputError: it is CUDA and there is none.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise InputError("device=cuda: no CUDA device was found; set device=cpu")
    if config.device == "cpu" or not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)))


def spaced(dataset: Dataset, frames: int) -> Dataset:
    """Return at most `frames` frames of a data set, evenly spaced; 0 means all."""
    n = len(dataset)
    if not 0 < frames < n:
        return dataset
    return Subset(dataset, np.linspace(0, n - 1, frames).round().astype(int).tolist())


def check_sets(model: PoseNetwork, train_set: Dataset, val_set: Dataset, config: TrainConfig) -> None:
    """Check that both sets can be used.

    Raises:
        InputError: a set is empty, or lacks what the network, its evaluation or the mirror needs, or the
            training ends before its warm-up does.
    """
    for name, dataset in (("training", train_set), ("validation", val_set)):
        if len(dataset) == 0:
            raise InputError(f"the {name} set has no frames; were its scenes generated?")
    needed = (*model.learns_from, *model.truth_inputs)
    data.require(train_set, needed, f"training {model.method}")
    data.require(val_set, (*needed, *data.EVALUATED), f"the validation of {model.method}")
    if config.mirror:
        data.require(train_set, data.MIRRORED, "mirror")
    steps = config.epochs * math.ceil(min(config.frames or len(train_set), len(train_set)) / config.batch)
    # A preset's own warm-up was not chosen for this training: a trial on a few frames is over before it.
    if config.warmup > steps and config.warmup not in {usual.training.warmup for usual in PRESETS.values()}:
        raise InputError(
            f"warmup={config.warmup} steps, and the whole training has {steps}: lr would never be reached; "
            "set a tenth of them, or train longer"
        )


def prepare(state: TrainState, train_set: Dataset) -> None:
    """Let the network look at the truth of some training frames before the first step, once.

    Raises:
        InputError: the network cannot learn from it, a label is none of its classes, or frames are to be
            mirrored whose drone is not its own mirror image.
    """
    if state.prepared or state.epoch > 0:
        return
    annotations = data.read_annotations(spaced(train_set, PREPARED_ON))
    if "label" in annotations and hasattr(state.model.config, "classes"):
        check_label(annotations["label"], state.model.config.classes)
    if state.config.mirror:
        data.check_mirror(annotations, data.drones_of(train_set))
    state.model.prepare(annotations)
    state.prepared = True


def check_first_batch(model: PoseNetwork, items: dict[str, Tensor]) -> None:
    """Check that the first batch is what the network takes, see `model.inputs`; the others are like it.

    Raises:
        InputError: it is not. The message names the key of the items.
    """
    given = {name: items.get(name) for name in INPUTS}
    check_input_shapes(given, getattr(model.config, "image_size", "S"))
    check_placed(given, model)
    check_values(given, getattr(model.config, "classes", None))


def fit(
    model: PoseNetwork,
    train_set: Dataset,
    val_set: Dataset,
    config: TrainConfig,
    on_epoch: Callable[[TrainState], None] | None = None,
    progress: bool = False,
    state: TrainState | None = None,
) -> list[dict[str, Any]]:
    """Train a network in memory and return the history, one dict per epoch.

    Its keys are the columns of metrics.csv. The model keeps the weights of the last epoch.

    Args:
        model: the network.
        train_set: the frames to learn from.
        val_set: the frames that judge every epoch.
        config: how to train.
        on_epoch: called as `on_epoch(state)` after every epoch. `state.history[-1]` is its row, and
            `state.is_best` says whether it is the best so far. An exception in it stops the training.
        progress: show a bar and one line per epoch.
        state: goes on from an earlier training; None starts anew.

    Raises:
        InputError: a set is empty or lacks a truth, the batch cannot be shared by the processes, or a loss is
            not finite (the message names the epoch, the batch and, if it can, the frame), or a process that
            loads data died.
    """
    check_sets(model, train_set, val_set, config)
    drones = data.drones_of(train_set)
    if drones is not None and not are_named(model.drones):
        model.know(drones)
    rank, world = (dist.get_rank(), dist.get_world_size()) if dist.is_initialized() else (0, 1)
    device, started = choose_device(config), time.monotonic()
    model.to(device)
    set_precision(model, config.precision)
    pretrained = getattr(model.config, "backbone_weights", None) is not None
    if isinstance(model.backbone, Backbone) and pretrained:
        model.backbone.freeze(config.frozen_stages)
    if state is None:
        state = TrainState(model, config)
    prepare(state, train_set)
    if config.batch % world:
        raise InputError(
            f"batch={config.batch} cannot be shared by {world} processes; choose a multiple of {world}"
        )
    val_set = spaced(val_set, config.val_frames)
    epochs = _Epochs(model, train_set, config, state, device, rank, world, progress)
    for epoch in range(state.epoch, config.epochs):
        tic = time.monotonic()
        with loading(config.workers):
            row = epochs.run(epoch)
            if rank == 0:  # the others wait at the broadcast below
                row.update(validate(model, val_set, config))
        row["seconds"] = round(time.monotonic() - tic, 2)
        state.epoch = epoch + 1
        state.history.append(row)
        if rank == 0:
            state.is_best = row["score"] < state.best_score
            state.best_score = min(state.best_score, row["score"])
        if on_epoch:
            on_epoch(state)
        if rank == 0 and progress:  # after the epoch is kept: nobody may be reading
            print(describe(row, config, state.is_best), flush=True)
        over = bool(config.max_minutes) and time.monotonic() - started > 60 * config.max_minutes
        out_of_time = torch.tensor(over, device=device)
        if world > 1:
            dist.broadcast(out_of_time, 0)
        if out_of_time:
            break
    return state.history


class _Epochs:
    """This class holds what stays the same from epoch to epoch, and passes over the training frames."""

    def __init__(
        self,
        model: PoseNetwork,
        train_set: Dataset,
        config: TrainConfig,
        state: TrainState,
        device: torch.device,
        rank: int,
        world: int,
        progress: bool,
    ) -> None:
        self.model, self.train_set, self.config, self.state = model, train_set, config, state
        self.device, self.rank, self.world = device, rank, world
        self.hide_bar = None if progress and rank == 0 else True  # None: tqdm looks whether it is a terminal
        self.network: nn.Module = model
        if world > 1:
            self.network = DistributedDataParallel(model, find_unused_parameters=model.idle_parameters)
        self.batch = config.batch // world
        frames = len(epoch_order(len(train_set), config, 0, rank, world))
        self.steps_per_epoch = math.ceil(frames / self.batch)
        self.steps = self.steps_per_epoch * config.epochs
        # The frames of a data set on disk were checked when it was opened.
        self.checked = isinstance(data.underlying(train_set), FrameDataset)

    def run(self, epoch: int) -> dict[str, Any]:
        """Train for one epoch and return the first columns of its row.

        They are epoch, lr and the mean losses.
        """
        config = self.config
        dropout_seed = np.random.SeedSequence([config.seed, epoch, self.rank]).generate_state(1)[0]
        torch.manual_seed(int(dropout_seed))
        whole = data.underlying(self.train_set)
        if hasattr(whole, "set_epoch"):
            whole.set_epoch(epoch)  # augmentation
        order = epoch_order(len(self.train_set), config, epoch, self.rank, self.world)
        loader = DataLoader(
            self.train_set,
            self.batch,
            sampler=order,
            num_workers=config.workers,
            generator=torch.Generator(),
            pin_memory=self.device.type == "cuda",
        )
        flips = mirror_generator(config, epoch, self.rank)
        sums: Tensor | None = None
        names: list[str] = []
        self.model.train()
        bar = tqdm(loader, f"epoch {epoch + 1}/{config.epochs}", disable=self.hide_bar, leave=False)
        for number, items in enumerate(bar):
            step = epoch * self.steps_per_epoch + number
            lr = learning_rate(config, step, self.steps)
            items = to_device(items, self.device)
            if config.mirror:
                chosen = torch.rand(len(items["t"]), generator=flips) < 0.5
                items = mirrored(items, chosen.to(self.device))
            if not self.checked:
                check_first_batch(self.model, items)
                self.checked = True
            terms = self.model.losses(
                apply_model(self.network, items, self.model.truth_inputs), items, config.keypoint_unit
            )
            values = torch.stack([value.detach() for value in terms.values()]).double()
            check_finite(terms, values, items, epoch + 1, number + 1)
            if "L_rot" in terms:
                terms = {**terms, "L_rot": config.rotation_weight * terms["L_rot"]}
            self._step(total_loss(terms, loss_weights(config.schedule, step / max(1, self.steps - 1))), lr)
            weighted = values * len(items["square"])
            sums = weighted if sums is None else sums + weighted
            names = list(terms)
        if self.world > 1:  # the mean over all processes, not over rank 0's share
            dist.all_reduce(sums)
            sums = sums / self.world
        row: dict[str, Any] = {"epoch": epoch + 1, "lr": lr}
        for name, total in zip(names, sums.tolist(), strict=True):
            row[f"train_{name}"] = total / len(order)
        row["train_total"] = sum(row[f"train_{name}"] for name in names)
        return row

    def _step(self, loss: Tensor, lr: float) -> None:
        """Take one step of Adam at a learning rate."""
        for group in self.state.optimiser.param_groups:
            group["lr"] = lr * group["share"]
        self.state.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        if self.config.clip:
            torch.nn.utils.clip_grad_norm_(self.model.parameters(), self.config.clip)
        self.state.optimiser.step()


def validate(model: PoseNetwork, val_set: Dataset, config: TrainConfig) -> dict[str, float]:
    """Return losses and errors on the validation frames, as columns of metrics.csv, and the score.

    A lower score is better.

    Raises:
        InputError: the method does not predict what its score is made of.
    """

    def criterion(output: dict, batch: dict) -> dict[str, Tensor]:
        return model.losses(output, batch, config.keypoint_unit)

    frames = evaluate(model, val_set, config.batch, config.workers, criterion)
    row = {f"val_{name}": value for name, value in frames["losses"].items()}
    row["val_total"] = sum(row.values())
    row.update({f"val_{name}": value for name, value in measure(frames).items()})
    if model.judged_by == "keypoints":
        parts = [float(frames["keypoint_units"].mean())]
    else:
        median_distance = float(np.median(frames["distance_m"]))
        parts = [row["val_R_medae_deg"] / 90, row["val_t_medae_m"] / median_distance]
    measured = [part for part in parts if not math.isnan(part)]
    if not measured:
        raise InputError(
            f"{model.method} is judged by its {model.judged_by} and predicts none: "
            "no epoch can be the best (PoseNetwork.judged_by)"
        )
    row["score"] = sum(measured)
    return row


def describe(row: dict[str, Any], config: TrainConfig, is_best: bool) -> str:
    """Return one line for an epoch; what the method does not predict is left out."""
    parts = {
        "R": (row["val_R_medae_deg"], "{:.2f}°"),
        "t": (row["val_t_medae_m"], "{:.3f} m"),
        "class": (100 * row["val_class_accuracy"], "{:.1f} %"),
        "keypoints": (row["val_keypoint_crop_px"], "{:.2f} px of the crop"),
    }
    errors = []
    for name, (value, form) in parts.items():
        if not math.isnan(value):
            errors.append(f"{name} {form.format(value)}")
    losses = f"loss {row['train_total']:.4f}  val {row['val_total']:.4f}"
    end = f"{row['seconds']:.0f} s" + ("  best" if is_best else "")
    return f"epoch {row['epoch']:3d}/{config.epochs}  {losses}  {'  '.join(errors)}  {end}"
