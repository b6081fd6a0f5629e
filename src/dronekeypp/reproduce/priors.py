"""Is it prior-free? What the network knows of a drone's size, and where it keeps it.

A picture shows angles, never metres (notebook 02). So a network that answers in metres has learned how large each drone is, and its class
branch is where it can look that up. Three questions: what if it is told a wrong class; what of a drone it was never trained on; and does the
class embedding hold sizes?
"""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from scipy.stats import linregress, spearmanr

from dronekeypp import plots
from dronekeypp.evaluate import drone_names, frame_errors, json_values, read_annotations
from dronekeypp.files import write_beside
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce.runner import Bench, Run, complete, result, rows_and_averages, write_result
from dronekeypp.reproduce.tables import heading, number, over_seeds, percent, write_figure
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.train import choose_device

WHOLE = Run(DroneKeyPP.method)
WITHOUT = {name: Run(DroneKeyPP.method, f"without {name}", without=name) for name in DRONES}


def hub_radius(name: str) -> float:
    """Size of a drone in one number, metres."""
    return radius(DRONES[name].hubs)


def radius(hubs: np.ndarray) -> float:
    """Root mean square distance of hubs (4, 3) from their middle."""
    return float(np.sqrt(np.square(hubs - hubs.mean(axis=0)).sum(axis=1).mean()))


def told_wrong(
    model: DroneKeyPP, frames: dict[str, np.ndarray], truth: dict[str, torch.Tensor]
) -> dict[str, list[list[float]]]:
    """Medians by true and told class, 7 x 7 each: distance_ratio (predicted over true distance), R_deg, t_m.

    `frames` are those of `evaluate` with the network's own keypoints, `truth` the annotations of the same frames. Only the decoder runs again.
    """
    device = next(model.parameters()).device
    names = drone_names()
    truth = {key: value.to(device) for key, value in truth.items()}
    keypoints = torch.from_numpy(frames["keypoints"]).to(device)
    blank = torch.empty(
        len(keypoints), 3, 1, model.config.image_size, device=device
    )  # of the pictures only the width is read
    found = {key: [[0.0] * len(names) for _ in names] for key in ("distance_ratio", "R_deg", "t_m")}
    for told in range(len(names)):
        label = torch.full_like(truth["label"], told)
        with torch.inference_mode():
            errors = frame_errors(
                model(None, truth["K"], truth["square"], keypoints, label), {**truth, "image": blank}
            )
        for true in range(len(names)):
            for key, table in found.items():
                table[true][told] = float(np.median(errors[key][frames["label"] == true]))
    return found


def embedding(model: DroneKeyPP) -> dict[str, Any]:
    """Distances between the seven columns of the class embedding (7 x 7), and how well they rank the differences of the drones' sizes.

    spearman: rank correlation over the 21 pairs of |log size ratio| with the distance of the embeddings. 1: sizes lie along one line in it.
    """
    columns = model.decoder.embed_class.weight.T.detach().cpu()  # (7, 64)
    apart = torch.cdist(columns, columns).numpy()
    sizes = np.log([hub_radius(name) for name in drone_names()])
    pairs = np.triu_indices(len(sizes), 1)
    return {
        "distance": apart.tolist(),
        "spearman": float(spearmanr(np.abs(sizes[:, None] - sizes)[pairs], apart[pairs]).statistic),
    }


def reproduce(bench: Bench, seeds: int = 1) -> dict[str, Any]:
    """Train and measure whatever is missing: the whole network, and one without each drone. Returns the recorded result."""
    bench.render()
    jobs = [(bench, run, seed) for seed in range(seeds) for run in (WHOLE, *WITHOUT.values())]
    return complete(jobs, Bench.finished, measured, lambda parts: record(bench, parts))


