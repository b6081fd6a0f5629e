"""Show an ablation as a table in words and numbers, and as a figure.

The module also says when a row may be called better than another.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dronekeypp.evaluate import interval_of_mean
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce.results import PAPER
from dronekeypp.reproduce.tables import (
    PRINTED,
    Name,
    average,
    by_seed,
    cells,
    columns,
    heading,
    line,
    methods,
    number,
    panels,
    percent,
)

METHOD = DroneKeyPP.method
TITLES = [metric for metric, *_ in PRINTED]


def paper_value(name: str, variant: str | None, key: str) -> float | None:
    """Return the paper's number in one of PRINTED's keys, or None where it has no such row or column."""
    keys = [ours for _, ours, theirs, _ in PRINTED if theirs]
    printed = PAPER.get(name, {}).get(variant)
    return printed[keys.index(key)] if printed and key in keys else None


# --- one row against another ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Difference:
    """Describe a row's measure minus the reference's.

    Args:
        mean: the mean over the sequences, with the seeds averaged.
        interval: its 95 % interval over the sequences.
        seeds: (n, m), every seed of the row (first axis) against every seed of the reference.
    """

    mean: float
    interval: tuple[float, float]
    seeds: np.ndarray

    @property
    def verdict(self) -> str:
        """Say "better" or "worse" only if the interval leaves out 0 and all seeds lie on one side of 0.

        With fewer than three seeds in either row a question mark stays. All our measures are errors, so less
        is better.
        """
        if self.interval[0] <= 0 <= self.interval[1] or len(np.unique(np.sign(self.seeds))) > 1:
            return "not told apart"
        word = "better" if self.mean < 0 else "worse"
        return word if min(self.seeds.shape) >= 3 else f"{word}?"


def difference(recorded: dict[str, Any], variant: str, key: str) -> Difference | None:
    """Compare a row with the reference, sequence by sequence; return None if either was not measured."""
    reference = recorded["reference"]
    ours = cells(recorded, METHOD, variant, key)[:-1]
    theirs = cells(recorded, METHOD, reference, key)[:-1]
    apart = np.subtract(ours, theirs)
    if not np.isfinite(apart).all():
        return None
    low, high = interval_of_mean(apart)
    our_seeds = np.array(by_seed(recorded, METHOD, variant, key))
    their_seeds = np.array(by_seed(recorded, METHOD, reference, key))
    return Difference(float(apart.mean()), (low, high), np.subtract.outer(our_seeds, their_seeds))


def difference_text(recorded: dict[str, Any], variant: str, key: str, digits: int) -> str:
    """Write a difference as "-1.23 [-2.34, -0.12] better".

    A dash stands where either of the two was not measured.
    """
    apart = difference(recorded, variant, key)
    if apart is None:
        return "–"
    low, high = apart.interval
    return f"{apart.mean:+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}] {apart.verdict}"


def mean_and_spread(recorded: dict[str, Any], variant: str, key: str, digits: int) -> str:
    """Write the mean and the standard deviation over the seeds as "16.5 ± 0.4".

    A single seed has no spread. A dash stands where no seed measured it.
    """
    values = by_seed(recorded, METHOD, variant, key)
    if not values:
        return "–"
    text = number(float(np.mean(values)), digits)
    return f"{text} ± {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else text


# --- the table --------------------------------------------------------------------------------------------


def markdown(recorded: dict[str, Any], title: str) -> str:
    """Return the ablation's tables as Markdown.

    The first table is the paper's with ours beside it. The second compares every row with the reference. The
    third shows the decoders on true keypoints.
    """
    minutes = [run["minutes"] for run in recorded["runs"]]
    with_spread = any(run["seed"] for run in recorded["runs"])
    note = f"Mean of the {len(columns(recorded))} columns of Table 3"
    if with_spread:
        note += " ± standard deviation over the seeds (without it: one seed)"
    if recorded["name"] in PAPER:
        note += ". The paper's value, on its own data, in brackets"
    lines = [
        f"# {title}",
        "",
        f"{heading(recorded)} {len(minutes)} trainings of {min(minutes):g} to {max(minutes):g} minutes.",
        "",
        f"{note}.",
        "",
        "| | " + " | ".join(TITLES) + " | direction (deg) | class | keypoints (px) |",
        "|---|" + "---:|" * (len(PRINTED) + 3),
    ]
    for _, variant in methods(recorded):
        row, shown = average(recorded, METHOD, variant), []
        for _, key, _, digits in PRINTED:
            printed = paper_value(recorded["name"], variant, key)
            text = mean_and_spread(recorded, variant, key, digits)
            shown.append(text if printed is None else f"{text} ({number(printed, digits)})")
        shown.append(number(row["direction_deg"], 2))
        shown.append(percent(row["class_accuracy"]))
        shown.append(number(row["keypoint_px"], 1))
        lines.append(line([variant, *shown]))
    lines += against_the_reference(recorded) + given_true_keypoints(recorded)
    return "\n".join(lines) + "\n"


def against_the_reference(recorded: dict[str, Any]) -> list[str]:
    """Return the lines of the second table, or none while the reference was not measured."""
    reference = recorded["reference"]
    variants = [variant for _, variant in methods(recorded)]
    if reference not in variants:
        return []
    lines = [
        "",
        f"## Against “{reference}”",
        "",
        "Difference of the errors, seeds averaged, with its 95 % interval over the sequences. *Better* or "
        "*worse*: the interval leaves out 0 and every seed is on the same side of every seed of the "
        "reference; with fewer than three a question mark stays.",
        "",
        "| | " + " | ".join(TITLES) + " |",
        "|---|" + "---|" * len(PRINTED),
    ]
    for variant in variants:
        if variant != reference:
            shown = [difference_text(recorded, variant, key, digits) for _, key, _, digits in PRINTED]
            lines.append(line([variant, *shown]))
    return lines


def given_true_keypoints(recorded: dict[str, Any]) -> list[str]:
    """Return the lines of the third table, or none where no decoder takes keypoints alone."""
    medians_of = {}
    for run in recorded["runs"]:
        if run["seed"] == 0 and "keypoints" in run:
            medians_of[run["variant"]] = run["keypoints"]
    if not medians_of:
        return []
    lines = [
        "",
        "## Given the true keypoints",
        "",
        "Medians over all test frames, seed 0. The class is the one it named itself.",
        "",
        "| | R, own keypoints (deg) | R, true | t, own (m) | t, true | distance off, own "
        "| distance off, true |",
        "|---|" + "---:|" * 6,
    ]
    for variant, medians in medians_of.items():
        own, true = medians["its own"], medians["true"]
        shown = [number(own["R_deg"], 1), number(true["R_deg"], 1)]
        shown += [number(own["t_m"], 3), number(true["t_m"], 3)]
        shown += [percent(own["distance"]), percent(true["distance"])]
        lines.append(line([variant, *shown]))
    return lines


def as_csv(recorded: dict[str, Any]) -> str:
    """Return the table as CSV in long format.

    Its columns are variant, metric, source (paper | ours), seed (empty for the paper's) and value.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["variant", "metric", "source", "seed", "value"])
    for _, variant in methods(recorded):
        for _, key, _, _ in PRINTED:
            for seed, value in enumerate(by_seed(recorded, METHOD, variant, key)):
                writer.writerow([variant, key, "ours", seed, f"{value:.6g}"])
            printed = paper_value(recorded["name"], variant, key)
            if printed is not None:
                writer.writerow([variant, key, "paper", "", f"{printed:.6g}"])
    return text.getvalue()


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """Draw one panel for each metric, with one line for each row."""
    names = methods(recorded)
    labels = [variant for _, variant in names]

    def printed(name: Name, key: str) -> float | None:
        return paper_value(recorded["name"], name[1], key)

    return panels(recorded, names, labels, printed)
