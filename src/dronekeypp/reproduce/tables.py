"""What every table is made of: means over the seeds and the 14 test sequences, their intervals, and one panel a metric."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dronekeypp import plots
from dronekeypp.evaluate import MEASURES, interval_of_mean
from dronekeypp.files import write_beside

TEST_SCENES = (6, 7)
# The metrics of the paper's tables: name, our measure, the paper's, digits. The paper's translation MAE fits a per-axis mean (see evaluate.py).
PRINTED = (
    ("R MAE (deg)", "R_mae_deg", "R_deg_MAE", 2),
    ("R MedAE (deg)", "R_medae_deg", "R_deg_MedAE", 2),
    ("t per-axis MAE (m)", "t_axis_mae_m", "t_m_MAE", 3),
    ("t MAE (m)", "t_mae_m", None, 3),
    ("t MedAE (m)", "t_medae_m", "t_m_MedAE", 3),
)


def title(method: str, variant: str | None) -> str:
    return f"{method} ({variant})" if variant else method


def methods(recorded: dict[str, Any]) -> list[tuple[str, str | None]]:
    """(method, variant) of a recorded result, in its order."""
    return list(dict.fromkeys((row["method"], row["variant"]) for row in recorded["rows"]))


def drones(recorded: dict[str, Any]) -> list[str]:
    """The drones of a recorded result, in class order: whoever has drones of his own still reads the tables of seven."""
    return list(dict.fromkeys(row["drone"] for row in recorded["rows"]))


def over_seeds(rows: Sequence[dict], key: str) -> float:
    """Mean of a measure over the rows given (the seeds of one cell); NaN where it was not measured."""
    values = [row[key] for row in rows if row.get(key) is not None]
    return float(np.mean(values)) if values else float("nan")


def cells(recorded: dict[str, Any], method: str, variant: str | None, key: str) -> list[float]:
    """Our columns (scene 6, then scene 7, `drones` in class order) and their mean; NaN where there is no such frame."""
    mine = [row for row in recorded["rows"] if (row["method"], row["variant"]) == (method, variant)]
    columns = [
        over_seeds([row for row in mine if (row["scene"], row["drone"]) == (scene, drone)], key)
        for scene in TEST_SCENES
        for drone in drones(recorded)
    ]
    return [*columns, float(np.nanmean(columns)) if not np.isnan(columns).all() else float("nan")]


def by_seed(recorded: dict[str, Any], method: str, variant: str | None, key: str) -> list[float]:
    """The mean over the 14 columns of every seed by itself, in the seeds' order; without those that did not measure it."""
    seeds = sorted(
        {row["seed"] for row in recorded["rows"] if (row["method"], row["variant"]) == (method, variant)}
    )
    means = [
        cells({"rows": [row for row in recorded["rows"] if row["seed"] == seed]}, method, variant, key)[-1]
        for seed in seeds
    ]
    return [mean for mean in means if not np.isnan(mean)]


def average(recorded: dict[str, Any], method: str, variant: str | None) -> dict[str, Any]:
    """Every measure averaged over the seeds and the 14 columns, and KEY_ci95: its interval over the columns. None: not predicted."""
    found: dict[str, Any] = {}
    for key in MEASURES:
        *columns, mean = cells(recorded, method, variant, key)
        found[key] = None if np.isnan(mean) else mean
        if np.isfinite(columns).all():
            found[f"{key}_ci95"] = interval_of_mean(columns)
    return found


def number(value: float | None, digits: int) -> str:
    return "–" if value is None or np.isnan(value) else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    return "–" if value is None or np.isnan(value) else f"{100 * value:.1f} %"


def interval(row: dict, key: str, digits: int) -> str:
    """ "12.34 [10.00, 15.00]", or without the brackets where there is no interval."""
    low_high = row.get(f"{key}_ci95")
    text = number(row[key], digits)
    return f"{text} [{', '.join(number(v, digits) for v in low_high)}]" if low_high else text


def panels(
    recorded: dict[str, Any],
    names: Sequence[tuple[str, str | None]],
    labels: Sequence[str],
    paper: Callable[[tuple[str, str | None], str], float | None],
) -> plt.Figure:
    """One panel a metric, one line a row: our mean with its 95 % interval over the sequences, every seed, and the paper's value.

    `paper(name, key)` is the printed value of a row in one of PRINTED' keys, or None.
    """
    plots.style()
    figure, axes = plt.subplots(1, len(PRINTED), figsize=(12, 1.2 + 0.34 * len(names)), sharey=True)
    y = np.arange(len(names))[::-1]
    for ax, (title_, key, _, _) in zip(axes, PRINTED, strict=True):
        for i, name in zip(y, names, strict=True):
            row, seeds, theirs = average(recorded, *name), by_seed(recorded, *name, key), paper(name, key)
            if row[key] is not None:
                low, high = row.get(f"{key}_ci95") or (row[key], row[key])
                ax.plot([low, high], [i, i], color="#0072B2", linewidth=1.5)
                ax.plot(
                    row[key],
                    i,
                    "o",
                    color="#0072B2",
                    markersize=5,
                    label="measured here, 95 % interval over the sequences",
                )
            if len(seeds) > 1:
                ax.plot(seeds, [i] * len(seeds), "|", color="black", markersize=7, label="each seed")
            if theirs is not None:
                ax.plot(
                    theirs,
                    i,
                    "D",
                    color="#D55E00",
                    markersize=5,
                    markerfacecolor="none",
                    label="paper, its data",
                )
        ax.set(title=title_, xlim=(0, None), ylim=(-0.6, len(names) - 0.4))
        ax.grid(axis="x", alpha=0.3)
    axes[0].set_yticks(y, labels)
    entries = {
        label: line for ax in axes for line, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    figure.legend(entries.values(), entries.keys(), ncols=len(entries), loc="outside lower center")
    return figure


def write_figure(path: Path, figure: plt.Figure) -> None:
    """The figure as PNG, written beside and renamed; it is closed."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    plt.close(figure)
    write_beside(path, content.getvalue())


def count_seeds(recorded: dict[str, Any]) -> str:
    """ "3 seeds", or "1 to 3 seeds" where the rows differ."""
    of_rows: dict[tuple, set] = {}
    for story in recorded["runs"]:
        of_rows.setdefault((story["method"], story["variant"]), set()).add(story["seed"])
    fewest, most = min(map(len, of_rows.values())), max(map(len, of_rows.values()))
    return (f"{most}" if fewest == most else f"{fewest} to {most}") + " seed" + "s" * (most > 1)


def heading(recorded: dict[str, Any]) -> str:
    """What a recorded table was made with, in a sentence or two."""
    data = recorded["dataset"]
    return (
        f"Preset `{recorded['preset']}`, {data['train_frames']:,} training frames, {data['test_frames']:,} test frames, {count_seeds(recorded)}, "
        f"{recorded['hardware']}. Budget: {', '.join(f'{k}={v}' for k, v in recorded['budget'].items()) or 'as in the preset'}."
    )
