"""Training (Sec. V-A): a plain PyTorch loop. `fit` trains in memory, `train` adds a run folder that survives being killed.

The loop is one for every `PoseNetwork`: DroneKey++, the baselines it is measured against, the backbone's pretraining.

A run folder holds
    config.json        every setting, and what the data was
    best/              the checkpoint with the lowest validation score: `DroneKeyPP.from_pretrained(run / "best")`
    last.safetensors   everything needed to go on: weights, Adam's moments, the history as JSON in the header
    metrics.csv        one row per epoch

*Score* = median rotation error / 90° + median translation error / median distance, on the validation frames (for a method that only finds
keypoints: their mean error in crop units). The paper says only "best validation checkpoint". The total loss would not do: its
keypoint term depends on the unit of y2D, and its class term rises long after the poses stopped getting worse.

Every random number of an epoch follows from (seed, epoch): a resumed run gives the same bits as one that never stopped.
`torchrun --nproc-per-node 2 -m dronekeypp train …` runs the same code on several processes; `batch` is their sum.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.distributed as dist
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader, Dataset, Subset
from tqdm import tqdm

from dronekeypp import presets
from dronekeypp.camera import mirror_keypoints
from dronekeypp.errors import InputError
from dronekeypp.evaluate import apply_model, evaluate, measure, read_annotations, to_device
from dronekeypp.files import digest, lock_folder, read_json, write_beside
from dronekeypp.model import DroneKeyPP, ModelConfig, PoseNetwork, loss_weights, total_loss
from dronekeypp.model.backbone import find_weights
from dronekeypp.presets import TrainConfig

LAST, METRICS, CONFIG, BEST = "last.safetensors", "metrics.csv", "config.json", "best"
FREE_KEYS = ("workers", "max_minutes", "device")  # these may differ when a run is resumed


class TrainState:
    """What changes while training: the network, Adam, the finished epochs and their history."""

    def __init__(self, model: PoseNetwork, config: TrainConfig, data: dict[str, Any] | None = None):
        self.model, self.config = model, config
        self.settings = run_settings(model.method, model.config, config, data or {})
        backbone = list(model.backbone.parameters()) if model.backbone is not None else []
        known = {id(p) for p in backbone}
        rest = [p for p in model.parameters() if id(p) not in known]
        groups = [
            {"params": rest, "share": 1.0},
            {"params": backbone, "share": config.backbone_lr},
        ]  # share: of the learning rate
        self.optimiser = torch.optim.Adam(
            [g for g in groups if g["params"]], lr=config.lr, weight_decay=config.weight_decay
        )
        self.epoch = 0  # finished epochs
        self.history: list[dict[str, Any]] = []
        self.best_score = math.inf
        self.is_best = False  # the epoch just finished is the best so far

    def _names(self) -> list[str]:
        """Names of the parameters in Adam's order."""
        names = {id(p): name for name, p in self.model.named_parameters()}
        return [names[id(p)] for group in self.optimiser.param_groups for p in group["params"]]

    def save(self, path: Path) -> None:
        """One safetensors file, written beside and renamed. Nothing is pickled."""
        tensors = {f"model/{k}": v for k, v in self.model.state_dict().items()}
        names = self._names()
        for i, moments in self.optimiser.state_dict()["state"].items():
            tensors.update({f"adam/{names[i]}/{k}": v for k, v in moments.items()})
        tensors = {k: v.detach().cpu().contiguous() for k, v in tensors.items()}
        header = {
            "epoch": self.epoch,
            "best_score": self.best_score,
            "history": self.history,
            "settings": self.settings,
        }
        write_beside(path, save(tensors, {"state": json.dumps(header)}))

    def load(self, path: Path) -> None:
        """Go on from a file of `save`.

        Raises:
            InputError: it is broken, or belongs to other settings, other data or another network.
        """
        try:
            with safe_open(path, "pt") as file:
                header = json.loads(file.metadata()["state"])
                tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 (not a dict)
            old, epoch, best_score, history = (
                header[key] for key in ("settings", "epoch", "best_score", "history")
            )
        except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{path} is not a readable training state ({error}); start again without --resume"
            ) from None
        check_settings(old, self.settings, path)
        parameters, places = (
            dict(self.model.named_parameters()),
            {name: i for i, name in enumerate(self._names())},
        )
        moments: dict[int, dict[str, torch.Tensor]] = {}
        try:
            self.model.load_state_dict(
                {key.removeprefix("model/"): v for key, v in tensors.items() if key.startswith("model/")}
            )
            for key, value in tensors.items():
                if key.startswith("adam/"):
                    _, parameter, name = key.split("/")
                    # In the memory layout of the weight: sums in another order would differ in the last bit.
                    like = parameters[parameter] if value.dim() else value
                    moments.setdefault(places[parameter], {})[name] = (
                        torch.empty_like(like).copy_(value).detach()
                    )
        except (RuntimeError, KeyError, ValueError):
            raise InputError(f"{path} belongs to another network; start again without --resume") from None
        self.optimiser.load_state_dict(
            {"state": moments, "param_groups": self.optimiser.state_dict()["param_groups"]}
        )
        self.epoch, self.best_score, self.history = epoch, best_score, history


