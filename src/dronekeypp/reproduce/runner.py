"""The one runner behind every table: render what is missing, train what is missing, measure, write what there is. Kill it at any point.

A table is a list of `Run`s. Each has a folder of its own under ROOT/runs/, trained by the same `fit` at the same budget; its errors on
every test frame lie beside as test-*.npz. Whoever calls again goes on where the last call stopped.
"""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import sys
import zipfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from dronekeypp import __version__
from dronekeypp.baselines import NETWORKS, network_class
from dronekeypp.errors import InputError
from dronekeypp.evaluate import FORMAT, averages, evaluate, json_values, summarise
from dronekeypp.files import command_line, digest, write_beside
from dronekeypp.model import ModelConfig
from dronekeypp.model.base import WEIGHTS
from dronekeypp.presets import TrainConfig
from dronekeypp.presets import preset as find_preset
from dronekeypp.sixdronesyn.bop import read_json
from dronekeypp.sixdronesyn.dataset import SixDroneSyn
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.scenes import count_frames, frame_numbers, subsequences
from dronekeypp.train import (
    BEST,
    CONFIG,
    METRICS,
    check_settings,
    choose_device,
    run_settings,
    train_on,
    weights_digest,
)

PAPER = json.loads(
    (Path(__file__).parent / "paper.json").read_text(encoding="utf-8")
)  # every number the paper prints, by table and row
HARDWARE = "hardware.txt"  # in a run's folder: what it was trained on


@dataclass(frozen=True)
class Run:
    """One training: a method, a variant of it (None: as it is), and the settings in which it differs from the preset.

    `without` names a drone that is left out of training and validation.
    """

    method: str
    variant: str | None = None
    changes: dict[str, Any] = field(default_factory=dict)
    without: str | None = None
    hypotheses: tuple[str, ...] = ()  # PnP only: the readings of its two poses, each a row of its own

    @property
    def slug(self) -> str:
        """Its folder's name."""
        text = f"{self.method} {self.variant or ''}".strip().lower().replace("++", "pp")
        return "".join(c if c.isalnum() else "-" for c in text)


