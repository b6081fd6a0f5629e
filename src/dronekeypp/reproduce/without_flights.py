"""Compare rows of a result that was recorded without its flights, by an interval over sequences alone.

The first edition's results are like that. The module goes when the last of them is measured again. Nothing
else makes an interval over sequences.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dronekeypp.evaluate import Difference, interval_of_mean
from dronekeypp.reproduce.flights import Name

NOTE = (
    "Difference of the errors, seeds averaged, with its 95 % interval over the sequences. *Better* or "
    "*worse*: the interval leaves out 0 and every seed is on the same side of every seed of the "
    "reference; with fewer than three a question mark stays."
)
INTERVAL_NOTE = (
    "The interval draws these sequences (scene and drone) with replacement. They are few: an interval this "
    "rough says only whether two methods are far apart. Seeds are averaged first."
)


def shared_sequences(recorded: dict[str, Any], names: Sequence[Name]) -> dict[str, Any]:
    """Return the result with the rows of the sequences (scene and drone) alone that all these rows saw."""
    seen: dict[Name, set] = {name: set() for name in names}
    for row in recorded["rows"]:
        if (row["method"], row["variant"]) in seen:
            seen[row["method"], row["variant"]].add((row["scene"], row["drone"]))
    shared = set.intersection(*seen.values())
    rows = [row for row in recorded["rows"] if (row["scene"], row["drone"]) in shared]
    return {**recorded, "rows": rows}


def difference_of_sequences(
    ours: Sequence[float], theirs: Sequence[float], our_seeds: Sequence[float], their_seeds: Sequence[float]
) -> Difference | None:
    """Return the difference of two rows, or None if either was not measured.

    Args:
        ours, theirs: an error of each row in every sequence (scene and drone), with the seeds averaged.
        our_seeds, their_seeds: the mean over the sequences of every seed.
    """
    apart = np.subtract(ours, theirs)
    if not np.isfinite(apart).all():
        return None
    low, high = interval_of_mean(apart)
    return Difference(float(apart.mean()), (low, high), np.subtract.outer(our_seeds, their_seeds))


def interval_of_sequences(values: Sequence[float]) -> list[float] | None:
    """Return the interval of a row's mean over its sequences, or None where one was not measured."""
    return interval_of_mean(values) if np.isfinite(values).all() else None
