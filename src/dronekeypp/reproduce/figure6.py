"""Compare real drone frames with older-style synthetic ones and with ours (Figure 6).

Ours have drawn or photographed backgrounds. The paper reads realism off two scatter plots. Here they stand
beside four distances to the real frames, each with an interval.

With `--real DIR` everything is measured from pictures (`figure6_sets.py`). Without it, everything is measured
from the features that an earlier call recorded in data_samples/results/figure6_features.npz. They are numbers
from which no picture can be made. The measures stand in `figure6_measures.py`.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dronekeypp import plots
from dronekeypp.errors import InputError
from dronekeypp.files import repository_root
from dronekeypp.reproduce.figure6_measures import (
    COMPONENTS,
    KINDS,
    MAPS,
    MEASURES,
    centre_order,
    components,
    distances,
    flights_of,
    gains,
    kinds_of,
    labels_of,
    pairs_of,
    purity,
    sets_of,
    tsne,
    tsne_name,
)
from dronekeypp.reproduce.figure6_sets import (
    PICTURES,
    SETS,
    VERSIONS,
    Features,
    Pictures,
    from_pictures,
    made_pictures,
    real_pictures,
)
from dronekeypp.reproduce.protocol import Table, assemble
from dronekeypp.reproduce.results import RESULTS, read_result, write_npz
from dronekeypp.reproduce.runner import Bench
from dronekeypp.reproduce.tables import line, number

__all__ = [
    "COMPONENTS",
    "FEATURES",
    "KINDS",
    "MAPS",
    "MEASURES",
    "PICTURES",
    "SETS",
    "VERSIONS",
    "Figure6",
    "Pictures",
    "centre_order",
    "components",
    "distances",
    "draw_distances",
    "draw_maps",
    "flights_of",
    "from_pictures",
    "gains",
    "kinds_of",
    "labels_of",
    "made_pictures",
    "markdown",
    "purity",
    "read_features",
    "real_pictures",
    "reproduce",
    "scatter",
    "set_label",
    "sets_of",
    "short_label",
    "tsne",
    "tsne_name",
    "with_interval",
]

FEATURES = RESULTS / "figure6_features.npz"  # below the root

# For each kind of features the maps of the sets as made: {"two components", …: points (n, 2 or more)}.
Planes = dict[str, dict[str, np.ndarray]]


class Figure6(Table):
    """Measure the distances and draw the maps.

    Nothing is trained.
    """

    name = "figure6"

    def __init__(self) -> None:
        self.planes: Planes = {}
        self.labels = np.array([])  # (n,) the set of each point of the planes

    def reproduce(self, bench: Bench, seeds: int | None = None) -> dict[str, Any]:
        """Measure the distances, draw the figures, and record both (and, from pictures, the features).

        Raises:
            InputError: The real frames cannot be read, or there are neither pictures nor recorded features.
        """
        if bench.real is not None:
            arrays, answers, datasets = from_pictures(bench, bench.real)
            (bench.root / FEATURES).parent.mkdir(parents=True, exist_ok=True)
            write_npz(bench.root / FEATURES, arrays)
        else:
            earlier = read_result(self.name, bench.root)
            arrays = read_features(bench.root)
            answers, datasets = earlier["answers"], earlier["datasets"]
        rows, changes, maps, variance = [], [], [], {}
        for kind in kinds_of(arrays):
            bench.say(f"measuring: {KINDS[kind]}")
            x, variance[kind] = components(arrays, kind)
            rows += [{"features": kind, **row} for row in distances(x, arrays)]
            changes += [{"features": kind, **row} for row in gains(x, arrays, pairs_of(arrays))]
            self.labels = labels_of(x)
            self.planes[kind] = planes_of(x)
            for title, points in self.planes[kind].items():
                shares = purity(points, self.labels, flights_of(arrays))
                order = centre_order(points, self.labels)
                maps.append({"features": kind, "map": title, "purity": shares, "order": order})
        recorded = assemble(
            self.name,
            bench,
            [],
            dataset=datasets["drawn"],
            of=len(arrays["real/groups"]),
            datasets=datasets,
            variance_kept=variance,
            rows=rows,
            nearer=changes,
            maps=maps,
            answers=answers,
        )
        self.write(bench, recorded)
        return recorded

    def markdown(self, recorded: dict[str, Any]) -> str:
        return markdown(recorded)

    def draw(self, recorded: dict[str, Any]) -> dict[str, plt.Figure]:
        return {
            "figure6": draw_maps(self.planes, self.labels),
            "figure6_distances": draw_distances(recorded),
        }


def reproduce(bench: Bench) -> dict[str, Any]:
    """Measure, draw and record, and return the recorded result.

    See `Figure6.reproduce`.
    """
    return Figure6().reproduce(bench)


def planes_of(x: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return all components of the sets as made, the first two, and every one of MAPS."""
    together = np.concatenate([x[name] for name in SETS if name in x])
    planes = {"all components": together, "two components": together[:, :2]}
    for perplexity, seed in MAPS:
        planes[tsne_name(perplexity, seed)] = tsne(x, perplexity, seed)
    return planes


