"""Go beyond the paper: compare its network with the one that has the geometry put back, at one budget.

The module also says whether the latter's uncertainty can be trusted.

What is asked of the geometric network stands in `beyond_uncertainty.py` and `beyond_flights.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.ticker import LogLocator, NullFormatter
from torch.utils.data import Subset

from dronekeypp import plots
from dronekeypp.classes import DroneClass
from dronekeypp.data import FrameDataset, read_annotations
from dronekeypp.evaluate import ENOUGH_SEEDS, json_values
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.files import write_beside
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce.beyond_flights import FILTERS, over_flights, sequences
from dronekeypp.reproduce.beyond_uncertainty import (
    HALVES,
    HIDDEN,
    LEVELS,
    PARTS,
    Answers,
    Hidden,
    answers,
    calibration,
    claimed,
    coverage,
    doubt,
    merged,
    occlusion,
    surprise,
)
from dronekeypp.reproduce.comparisons import closing_lines, differences_to
from dronekeypp.reproduce.field import field_errors, field_lines, measures_of
from dronekeypp.reproduce.flights import Name, has_flights
from dronekeypp.reproduce.priors import radius
from dronekeypp.reproduce.protocol import SPLITS, Job, Part, Table, add_entries
from dronekeypp.reproduce.results import measurements
from dronekeypp.reproduce.runner import Bench, Run
from dronekeypp.reproduce.tables import (
    average,
    heading,
    interval,
    interval_note,
    line,
    methods,
    number,
    panels,
    percent,
    with_intervals,
)
from dronekeypp.train import METRICS

__all__ = [
    "FILTERS",
    "GEOMETRIC",
    "HALVES",
    "HIDDEN",
    "LEVELS",
    "PAPERS",
    "PARTS",
    "WITHOUT",
    "Answers",
    "Beyond",
    "Hidden",
    "answers",
    "calibration",
    "claimed",
    "coverage",
    "doubt",
    "draw",
    "draw_doubt",
    "markdown",
    "merged",
    "occlusion",
    "over_flights",
    "reproduce",
    "sequences",
    "shapes",
    "surprise",
]

METHOD = DroneKeyPP.method
SETTINGS = {"pose": "geometric", "classifier": "features"}
PAPERS, GEOMETRIC = Run(METHOD), Run(METHOD, "geometric", SETTINGS)
# Each drone left out in turn would be seven trainings. These are the smallest and one whose size others have
# too, with a quarter of the budget.
WITHOUT = {
    name: Run(METHOD, f"geometric without {name}", {**SETTINGS, "epochs": 10}, without=name)
    for name in ("Tello", "Air2")
}


class Beyond(Table):
    """Compare both networks, and two that were never shown one of the drones.

    Each has three seeds unless another number is given; those that were never shown one have one. The
    calibrated network is written to data_samples/beyond.
    """

    name = "beyond"
    full_budget = True
    lists = (*Table.lists, "doubt", "occlusion", "shapes", "sequences")

    def jobs(self, bench: Bench, seeds: int | None) -> list[Job]:
        jobs = []
        for seed in range(seeds or ENOUGH_SEEDS):
            jobs += [Job(bench, PAPERS, seed), Job(bench, GEOMETRIC, seed)]
        return jobs + [Job(bench, run, 0) for run in WITHOUT.values()]

    def measure(self, job: Job) -> Part:
        """Measure one run.

        The part holds rows of its answers and, for a geometric network, how far its covariance can be
        trusted.
        """
        bench, run, seed = job.bench, job.run, job.seed
        if run is PAPERS:
            part: Part = {}
            for split in SPLITS:
                add_rows(part, bench, job, split, bench.measure(run, seed, split, field=split == "test"))
        else:
            part = self.measure_geometric(job)
        part["run"] = bench.training_record(run, seed)
        return part

    def measure_geometric(self, job: Job) -> Part:
        """Measure a geometric network, its parts and its covariance."""
        bench, run, seed = job.bench, job.run, job.seed
        bench.train(run, seed)
        bench.say(f"asking {run.variant} seed {seed}")
        model, val = load(bench, run, seed)
        part: Part = {}
        for split in SPLITS:
            dataset = bench.split(split, run, seed, all_drones=True)
            answered = answers(model, dataset, () if run.without else tuple(PARTS))
            frames_of = {run.variant: answered.whole}
            for name, frames in answered.parts.items():
                frames_of[PARTS[name]] = frames
            if split == "test":
                for frames in frames_of.values():
                    frames |= field_errors(frames, dataset)
            chosen = slice(None)
            if run.without:
                chosen = answered.whole["label"] == bench.names.index(run.without)
                for name, frames in frames_of.items():
                    frames_of[name] = {key: value[chosen] for key, value in frames.items()}
            add_rows(part, bench, job, split, frames_of)
            if split == "test":
                uncertainty = doubt(answered.error[chosen], answered.covariance[chosen], model)
                part["doubt"] = [{"variant": run.variant, "seed": seed, **json_values(uncertainty)}]
                if seed == 0 and not run.without:
                    keep_network(bench, model, bench.folder(run, seed) / METRICS)
                    part |= self.details_of(job, model, answered, val, dataset)
        return part

    def details_of(
        self, job: Job, model: DroneKeyPP, answered: Answers, val: Answers, test_set: FrameDataset
    ) -> Part:
        """Measure what only the first geometric network is asked: flights, hidden parts and shapes."""
        bench, run, seed = job.bench, job.run, job.seed
        truth, val_truth = read_annotations(test_set), read_annotations(bench.split("val", run, seed))
        networks = {None: load(bench, PAPERS, seed)[0], run.variant: model}
        some = Subset(test_set, range(0, len(test_set), 10))
        return {
            "sequences": json_values(sequences(answered, truth, val, val_truth)),
            "occlusion": json_values(occlusion(networks, some)),
            "shapes": json_values(shapes(model, bench.drones)),
        }

    def markdown(self, recorded: dict[str, Any]) -> str:
        return markdown(recorded)

    def draw(self, recorded: dict[str, Any]) -> dict[str, plt.Figure]:
        figures = {"beyond": draw(recorded)}
        if recorded["doubt"] and recorded["occlusion"]:
            figures["beyond_doubt"] = draw_doubt(recorded)
        return figures


def reproduce(bench: Bench, seeds: int | None = None) -> dict[str, Any]:
    """Train and measure whatever is missing, and return the recorded result."""
    return Beyond().reproduce(bench, seeds)


def add_rows(part: Part, bench: Bench, job: Job, split: str, frames_of: dict[str | None, Frames]) -> None:
    """Add what is recorded of a job's variants and one split to its part."""
    for variant, frames in frames_of.items():
        labels = {"method": METHOD, "variant": variant, "seed": job.seed}
        add_entries(part, measurements(frames, bench.names, split, measures_of(frames), **labels))


