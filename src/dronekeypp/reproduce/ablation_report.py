"""Show an ablation as a table in words and numbers, and as a figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dronekeypp.evaluate import Difference
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce import comparisons, without_flights
from dronekeypp.reproduce.comparisons import closing_lines, difference_text
from dronekeypp.reproduce.flights import Name, has_flights
from dronekeypp.reproduce.headings import Pair, gain_lines
from dronekeypp.reproduce.results import PAPER
from dronekeypp.reproduce.tables import (
    PRINTED,
    average,
    by_seed,
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


def difference(recorded: dict[str, Any], variant: str, key: str, split: str = "val") -> Difference | None:
    """Compare a row with the reference, on the validation scenes; see `comparisons.difference`."""
    names = (METHOD, variant), (METHOD, recorded["reference"])
    return comparisons.difference(recorded, *names, key, split)


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


def markdown(recorded: dict[str, Any], title: str, gains: Sequence[Pair] = ()) -> str:
    """Return the ablation's tables as Markdown, as `ablations.markdown` does.

    Args:
        recorded: the result.
        title: the question that the ablation asks.
        gains: pairs of rows, the first of whose gain over the second is split by heading.
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
    against, verdicts = against_the_reference(recorded)
    lines += against + given_true_keypoints(recorded) + gain_lines(recorded, gains)
    lines += closing_lines(recorded, verdicts)
    return "\n".join(lines) + "\n"


def against_the_reference(recorded: dict[str, Any]) -> tuple[list[str], int]:
    """Return the lines of the second table and the number of its verdicts.

    There are none while the reference was not measured.
    """
    reference = recorded["reference"]
    variants = [variant for _, variant in methods(recorded)]
    if reference not in variants:
        return [], 0
    note = without_flights.NOTE
    if has_flights(recorded):
        note = (
            f"Validation scenes, where choices are made: a row less the reference, {comparisons.OF_FLIGHTS}. "
            "Beside it the same difference on the test scenes, without a word."
        )
    lines = [
        "",
        f"## Against “{reference}”",
        "",
        note,
        "",
        "| | " + " | ".join(TITLES) + " |",
        "|---|" + "---|" * len(PRINTED),
    ]
    verdicts = 0
    for variant in variants:
        if variant != reference:
            shown = []
            for _, key, _, digits in PRINTED:
                apart = difference(recorded, variant, key)
                verdicts += apart is not None
                text = difference_text(apart, digits)
                if has_flights(recorded):
                    on_test = difference(recorded, variant, key, "test")
                    text += f"; test {difference_text(on_test, digits, with_verdict=False)}"
                shown.append(text)
            lines.append(line([variant, *shown]))
    return lines, verdicts


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
