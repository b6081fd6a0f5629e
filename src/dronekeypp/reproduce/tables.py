"""Provide what the tables share: rows averaged over seeds and sequences, text cells and panels."""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dronekeypp import plots
from dronekeypp.evaluate import MEASURES, interval_of_mean
from dronekeypp.files import write_beside

TEST_SCENES = (6, 7)
# The metrics of the paper's tables: name, our measure, the paper's, digits. The paper's translation MAE fits
# a per-axis mean (see evaluate/errors.py).
PRINTED = (
    ("R MAE (deg)", "R_mae_deg", "R_deg_MAE", 2),
    ("R MedAE (deg)", "R_medae_deg", "R_deg_MedAE", 2),
    ("t per-axis MAE (m)", "t_axis_mae_m", "t_m_MAE", 3),
    ("t MAE (m)", "t_mae_m", None, 3),
    ("t MedAE (m)", "t_medae_m", "t_m_MedAE", 3),
)

Name = tuple[str, str | None]  # of a row: its method, and its variant or None

# --- rows of a recorded result ----------------------------------------------------------------------------


def title(method: str, variant: str | None) -> str:
    """Return the name of a row, as people read it."""
    return f"{method} ({variant})" if variant else method


def methods(recorded: dict[str, Any]) -> list[Name]:
    """Return (method, variant) of every row of a recorded result, in its order."""
    return list(dict.fromkeys((row["method"], row["variant"]) for row in recorded["rows"]))


def drones(recorded: dict[str, Any]) -> list[str]:
    """Return the drones of a recorded result, in class order.

    A data set with other drones does not change how the recorded tables of seven are read.
    """
    return list(dict.fromkeys(row["drone"] for row in recorded["rows"]))


def columns(recorded: dict[str, Any]) -> list[tuple[int, str]]:
    """Return (scene, drone) of our columns: scene 6, then scene 7, with the drones in class order."""
    return list(itertools.product(TEST_SCENES, drones(recorded)))


def over_seeds(rows: Sequence[dict[str, Any]], key: str) -> float:
    """Return the mean of a measure over the rows given (the seeds of one cell).

    It is NaN where it was not measured.
    """
    values = [row[key] for row in rows if row.get(key) is not None]
    return float(np.mean(values)) if values else float("nan")


def cells(recorded: dict[str, Any], method: str, variant: str | None, key: str) -> list[float]:
    """Return a measure of one row in each of `columns`, and their mean.

    A value is NaN where there is no such frame.
    """
    by_column: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for row in recorded["rows"]:
        if (row["method"], row["variant"]) == (method, variant):
            by_column.setdefault((row["scene"], row["drone"]), []).append(row)
    values = [over_seeds(by_column.get(column, []), key) for column in columns(recorded)]
    mean = float("nan") if np.isnan(values).all() else float(np.nanmean(values))
    return [*values, mean]


def by_seed(recorded: dict[str, Any], method: str, variant: str | None, key: str) -> list[float]:
    """Return the mean over the columns of every seed by itself, in the seeds' order.

    Seeds that did not measure it are left out.
    """
    rows_of: dict[int, list[dict[str, Any]]] = {}
    for row in recorded["rows"]:
        rows_of.setdefault(row["seed"], []).append(row)
    means = []
    for seed in sorted(rows_of):
        mean = cells({"rows": rows_of[seed]}, method, variant, key)[-1]
        if not np.isnan(mean):
            means.append(mean)
    return means


def average(recorded: dict[str, Any], method: str, variant: str | None) -> dict[str, Any]:
    """Return every measure of a row, averaged over the seeds and the columns.

    A measure is None where it was not predicted. KEY_ci95 is its 95 % interval over the columns.
    """
    result: dict[str, Any] = {}
    for key in MEASURES:
        *values, mean = cells(recorded, method, variant, key)
        result[key] = None if np.isnan(mean) else mean
        if np.isfinite(values).all():
            result[f"{key}_ci95"] = interval_of_mean(values)
    return result


# --- text -------------------------------------------------------------------------------------------------