def run_settings(
    method: str, model: ModelConfig, config: TrainConfig, data: dict[str, Any]
) -> dict[str, dict[str, Any]]:
    """What config.json of a run holds, and what must be the same when it is resumed."""
    return {"model": {"method": method, **model.to_dict()}, "train": config.to_dict(), "data": data}


def check_settings(old: dict, new: dict, where: Path) -> None:
    """Raise InputError, naming the setting, if a run made with the settings `old` cannot go on with `new`; FREE_KEYS may differ.

    A setting that did not exist when the run began stands for its default, which does what was done before there was a choice.
    """
    usual = {"model": ModelConfig().to_dict(), "train": TrainConfig().to_dict()}
    try:
        pairs = [
            (f"{part}.{k}", old[part].get(k, usual.get(part, {}).get(k)), new[part].get(k))
            for part in new
            for k in old[part] | new[part]
        ]
    except (KeyError, AttributeError, TypeError) as error:
        raise InputError(f"{where} is broken ({error!r}); start again in another folder") from None
    for key, was, now in pairs:
        if was != now and key.split(".")[1] not in FREE_KEYS:
            raise InputError(
                f"cannot resume {where}: {key} was {was!r} and is now {now!r}; use the old one or another folder"
            )


def epoch_order(n: int, config: TrainConfig, epoch: int, rank: int = 0, world: int = 1) -> list[int]:
    """Indices of one epoch for one process: a permutation that follows from (seed, epoch), every `world`-th of it.

    The last few are repeated where `world` does not divide, so that no process waits for another.
    """
    seed = np.random.SeedSequence([config.seed, epoch]).generate_state(1, np.uint64)[0]
    order = torch.randperm(n, generator=torch.Generator().manual_seed(int(seed >> 1))).tolist()
    order = order[: config.frames or n]
    order += order[: -len(order) % world]
    return order[rank::world]


def mirror_generator(config: TrainConfig, epoch: int, rank: int = 0) -> torch.Generator:
    """The generator that decides which frames of an epoch are mirrored."""
    return torch.Generator().manual_seed(
        int(np.random.SeedSequence([config.seed, epoch, rank, 1]).generate_state(1)[0])
    )


def mirrored(items: dict, chosen: torch.Tensor) -> dict:
    """The batch with the chosen frames (B,) seen in a mirror held at x = 0 of the camera.

    A drone's left is its right in a mirror, so the picture shows the same drone in another pose: R becomes S R S' with S =
    diag(-1, 1, 1) in camera axes and S' = diag(1, -1, 1) in body axes, left and right hubs change names, and the crop's square is
    mirrored about the principal point. Flights are few and each has few headings; this doubles them.
    """
    swap = [1, 0, 3, 2]  # FL, FR, RR, RL
    S, body = (
        torch.diag(torch.tensor(d, device=chosen.device)) for d in ((-1.0, 1.0, 1.0), (1.0, -1.0, 1.0))
    )
    x, y, side = items["square"].unbind(1)
    other = {
        "image": items["image"].flip(3),
        "square": torch.stack([2 * items["K"][:, 0, 2] - x - side, y, side], dim=1),
        "keypoints": mirror_keypoints(items["keypoints"]),
        "keypoints_3d": items["keypoints_3d"][:, swap] @ S,
        "R": S @ items["R"] @ body,
        "t": items["t"] @ S,
        "visible": items["visible"][:, swap],
    }
    return {
        k: torch.where(chosen.view(-1, *[1] * (v.dim() - 1)), other.get(k, v), v) for k, v in items.items()
    }


