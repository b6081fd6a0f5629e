"""Compare two rows of a recorded result, and say what a page of such verdicts is worth.

Choices are made on the validation scenes, so the verdicts of ablations come from there. Whole methods are
compared on the test scenes, which are asked once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dronekeypp.evaluate import Difference, compare_rows
from dronekeypp.reproduce import without_flights
from dronekeypp.reproduce.flights import Name, has_flights, shared_values
from dronekeypp.reproduce.tables import HIGHER_IS_BETTER, PRINTED, by_seed, cells, line, title

CHANCE = 20  # one of so many verdicts at 95 % is due to chance
# What a difference is of, and when it has a word. It stands above every table of differences.
OF_FLIGHTS = (
    "of the mean over flights; for MedAE, of the mean over flights of a flight's median. The 95 % interval "
    "draws flights, the same for both rows, and the seeds of each row. *Better* or *worse*: the interval "
    "leaves out 0 and every seed is on the same side of every seed of the other row; with fewer than three "
    "seeds a question mark stays"
)


def difference(
    recorded: dict[str, Any], name: Name, reference: Name, key: str, split: str = "test"
) -> Difference | None:
    """Compare a row with another, flight by flight; return None if either was not measured.

    A result without flights is compared by its sequences of the test scenes, see `without_flights`.

    Args:
        recorded: the result.
        name: the row, as (method, variant).
        reference: the other row.
        key: the measure, one of `evaluate.FLIGHT_MEASURES`. Of a median, the mean over flights of a flight's
            median is compared.
        split: "test" or "val".
    """
    if not has_flights(recorded):
        recorded = without_flights.shared_sequences(recorded, (name, reference))
        ours, theirs = cells(recorded, *name, key)[:-1], cells(recorded, *reference, key)[:-1]
        seeds, their_seeds = by_seed(recorded, *name, key), by_seed(recorded, *reference, key)
        return without_flights.difference_of_sequences(ours, theirs, seeds, their_seeds)
    rows = shared_values(recorded, [name, reference], key, split)
    return compare_rows(*rows, more_is_better=key in HIGHER_IS_BETTER) if rows else None


def difference_text(apart: Difference | None, digits: int, with_verdict: bool = True) -> str:
    """Write a difference as "-1.23 [-2.34, -0.12] better", or a dash where there is none."""
    if apart is None:
        return "–"
    low, high = apart.interval
    text = f"{apart.mean:+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}]"
    return f"{text} {apart.verdict}" if with_verdict else text


def differences_to(
    recorded: dict[str, Any], reference: Name, names: Sequence[Name], label: str
) -> tuple[list[str], int]:
    """Return a table of the differences of rows to one of them on the test scenes, and its verdicts' number.

    There are none where the result has no flights.

    Args:
        recorded: the result.
        reference: the row that the others are compared with.
        names: the others.
        label: how the reference is called.
    """
    if not has_flights(recorded):
        return [], 0
    lines = [
        "",
        f"## Differences to {label}",
        "",
        f"Test scenes. A row less {label}, {OF_FLIGHTS}.",
        "",
        "| | " + " | ".join(metric for metric, *_ in PRINTED) + " |",
        "|---|" + "---|" * len(PRINTED),
    ]
    verdicts = 0
    for name in names:
        shown = []
        for _, key, _, digits in PRINTED:
            apart = difference(recorded, name, reference, key)
            verdicts += apart is not None
            shown.append(difference_text(apart, digits))
        lines.append(line([title(*name), *shown]))
    return lines, verdicts


def closing_lines(recorded: dict[str, Any], verdicts: int) -> list[str]:
    """Return the end of a page: what was asked more than once, and how many verdicts are due to chance.

    Args:
        recorded: the result.
        verdicts: how many verdicts the page holds; 0 for no sentence.
    """
    lines = _asked_again_lines(recorded)
    if verdicts and has_flights(recorded):
        lines += ["", f"This page holds {verdicts} verdicts at 95 %. {chance_sentence(verdicts)}"]
    return lines


def chance_sentence(verdicts: int) -> str:
    """Say how many of so many verdicts are due to chance."""
    by_chance = max(1, round(verdicts / CHANCE))
    return (
        f"If no row differed from any other, about one in {CHANCE} of them, here {by_chance}, would still be "
        "told apart by chance alone."
    )


def _asked_again_lines(recorded: dict[str, Any]) -> list[str]:
    """Return a table of the runs whose test scenes were asked before, with other weights."""
    shown = []
    for run in recorded["runs"]:
        for earlier in run.get("earlier", []):
            for row in earlier["averages"]:
                shown.append(_asked_again_line(recorded, row, run["seed"]))
    if not shown:
        return []
    return [
        "",
        "## Asked more than once",
        "",
        "These trainings were made again after the test scenes had been asked: the recorded value, and in "
        "brackets the one before.",
        "",
        "| | seed | " + " | ".join(metric for metric, *_ in PRINTED) + " |",
        "|---|---:|" + "---:|" * len(PRINTED),
        *shown,
    ]


def _asked_again_line(recorded: dict[str, Any], earlier: dict[str, Any], seed: int) -> str:
    name = earlier["method"], earlier["variant"]
    own = [row for row in recorded["rows"] if row["seed"] == seed]
    shown = []
    for _, key, _, digits in PRINTED:
        before = earlier[key]
        now = cells({"rows": own}, *name, key)[-1]
        shown.append("–" if before is None else f"{now:.{digits}f} ({before:.{digits}f})")
    return line([title(*name), str(seed), *shown])