def number(value: float | None, digits: int) -> str:
    """Write a number with so many digits, or a dash where there is none."""
    return "–" if value is None or np.isnan(value) else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """Write a share in per cent, or a dash where there is none."""
    return "–" if value is None or np.isnan(value) else f"{100 * value:.1f} %"


def interval(row: dict[str, Any], key: str, digits: int) -> str:
    """Write a value as "12.34 [10.00, 15.00]", or without the brackets where it has no interval."""
    text = number(row[key], digits)
    limits = row.get(f"{key}_ci95")
    if not limits:
        return text
    low, high = limits
    return f"{text} [{number(low, digits)}, {number(high, digits)}]"


def line(cells: Sequence[str]) -> str:
    """Return one line of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def count_seeds(recorded: dict[str, Any]) -> str:
    """Write the number of seeds as "3 seeds", or as "1 to 3 seeds" where the rows differ."""
    seeds_of: dict[Name, set[int]] = {}
    for run in recorded["runs"]:
        seeds_of.setdefault((run["method"], run["variant"]), set()).add(run["seed"])
    counts = [len(seeds) for seeds in seeds_of.values()]
    fewest, most = min(counts), max(counts)
    text = f"{most}" if fewest == most else f"{fewest} to {most}"
    return f"{text} seeds" if most > 1 else f"{text} seed"


def heading(recorded: dict[str, Any]) -> str:
    """Say in a sentence or two what a recorded table was made with."""
    data = recorded["dataset"]
    budget = ", ".join(f"{key}={value}" for key, value in recorded["budget"].items())
    return (
        f"Preset `{recorded['preset']}`, {data['train_frames']:,} training frames, "
        f"{data['test_frames']:,} test frames, {count_seeds(recorded)}, {recorded['hardware']}. "
        f"Budget: {budget or 'as in the preset'}."
    )


# --- figures ----------------------------------------------------------------------------------------------


def panels(
    recorded: dict[str, Any],
    names: Sequence[Name],
    labels: Sequence[str],
    paper: Callable[[Name, str], float | None],
) -> plt.Figure:
    """Draw one panel for each metric, with one line for each row.

    A line shows our mean with its 95 % interval over the sequences, every seed, and the paper's value.

    Args:
        recorded: the result.
        names: the rows that are shown, from top to bottom.
        labels: how they are called.
        paper: a function; `paper(name, key)` is the printed value of a row in one of our keys, or None.
    """
    plots.style()
    figure, axes = plt.subplots(1, len(PRINTED), figsize=(12, 1.2 + 0.34 * len(names)), sharey=True)
    places = np.arange(len(names))[::-1]
    for ax, (metric, key, _, _) in zip(axes, PRINTED, strict=True):
        for y, name in zip(places, names, strict=True):
            row, seeds = average(recorded, *name), by_seed(recorded, *name, key)
            _panel_line(ax, y, row, key, seeds, paper(name, key))
        ax.set(title=metric, xlim=(0, None), ylim=(-0.6, len(names) - 0.4))
        ax.grid(axis="x", alpha=0.3)
    axes[0].set_yticks(places, labels)
    entries = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            entries[label] = handle
    figure.legend(entries.values(), entries.keys(), ncols=len(entries), loc="outside lower center")
    return figure


def _panel_line(
    ax: plt.Axes,
    y: float,
    row: dict[str, Any],
    key: str,
    seeds: Sequence[float],
    printed: float | None,
) -> None:
    """Draw one row of a panel at height `y`."""
    if row[key] is not None:
        limits = row.get(f"{key}_ci95") or (row[key], row[key])
        ax.plot(limits, [y, y], color="#0072B2", linewidth=1.5)
        label = "measured here, 95 % interval over the sequences"
        ax.plot(row[key], y, "o", color="#0072B2", markersize=5, label=label)
    if len(seeds) > 1:
        ax.plot(seeds, [y] * len(seeds), "|", color="black", markersize=7, label="each seed")
    if printed is not None:
        style = {"color": "#D55E00", "markersize": 5, "markerfacecolor": "none"}
        ax.plot(printed, y, "D", label="paper, its data", **style)


def write_figure(path: Path, figure: plt.Figure) -> None:
    """Write the figure as PNG beside `path`, rename it, and close the figure."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    plt.close(figure)
    write_beside(path, content.getvalue())