def measured(bench: Bench, run: Run, seed: int) -> dict[str, Any]:
    """One run: its rows (of the drone it never saw, or of all), what it took them for, and for the whole network the other two questions."""
    frames = bench.measure(run, seed)[run.variant]
    found: dict[str, Any] = {"story": bench.story(run, seed), "taken_for": [], "told": [], "embedding": []}
    if run.without:
        drone = DRONES[run.without].index
        frames = {key: value[frames["label"] == drone] for key, value in frames.items()}
        share = np.bincount(frames["predicted"], minlength=len(DRONES)) / len(frames["predicted"])
        found["taken_for"] = [{"drone": run.without, "seed": seed, "share": json_values(share.tolist())}]
    else:
        model = DroneKeyPP.from_pretrained(bench.train(run, seed)).to(
            choose_device(bench.settings(run, seed)[1])
        )
        truth = read_annotations(bench.split("test", run, seed))
        found["told"] = [{"seed": seed, **json_values(told_wrong(model, frames, truth))}]
        found["embedding"] = [{"seed": seed, **json_values(embedding(model))}]
    labels = {"method": run.method, "variant": run.variant, "seed": seed}
    found["rows"], found["averages"] = rows_and_averages(frames, **labels)
    return found


def record(bench: Bench, parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Write the result, its table and its figure from what there is; returns the result."""
    joined = {
        key: [row for part in parts for row in part[key]]
        for key in ("rows", "averages", "told", "embedding", "taken_for")
    }
    sizes = {name: round(hub_radius(name), 5) for name in drone_names()}
    recorded = result("priors", bench, [part["story"] for part in parts], hub_radius_m=sizes, **joined)
    write_result(bench.root, recorded)
    folder = bench.root / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    write_beside(folder / "priors.md", markdown(recorded).encode())
    write_figure(folder / "priors.png", draw(recorded))
    return recorded


def size_ratios(recorded: dict[str, Any]) -> np.ndarray:
    """Told over true size (7, 7), [true][told]."""
    sizes = np.array(list(recorded["hub_radius_m"].values()))
    return sizes[None, :] / sizes[:, None]


def told_medians(recorded: dict[str, Any], key: str) -> np.ndarray:
    """Medians of `told_wrong`, averaged over the seeds (7, 7), [true][told]."""
    return np.mean([one[key] for one in recorded["told"]], axis=0)


def told_slope(recorded: dict[str, Any]) -> tuple[float, float]:
    """Of log(distance ratio) on log(size ratio) over the 42 wrong pairs: slope and r². 1 and 1: the told size sets the distance, nothing else."""
    wrong = ~np.eye(len(recorded["hub_radius_m"]), dtype=bool)
    fit = linregress(
        np.log(size_ratios(recorded)[wrong]), np.log(told_medians(recorded, "distance_ratio")[wrong])
    )
    return float(fit.slope), float(fit.rvalue**2)


def left_out(recorded: dict[str, Any], drone: str, key: str) -> tuple[float, float]:
    """A measure of a drone, mean of its two test scenes: with the drone in training, and without."""
    both = []
    for variant in (None, WITHOUT[drone].variant):
        both.append(
            over_seeds(
                [row for row in recorded["rows"] if (row["variant"], row["drone"]) == (variant, drone)], key
            )
        )
    return both[0], both[1]


def by_size(recorded: dict[str, Any]) -> list[str]:
    """The drones' names, the smallest first."""
    return sorted(recorded["hub_radius_m"], key=recorded["hub_radius_m"].get)


def markdown(recorded: dict[str, Any]) -> str:
    """Three short tables, one a question."""
    names, order = list(recorded["hub_radius_m"]), by_size(recorded)
    lines = ["# Is it prior-free?", "", heading(recorded)]
    if recorded["told"]:
        ratios, slope = told_medians(recorded, "distance_ratio"), told_slope(recorded)
        lines += [
            "",
            "## Told a wrong class",
            "",
            "Median of predicted over true distance (in brackets: told over true size). "
            f"log(distance ratio) grows by {slope[0]:.2f} with log(size ratio), r² = {slope[1]:.2f}: at 1 and 1 the told size alone would set "
            "the distance.",
            "",
            "| true \\ told | " + " | ".join(order) + " |",
            "|---|" + "---:|" * len(order),
        ]
        for true in order:
            pairs = [(names.index(true), names.index(told)) for told in order]
            lines.append(
                f"| {true} | "
                + " | ".join(f"{ratios[p]:.2f} ({size_ratios(recorded)[p]:.2f})" for p in pairs)
                + " |"
            )
    lines += [
        "",
        "## A drone left out of training",
        "",
        "Mean of its two test scenes, with the drone in training → left out. The backbone's pretraining had seen the drone: with one that had not, "
        "the keypoints would be worse too.",
        "",
        "| drone | hub radius (m) | R MedAE (deg) | t MedAE (m) | distance ratio | keypoints (px) | taken for |",
        "|---|---:|---:|---:|---:|---:|---|",
    ]
    for drone in order:
        shares = [taken["share"] for taken in recorded["taken_for"] if taken["drone"] == drone]
        if shares:
            share = np.mean(shares, axis=0)
            cells = [" → ".join(number(v, digits) for v in left_out(recorded, drone, key))
                      for key, digits in (("R_medae_deg", 1), ("t_medae_m", 3), ("distance_ratio", 2), ("keypoint_px", 1))]  # fmt: skip
            most = ", ".join(f"{names[i]} {percent(share[i])}" for i in np.argsort(-share)[:2])
            lines.append(
                f"| {drone} | {recorded['hub_radius_m'][drone]:.3f} | {' | '.join(cells)} | {most} |"
            )
    if recorded["embedding"]:
        rank = np.mean([one["spearman"] for one in recorded["embedding"]])
        lines += ["", "## The class embedding", ""]
        lines += [
            f"Distance of two drones' embeddings against |log size ratio|, 21 pairs: rank correlation {rank:.2f}."
        ]
    return "\n".join(lines) + "\n"


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """One panel a question."""
    plots.style()
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6))
    names, order = list(recorded["hub_radius_m"]), by_size(recorded)
    wrong = ~np.eye(len(names), dtype=bool)
    if recorded["told"]:
        x, y = size_ratios(recorded)[wrong], told_medians(recorded, "distance_ratio")[wrong]
        span = [x.min(), x.max()]
        axes[0].plot(span, span, color="0.6", linewidth=1, label="told size sets the distance")
        axes[0].plot(x, y, "o", markersize=4, label="42 pairs of drones")
        axes[0].set(
            xscale="log",
            yscale="log",
            xlabel="told size / true size",
            ylabel="predicted / true distance (median)",
        )
        for axis in (axes[0].xaxis, axes[0].yaxis):
            axis.set_ticks([0.5, 1, 2], ["½", "1", "2"])
            axis.set_ticks([], minor=True)
        axes[0].legend()
    axes[0].set_title("Told a wrong class")
    for place, drone in enumerate(order):
        inside, outside = left_out(recorded, drone, "t_medae_m")
        axes[1].plot([place] * 2, [inside, outside], color="0.8", linewidth=1, zorder=0)
        axes[1].plot(place, inside, "o", color="#0072B2", label="in training" if not place else None)
        axes[1].plot(
            place,
            outside,
            "D",
            color="#D55E00",
            markerfacecolor="none",
            label="left out" if not place else None,
        )
    axes[1].set_xticks(range(len(order)), order, rotation=30)
    axes[1].set(ylim=(0, None), ylabel="translation MedAE (m)", title="A drone left out of training")
    axes[1].legend()
    if recorded["embedding"]:
        sizes, pairs = np.log(list(recorded["hub_radius_m"].values())), np.triu_indices(len(names), 1)
        for one in recorded["embedding"]:
            axes[2].plot(
                np.abs(sizes[:, None] - sizes)[pairs],
                np.array(one["distance"])[pairs],
                "o",
                markersize=4,
                label=f"seed {one['seed']}",
            )
        axes[2].set(
            xlabel="|log size ratio| of two drones", ylabel="distance of their embeddings", ylim=(0, None)
        )
        axes[2].legend()
    axes[2].set_title("What the class embedding holds")
    return figure
