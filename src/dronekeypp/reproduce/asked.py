"""Keep account of how often the test scenes were asked.

The test scenes are asked once for a recorded result. Where a training is made again, with other weights, and
measured on the same scenes, the record of the new run carries the averages of the older ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dronekeypp.reproduce.results import read_recorded

# What is kept of an earlier answer.
KEPT = ("R_mae_deg", "R_medae_deg", "t_axis_mae_m", "t_mae_m", "t_medae_m", "class_accuracy")


def run_key(run: dict[str, Any]) -> tuple:
    """Return what tells a run from others of one table.

    `trained` is set only where a table trains one run on several data sets.
    """
    return run["method"], run["variant"], run["seed"], run.get("trained")


def with_earlier(recorded: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return a result with what the file that it replaces knows of earlier answers.

    A run that the file holds with other weights is put into the list `earlier` of the new run's record. A run
    that the new result does not hold, or not yet, is kept in the result's own list `earlier`. A file of other
    test scenes, and one that does not name weights, know nothing.

    Args:
        recorded: the new result.
        path: the file that it will replace; it may be missing.
    """
    before = read_recorded(path) if path.is_file() else {}
    known = known_answers(before) if digests(before) == digests(recorded) else []
    runs = []
    for run in recorded["runs"]:
        own = [entry for entry in known if run_key(entry) == run_key(run)]
        own = [entry for entry in own if entry["weights"] != run.get("weights")]
        runs.append({**run, "earlier": own} if own else run)
    present = {run_key(run) for run in runs}
    rest = [entry for entry in known if run_key(entry) not in present]
    return {**recorded, "runs": runs, **({"earlier": rest} if rest else {})}


def digests(recorded: dict[str, Any]) -> list[str]:
    """Return the digests of the data sets that a result was measured on."""
    sets = [recorded.get("dataset", {}), *recorded.get("datasets", {}).values()]
    return [data.get("digest", "") for data in sets]


def known_answers(recorded: dict[str, Any]) -> list[dict[str, Any]]:
    """Return every answer that a result knows, its own included, each training once.

    A result without averages never asked the test scenes.
    """
    if "averages" not in recorded:
        return []
    answers = list(recorded.get("earlier", []))
    for run in recorded.get("runs", []):
        answers += run.get("earlier", [])
        if run.get("weights"):
            answers.append(answer_of(run, recorded["averages"]))
    unique = {}
    for answer in answers:
        unique[(*run_key(answer), answer["weights"])] = answer
    return list(unique.values())


def answer_of(run: dict[str, Any], averages: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return what is kept of a run: what it is, its weights, and the averages over its columns."""
    kept = []
    for row in averages:
        own = (row["method"], row["seed"]) == (run["method"], run["seed"]) and row["variant"] in run["rows"]
        if own and row["over"] == "rows":
            labels = {"method": row["method"], "variant": row["variant"]}
            kept.append(labels | {key: row[key] for key in KEPT})
    fields = ("method", "variant", "seed", "trained", "weights", "epochs", "minutes")
    return {key: run[key] for key in fields if key in run} | {"averages": kept}