@dataclass
class Bench:
    """Where things lie, and at what budget they are made.

    Args:
        root: runs/ and, unless told otherwise, data/ are made below it; results and figures go to data_samples/results and figures/.
        preset, budget: every run starts from this preset with these changes; the method's own `defaults` and `Run.changes` come on top.
        data: the data set; missing flights are rendered. stride, environments, workers: of that rendering.
        photographs, real: folders of 360° panoramas and of real drone frames, for what is measured on them.
        group: folder below runs/; runs of the same name in the same group are the same run.
    """

    root: Path
    preset: str
    budget: dict[str, Any]
    group: str
    data: Path
    stride: int = 1
    environments: Path | None = None
    photographs: Path | None = None
    real: Path | None = None
    workers: int = 2
    progress: bool = True

    def render(self) -> None:
        """Complete the data set, if it is not.

        Raises:
            InputError: it is there, with another stride or before other environments.
        """
        there = read_json(self.data / "manifest.json") if (self.data / "manifest.json").is_file() else {}
        settings = there.get("settings", {})
        if settings.get("stride", self.stride) != self.stride:
            raise InputError(
                f"{self.data} keeps every {settings['stride']}. frame, not every {self.stride}.; set --stride or --data"
            )
        wanted = self.environments.resolve().name if self.environments else None
        if wanted and settings.get("environments", wanted) != wanted:
            raise InputError(
                f"{self.data} was rendered before {settings['environments']}, not before {wanted}; set --data to another folder"
            )
        if sum(there.get("frames", {}).values()) < count_frames(stride=self.stride):
            from dronekeypp.sixdronesyn.generate import (
                generate,
            )  # here: a server that is handed the finished data set needs no renderer

            say(f"rendering into {self.data}", self.progress)
            generate(
                self.data,
                stride=self.stride,
                environments=self.environments,
                workers=self.workers,
                progress=self.progress,
            )

    def settings(self, run: Run, seed: int) -> tuple[ModelConfig, TrainConfig]:
        """The settings of a run."""
        own = network_class(run.method).defaults if run.method in NETWORKS else {}
        return find_preset(self.preset, {**self.budget, **own, **run.changes, "seed": seed})

    def folder(self, run: Run, seed: int) -> Path:
        return self.root / "runs" / self.group / run.slug / f"seed{seed}"

    def split(self, name: str, run: Run, seed: int, data: Path | None = None) -> SixDroneSyn:
        model, training = self.settings(run, seed)
        shown = {"augment": training.augment, "degrade": training.degrade} if name == "train" else {}
        drones = [drone for drone in DRONES if drone != run.without or name == "test"]
        return SixDroneSyn(
            data or self.data, name, size=model.image_size, seed=training.seed, drones=drones, **shown
        )

    def count(self, name: str, run: Run) -> int:
        """Frames of a split that a run sees, from the table of flights alone."""
        stride = read_json(self.data / "manifest.json")["settings"]["stride"]
        flights = subsequences(drones=[drone for drone in DRONES if drone != run.without])
        return sum(len(frame_numbers(flight, stride)) for flight in flights if flight.split == name)

    def finished(self, run: Run, seed: int) -> bool:
        """Whether a run was trained to its end, with these settings on these data.

        Raises:
            InputError: it was begun with others.
        """
        folder, (model, training) = self.folder(run, seed), self.settings(run, seed)
        if not (folder / METRICS).is_file():
            return False
        data = {
            "train_frames": self.count("train", run), "val_frames": self.count("val", run), "digest": describe(self.data)["digest"],
            "processes": 1, "backbone_digest": weights_digest(model),
        }  # fmt: skip
        check_settings(read_json(folder / CONFIG), run_settings(run.method, model, training, data), folder)
        return len((folder / METRICS).read_text().splitlines()) - 1 >= training.epochs

    def train(self, run: Run, seed: int) -> Path:
        """Train a run as far as it was not; returns its best checkpoint."""
        folder = self.folder(run, seed)
        if not self.finished(run, seed):
            say(f"{run.method} {run.variant or ''} seed {seed}: {folder}", self.progress)
            sets = [self.split(name, run, seed) for name in ("train", "val")]
            network = network_class(run.method)
            train_on(
                *sets, folder, *self.settings(run, seed), resume=True, progress=self.progress, network=network
            )
        if not (folder / HARDWARE).is_file():  # also after a kill between the last epoch and this line
            write_beside(folder / HARDWARE, f"{hardware(self.settings(run, seed)[1])}\n".encode())
        return folder / BEST

    def measure(
        self, run: Run, seed: int, name: str = "test", data: Path | None = None, split: str = "test"
    ) -> dict[str | None, dict[str, np.ndarray]]:
        """Errors of every frame of a split by variant: {variant: frames of `evaluate`}. Trains first.

        They are kept in the run's folder as NAME.npz, and made again if the network or the data have changed since.
        """
        best, folder, found = self.train(run, seed), self.folder(run, seed), {}
        made_from = source_digest(best / WEIGHTS, data or self.data)
        for hypothesis in run.hypotheses or (None,):
            path = folder / f"{name}{'-' + hypothesis if hypothesis else ''}.npz"
            frames = read_npz(path, made_from)
            if frames is None:
                model = (
                    network_class(run.method)
                    .from_pretrained(best)
                    .to(choose_device(self.settings(run, seed)[1]))
                )
                if hypothesis:
                    model.pnp.hypothesis = hypothesis
                frames = evaluate(
                    model, self.split(split, run, seed, data), progress=self._bar(f"{run.method} {name}")
                )
                write_npz(path, frames, made_from)
            found[variant_name(run, hypothesis)] = frames
        return found

    def _bar(self, title: str) -> Callable[[Iterable], Iterable]:
        return lambda batches: tqdm(
            batches, title, leave=False, disable=not (self.progress and sys.stderr.isatty())
        )

    def story(self, run: Run, seed: int) -> dict[str, Any]:
        """How a finished run went: epochs, minutes, the best epoch, parameters, where."""
        folder = self.folder(run, seed)
        with open(folder / METRICS, newline="") as file:
            history = list(csv.DictReader(file))
        scores = [float(row["score"]) for row in history]
        model = network_class(run.method)(self.settings(run, seed)[0], load_backbone=False)
        return {
            "method": run.method, "variant": run.variant, "seed": seed, "epochs": len(history), "best_epoch": int(np.argmin(scores)) + 1,
            "minutes": round(sum(float(row["seconds"]) for row in history) / 60, 1), "parameters": sum(p.numel() for p in model.parameters()),
            "without": run.without, "changes": {**model.defaults, **run.changes}, "hardware": (folder / HARDWARE).read_text().strip(),
        }  # fmt: skip


