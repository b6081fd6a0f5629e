"""Show what `beyond` measured: its page as Markdown, and its two figures."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

from dronekeypp import plots
from dronekeypp.reproduce.beyond_runs import GEOMETRIC, LEFT_OUT, METHOD
from dronekeypp.reproduce.beyond_uncertainty import HALVES, LEVELS
from dronekeypp.reproduce.comparisons import closing_lines, differences_to
from dronekeypp.reproduce.field import field_lines
from dronekeypp.reproduce.flights import Name, has_flights
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

# --- the table --------------------------------------------------------------------------------------------


def side_by_side(recorded: dict[str, Any]) -> list[Name]:
    """Return the names of the rows that are about all drones."""
    return [name for name in methods(recorded) if name[1] not in LEFT_OUT]


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
        if row["variant"] in LEFT_OUT and row["over"] == "frames":
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
