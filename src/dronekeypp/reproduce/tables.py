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
from dronekeypp.evaluate import BOP_MEASURES, FLIGHT_MEASURES, MEASURES, interval_of_row
from dronekeypp.files import write_beside
from dronekeypp.reproduce import without_flights
from dronekeypp.reproduce.flights import Name, has_flights, shared_values

TEST_SCENES = (6, 7)
# The metrics of the paper's tables: name, our measure, the paper's, digits. How its translation MAE is read:
# see evaluate/errors.py.
PRINTED = (
    ("R MAE (deg)", "R_mae_deg", "R_deg_MAE", 2),
    ("R MedAE (deg)", "R_medae_deg", "R_deg_MedAE", 2),
    ("t per-axis MAE (m)", "t_axis_mae_m", "t_m_MAE", 3),
    ("t MAE (m)", "t_mae_m", None, 3),
    ("t MedAE (m)", "t_medae_m", "t_m_MedAE", 3),
)

PER_AXIS_READING = (
    "the paper's MAE fits a per-axis mean for DroneKey++ and DronePose, where it lies below the median by "
    "about √3, and does not for DroneKey and YOLOv8n-pose + PnP, where it lies above."
)
MEDIANS = ("R_medae_deg", "t_medae_m")
# Rows with intervals have them on means. A median of a column has none: frames of a flight resemble each
# other, and only flights are drawn. The mean over flights of a flight's median stands beside, with its own.
OF_FLIGHTS = "_of_flights"
FLIGHT_MEDIANS = (
    ("R, a flight's median (deg)", "R_medae_deg" + OF_FLIGHTS, None, 2),
    ("t, a flight's median (m)", "t_medae_m" + OF_FLIGHTS, None, 3),
)
FIELD = tuple(key for key in BOP_MEASURES if key.endswith("recall"))  # of ADD, MSSD and MSPD
HIGHER_IS_BETTER = ("class_accuracy", "pck", *FIELD)
LISTS = {"test": "rows", "val": "validation"}  # the rows of a result by split

# --- rows of a recorded result ----------------------------------------------------------------------------


def title(method: str, variant: str | None) -> str:
    """Return the name of a row, as people read it."""
    return f"{method} ({variant})" if variant else method


def methods(recorded: dict[str, Any]) -> list[Name]:
    """Return (method, variant) of every row of a recorded result, in its order."""
    return list(dict.fromkeys((row["method"], row["variant"]) for row in recorded["rows"]))


def drones(recorded: dict[str, Any], split: str = "test") -> list[str]:
    """Return the drones of a recorded result, in class order.

    A data set with other drones does not change how the recorded tables of seven are read.
    """
    return list(dict.fromkeys(row["drone"] for row in recorded[LISTS[split]]))


def columns(recorded: dict[str, Any], split: str = "test") -> list[tuple[int, str]]:
    """Return (scene, drone) of our columns: scene by scene, with the drones in class order."""
    scenes = sorted({row["scene"] for row in recorded[LISTS[split]]})
    return list(itertools.product(scenes, drones(recorded, split)))


def over_seeds(rows: Sequence[dict[str, Any]], key: str) -> float:
    """Return the mean of a measure over the rows given (the seeds of one cell).

    It is NaN where it was not measured.
    """
    values = [row[key] for row in rows if row.get(key) is not None]
    return float(np.mean(values)) if values else float("nan")


def cells(
    recorded: dict[str, Any], method: str, variant: str | None, key: str, split: str = "test"
) -> list[float]:
    """Return a measure of one row in each of `columns`, and their mean.

    A value is NaN where there is no such frame.
    """
    by_column: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for row in recorded[LISTS[split]]:
        if (row["method"], row["variant"]) == (method, variant):
            by_column.setdefault((row["scene"], row["drone"]), []).append(row)
    values = [over_seeds(by_column.get(column, []), key) for column in columns(recorded, split)]
    mean = float("nan") if np.isnan(values).all() else float(np.nanmean(values))
    return [*values, mean]


def by_seed(
    recorded: dict[str, Any], method: str, variant: str | None, key: str, split: str = "test"
) -> list[float]:
    """Return the mean over the columns of every seed by itself, in the seeds' order.

    Seeds that did not measure it are left out.
    """
    rows_of: dict[int, list[dict[str, Any]]] = {}
    for row in recorded[LISTS[split]]:
        rows_of.setdefault(row["seed"], []).append(row)
    means = []
    for seed in sorted(rows_of):
        mean = cells({LISTS[split]: rows_of[seed]}, method, variant, key, split)[-1]
        if not np.isnan(mean):
            means.append(mean)
    return means


def average(
    recorded: dict[str, Any], method: str, variant: str | None, split: str = "test"
) -> dict[str, Any]:
    """Return every measure of a row, averaged over the seeds and the columns.

    A measure is None where it was not predicted. KEY_ci95 is the 95 % interval of a mean, over flights and
    seeds. A median over a column has none: KEY_of_flights is the mean over flights of a flight's median, and
    KEY_of_flights_ci95 its interval.
    """
    result: dict[str, Any] = {}
    for key in (*MEASURES, *FIELD):
        *values, mean = cells(recorded, method, variant, key, split)
        result[key] = None if np.isnan(mean) else mean
        if not has_flights(recorded):
            limits = without_flights.interval_of_sequences(values)
            result |= {f"{key}_ci95": limits} if limits else {}
    return result | _flight_intervals(recorded, (method, variant), split)


def _flight_intervals(recorded: dict[str, Any], name: Name, split: str) -> dict[str, Any]:
    """Return what `average` adds from the flights of a row; nothing where there are none."""
    result: dict[str, Any] = {}
    for key in FLIGHT_MEASURES if has_flights(recorded) else ():
        for values in shared_values(recorded, [name], key, split):
            shown = key
            if key in MEDIANS:
                shown = key + OF_FLIGHTS
                result[shown] = float(values.mean())
            result[f"{shown}_ci95"] = interval_of_row(values)
    return result


def with_intervals(recorded: dict[str, Any]) -> tuple:
    """Return the columns of a table of rows with intervals, like PRINTED."""
    return PRINTED + FLIGHT_MEDIANS if has_flights(recorded) else PRINTED


def interval_note(recorded: dict[str, Any]) -> str:
    """Say what is drawn for the intervals of rows."""
    if not has_flights(recorded):
        return without_flights.INTERVAL_NOTE
    return (
        "The interval of a mean draws flights and seeds. A median over a column has none; the mean over "
        "flights of a flight's median stands beside, with its own."
    )


def seeds_of(recorded: dict[str, Any], name: Name) -> int:
    """Return the number of seeds behind a row."""
    return len({row["seed"] for row in recorded["rows"] if (row["method"], row["variant"]) == name})


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
    edition = f"edition {data['edition']}, " if "edition" in data else ""
    budget = ", ".join(f"{key}={value}" for key, value in recorded["budget"].items())
    return (
        f"Preset `{recorded['preset']}`, {edition}{data['train_frames']:,} training frames, "
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

    A line shows our mean with its 95 % interval, every seed, and the paper's value. A median over a column
    has no interval, see `average`.

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
        label = "measured here, 95 % interval"
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
