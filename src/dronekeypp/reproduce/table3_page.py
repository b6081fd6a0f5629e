"""Show Table 3 as a page, as CSV and as a figure, in the paper's layout and with the paper's values.

The page also says what each baseline lacks against the paper that it comes from.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dronekeypp.baselines import yolo
from dronekeypp.reproduce.comparisons import closing_lines, differences_to
from dronekeypp.reproduce.field import field_lines
from dronekeypp.reproduce.flights import Name
from dronekeypp.reproduce.headings import gain_lines
from dronekeypp.reproduce.results import PAPER
from dronekeypp.reproduce.table3_runs import GAINS, OURS
from dronekeypp.reproduce.tables import (
    PER_AXIS_READING,
    PRINTED,
    TEST_SCENES,
    average,
    cells,
    columns,
    drones,
    heading,
    interval,
    interval_note,
    line,
    methods,
    number,
    panels,
    percent,
    title,
    with_intervals,
)

# What each baseline lacks against the paper that it comes from.
LACKS = {
    "DroneKey": (
        "its own loss, a Mahalanobis distance that adapts to the pose. It is trained on the L_2D of "
        "DroneKey++. It has its prior: PnP is told which drone it is, and so how large."
    ),
    "DronePose": (
        "its silhouette loss, which renders the drone's mesh. The paper had neither its mesh nor its "
        "data, and trains rotation and translation by MSE instead. So do we."
    ),
    yolo.METHOD: (
        "the weights from COCO that it is usually started from. It is trained from scratch on our crops, in "
        "its own loop. The paper does not say what its detector was started from."
    ),
}


def paper_cells(method: str, key: str, names: Sequence[str] = ()) -> list[float] | None:
    """Return the paper's columns of the drones `names`, and then its printed average.

    A column that the paper does not have is NaN. A method that the paper does not have gives None.
    """
    printed = PAPER["table3"].get(method, {}).get(key)
    if printed is None:
        return None
    values = []
    for scene in TEST_SCENES:
        values += [printed[f"scene_{scene:02d}"].get(drone, np.nan) for drone in names]
    return [*values, printed["average_printed"]]


def paper_row(name: Name, key: str | None, names: Sequence[str] = ()) -> list[float] | None:
    """Return `paper_cells` for a row of ours.

    The answer is None where the paper has no such row, or no such measure.
    """
    method, variant = name
    if variant is not None or key is None:
        return None
    return paper_cells(method, key, names)


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """Draw one panel for each metric, with our average and its interval, and the paper's value."""
    printed_key = {ours: theirs for _, ours, theirs, _ in PRINTED}
    names = methods(recorded)

    def paper_average(name: Name, key: str) -> float | None:
        values = paper_row(name, printed_key[key])
        return values[-1] if values else None

    return panels(recorded, names, [title(*name) for name in names], paper_average)


def markdown(recorded: dict[str, Any]) -> str:
    """Return the table in the paper's layout, and then what the paper does not print.

    The layout is methods by metrics, with 14 columns and the average, and the paper's value above ours.
    """
    minutes: dict[str, float] = {}
    for run in recorded["runs"]:
        minutes.setdefault(title(run["method"], run["variant"]), run["minutes"])
    spent = ", ".join(f"{name} {value:g}" for name, value in minutes.items())
    places = [f"{scene}·{drone}" for scene, drone in columns(recorded)]
    shown_columns = with_intervals(recorded)
    lines = [
        "# Table 3: test scenes 6 and 7",
        "",
        f"{heading(recorded)} Minutes of training: {spent}.",
        "",
        "`paper` is the printed value, `ours` what we measured on our own 6DroneSyn: other renderings, other "
        "flights, so compare the order of the methods rather than single cells. The paper's t MAE stands "
        f"beside ours per axis, and ours as a distance below it: {PER_AXIS_READING}",
        "",
        "| method | metric | | " + " | ".join(places) + " | average |",
        "|---|---|---|" + "---:|" * (len(places) + 1),
    ]
    for name in methods(recorded):
        for metric, ours, theirs, digits in PRINTED:
            printed = paper_row(name, theirs, drones(recorded))
            sources = {"paper": printed} if printed else {}
            sources["ours"] = cells(recorded, *name, ours)
            for source, values in sources.items():
                shown = [number(value, digits) for value in values]
                lines.append(line([title(*name), metric, source, *shown]))
    lines += [
        "",
        "## Averages, with 95 % intervals",
        "",
        f"Mean of the {len(places)} columns. {interval_note(recorded)}",
        "",
        line(
            [
                "method",
                *(metric for metric, *_ in shown_columns),
                *("class", "keypoints (px)", "PCK@0.05", "heading flips", "no pose"),
            ]
        ),
        "|---|" + "---:|" * (len(shown_columns) + 5),
    ]
    for name in methods(recorded):
        row = average(recorded, *name)
        shown = [interval(row, key, digits) for _, key, _, digits in shown_columns]
        shown += [percent(row["class_accuracy"]), number(row["keypoint_px"], 1)]
        shown += [percent(row[key]) for key in ("pck", "flip_rate", "failed")]
        lines.append(line([title(*name), *shown]))
    lines += field_lines(recorded, methods(recorded)) + lack_lines(recorded)
    others = [name for name in methods(recorded) if name != OURS]
    differences, verdicts = differences_to(recorded, OURS, others, OURS[0])
    lines += differences + gain_lines(recorded, GAINS) + closing_lines(recorded, verdicts)
    return "\n".join(lines) + "\n"


def lack_lines(recorded: dict[str, Any]) -> list[str]:
    """Return the lines that say what the measured baselines lack."""
    lines = ["", "## What the baselines lack against their own papers", ""]
    for method in dict.fromkeys(method for method, _ in methods(recorded)):
        if method in LACKS:
            lines.append(f"- {method} lacks {LACKS[method]}")
    return lines


def as_csv(recorded: dict[str, Any]) -> str:
    """Return the table as CSV in long format.

    Its columns are method, variant, metric, source (paper | ours), scene, drone and value. The scene of the
    last column is "average".
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "variant", "metric", "source", "scene", "drone", "value"])
    places = [*columns(recorded), ("average", "")]
    for method, variant in methods(recorded):
        for _, ours, theirs, _ in PRINTED:
            sources = {"ours": cells(recorded, method, variant, ours)}
            printed = paper_row((method, variant), theirs, drones(recorded))
            if printed:
                sources["paper"] = printed
            for source, values in sources.items():
                for (scene, drone), value in zip(places, values, strict=True):
                    shown = "" if np.isnan(value) else f"{value:.6g}"
                    writer.writerow([method, variant or "", ours, source, scene, drone, shown])
    return text.getvalue()