def complete(
    jobs: Sequence[tuple],
    finished: Callable[..., bool],
    measured: Callable[..., Any],
    record: Callable[[list], dict[str, Any]],
) -> dict[str, Any]:
    """Measure every job and record them in their order, anew after each that was trained: a kill loses nothing. Returns the last record.

    What an earlier call finished comes first, so that nothing is recorded without it.
    """
    known, found = [finished(*job) for job in jobs], {}
    for i in sorted(range(len(jobs)), key=lambda i: not known[i]):
        found[i] = measured(*jobs[i])
        if not known[i]:
            record([found[k] for k in sorted(found)])
    return record([found[k] for k in sorted(found)])


def variant_name(run: Run, hypothesis: str | None) -> str | None:
    """The variant's name in a table; a PnP that takes the upright pose is a variant of its own."""
    parts = [run.variant, "upright" if hypothesis == "upright" else None]
    return ", ".join(part for part in parts if part) or None


def say(line: str, progress: bool) -> None:
    if progress:
        print(line.rstrip(), flush=True)


def source_digest(weights: Path, data: Path) -> str:
    """What a measurement was made from: these weights, on these frames, by this version of `frame_errors`."""
    return (
        f"{digest(weights.read_bytes())} on {read_json(data / 'manifest.json')['digest']}, measures {FORMAT}"
    )


def write_npz(path: Path, arrays: dict[str, Any], made_from: str | None = None) -> None:
    """The arrays of `arrays`, written beside and renamed, with what they were made from."""
    content = io.BytesIO()
    kept = {name: value for name, value in arrays.items() if isinstance(value, np.ndarray)}
    np.savez_compressed(content, **kept, **({"made_from": np.array(made_from)} if made_from else {}))
    write_beside(path, content.getvalue())


def read_npz(path: Path, made_from: str) -> dict[str, np.ndarray] | None:
    """The arrays of `write_npz`, or None if they are not there, broken, or made from something else."""
    try:
        with np.load(path) as stored:
            arrays = dict(stored)
    except (OSError, ValueError, zipfile.BadZipFile):
        return None
    return arrays if str(arrays.pop("made_from", "")) == made_from else None


def rows_and_averages(frames: dict[str, np.ndarray], **labels) -> tuple[list[dict], list[dict]]:
    """`summarise` and `averages` of one method, for JSON."""
    return json_values(summarise(frames, **labels)), json_values(averages(frames, **labels))


def result(
    name: str, bench: Bench, stories: Sequence[dict], dataset: dict[str, Any] | None = None, **parts
) -> dict[str, Any]:
    """A recorded result: what was run, on what (default: the bench's data), for how long, and its rows."""
    command = command_line() if sys.argv[1:2] == ["reproduce"] else None
    return {
        "name": name,
        "command": command,
        "preset": bench.preset,
        "budget": {key: str(value) for key, value in bench.budget.items()},
        "dataset": dataset or describe(bench.data),
        "hardware": ", ".join(dict.fromkeys(story["hardware"] for story in stories)),
        "minutes": round(sum(story["minutes"] for story in stories), 1),
        "versions": {
            "dronekeypp": __version__,
            "torch": torch.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "runs": list(stories),
        **parts,
    }


def describe(data: Path) -> dict[str, Any]:
    """A data set in a recorded result."""
    manifest = read_json(data / "manifest.json")
    settings, frames = manifest["settings"], manifest["frames"]
    return {
        "seed": settings["seed"], "digest": manifest["digest"], "train_frames": frames["train"], "test_frames": frames["test"],
        "stride": settings["stride"], "environments": settings["environments"],
    }  # fmt: skip


def hardware(config: TrainConfig) -> str:
    """The device a training runs on, in words."""
    device = choose_device(config)
    return (
        torch.cuda.get_device_name(device)
        if device.type == "cuda"
        else f"{os.cpu_count()} CPU cores ({platform.machine()})"
    )


def write_result(root: Path, result: dict[str, Any]) -> Path:
    """data_samples/results/NAME.json below `root`."""
    path = root / "data_samples" / "results" / f"{result['name']}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_beside(path, (json.dumps(result, indent=1) + "\n").encode())
    return path


def read_result(name: str, root: Path | None = None) -> dict[str, Any]:
    """A recorded result by name ("table3"), from `root` or the repository this package lies in.

    Raises:
        InputError: nothing of that name has been recorded.
    """
    path = (root or Path(__file__).parents[3]) / "data_samples" / "results" / f"{name}.json"
    if not path.is_file():
        raise InputError(f"{path} not found: make it with `python -m dronekeypp reproduce {name}`")
    return json.loads(path.read_text())
