"""Ask whether the network is prior-free: what it knows of a drone's size, and where it keeps it.

A picture shows angles, never metres (notebook 02). So a network that answers in metres has learned how large
each drone is, and its class branch is where it can look that up. The module asks three questions. What does
it answer when it is given a wrong class? What does it answer for a drone it was never trained on? Does the
class embedding hold sizes?
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from scipy.stats import linregress, spearmanr

from dronekeypp import plots
from dronekeypp.classes import DroneClass
from dronekeypp.data import read_annotations
from dronekeypp.evaluate import frame_errors, json_values
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce.comparisons import closing_lines
from dronekeypp.reproduce.protocol import SPLITS, Job, Part, Table, add_entries
from dronekeypp.reproduce.results import measurements
from dronekeypp.reproduce.runner import Bench, Run
from dronekeypp.reproduce.tables import heading, line, number, over_seeds, percent

WHOLE = Run(DroneKeyPP.method)
LEFT_OUT = "left out"  # the row of all drones together, each by the network that never saw it
TOLD_MEASURES = ("distance_ratio", "R_deg", "t_m")  # of `told_wrong`

# --- sizes ------------------------------------------------------------------------------------------------


def radius(hubs: np.ndarray) -> float:
    """Return the root mean square distance of hubs (4, 3) from their middle."""
    return float(np.sqrt(np.square(hubs - hubs.mean(axis=0)).sum(axis=1).mean()))


# --- measuring --------------------------------------------------------------------------------------------


def without(drone: str) -> Run:
    """Return the training that leaves out one drone, by its name."""
    return Run(DroneKeyPP.method, f"without {drone}", without=drone)


class Priors(Table):
    """Measure the whole network, and one network without each drone of the data set.

    Each has one seed unless another number is given.
    """

    name = "priors"
    lists = (*Table.lists, "told", "embedding", "taken_for")

    def jobs(self, bench: Bench, seeds: int | None) -> list[Job]:
        runs = [WHOLE, *(without(drone) for drone in bench.names)]
        jobs = []
        for seed in range(seeds or 1):
            jobs += [Job(bench, run, seed) for run in runs]
        return jobs

    def measure(self, job: Job) -> Part:
        """Measure one run.

        The part holds its rows (of the drone that it never saw, or of all) and the classes for which it took
        them. For the whole network it also holds the other two questions.
        """
        bench, run, seed = job.bench, job.run, job.seed
        names = bench.names
        part: Part = {"run": bench.training_record(run, seed)}
        for split in SPLITS:
            frames = bench.measure(run, seed, split)[run.variant]
            if run.without:
                chosen = frames["label"] == names.index(run.without)
                frames = {key: value[chosen] for key, value in frames.items()}
            labels = {"method": run.method, "variant": run.variant, "seed": seed}
            add_entries(part, measurements(frames, names, split, **labels))
            if split == "test":
                part |= self.answers_of(job, frames)
        return part

    def answers_of(self, job: Job, frames: Frames) -> Part:
        """Return what only this table asks of the test frames that count for a run."""
        bench, run, seed = job.bench, job.run, job.seed
        if run.without:
            share = np.bincount(frames["predicted"], minlength=len(bench.names)) / len(frames["predicted"])
            entry = {"drone": run.without, "seed": seed, "share": json_values(share.tolist())}
            return {"taken_for": [entry]}
        network = bench.network(run, seed)
        truth = read_annotations(bench.split("test", run, seed))
        return {
            "told": [{"seed": seed, **json_values(told_wrong(network, frames, truth))}],
            "embedding": [{"seed": seed, **json_values(embedding(network, bench.drones))}],
        }

    def details(self, bench: Bench) -> dict[str, Any]:
        return {"hub_radius_m": {drone.name: round(radius(drone.hubs), 5) for drone in bench.drones}}

    def markdown(self, recorded: dict[str, Any]) -> str:
        return markdown(recorded)

    def draw(self, recorded: dict[str, Any]) -> dict[str, plt.Figure]:
        return {self.name: draw(recorded)}


def told_wrong(
    model: DroneKeyPP, frames: Frames, truth: dict[str, torch.Tensor]
) -> dict[str, list[list[float]]]:
    """Give the network each class in turn, and return what it answers.

    Only the decoder runs again.

    Args:
        model: the network.
        frames: the frames of `evaluate`, with the network's own keypoints.
        truth: the annotations of the same frames.

    Returns:
        Medians by true (rows) and given class (columns), n by n each: distance_ratio (predicted over true
        distance), R_deg, t_m.
    """
    device = next(model.parameters()).device
    count = len(model.drones)
    truth = {key: value.to(device) for key, value in truth.items()}
    K, square = truth["K"], truth["square"]
    keypoints = torch.from_numpy(frames["keypoints"]).to(device)
    # Of the pictures only the width is read.
    blank = torch.empty(len(keypoints), 3, 1, model.config.image_size, device=device)
    medians = {key: np.zeros((count, count)) for key in TOLD_MEASURES}
    for given in range(count):
        label = torch.full_like(truth["label"], given)
        with torch.inference_mode():
            output = model(None, K, square, keypoints, label)
            errors = frame_errors(output, {**truth, "image": blank})
        for true in range(count):
            chosen = frames["label"] == true
            for key in TOLD_MEASURES:
                medians[key][true, given] = np.median(errors[key][chosen])
    return {key: table.tolist() for key, table in medians.items()}


def embedding(model: DroneKeyPP, drones: Sequence[DroneClass]) -> dict[str, Any]:
    """Measure the distances between the columns of the class embedding, and how they rank drones by size.

    The distances are n by n. spearman is the rank correlation, over the pairs of drones (21 of seven), of
    |log size ratio| with the distance of the embeddings. At 1, sizes lie along one line in it. `drones` are
    the classes, with their hubs.
    """
    vectors = model.decoder.embed_class.weight.T.detach().cpu()  # (n, 64)
    apart = torch.cdist(vectors, vectors).numpy()
    sizes = [radius(drone.hubs) for drone in drones]
    ratios, pairs = size_differences(sizes)
    correlation = spearmanr(ratios, apart[pairs]).statistic
    return {"distance": apart.tolist(), "spearman": float(correlation)}


def size_differences(sizes: Sequence[float]) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Return |log size ratio| of every two of n drones, and the pairs as indices of a matrix.

    The differences have shape (n (n - 1) / 2,).
    """
    logarithms = np.log(sizes)
    pairs = np.triu_indices(len(sizes), 1)
    return np.abs(logarithms[:, None] - logarithms)[pairs], pairs


