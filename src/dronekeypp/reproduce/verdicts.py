"""Derive the verdict of a claim from the recorded results.

The equations, figures and data are *reproduced* where they are built here. So is an order or an effect that
the paper's numbers show, if ours show it by their intervals. A number on other data is never reproduced: its
order of magnitude compares.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dronekeypp.evaluate import ENOUGH_SEEDS
from dronekeypp.reproduce.evidence import PRINTED_KEYS, Results, paper_numbers
from dronekeypp.reproduce.flights import Name

REPRODUCED, DIFFERS, NOT_ATTEMPTED = "reproduced", "differs", "not attempted"
SAME_ORDER = "same order of magnitude"  # the same question on other data
VERDICTS = (REPRODUCED, SAME_ORDER, DIFFERS, NOT_ATTEMPTED)
SHORT = dict(zip(PRINTED_KEYS, ("R MAE", "R MedAE", "t MAE", "t MedAE"), strict=True))


@dataclass(frozen=True)
class Comparison:
    """Describe an order of rows that the paper's numbers show, to be found in ours or not.

    Args:
        table: the name of the result.
        row: the row, as (method, variant).
        references: the rows that it is compared with.
        keys: the measures that count, of `evidence.PRINTED_KEYS`.
        split: "test", or "val" for an ablation.
    """

    table: str
    row: Name
    references: tuple[Name, ...]
    keys: tuple[str, ...] = tuple(PRINTED_KEYS)
    split: str = "test"

    def verdict(self, results: Results) -> str:
        """Return REPRODUCED if every measure is told apart in the direction of the paper, else DIFFERS."""
        for reference in self.references:
            words = words_of(results, self.table, self.row, reference, self.split)
            for key in self.keys:
                if words[key].rstrip("?") != self.printed_word(reference, key):
                    return DIFFERS
        return REPRODUCED

    def printed_word(self, reference: Name, key: str) -> str:
        """Return "better" or "worse": what the row is in the paper, by its printed numbers."""
        ours, theirs = (
            paper_numbers(self.table, variant or method) for method, variant in (self.row, reference)
        )
        return "better" if ours[key] < theirs[key] else "worse"

    def rows(self) -> tuple[tuple[str, Name], ...]:
        """Return the rows that it rests on, each with the name of its result."""
        return tuple((self.table, name) for name in (self.row, *self.references))

    def text(self, results: Results) -> str:
        """Say in words what our intervals show against each reference."""
        texts = []
        for method, variant in self.references:
            said = words_text(results, self.table, self.row, (method, variant), self.split)
            named = f"against {variant}: " if len(self.references) > 1 else ""
            texts.append(f"{named}{said}")
        return "; ".join(texts)


@dataclass(frozen=True)
class Claim:
    """Describe a line of the table of claims.

    Args:
        where: the place in the paper.
        says: what the paper says there.
        code: a dotted name below dronekeypp.
        test: FILE::FUNCTION below tests.
        notebook: the stem of its file.
        section: the number of the notebook's section.
        verdict: one of VERDICTS; a comparison has none of its own.
        why: in what sense it was reproduced, or what stands against it; or a function that says so from the
            results.
        paper: the paper's values, where there are any.
        ours: a function that makes our values from the results.
        holds: a function that says whether the verdict and the words beside it stand, by the results.
        compares: the order of rows that the claim is about; the verdict is derived from it.
        rests_on: other rows that the claim is about, each with the name of its result.
    """

    where: str
    says: str
    code: str
    test: str
    notebook: str
    section: str
    verdict: str = ""
    why: str | Callable[[Results], str] = ""
    paper: str = ""
    ours: Callable[[Results], str] | None = None
    holds: Callable[[Results], bool] | None = None
    compares: Comparison | None = None
    rests_on: tuple[tuple[str, Name], ...] = ()

    def derived_verdict(self, results: Results) -> str:
        """Return the verdict, by the results where it is a comparison."""
        return self.compares.verdict(results) if self.compares else self.verdict

    def mark(self, results: Results) -> str:
        """Return "?" if one of the rows behind the claim has fewer than three seeds, else ""."""
        rows = self.rests_on + (self.compares.rows() if self.compares else ())
        few = any(results.seeds(table, name) < ENOUGH_SEEDS for table, name in rows)
        return "?" if few else ""

    def reason(self, results: Results) -> str:
        """Return what stands after the verdict: the words of the comparison, and why."""
        why = self.why(results) if callable(self.why) else self.why
        said = self.compares.text(results) if self.compares else ""
        return "; ".join(text for text in (said, why) if text)


def words_of(results: Results, table: str, row: Name, reference: Name, split: str) -> dict[str, str]:
    """Return the verdict on every one of the four numbers of a row against another, by its key."""
    words = {}
    for key in PRINTED_KEYS:
        words[key] = results.difference(table, row, reference, key, split).verdict
    return words


def words_text(results: Results, table: str, row: Name, reference: Name, split: str) -> str:
    """Write the verdicts on the four numbers as "R MAE better, R MedAE worse, …", or "all four better"."""
    words = words_of(results, table, row, reference, split)
    if len(set(words.values())) == 1:
        return f"all four {words['R_mae_deg']}"
    return ", ".join(f"{SHORT[key]} {word}" for key, word in words.items())