def read_features(root: Path | None = None) -> Features:
    """Read the recorded features from `root` or from the repository.

    They are "SET/KIND" (n, D) float16 and "SET/groups" (n,).

    Raises:
        InputError: No features are recorded there, or there is no `root` and no repository.
    """
    path = (root or repository_root()) / FEATURES
    if not path.is_file():
        raise InputError(
            f"{path} not found: make it with `python -m dronekeypp reproduce figure6 --real DIR`"
        )
    with np.load(io.BytesIO(path.read_bytes())) as stored:
        return dict(stored)


# --- the table --------------------------------------------------------------------------------------------


def set_label(name: str) -> str:
    """Turn the name of a set into its label.

    "drawn small" becomes "ours, drawn places: as small as the real ones".
    """
    base, _, version = name.partition(" ")
    if base == "real":
        return "real frames among themselves"
    label = SETS[base][0]
    return f"{label}: {VERSIONS[' ' + version]}" if version else label


def short_label(name: str) -> str:
    """Return the label of a set, or of one of its versions, for an axis."""
    base, _, version = name.partition(" ")
    return VERSIONS[" " + version] if version else set_label(base)


def with_interval(row: dict[str, Any], key: str) -> str:
    """Write a measure with its interval as "12.3 [10.0, 15.0]"."""
    digits = 1 if key in ("frechet", "doubt_px") else 2
    low, high = row[f"{key}_ci95"]
    return f"{row[key]:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def markdown(recorded: dict[str, Any]) -> str:
    """Return the distances to the real frames, set by set, and then what the changes are worth."""
    lines = [
        "# Figure 6: how far the made pictures are from real ones",
        "",
        f"{recorded['of']} real frames; of every other set up to {PICTURES} crops of the test flights. "
        "95 % intervals by leaving out whole videos and flights.",
    ]
    for kind, variance in recorded["variance_kept"].items():
        lines += [
            "",
            f"## {KINDS[kind]}",
            "",
            f"{COMPONENTS} principal components hold {100 * variance:.0f} % of the variance.",
            "",
            "| set | " + " | ".join(MEASURES.values()) + " |",
            "|---|" + "---:|" * len(MEASURES),
        ]
        for row in recorded["rows"]:
            if row["features"] == kind:
                shown = [with_interval(row, key) for key in MEASURES]
                lines.append(line([set_label(row["set"]), *shown]))
        lines += ["", "| from | to | measure | change |", "|---|---|---|---:|"]
        for row in recorded["nearer"]:
            if row["features"] == kind:
                names = [set_label(row["before"]), set_label(row["after"]), MEASURES[row["measure"]]]
                lines.append(line([*names, _change(row)]))
    lines += [
        "",
        "## What a network answers",
        "",
        "Mirror doubt: how far its keypoints move when the crop is mirrored, pixels of a 96 px crop; mean of "
        "the videos' medians.",
        "",
        "| network | set | mirror doubt (px) | class probability, median | R MedAE (deg) | t MedAE (m) |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for row in recorded["answers"]:
        name = "real frames" if row["set"] == "real" else set_label(row["set"])
        probability = f"{100 * row['class_probability']:.0f} %"
        errors = [number(row.get("R_medae_deg"), 1), number(row.get("t_medae_m"), 3)]
        lines.append(line([row["network"], name, with_interval(row, "doubt_px"), probability, *errors]))
    return "\n".join(lines) + "\n"


def _change(row: dict[str, Any]) -> str:
    """Write a row of `gains` as text."""
    digits = 1 if row["measure"] == "frechet" else 2
    low, high = row["difference_ci95"]
    return f"{row['difference']:+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}]"


# --- the figures ------------------------------------------------------------------------------------------


def scatter(ax: plt.Axes, points: np.ndarray, labels: np.ndarray) -> plt.Axes:
    """Draw the sets on a plane as points (n, 2), with the real ones on top."""
    for name in [*list(SETS)[1:], "real"]:
        if name in labels:
            text, colour, marker = SETS[name]
            x, y = points[labels == name].T
            style = {"s": 9, "c": colour, "marker": marker, "alpha": 0.6, "linewidths": 0}
            ax.scatter(x, y, label=text, zorder=3 if name == "real" else 2, **style)
    return ax


def draw_maps(planes: Planes, labels: np.ndarray) -> plt.Figure:
    """Draw the paper's two scatter plots, once for each kind of features.

    Args:
        planes: {kind: {"two components" or the name of a t-SNE: points (n, 2)}}.
        labels: (n,) the set of each point.
    """
    plots.style()
    figure, axes = plt.subplots(len(planes), 2, figsize=(9, 3.9 * len(planes)), squeeze=False)
    for (left, right), (kind, maps) in zip(axes, planes.items(), strict=True):
        scatter(left, maps["two components"], labels)
        left.set(title=f"PCA, {KINDS[kind]}", xlabel="first component", ylabel="second component")
        scatter(right, maps[tsne_name(*MAPS[0])], labels)
        right.set(title=f"t-SNE, {KINDS[kind]}", xticks=[], yticks=[])
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, ncols=4, loc="outside lower center", markerscale=2)
    return figure


