"""Read the flights of a recorded result: the errors of every row, seed and flight.

The list `flights` has an entry for every method, variant, seed and split. Its values are lists of one length:
scene, drone and subsequence name a flight, and the rest are means and medians over its frames.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Name = tuple[str, str | None]  # of a row: its method, and its variant or None
Flight = tuple[int, str, int]  # scene, drone and subsequence


def has_flights(recorded: dict[str, Any]) -> bool:
    """Tell whether a result was recorded with its flights.

    Those of the first edition were not.
    """
    return bool(recorded.get("flights"))


def values_by_seed(
    recorded: dict[str, Any], name: Name, key: str, split: str
) -> dict[int, dict[Flight, float]]:
    """Return a measure of one row as {seed: {flight: value}}, in the seeds' order.

    A value is NaN where it was not predicted.
    """
    values: dict[int, dict[Flight, float]] = {}
    for entry in recorded["flights"]:
        if (entry["method"], entry["variant"], entry["split"]) == (*name, split):
            flights = zip(entry["scene"], entry["drone"], entry["subsequence"], strict=True)
            numbers = [np.nan if value is None else value for value in entry[key]]
            values.setdefault(entry["seed"], {}).update(zip(flights, numbers, strict=True))
    return dict(sorted(values.items()))


def shared_values(recorded: dict[str, Any], names: list[Name], key: str, split: str) -> list[np.ndarray]:
    """Return a measure of several rows (n, F) each, over the F flights that all of them saw.

    The list is empty where a row was not measured, or where they have no flight in common.
    """
    rows = [values_by_seed(recorded, name, key, split) for name in names]
    seen = [set(flights) for row in rows for flights in row.values()]
    shared = sorted(set.intersection(*seen)) if all(rows) else []
    if not shared:
        return []
    matrices = []
    for row in rows:
        matrices.append(np.array([[flights[flight] for flight in shared] for flights in row.values()]))
    return matrices if all(np.isfinite(matrix).all() for matrix in matrices) else []