def load(bench: Bench, run: Run, seed: int) -> tuple[DroneKeyPP, Answers | None]:
    """Load a run's network.

    A geometric network is calibrated on the validation flights, and its answers to them are returned with it.
    """
    model = bench.network(run, seed)
    if not model.decoder.needs_image:
        return model, None
    answered = answers(model, bench.split("val", run, seed), ())
    factors = calibration(answered.error, answered.covariance)
    model.decoder.calibration.copy_(torch.tensor(factors))
    scale = np.repeat(factors, 3)
    covariance = answered.covariance * scale[:, None] * scale
    return model, Answers(answered.whole, answered.parts, answered.error, covariance)


def keep_network(bench: Bench, model: DroneKeyPP, history: Path) -> None:
    """Write the calibrated network as float16, and its training curve, to data_samples/beyond."""
    folder = bench.root / "data_samples" / "beyond"
    model.save_pretrained(folder, half=True)
    write_beside(folder / METRICS, history.read_bytes())


def shapes(model: DroneKeyPP, drones: Sequence[DroneClass]) -> list[dict[str, Any]]:
    """Compare the hubs and the size that the network has learned of each drone with the true ones.

    off_mm is the root mean square distance of the learned hubs from the true ones, in millimetres. size_ratio
    is the believed size over the true one.
    """
    rows = []
    learned_hubs = model.decoder.shapes.hubs.detach().cpu().numpy()  # (n, 4, 3)
    for drone, learned in zip(drones, learned_hubs, strict=True):
        off = float(np.sqrt(np.square(learned - drone.hubs).sum(axis=1).mean()))
        ratio = radius(learned) / radius(drone.hubs)
        rows.append({"drone": drone.name, "off_mm": 1000 * off, "size_ratio": ratio})
    return rows