def reproduce(bench: Bench, seeds: int = 1) -> dict[str, Any]:
    """Train and measure whatever is missing, and return the recorded result."""
    return Priors().reproduce(bench, seeds)


# --- what a recorded result says --------------------------------------------------------------------------


def hub_radii(recorded: dict[str, Any]) -> np.ndarray:
    """Return the sizes of the drones (7,) in metres, see `radius`, in the order of their classes."""
    return np.array(list(recorded["hub_radius_m"].values()))


def size_ratios(recorded: dict[str, Any]) -> np.ndarray:
    """Return the size of the given class over the true size (7, 7), as [true][given]."""
    sizes = hub_radii(recorded)
    return sizes[None, :] / sizes[:, None]


def told_medians(recorded: dict[str, Any], key: str) -> np.ndarray:
    """Return the medians of `told_wrong`, averaged over the seeds (7, 7), as [true][given]."""
    return np.mean([entry[key] for entry in recorded["told"]], axis=0)


def told_slope(recorded: dict[str, Any]) -> tuple[float, float]:
    """Return slope and r² of log(distance ratio) on log(size ratio) over the 42 wrong pairs.

    If both are 1, the size of the given class sets the distance, and nothing else does.
    """
    wrong = ~np.eye(len(recorded["hub_radius_m"]), dtype=bool)
    sizes = np.log(size_ratios(recorded)[wrong])
    distances = np.log(told_medians(recorded, "distance_ratio")[wrong])
    fit = linregress(sizes, distances)
    return float(fit.slope), float(fit.rvalue**2)


def left_out(recorded: dict[str, Any], drone: str, key: str) -> tuple[float, float]:
    """Return a measure of a drone with the drone in training, and without it.

    Both are means of its two test scenes.
    """
    mine = [row for row in recorded["rows"] if row["drone"] == drone]
    inside = [row for row in mine if row["variant"] is None]
    outside = [row for row in mine if row["variant"] == without(drone).variant]
    return over_seeds(inside, key), over_seeds(outside, key)


def pooled(recorded: dict[str, Any]) -> dict[str, Any]:
    """Return the result with the rows and flights of all left-out drones under one name, LEFT_OUT."""
    joined = {}
    for name in ("rows", "validation", "flights"):
        entries = []
        for entry in recorded.get(name, []):
            variant = LEFT_OUT if entry["variant"] else None
            entries.append({**entry, "variant": variant})
        joined[name] = entries
    return {**recorded, **joined}


def by_size(recorded: dict[str, Any]) -> list[str]:
    """Return the drones' names, the smallest first."""
    return sorted(recorded["hub_radius_m"], key=recorded["hub_radius_m"].get)


# --- the table --------------------------------------------------------------------------------------------


def markdown(recorded: dict[str, Any]) -> str:
    """Return three short tables, one for each question."""
    lines = ["# Is it prior-free?", "", heading(recorded)]
    if recorded["told"]:
        lines += _told_lines(recorded)
    lines += _left_out_lines(recorded)
    if recorded["embedding"]:
        rank = np.mean([entry["spearman"] for entry in recorded["embedding"]])
        lines += [
            "",
            "## The class embedding",
            "",
            "Distance of two drones' embeddings against |log size ratio|, 21 pairs: "
            f"rank correlation {rank:.2f}.",
        ]
    lines += closing_lines(recorded, verdicts=0)
    return "\n".join(lines) + "\n"


