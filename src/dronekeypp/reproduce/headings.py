"""Split the rotation error by heading, to ask where a head without a seam gains.

Three sigmoid angles have a seam at yaw ±180° (see `model.rotation_heads`): there the nose points at the
camera. If six numbers gained by the seam alone, they would gain for such noses and for no others.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from dronekeypp.evaluate import json_values
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.reproduce.flights import Name
from dronekeypp.reproduce.run import Run
from dronekeypp.reproduce.runner import Bench
from dronekeypp.reproduce.tables import line, percent, title

NEAR = 45.0  # degrees between the nose and the direction to the camera
TOWARDS, ELSEWHERE = "towards the camera", "elsewhere"
PARTS = (TOWARDS, ELSEWHERE)
SCENES = {"val": "validation", "test": "test"}  # the splits that are asked, and how a page calls them

# A row whose gain is asked for, and the row that it gains over.
Pair = tuple[Name, Name]


def by_heading(frames: Frames, **labels: Any) -> list[dict[str, Any]]:
    """Return the rotation error of each of PARTS as {**labels, "part", "frames", "share", and two measures}.

    The measures are R_mae_deg and R_medae_deg, in degrees. `share` is the part's share of the frames. A part
    without frames has no entry.

    Args:
        frames: the arrays of `evaluate`.
        labels: entries that are put in front (method=, variant=, seed=, split=).
    """
    near = frames["heading_deg"] < NEAR
    entries = []
    for part, chosen in ((TOWARDS, near), (ELSEWHERE, ~near)):
        if chosen.any():
            errors = frames["R_deg"][chosen]
            measures = {"R_mae_deg": errors.mean(), "R_medae_deg": np.median(errors)}
            counts = {"frames": int(chosen.sum()), "share": chosen.mean()}
            entries.append({**labels, "part": part, **json_values({**counts, **measures})})
    return entries


def measure_by_heading(bench: Bench, run: Run, seed: int, variant: str | None) -> list[dict[str, Any]]:
    """Return `by_heading` of a run on the validation and on the test scenes, one split after the other.

    `variant` is the name of its row.
    """
    entries = []
    for split in SCENES:
        frames = bench.measure(run, seed, split)[run.variant]
        entries += by_heading(frames, method=run.method, variant=variant, seed=seed, split=split)
    return entries


def errors_by_seed(recorded: dict[str, Any], name: Name, split: str, part: str, key: str) -> list[float]:
    """Return a measure of one row in one part, seed by seed.

    Args:
        recorded: the result, with its list "by_heading".
        name: the row, as (method, variant).
        split: "val" or "test".
        part: one of PARTS.
        key: "R_mae_deg", "R_medae_deg" or "share".
    """
    values = []
    for entry in recorded["by_heading"]:
        place = (entry["method"], entry["variant"], entry["split"], entry["part"])
        if place == (*name, split, part):
            values.append(entry[key])
    return values


def gain_lines(recorded: dict[str, Any], pairs: Sequence[Pair]) -> list[str]:
    """Return the lines of a table of gains by heading, as Markdown.

    There are none where the result has no list "by_heading", or where no pair was measured.

    Args:
        recorded: the result.
        pairs: whose gain over whom.
    """
    rows = []
    if recorded.get("by_heading"):
        for (name, reference), split in product(pairs, SCENES):
            rows += _gain_rows(recorded, name, reference, split)
    if not rows:
        return []
    return [
        "",
        "## The gain in rotation, by heading",
        "",
        f"*{TOWARDS.capitalize()}*: the nose within {NEAR:g}° of the direction to the camera, where the "
        "angles' seam lies. A gain is the second row's error less the first's: the mean over the seeds, in "
        "brackets the least and the largest over all pairs of seeds. *Of the gain*: the part's share of the "
        "gain over all frames. If the seam were the whole story, nothing would be gained elsewhere.",
        "",
        "| | scenes | nose | frames | gain in R MAE (deg) | of the gain | gain in R MedAE (deg) |",
        "|---|---|---|---:|---:|---:|---:|",
        *rows,
    ]


def _gain_rows(recorded: dict[str, Any], name: Name, reference: Name, split: str) -> list[str]:
    """Return the two lines of a pair on one split, or none where either was not measured there."""
    gains, shares, medians = [], [], []
    for part in PARTS:
        means = _pairs_of_seeds(recorded, name, reference, split, part, "R_mae_deg")
        if not means.size:
            return []
        gains.append(means)
        medians.append(_pairs_of_seeds(recorded, name, reference, split, part, "R_medae_deg"))
        shares.append(float(np.mean(errors_by_seed(recorded, name, split, part, "share"))))
    parts_of_gain = [share * float(gain.mean()) for share, gain in zip(shares, gains, strict=True)]
    whole = sum(parts_of_gain)
    rows = []
    for i, part in enumerate(PARTS):
        # A share of nothing, or of a loss, would say nothing.
        of_gain = percent(parts_of_gain[i] / whole) if whole > 0 else "–"
        label = f"{title(*name)} over {title(*reference)}"
        cells = [percent(shares[i]), _range(gains[i]), of_gain, _range(medians[i])]
        rows.append(line([label, SCENES[split], part, *cells]))
    return rows


def _pairs_of_seeds(
    recorded: dict[str, Any], name: Name, reference: Name, split: str, part: str, key: str
) -> np.ndarray:
    """Return the reference's error less the row's for every pair of seeds."""
    ours = errors_by_seed(recorded, name, split, part, key)
    theirs = errors_by_seed(recorded, reference, split, part, key)
    return np.subtract.outer(theirs, ours)


def _range(values: np.ndarray) -> str:
    """Write values as "+1.23 [+1.00, +1.50]": their mean, the least and the largest."""
    return f"{values.mean():+.2f} [{values.min():+.2f}, {values.max():+.2f}]"