# --- the table --------------------------------------------------------------------------------------------


def side_by_side(recorded: dict[str, Any]) -> list[Name]:
    """Return the names of the rows that are about all drones."""
    return [name for name in methods(recorded) if "without" not in (name[1] or "")]


def markdown(recorded: dict[str, Any]) -> str:
    """Return the table of both networks and their parts, and then what the covariance is worth."""
    shown_columns = with_intervals(recorded)
    metrics = " | ".join(metric for metric, *_ in shown_columns)
    note = "Mean of the 14 columns of Table 3, 95 % interval over them."
    if has_flights(recorded):
        note = f"Mean of the 14 columns of Table 3, with 95 % intervals. {interval_note(recorded)}"
    lines = [
        "# Beyond the paper: the geometry put back",
        "",
        heading(recorded),
        "",
        note,
        "",
        f"| | {metrics} | class | flips | keypoints (px of the crop) |",
        "|---|" + "---:|" * (len(shown_columns) + 3),
    ]
    names = side_by_side(recorded)
    for name in names:
        row = average(recorded, *name)
        shown = [interval(row, key, digits) for _, key, _, digits in shown_columns]
        shown += [percent(row["class_accuracy"]), percent(row["flip_rate"])]
        shown.append(number(row["keypoint_crop_px"], 1))
        lines.append(line([name[1] or "the paper’s network", *shown]))
    paper: Name = (METHOD, None)
    others = [name for name in names if name != paper]
    differences, verdicts = differences_to(recorded, paper, others, "the paper’s network")
    lines += differences + field_lines(recorded, names)
    lines += _covariance_lines(recorded) + _flight_lines(recorded) + _left_out_lines(recorded)
    return "\n".join(lines + closing_lines(recorded, verdicts)) + "\n"


def _covariance_lines(recorded: dict[str, Any]) -> list[str]:
    lines = [
        "",
        "## What its covariance is worth",
        "",
        "Share of the frames whose error lies inside the region claimed for 50 % and 90 % of them; "
        "test scenes.",
        "",
        "| | turn 50 % | turn 90 % | shift 50 % | shift 90 % | claimed turn (deg) | claimed shift (m) |",
        "|---|" + "---:|" * 6,
    ]
    for row in recorded["doubt"]:
        shown = [row["variant"]]
        for name in HALVES:
            shares = row["coverage"][name]
            shown += [percent(shares[LEVELS.index(0.5)]), percent(shares[LEVELS.index(0.9)])]
        lines.append(line([*shown, f"{row['claimed_turn']:.1f}", f"{row['claimed_shift']:.3f}"]))
    return lines