def _told_lines(recorded: dict[str, Any]) -> list[str]:
    names, order = list(recorded["hub_radius_m"]), by_size(recorded)
    distances, sizes = told_medians(recorded, "distance_ratio"), size_ratios(recorded)
    slope, r2 = told_slope(recorded)
    lines = [
        "",
        "## Told a wrong class",
        "",
        "Median of predicted over true distance (in brackets: told over true size). "
        f"log(distance ratio) grows by {slope:.2f} with log(size ratio), r² = {r2:.2f}: at 1 and 1 the told "
        "size alone would set the distance.",
        "",
        "| true \\ told | " + " | ".join(order) + " |",
        "|---|" + "---:|" * len(order),
    ]
    for true in order:
        shown = []
        for given in order:
            pair = names.index(true), names.index(given)
            shown.append(f"{distances[pair]:.2f} ({sizes[pair]:.2f})")
        lines.append(line([true, *shown]))
    return lines


def _left_out_lines(recorded: dict[str, Any]) -> list[str]:
    names = list(recorded["hub_radius_m"])
    lines = [
        "",
        "## A drone left out of training",
        "",
        "Mean of its two test scenes, with the drone in training → left out. The backbone's pretraining had "
        "seen the drone: with one that had not, the keypoints would be worse too.",
        "",
        "| drone | hub radius (m) | R MedAE (deg) | t MedAE (m) | distance ratio | keypoints (px) "
        "| taken for |",
        "|---|---:|---:|---:|---:|---:|---|",
    ]
    for drone in by_size(recorded):
        shares = [entry["share"] for entry in recorded["taken_for"] if entry["drone"] == drone]
        if not shares:
            continue
        shown = [drone, f"{recorded['hub_radius_m'][drone]:.3f}"]
        for key, digits in (("R_medae_deg", 1), ("t_medae_m", 3), ("distance_ratio", 2), ("keypoint_px", 1)):
            inside, outside = left_out(recorded, drone, key)
            shown.append(f"{number(inside, digits)} → {number(outside, digits)}")
        share = np.mean(shares, axis=0)
        likeliest = [f"{names[i]} {percent(share[i])}" for i in np.argsort(-share)[:2]]
        lines.append(line([*shown, ", ".join(likeliest)]))
    return lines


# --- the figure -------------------------------------------------------------------------------------------


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """Draw one panel for each question."""
    plots.style()
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6))
    axes[0].set_title("Told a wrong class")
    if recorded["told"]:
        _draw_told(axes[0], recorded)
    _draw_left_out(axes[1], recorded)
    axes[2].set_title("What the class embedding holds")
    if recorded["embedding"]:
        _draw_embedding(axes[2], recorded)
    return figure


def _draw_told(ax: plt.Axes, recorded: dict[str, Any]) -> None:
    wrong = ~np.eye(len(recorded["hub_radius_m"]), dtype=bool)
    sizes = size_ratios(recorded)[wrong]
    distances = told_medians(recorded, "distance_ratio")[wrong]
    span = [sizes.min(), sizes.max()]
    ax.plot(span, span, color="0.6", linewidth=1, label="told size sets the distance")
    ax.plot(sizes, distances, "o", markersize=4, label="42 pairs of drones")
    ax.set(xscale="log", yscale="log")
    ax.set(xlabel="told size / true size", ylabel="predicted / true distance (median)")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_ticks([0.5, 1, 2], ["½", "1", "2"])
        axis.set_ticks([], minor=True)
    ax.legend()


def _draw_left_out(ax: plt.Axes, recorded: dict[str, Any]) -> None:
    order = by_size(recorded)
    for place, drone in enumerate(order):
        inside, outside = left_out(recorded, drone, "t_medae_m")
        labels = ("in training", "left out") if place == 0 else (None, None)
        ax.plot([place] * 2, [inside, outside], color="0.8", linewidth=1, zorder=0)
        ax.plot(place, inside, "o", color="#0072B2", label=labels[0])
        ax.plot(place, outside, "D", color="#D55E00", markerfacecolor="none", label=labels[1])
    ax.set_xticks(range(len(order)), order, rotation=30)
    ax.set(ylim=(0, None), ylabel="translation MedAE (m)", title="A drone left out of training")
    ax.legend()


def _draw_embedding(ax: plt.Axes, recorded: dict[str, Any]) -> None:
    ratios, pairs = size_differences(hub_radii(recorded))
    for entry in recorded["embedding"]:
        distances = np.array(entry["distance"])[pairs]
        ax.plot(ratios, distances, "o", markersize=4, label=f"seed {entry['seed']}")
    ax.set(ylim=(0, None))
    ax.set(xlabel="|log size ratio| of two drones", ylabel="distance of their embeddings")
    ax.legend()