def learning_rate(config: TrainConfig, step: int, steps: int) -> float:
    """Cosine annealing from lr to 0 over all steps, after a linear warm-up (the paper has none)."""
    warm = min(1.0, (step + 1) / (config.warmup + 1))
    return config.lr * warm * 0.5 * (1 + math.cos(math.pi * step / steps))


def check_finite(terms: dict[str, torch.Tensor], items: dict, epoch: int, number: int) -> None:
    """Raise InputError for a loss that is not finite, naming epoch, batch, term, and the frame if an annotation is to blame."""
    bad = [name for name, value in terms.items() if not math.isfinite(value.item())]
    if not bad:
        return
    for name, value in items.items():
        if value.is_floating_point() and not torch.isfinite(value).all():
            i = int((~torch.isfinite(value.flatten(1))).any(dim=1).int().argmax())
            where = f"scene {int(items['scene'][i])} frame {int(items['frame'][i])}"
            raise InputError(
                f"epoch {epoch} batch {number}: {bad[0]} is not finite, because {name} of {where} is not; mend the data"
            )
    raise InputError(f"epoch {epoch} batch {number}: {bad[0]} is not finite; lower lr, or set clip=1")


def choose_device(config: TrainConfig) -> torch.device:
    if config.device == "cuda" and not torch.cuda.is_available():
        raise InputError("device=cuda: no CUDA device was found; set device=cpu")
    if config.device == "cpu" or not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)))


def spaced(dataset: Dataset, frames: int) -> Dataset:
    """At most `frames` of a data set, evenly spaced; 0 means all."""
    n = len(dataset)
    return (
        Subset(dataset, np.linspace(0, n - 1, frames).round().astype(int).tolist())
        if 0 < frames < n
        else dataset
    )


def fit(
    model: PoseNetwork,
    train_set: Dataset,
    val_set: Dataset,
    config: TrainConfig,
    on_epoch: Callable[[TrainState], None] | None = None,
    progress: bool = False,
    state: TrainState | None = None,
) -> list[dict[str, Any]]:
    """Train `model` in memory and return the history, one dict per epoch (the columns of metrics.csv).

    The model keeps the last epoch's weights. `on_epoch(state)` is called after every epoch (`state.history[-1]` is its row,
    `state.is_best` says whether it is the best so far); an exception in it stops the training. `state` goes on from an earlier one.

    Raises:
        InputError: an empty set, or a loss that is not finite (it names the epoch, the batch and, if it can, the frame).
    """
    for name, dataset in (("training", train_set), ("validation", val_set)):
        if len(dataset) == 0:
            raise InputError(f"the {name} set has no frames; were its scenes generated?")
    rank, world = (dist.get_rank(), dist.get_world_size()) if dist.is_initialized() else (0, 1)
    device, started = choose_device(config), time.monotonic()
    model.to(device)
    if model.backbone is not None:
        model.backbone.bfloat16 = config.precision == "bfloat16"
    if state is None:
        state = TrainState(model, config)
    if state.epoch == 0:
        model.prepare(read_annotations(spaced(train_set, 2048)))
    network = (
        DistributedDataParallel(model, find_unused_parameters=model.idle_parameters) if world > 1 else model
    )
    if config.batch % world:
        raise InputError(
            f"batch={config.batch} cannot be shared by {world} processes; choose a multiple of {world}"
        )
    batch = config.batch // world
    val_set = spaced(val_set, config.val_frames)
    steps_per_epoch = math.ceil(len(epoch_order(len(train_set), config, 0, rank, world)) / batch)
    steps = steps_per_epoch * config.epochs

    for epoch in range(state.epoch, config.epochs):
        tic = time.monotonic()
        torch.manual_seed(
            int(np.random.SeedSequence([config.seed, epoch, rank]).generate_state(1)[0])
        )  # dropout
        whole = train_set
        while isinstance(whole, Subset):
            whole = whole.dataset
        if hasattr(whole, "set_epoch"):
            whole.set_epoch(epoch)  # augmentation
        order = epoch_order(len(train_set), config, epoch, rank, world)
        loader = DataLoader(
            train_set, batch, sampler=order, num_workers=config.workers, generator=torch.Generator()
        )
        sums, flips = {}, mirror_generator(config, epoch, rank)
        model.train()
        hidden = not (progress and rank == 0 and sys.stderr.isatty())
        for number, items in enumerate(
            tqdm(loader, f"epoch {epoch + 1}/{config.epochs}", disable=hidden, leave=False)
        ):
            step = epoch * steps_per_epoch + number
            lr = learning_rate(config, step, steps)
            for group in state.optimiser.param_groups:
                group["lr"] = lr * group["share"]
            items = to_device(items, device)
            if config.mirror:
                items = mirrored(items, (torch.rand(len(items["t"]), generator=flips) < 0.5).to(device))
            terms = model.losses(apply_model(network, items, model.truth_inputs), items, config.keypoint_unit)
            check_finite(terms, items, epoch + 1, number + 1)
            loss = total_loss(terms, loss_weights(config.schedule, step / max(1, steps - 1)))
            state.optimiser.zero_grad(set_to_none=True)
            loss.backward()
            if config.clip:
                torch.nn.utils.clip_grad_norm_(model.parameters(), config.clip)
            state.optimiser.step()
            for name, value in terms.items():
                sums[name] = sums.get(name, 0.0) + value.item() * len(items["t"])
        if world > 1:  # the mean over all processes, not over rank 0's share
            shared = torch.tensor(list(sums.values()), dtype=torch.float64, device=device)
            dist.all_reduce(shared)
            sums = dict(zip(sums, (shared / world).tolist(), strict=True))
        row = {
            "epoch": epoch + 1,
            "lr": lr,
            **{f"train_{name}": total / len(order) for name, total in sums.items()},
        }
        row["train_total"] = sum(row[f"train_{name}"] for name in sums)
        if rank == 0:  # the others wait at the broadcast below
            row.update(validate(model, val_set, config))
        row["seconds"] = round(time.monotonic() - tic, 2)
        state.epoch = epoch + 1
        state.history.append(row)
        if rank == 0:
            state.is_best = row["score"] < state.best_score
            state.best_score = min(state.best_score, row["score"])
            if progress:
                print(describe(row, config, state.is_best), flush=True)
        if on_epoch:
            on_epoch(state)
        out_of_time = torch.tensor(
            bool(config.max_minutes) and time.monotonic() - started > 60 * config.max_minutes, device=device
        )
        if world > 1:
            dist.broadcast(out_of_time, 0)
        if out_of_time:
            break
    return state.history