def _flight_lines(recorded: dict[str, Any]) -> list[str]:
    if not recorded["sequences"]:
        return []
    lines = [
        "",
        "## Over whole flights",
        "",
        "Test flights; the strength of each filter chosen on validation flights; "
        "change against single frames.",
        "",
        "| | strength | R MAE (deg) | change, 95 % | t MAE (m) | change, 95 % |",
        "|---|" + "---:|" * 5,
    ]
    for row in recorded["sequences"]:
        low, high = row["R_deg_change_ci95"]
        turn = f"[{low:+.1f}, {high:+.1f}]"
        low, high = row["t_m_change_ci95"]
        shift = f"[{low:+.3f}, {high:+.3f}]"
        shown = [
            row["filter"],
            f"{row['strength']:g}",
            f"{row['R_deg']:.1f}",
            turn,
            f"{row['t_m']:.3f}",
            shift,
        ]
        lines.append(line(shown))
    return lines


def _left_out_lines(recorded: dict[str, Any]) -> list[str]:
    rows = []
    for row in recorded["averages"]:
        if "without" in (row["variant"] or "") and row["over"] == "frames":
            rows.append(row)
    if not rows:
        return []
    lines = [
        "",
        "## A drone it was never trained on",
        "",
        "Its frames of the test scenes, a quarter of the training.",
        "",
        "| | R MedAE (deg) | t MedAE (m) | predicted / true distance |",
        "|---|---:|---:|---:|",
    ]
    for row in rows:
        values = [f"{row['R_medae_deg']:.1f}", f"{row['t_medae_m']:.2f}", f"{row['distance_ratio']:.2f}"]
        lines.append(line([row["variant"], *values]))
    return lines


# --- the figures ------------------------------------------------------------------------------------------


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """Draw both networks, and the parts of ours, with one panel for each metric."""
    names = side_by_side(recorded)
    labels = [variant or "the paper's network" for _, variant in names]
    return panels(recorded, names, labels, lambda name, key: None)


def draw_doubt(recorded: dict[str, Any]) -> plt.Figure:
    """Draw the coverage, the claimed against the actual error, and the error against the hidden share."""
    plots.style()
    figure, axes = plt.subplots(1, 4, figsize=(13, 3.2))
    row = next(row for row in recorded["doubt"] if row["variant"] == GEOMETRIC.variant)
    _draw_coverage(axes[0], row["coverage"])
    for ax, name, unit in ((axes[1], "turn", "degrees"), (axes[2], "shift", "m")):
        _draw_tenths(ax, row["tenths"][name], name, unit)
    _draw_occlusion(axes[3], recorded["occlusion"])
    return figure


def _draw_coverage(ax: plt.Axes, shares: dict[str, list[float]]) -> None:
    for name, marker in zip(HALVES, "os", strict=True):
        ax.plot(LEVELS, shares[name], f"{marker}-", label=name)
    ax.plot([0, 1], [0, 1], color="grey", linestyle="--", linewidth=1)
    ax.set(xlabel="claimed share of frames inside", ylabel="share inside", title="coverage")
    ax.set(xlim=(0, 1), ylim=(0, 1))
    ax.legend()


def _draw_tenths(ax: plt.Axes, tenths: list[dict[str, float]], name: str, unit: str) -> None:
    claims = [tenth["claimed"] for tenth in tenths]
    errors = [tenth["error"] for tenth in tenths]
    ax.loglog(claims, errors, "o-")
    low, high = min(claims + errors), max(claims + errors)
    ax.plot([low, high], [low, high], color="grey", linestyle="--", linewidth=1)
    ax.set(xlabel=f"claimed deviation, {unit}", ylabel=f"error, {unit}")
    ax.set(title=f"{name}: tenths of the frames")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 3)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())


def _draw_occlusion(ax: plt.Axes, occluded: list[dict[str, Any]]) -> None:
    for variant, style in ((None, "s--"), (GEOMETRIC.variant, "o-")):
        rows = [row for row in occluded if row["variant"] == variant]
        hidden = [100 * row["hidden"] for row in rows]
        errors = [row["R_deg"] for row in rows]
        ax.plot(hidden, errors, style, label=variant or "the paper's")
    ax.set(xlabel="hidden, % of the crop", ylabel="rotation MedAE, degrees", ylim=(0, None))
    ax.set(title="occlusion")
    ax.legend()
