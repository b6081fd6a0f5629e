"""Measure Table 3: DroneKey++ beside three baselines on test scenes 6 and 7, with seven drones each.

All methods see the same crops at the same budget. One loop trains them all but YOLO, which has its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from sklearn.metrics import confusion_matrix

from dronekeypp.baselines import yolo
from dronekeypp.evaluate import ENOUGH_SEEDS
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.reproduce.field import measures_of
from dronekeypp.reproduce.headings import measure_by_heading
from dronekeypp.reproduce.protocol import SPLITS, Job, Part, Table, add_entries
from dronekeypp.reproduce.results import RESULTS, measurements, write_npz
from dronekeypp.reproduce.runner import Bench
from dronekeypp.reproduce.table3_measures import (
    keep_checkpoint,
    keep_flights,
    measure_yolo,
    shrink,
    train_yolo,
    yolo_finished,
    yolo_record,
)
from dronekeypp.reproduce.table3_page import as_csv, draw, markdown
from dronekeypp.reproduce.table3_runs import METHOD, PAPERS, RUNS
from dronekeypp.reproduce.tables import (
    title,
)

# What is stored of every test frame, for figures.
STORED = (
    *("R_deg", "t_m", "distance_m", "heading_deg", "keypoint_px", "keypoint_crop_px", "flip", "failed"),
    *("label", "predicted", "scene", "subsequence", "frame"),
)


class Table3(Table):
    """Measure Table 3.

    Each method has three seeds unless another number is given. YOLOv8n-pose is measured where the optional
    extra is installed, or where it was trained before.
    """

    name = "table3"
    full_budget = True
    lists = (*Table.lists, "confusion", "by_heading")

    def jobs(self, bench: Bench, seeds: int | None) -> list[Job]:
        jobs, absent = [], False
        for seed in range(seeds or ENOUGH_SEEDS):
            for run in RUNS:
                job = Job(bench, run, seed)
                if run.method == yolo.METHOD and not yolo.installed() and not self.finished(job):
                    absent = True
                else:
                    jobs.append(job)
        if absent:
            bench.say(
                'YOLOv8n-pose is left out: its extra is not installed (pip install -e ".[yolo]", AGPL-3.0)'
            )
        return jobs

    def finished(self, job: Job) -> bool:
        if job.run.method == yolo.METHOD:
            rendered = (job.bench.data / "manifest.json").is_file()
            return rendered and yolo_finished(job.bench, job.run, job.seed)
        return super().finished(job)

    def train(self, job: Job) -> None:
        if job.run.method == yolo.METHOD:
            train_yolo(job.bench, job.run, job.seed)
        else:
            super().train(job)

    def measure(self, job: Job) -> Part:
        """Measure one run; beside the lists, the part holds "arrays" of every test frame of seed 0.

        Only DroneKey++ has "by_heading".
        """
        bench, run, seed = job.bench, job.run, job.seed
        is_yolo = run.method == yolo.METHOD
        part: Part = {"confusion": [], "arrays": {}}
        for split in SPLITS:
            field = split == "test"
            measure = measure_yolo if is_yolo else Bench.measure
            for variant, frames in measure(bench, run, seed, split, field=field).items():
                labels = {"method": run.method, "variant": variant, "seed": seed}
                entries = measurements(frames, bench.names, split, measures_of(frames), **labels)
                add_entries(part, entries)
                if split == "test":
                    part["confusion"] += confusion(frames, bench.names, labels)
                if split == "test" and seed == 0:
                    for name in STORED:
                        part["arrays"][f"{title(run.method, variant)}/{name}"] = shrink(frames[name])
        if run.method == METHOD:
            part["by_heading"] = measure_by_heading(bench, run, seed, run.variant)
        part["run"] = yolo_record(bench, run, seed) if is_yolo else bench.training_record(run, seed)
        if run == PAPERS and seed == 0:
            keep_checkpoint(bench, run, seed)
            keep_flights(bench, run, seed)
        return part

    def record(self, bench: Bench, parts: Sequence[Part]) -> dict[str, Any]:
        """Write the result, and the stored frames as table3_frames.npz beside it."""
        recorded = super().record(bench, parts)
        arrays: dict[str, np.ndarray] = {}
        for part in parts:
            arrays |= part["arrays"]
        write_npz(bench.root / RESULTS / "table3_frames.npz", arrays)
        return recorded

    def markdown(self, recorded: dict[str, Any]) -> str:
        return markdown(recorded)

    def as_csv(self, recorded: dict[str, Any]) -> str:
        return as_csv(recorded)

    def draw(self, recorded: dict[str, Any]) -> dict[str, plt.Figure]:
        return {self.name: draw(recorded)}


def reproduce(bench: Bench, seeds: int | None = None) -> dict[str, Any]:
    """Render, train and measure whatever of Table 3 is missing, and return the recorded result."""
    return Table3().reproduce(bench, seeds)


def confusion(frames: Frames, names: Sequence[str], labels: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the confusion matrix of a method as a list of one, or [] if the method names no drone.

    Args:
        frames: the frames of `evaluate`.
        names: the drones in class order.
        labels: method, variant and seed.
    """
    answered = frames["predicted"] >= 0
    if not answered.any():
        return []
    label, predicted = frames["label"][answered], frames["predicted"][answered]
    matrix = confusion_matrix(label, predicted, labels=range(len(names)))
    entry = {
        **labels,
        "drones": list(names),
        "true_by_predicted": matrix.tolist(),
        "unanswered": int((~answered).sum()),
    }
    return [entry]