def validate(model: PoseNetwork, val_set: Dataset, config: TrainConfig) -> dict[str, float]:
    """Losses and errors on the validation frames, as columns of metrics.csv, and the score (lower is better)."""
    frames = evaluate(
        model,
        val_set,
        config.batch,
        config.workers,
        lambda output, batch: model.losses(output, batch, config.keypoint_unit),
    )
    row = {f"val_{name}": value for name, value in frames["losses"].items()}
    row["val_total"] = sum(row.values())
    row.update({f"val_{name}": value for name, value in measure(frames).items()})
    pose = (row["val_R_medae_deg"] / 90, row["val_t_medae_m"] / float(np.median(frames["distance_m"])))
    parts = (float(frames["keypoint_units"].mean()),) if model.judged_by == "keypoints" else pose
    known = [part for part in parts if not math.isnan(part)]
    if not known:
        raise InputError(
            f"{model.method} is judged by its {model.judged_by} and predicts none: no epoch can be the best (PoseNetwork.judged_by)"
        )
    row["score"] = sum(known)
    return row


def describe(row: dict[str, Any], config: TrainConfig, is_best: bool) -> str:
    """One line for an epoch; what the method does not predict is left out."""
    parts = {
        "R": (row["val_R_medae_deg"], "{:.2f}°"), "t": (row["val_t_medae_m"], "{:.3f} m"),
        "class": (100 * row["val_class_accuracy"], "{:.1f} %"), "keypoints": (row["val_keypoint_crop_px"], "{:.2f} px of the crop"),
    }  # fmt: skip
    found = "  ".join(
        f"{name} {form.format(value)}" for name, (value, form) in parts.items() if not math.isnan(value)
    )
    return (
        f"epoch {row['epoch']:3d}/{config.epochs}  loss {row['train_total']:.4f}  val {row['val_total']:.4f}  {found}  "
        f"{row['seconds']:.0f} s{'  best' if is_best else ''}"
    )


