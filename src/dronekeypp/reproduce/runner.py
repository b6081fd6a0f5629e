"""Make the trainings behind every table: rendered data, a folder a training, and errors on every test frame.

Each `Run` has a folder of its own under ROOT/runs/, trained by the same loop at the same budget. Its errors
on every test frame lie beside it as test-*.npz. Everything may be killed at any point. The next call goes on
where the last call stopped.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from dronekeypp import presets
from dronekeypp.checkpoint import WEIGHTS
from dronekeypp.classes import DroneClass, names_of
from dronekeypp.data import FrameDataset, open_dataset
from dronekeypp.errors import InputError
from dronekeypp.evaluate import evaluate
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.files import digest, read_json
from dronekeypp.model import PoseNetwork
from dronekeypp.presets import TrainConfig
from dronekeypp.reproduce.field import field_errors, has_field_errors
from dronekeypp.reproduce.results import (
    describe,
    keep_hardware,
    read_hardware,
    read_npz,
    source_digest,
    write_npz,
)
from dronekeypp.reproduce.run import Run
from dronekeypp.settings import Settings
from dronekeypp.sixdronesyn import bop, folders
from dronekeypp.sixdronesyn.drones import EDITION
from dronekeypp.sixdronesyn.scenes import count_frames
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


@dataclass
class Bench:
    """A `Bench` says where things lie, and at what budget they are made.

    Args:
        root: the folder below which runs/ and, unless `data` is given, data/ are made. Results go to
            data_samples/results and tables to figures/ below it.
        preset: the preset that every run starts from.
        budget: changes to the preset, the same for all runs. A run leaves out those that its method does not
            use. The method's own `defaults` and `Run.changes` come on top.
        group: a folder below runs/. Runs of the same name in the same group are the same run.
        data: the data set; missing flights are rendered.
        stride: of the rendering, which keeps every stride-th frame.
        environments: the folder of the backgrounds to render; None takes the drawn ones.
        photographs: a folder of 360° panoramas, for what is measured on them.
        real: a folder of real drone frames, for what is measured on them.
        workers: the number of processes that render.
        trainings: how many trainings run side by side.
        progress: whether to print what is being done.
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
    trainings: int = 1
    progress: bool = True

    # --- the data -----------------------------------------------------------------------------------------

    def render(self) -> None:
        """Complete the data set, if it is not complete.

        Raises:
            InputError: It is of another edition, or was rendered with another stride or with other
                environments.
        """
        manifest = folders.read_manifest(self.data)
        settings = manifest.get("settings", {})
        if manifest and folders.edition_of(manifest) != EDITION:
            raise InputError(
                f"{self.data} is of edition {folders.edition_of(manifest)}, and results are recorded on "
                f"edition {EDITION}; set --data to another folder, where it will be rendered"
            )
        if settings.get("stride", self.stride) != self.stride:
            raise InputError(
                f"{self.data} keeps every {settings['stride']}. frame, not every {self.stride}.; "
                "set --stride or --data"
            )
        wanted = self.environments.resolve().name if self.environments else None
        if wanted and settings.get("environments", wanted) != wanted:
            raise InputError(
                f"{self.data} was rendered before {settings['environments']}, not before {wanted}; "
                "set --data to another folder"
            )
        if sum(manifest.get("frames", {}).values()) < count_frames(stride=self.stride):
            # Imported here: a server that is handed the finished data set needs no renderer.
            from dronekeypp.sixdronesyn.generate import generate

            self.say(f"rendering into {self.data}")
            generate(
                self.data,
                stride=self.stride,
                environments=self.environments,
                workers=self.workers,
                progress=self.progress,
                edition=EDITION,
            )

    @property
    def drones(self) -> tuple[DroneClass, ...]:
        """Return the drones of the data set, in class order."""
        return tuple(bop.read_models(self.data).values())

    @property
    def names(self) -> list[str]:
        """Return the names of the drones, in class order."""
        return names_of(self.drones)

    def split(
        self, name: str, run: Run, seed: int, data: Path | None = None, all_drones: bool = False
    ) -> FrameDataset:
        """Return a split as a run sees it.

        "train" has the run's augmentation. "train" and "val" come without the drone that the run leaves out.

        Args:
            name: "train", "val" or "test".
            run: the training.
            seed: its seed.
            data: another data set than the bench's.
            all_drones: whether "val" has the drone that the run leaves out as well, for measuring.
        """
        model, training = self.settings(run, seed)
        training_split = name == "train"
        drones = None
        if run.without and name != "test" and not all_drones:
            drones = [drone for drone in self.names if drone != run.without]
        return open_dataset(
            data or self.data,
            name,
            size=model.image_size,
            augment=training.augment and training_split,
            degrade=training.degrade and training_split,
            seed=training.seed,
            drones=drones,
        )

    def count(self, name: str, run: Run) -> int:
        """Return the number of frames of a split that a run sees, from the data set's plan alone."""
        left_out = self.names.index(run.without) if run.without else None
        count = 0
        manifest = folders.require_manifest(self.data)
        edition = folders.edition_of(manifest)
        for flight, frames in manifest["planned"].items():
            drone = folders.drone_of(flight, edition)
            if folders.split_of(flight, edition) == name and drone != left_out:
                count += frames
        return count

    # --- training -----------------------------------------------------------------------------------------

    def settings(self, run: Run, seed: int) -> tuple[Settings, TrainConfig]:
        """Return the settings of a run's network and of its training.

        The classes are the data set's drones, once it is there.
        """
        changes = {**self.used_budget(run), **run.changes, "seed": seed}
        model, training = presets.preset(self.preset, changes, run.network)
        if "classes" in type(model).keys() and "classes" not in changes and self.drones:
            model = model.replace(classes=len(self.drones))
        return model, training

    def used_budget(self, run: Run) -> dict[str, Any]:
        """Return the part of the budget that a run uses.

        The methods of one table do not all have the same settings. What the run or its method sets itself is
        left out as well.
        """
        kind = run.network.Config
        own = {**run.network.defaults, **run.changes}
        values = {**presets.PRESETS[self.preset].model, **self.budget, **own}
        known = (*kind.known_keys(values), *TrainConfig.keys())
        unused = run.network.unused_settings(values)
        used = {}
        for key, value in self.budget.items():
            if key in known and key not in unused and key not in own:
                used[key] = value
        return used

    def folder(self, run: Run, seed: int) -> Path:
        """Return the folder of a run."""
        return self.root / "runs" / self.group / run.slug / f"seed{seed}"

    def finished(self, run: Run, seed: int) -> bool:
        """Tell whether a run was trained to its end, with these settings on these data.

        Raises:
            InputError: It was begun with others.
        """
        folder = self.folder(run, seed)
        if not (folder / METRICS).is_file():
            return False
        model, training = self.settings(run, seed)
        data = {
            "train_frames": self.count("train", run),
            "val_frames": self.count("val", run),
            "digest": describe(self.data)["digest"],
            "processes": 1,
            "backbone_digest": weights_digest(model),
        }
        settings = run_settings(run.method, model, training, data)
        check_settings(read_json(folder / CONFIG, mend=f"remove {folder}"), settings, folder)
        return len(read_history(folder)) >= training.epochs

    def train(self, run: Run, seed: int) -> Path:
        """Train what is left of a run, and return the folder of its best checkpoint."""
        folder = self.folder(run, seed)
        model, training = self.settings(run, seed)
        if not self.finished(run, seed):
            self.say(f"{run.method} {run.variant or ''} seed {seed}: {folder}")
            train_on(
                self.split("train", run, seed),
                self.split("val", run, seed),
                folder,
                model,
                training,
                resume=True,
                progress=self.progress,
                network=run.network,
            )
        keep_hardware(folder, training)  # also after a kill between the last epoch and this line
        return folder / BEST

    def network(self, run: Run, seed: int) -> PoseNetwork:
        """Return the best network of a run, on its device.

        The run is trained first if need be.
        """
        network = run.network.from_pretrained(self.train(run, seed))
        return network.to(choose_device(self.settings(run, seed)[1]))

    def training_record(self, run: Run, seed: int) -> dict[str, Any]:
        """Return a finished run's epochs, minutes, best epoch, parameter count, device and files.

        `weights` is the digest of its best weights, `backbone` the file that it started from.
        """
        folder = self.folder(run, seed)
        history = read_history(folder)
        scores = [float(row["score"]) for row in history]
        seconds = [float(row["seconds"]) for row in history]
        settings, _ = self.settings(run, seed)
        model = run.network(settings, load_backbone=False)
        return {
            "method": run.method,
            "variant": run.variant,
            "seed": seed,
            "epochs": len(history),
            "best_epoch": int(np.argmin(scores)) + 1,
            "minutes": round(sum(seconds) / 60, 1),
            "parameters": sum(p.numel() for p in model.parameters()),
            "without": run.without,
            "changes": {**model.defaults, **run.changes},
            "backbone": backbone_record(settings),
            "weights": digest((folder / BEST / WEIGHTS).read_bytes()),
            "hardware": read_hardware(folder),
        }

    # --- measuring ----------------------------------------------------------------------------------------

    def measure(
        self,
        run: Run,
        seed: int,
        split: str = "test",
        name: str | None = None,
        data: Path | None = None,
        field: bool = False,
    ) -> dict[str | None, Frames]:
        """Measure the errors of every frame of a split by variant: {variant: frames of `evaluate`}.

        The run is trained first if need be. The errors are stored in its folder as NAME.npz, and made again
        if the network or the data have changed since.

        Args:
            run: the training.
            seed: its seed.
            split: "test" or "val"; either has all drones.
            name: of the stored file; the default is the split's.
            data: another data set than the bench's.
            field: whether to add the errors of `evaluate.bop_errors`.
        """
        best, folder = self.train(run, seed), self.folder(run, seed)
        made_from = source_digest(best / WEIGHTS, data or self.data)
        name = name or split
        dataset = self.split(split, run, seed, data, all_drones=True)
        frames_of = {}
        for hypothesis in run.hypotheses or (None,):
            path = folder / (f"{name}-{hypothesis}.npz" if hypothesis else f"{name}.npz")
            frames = read_npz(path, made_from)
            if frames is None:
                network = self.network(run, seed)
                if hypothesis:
                    network.pnp.hypothesis = hypothesis
                frames = evaluate(network, dataset, progress=self._bar(f"{run.method} {name}"))
                write_npz(path, frames, made_from)
            if field and not has_field_errors(frames):
                frames |= field_errors(frames, dataset)
                write_npz(path, frames, made_from)
            frames_of[run.row_name(hypothesis)] = frames
        return frames_of

    def _bar(self, title: str) -> Callable[[Iterable], Iterable]:
        disable = None if self.progress else True  # None shows the bar in a terminal only
        return lambda batches: tqdm(batches, title, leave=False, disable=disable)

    def say(self, line: str) -> None:
        """Print a line, if progress is wanted."""
        if self.progress:
            print(line.rstrip(), flush=True)


def backbone_record(settings: Settings) -> dict[str, str | None] | None:
    """Return the file of a network's pretrained backbone and its digest; None where it has no such file.

    ImageNet's weights are named without a digest.
    """
    weights = getattr(settings, "backbone_weights", None)
    if weights is None:
        return None
    return {"file": Path(weights).name, "digest": weights_digest(settings)}


def read_history(folder: Path) -> list[dict[str, str]]:
    """Read the rows of a run's metrics.csv.

    Raises:
        InputError: a line does not hold an epoch with its score and seconds.
    """
    path = folder / METRICS
    with open(path, newline="", errors="replace") as file:
        rows = list(csv.DictReader(file))
    for number, row in enumerate(rows, 1):
        try:
            whole = int(row["epoch"]) == number and None not in row and None not in row.values()
            float(row["score"]), float(row["seconds"])
        except (KeyError, TypeError, ValueError):
            whole = False
        if not whole:
            raise InputError(f"{path} line {number + 1}: not epoch {number}; remove {folder} and train again")
    return rows