def draw_distances(recorded: dict[str, Any]) -> plt.Figure:
    """Draw one panel for each measure, and one row of panels for each kind of features.

    A line is a set with its interval. Its mark is filled where the set is as it was made.
    """
    plots.style()
    rows = {(row["features"], row["set"]): row for row in recorded["rows"]}
    kinds = list(dict.fromkeys(kind for kind, _ in rows))
    names = list(dict.fromkeys(name for _, name in rows))[::-1]
    size = (12, 0.7 + 2.8 * len(kinds))
    figure, axes = plt.subplots(
        len(kinds), len(MEASURES), figsize=size, sharex="col", sharey=True, squeeze=False
    )
    for panels, kind in zip(axes, kinds, strict=True):
        for ax, key in zip(panels, MEASURES, strict=True):
            for y, name in enumerate(names):
                _draw_distance(ax, y, rows[kind, name], key)
            ax.grid(axis="x", alpha=0.3)
        panels[0].set_yticks(range(len(names)), [short_label(name) for name in names])
        panels[0].set_ylabel(KINDS[kind], fontweight="bold")
        panels[2].axvline(0.5, color="grey", linestyle=":", linewidth=1)
    for ax, title in zip(axes[0], MEASURES.values(), strict=True):
        ax.set_title(title)
    axes[0, 2].set_xlim(0.2, 1.03)
    axes[0, 3].set_xlim(-0.04, 1.04)
    return figure


def _draw_distance(ax: plt.Axes, y: int, row: dict[str, Any], key: str) -> None:
    """Draw one measure of one set at height `y`."""
    base, _, version = row["set"].partition(" ")
    _, colour, marker = SETS[base]
    fill = "white" if version else colour
    ax.plot(row[f"{key}_ci95"], [y, y], color=colour, linewidth=1.5)
    ax.plot(row[key], y, marker, color=colour, markersize=5, markerfacecolor=fill)