def train(
    dataset_root: str | Path,
    out: str | Path,
    preset: str = "cpu",
    overrides: dict[str, Any] | None = None,
    resume: bool = False,
    progress: bool = True,
    method: str = DroneKeyPP.method,
) -> Path:
    """Train a method on a data set on disk into the run folder `out`; returns the folder of the best checkpoint.

    Raises:
        InputError: a setting, the data set or the run folder does not fit; see `train_on` and `presets.preset`.
    """
    from dronekeypp.baselines import network_class
    from dronekeypp.sixdronesyn.dataset import (
        SixDroneSyn,
    )  # here, so that a network trains on other data without it

    network = network_class(method)
    model_config, config = presets.preset(preset, {**network.defaults, **(overrides or {})})
    size = model_config.image_size
    train_set = SixDroneSyn(
        dataset_root, "train", size=size, augment=config.augment, degrade=config.degrade, seed=config.seed
    )
    val_set = SixDroneSyn(dataset_root, "val", size=size)
    drones = max(frame.obj_id for frame in train_set.frames + val_set.frames)
    if drones > model_config.classes:
        raise InputError(
            f"drone number {drones} is in the data, and there are {model_config.classes} classes: --set classes={drones}"
        )
    return train_on(train_set, val_set, out, model_config, config, resume, progress, network=network)


def train_on(
    train_set,
    val_set,
    out,
    model_config,
    config,
    resume=False,
    progress=False,
    on_epoch=None,
    network: type[PoseNetwork] = DroneKeyPP,
) -> Path:
    """`train` for any two data sets whose items are those of `SixDroneSyn`, and any network made from a ModelConfig.

    Raises:
        InputError: `out` holds something and `resume` is off; `resume` with other settings or other data than `out` was made with; another
        process trains there; a loss that is not finite.
    """
    out = Path(out)
    with process_group(config), contextlib.ExitStack() as held:
        data = describe_data(train_set, val_set) | {"backbone_digest": weights_digest(model_config)}
        main = not dist.is_initialized() or dist.get_rank() == 0
        if main:
            prepare_folder(out, run_settings(network.method, model_config, config, data), resume)
            held.enter_context(lock_folder(out))
        if dist.is_initialized():
            dist.barrier()
        torch.manual_seed(config.seed)  # the network's first weights
        resuming = resume and (out / LAST).is_file()
        model = network(model_config, load_backbone=not resuming).to(choose_device(config))
        state = TrainState(model, config, data)
        if resuming:
            state.load(out / LAST)
            if main and state.history:  # a kill may have come between the state and its row
                write_beside(out / METRICS, to_csv(state.history).encode())

        def keep(state: TrainState) -> None:
            if main:
                if state.is_best:
                    model.save_pretrained(out / BEST)
                state.save(out / LAST)
                write_beside(out / METRICS, to_csv(state.history).encode())
            if on_epoch:
                on_epoch(state)

        fit(model, train_set, val_set, config, keep, progress, state)
    return out / BEST


def describe_data(train_set: Dataset, val_set: Dataset) -> dict[str, Any]:
    """What a run must find again to be resumed: the frames, their manifest's digest (None without one), the number of processes."""
    digest = getattr(train_set, "manifest", {}).get("digest")
    processes = dist.get_world_size() if dist.is_initialized() else 1
    return {
        "train_frames": len(train_set),
        "val_frames": len(val_set),
        "digest": digest,
        "processes": processes,
    }


def weights_digest(config: ModelConfig) -> str | None:
    """What tells one file of pretrained weights from another of the same name; None for ImageNet's and for none."""
    if config.backbone_weights in (None, "imagenet"):
        return None
    return digest(find_weights(config.backbone_weights).read_bytes())


def prepare_folder(out: Path, settings: dict, resume: bool) -> None:
    """Make the run folder, or check that it is the one to go on with."""
    if resume:
        for left in out.rglob(".*.tmp"):  # a kill while writing leaves one behind
            left.unlink()
    if resume and (out / CONFIG).is_file():
        check_settings(read_json(out / CONFIG, mend="start again in another folder"), settings, out / CONFIG)
        return
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        mend = "choose another folder" if resume else "add --resume to go on, or choose another folder"
        raise InputError(f"{out} is not empty{' and not a run' if resume else ''}: {mend}")
    out.mkdir(parents=True, exist_ok=True)
    write_beside(out / CONFIG, (json.dumps(settings, indent=2) + "\n").encode())


def to_csv(history: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(history[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in history
    )
    return text.getvalue()


@contextlib.contextmanager
def process_group(config: TrainConfig) -> Iterator[None]:
    """Under torchrun (WORLD_SIZE > 1) join the other processes: NCCL on GPUs, gloo on CPUs. Alone, do nothing."""
    if int(os.environ.get("WORLD_SIZE", 1)) < 2 or dist.is_initialized():
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
