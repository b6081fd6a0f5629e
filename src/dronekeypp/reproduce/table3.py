"""Measure Table 3: DroneKey++ beside three baselines on test scenes 6 and 7, with seven drones each.

All methods see the same crops at the same budget. One loop trains them all but YOLO, which has its own.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from sklearn.metrics import confusion_matrix

from dronekeypp.baselines import yolo
from dronekeypp.evaluate import ENOUGH_SEEDS
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce.comparisons import closing_lines, differences_to
from dronekeypp.reproduce.field import field_lines, measures_of
from dronekeypp.reproduce.flights import Name
from dronekeypp.reproduce.headings import gain_lines, measure_by_heading
from dronekeypp.reproduce.protocol import SPLITS, Job, Part, Table, add_entries
from dronekeypp.reproduce.results import PAPER, RESULTS, measurements, write_npz
from dronekeypp.reproduce.runner import Bench, Run
from dronekeypp.reproduce.table3_measures import (
    keep_checkpoint,
    keep_flights,
    measure_yolo,
    shrink,
    train_yolo,
    yolo_finished,
    yolo_record,
)
from dronekeypp.reproduce.tables import (
    PER_AXIS_READING,
    PRINTED,
    TEST_SCENES,
    average,
    cells,
    columns,
    drones,
    heading,
    interval,
    interval_note,
    line,
    methods,
    number,
    panels,
    percent,
    title,
    with_intervals,
)

METHOD = DroneKeyPP.method
# The learning rates of methods whose best one on validation is not the preset's, see `rates.best_rate`. Other
# tables take a run of this table with its rate.
RATES: dict[Name, float] = {}


def with_rate(run: Run) -> Run:
    """Return a run with the learning rate that RATES has for it, or as it is."""
    name = run.method, run.variant
    return dataclasses.replace(run, changes={**run.changes, "lr": RATES[name]}) if name in RATES else run


# YOLOv8n-pose trains itself, at a rate that its library chooses.
YOLO_RUN = Run(yolo.METHOD, hypotheses=("fit", "upright"))
PAPERS, SIX_NUMBERS = with_rate(Run(METHOD)), with_rate(Run(METHOD, "6D", {"rotation": "sixd"}))
RUNS = (
    PAPERS,
    SIX_NUMBERS,
    with_rate(Run("DroneKey", hypotheses=("fit", "upright"))),
    with_rate(Run("DronePose")),
    with_rate(Run("DronePose", "told the crop", {"use_rays": True})),
    YOLO_RUN,
)
OURS: Name = (PAPERS.method, PAPERS.variant)
# DronePose has six numbers. What they give DroneKey++ is split by heading.
GAINS = (((METHOD, SIX_NUMBERS.variant), OURS),)
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


def paper_cells(method: str, key: str, names: Sequence[str] = ()) -> list[float] | None:
    """Return the paper's columns of the drones `names`, and then its printed average.

    A column that the paper does not have is NaN. A method that the paper does not have gives None.
    """
    printed = PAPER["table3"].get(method, {}).get(key)
    if printed is None:
        return None
    values = []
    for scene in TEST_SCENES:
        values += [printed[f"scene_{scene:02d}"].get(drone, np.nan) for drone in names]
    return [*values, printed["average_printed"]]


def paper_row(name: Name, key: str | None, names: Sequence[str] = ()) -> list[float] | None:
    """Return `paper_cells` for a row of ours.

    The answer is None where the paper has no such row, or no such measure.
    """
    method, variant = name
    if variant is not None or key is None:
        return None
    return paper_cells(method, key, names)


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """Draw one panel for each metric, with our average and its interval, and the paper's value."""
    printed_key = {ours: theirs for _, ours, theirs, _ in PRINTED}
    names = methods(recorded)

    def paper_average(name: Name, key: str) -> float | None:
        values = paper_row(name, printed_key[key])
        return values[-1] if values else None

    return panels(recorded, names, [title(*name) for name in names], paper_average)


def markdown(recorded: dict[str, Any]) -> str:
    """Return the table in the paper's layout, and then what the paper does not print.

    The layout is methods by metrics, with 14 columns and the average, and the paper's value above ours.
    """
    minutes: dict[str, float] = {}
    for run in recorded["runs"]:
        minutes.setdefault(title(run["method"], run["variant"]), run["minutes"])
    spent = ", ".join(f"{name} {value:g}" for name, value in minutes.items())
    places = [f"{scene}·{drone}" for scene, drone in columns(recorded)]
    shown_columns = with_intervals(recorded)
    lines = [
        "# Table 3: test scenes 6 and 7",
        "",
        f"{heading(recorded)} Minutes of training: {spent}.",
        "",
        "`paper` is the printed value, `ours` what we measured on our own 6DroneSyn: other renderings, other "
        "flights, so compare the order of the methods rather than single cells. The paper's t MAE stands "
        f"beside ours per axis, and ours as a distance below it: {PER_AXIS_READING}",
        "",
        "| method | metric | | " + " | ".join(places) + " | average |",
        "|---|---|---|" + "---:|" * (len(places) + 1),
    ]
    for name in methods(recorded):
        for metric, ours, theirs, digits in PRINTED:
            printed = paper_row(name, theirs, drones(recorded))
            sources = {"paper": printed} if printed else {}
            sources["ours"] = cells(recorded, *name, ours)
            for source, values in sources.items():
                shown = [number(value, digits) for value in values]
                lines.append(line([title(*name), metric, source, *shown]))
    lines += [
        "",
        "## Averages, with 95 % intervals",
        "",
        f"Mean of the {len(places)} columns. {interval_note(recorded)}",
        "",
        line(
            [
                "method",
                *(metric for metric, *_ in shown_columns),
                *("class", "keypoints (px)", "PCK@0.05", "heading flips", "no pose"),
            ]
        ),
        "|---|" + "---:|" * (len(shown_columns) + 5),
    ]
    for name in methods(recorded):
        row = average(recorded, *name)
        shown = [interval(row, key, digits) for _, key, _, digits in shown_columns]
        shown += [percent(row["class_accuracy"]), number(row["keypoint_px"], 1)]
        shown += [percent(row[key]) for key in ("pck", "flip_rate", "failed")]
        lines.append(line([title(*name), *shown]))
    lines += field_lines(recorded, methods(recorded))
    others = [name for name in methods(recorded) if name != OURS]
    differences, verdicts = differences_to(recorded, OURS, others, OURS[0])
    lines += differences + gain_lines(recorded, GAINS) + closing_lines(recorded, verdicts)
    return "\n".join(lines) + "\n"


def as_csv(recorded: dict[str, Any]) -> str:
    """Return the table as CSV in long format.

    Its columns are method, variant, metric, source (paper | ours), scene, drone and value. The scene of the
    last column is "average".
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "variant", "metric", "source", "scene", "drone", "value"])
    places = [*columns(recorded), ("average", "")]
    for method, variant in methods(recorded):
        for _, ours, theirs, _ in PRINTED:
            sources = {"ours": cells(recorded, method, variant, ours)}
            printed = paper_row((method, variant), theirs, drones(recorded))
            if printed:
                sources["paper"] = printed
            for source, values in sources.items():
                for (scene, drone), value in zip(places, values, strict=True):
                    shown = "" if np.isnan(value) else f"{value:.6g}"
                    writer.writerow([method, variant or "", ours, source, scene, drone, shown])
    return text.getvalue()
