"""Summarise many frames: means and medians by scene and drone, and their bootstrap intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

Frames = dict[str, np.ndarray]  # the arrays of `frame_errors`, joined: (F, …)
# The columns of a row of results, by name: the array that each is made from, and how.
Measures = Mapping[str, tuple[str, Callable[[np.ndarray], float]]]

MEASURES: Measures = {
    "R_mae_deg": ("R_deg", np.mean),
    "R_medae_deg": ("R_deg", np.median),
    "t_mae_m": ("t_m", np.mean),
    "t_medae_m": ("t_m", np.median),
    "t_axis_mae_m": ("t_axis_m", np.mean),
    "class_accuracy": ("class_correct", np.mean),
    "keypoint_px": ("keypoint_px", np.mean),
    "keypoint_medae_px": ("keypoint_px", np.median),
    "keypoint_crop_px": ("keypoint_crop_px", np.mean),
    "pck": ("pck", np.mean),
    "distance_ratio": ("distance_ratio", np.median),
    "direction_deg": ("direction_deg", np.median),
    "flip_rate": ("flip", np.mean),
    "failed": ("failed", np.mean),
}
INTERVALS = ("R_mae_deg", "R_medae_deg", "t_mae_m", "t_medae_m", "class_accuracy")
# What is kept of every flight: a mean or a median over its frames. Intervals are made from them.
FLIGHT_MEASURES = (*INTERVALS[:4], "t_axis_mae_m", "class_accuracy")


def measure(
    frames: Frames, chosen: np.ndarray | slice = slice(None), measures: Measures = MEASURES
) -> dict[str, float]:
    """Return every measure over the chosen frames (an index array or a mask)."""
    values = {}
    for name, (array, reduce) in measures.items():
        values[name] = float(reduce(frames[array][chosen]))
    return values


def summarise(
    frames: Frames, names: Sequence[str], measures: Measures = MEASURES, **labels: Any
) -> list[dict]:
    """Return one row per scene and drone, in order.

    A row is {**labels, "scene", "drone", "frames", and every measure}.

    Args:
        frames: the arrays of `evaluate`.
        names: the drones in class order.
        measures: the columns.
        labels: entries that are put in front of every row (method=, variant=, seed=).
    """
    rows = []
    for scene in np.unique(frames["scene"]):
        for label in np.unique(frames["label"]):
            chosen = (frames["scene"] == scene) & (frames["label"] == label)
            if chosen.any():
                row = {**labels, "scene": int(scene), "drone": names[label], "frames": int(chosen.sum())}
                rows.append({**row, **measure(frames, chosen, measures)})
    return rows


def averages(frames: Frames, draws: int = 1000, measures: Measures = MEASURES, **labels: Any) -> list[dict]:
    """Return two rows of averages, which differ in "over": "rows" and "frames".

    The row "rows" is the mean of the rows of `summarise`, as a table's last column is. The row "frames" is
    taken over all frames.

    The second carries 95 % bootstrap intervals, KEY_ci95: [low, high]. Frames of a flight resemble each
    other, so single frames are never drawn, but whole subsequences (scene, drone, subsequence). Such an
    interval is wider than one over frames, and right.
    """
    numbered = [str(i) for i in range(int(frames["label"].max()) + 1)]
    rows = summarise(frames, numbered, measures)
    by_rows = {name: float(np.mean([row[name] for row in rows])) for name in measures}
    counts = {"rows": len(rows), "frames": len(frames["label"])}
    over_flights = flight_intervals(frames, draws)
    return [
        {**labels, "over": "rows", **counts, **by_rows},
        {**labels, "over": "frames", **counts, **measure(frames, measures=measures), **over_flights},
    ]


def flights_of(frames: Frames) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return (scene, label, subsequence) of every flight (n, 3), and the indices of its frames."""
    keys = np.stack([frames["scene"], frames["label"], frames["subsequence"]], axis=1)
    flights, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.ravel()
    return flights, [np.flatnonzero(group == g) for g in range(len(flights))]


def flight_errors(frames: Frames, names: Sequence[str]) -> dict[str, list]:
    """Return FLIGHT_MEASURES of every flight, as lists of one length.

    Lists "scene", "drone", "subsequence" and "frames" (their number) say which flight it is. Numbers have
    five digits, so that many trainings stay small; a measure that was not predicted is None.

    Args:
        frames: the arrays of `evaluate`.
        names: the drones in class order.
    """
    flights, members = flights_of(frames)
    errors: dict[str, list] = {
        "scene": flights[:, 0].tolist(),
        "drone": [names[label] for label in flights[:, 1]],
        "subsequence": flights[:, 2].tolist(),
        "frames": [len(chosen) for chosen in members],
    }
    for name in FLIGHT_MEASURES:
        array, reduce = MEASURES[name]
        values = [float(reduce(frames[array][chosen])) for chosen in members]
        errors[name] = [None if np.isnan(value) else float(f"{value:.5g}") for value in values]
    return errors


def flight_intervals(frames: Frames, draws: int) -> dict[str, list[float]]:
    """Return 95 % bootstrap intervals of INTERVALS, with whole flights drawn.

    They are {KEY_ci95: [low, high]}.
    """
    _, members = flights_of(frames)
    generator = np.random.default_rng(0)
    drawn: dict[str, list[float]] = {name: [] for name in INTERVALS}
    for _ in range(draws):
        flights = generator.integers(len(members), size=len(members))
        chosen = np.concatenate([members[g] for g in flights])
        for name in INTERVALS:
            array, reduce = MEASURES[name]
            drawn[name].append(float(reduce(frames[array][chosen])))
    intervals = {}
    for name, values in drawn.items():
        if np.isfinite(values).all():
            intervals[f"{name}_ci95"] = percentiles(values)
    return intervals


def interval_of_mean(values: Sequence[float], draws: int = 1000, seed: int = 0) -> list[float]:
    """Return the 95 % bootstrap interval [low, high] of the mean of values.

    The values, for example the columns of a table, are drawn with replacement.
    """
    chosen = np.random.default_rng(seed).integers(len(values), size=(draws, len(values)))
    return percentiles(np.asarray(values)[chosen].mean(axis=1))


def percentiles(values: Sequence[float] | np.ndarray) -> list[float]:
    """Return the middle 95 % of bootstrap draws: [low, high]."""
    return [float(q) for q in np.percentile(values, [2.5, 97.5])]


def json_values(value: Any) -> Any:
    """Return a value as JSON can hold it.

    Numbers are rounded to six digits. NaN (a part that a method does not predict) becomes None.
    """
    if isinstance(value, dict):
        return {key: json_values(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_values(v) for v in value]
    if isinstance(value, (float, np.floating)):
        return None if np.isnan(value) else float(f"{value:.6g}")
    return value.item() if isinstance(value, np.generic) else value


# The columns of `format_table`: title, key, digits, factor.
Columns = Sequence[tuple[str, str, int, int]]
COLUMNS: Columns = (
    ("R MAE°", "R_mae_deg", 2, 1),
    ("R Med°", "R_medae_deg", 2, 1),
    ("t MAE m", "t_mae_m", 3, 1),
    ("t Med m", "t_medae_m", 3, 1),
    ("t axis m", "t_axis_mae_m", 3, 1),
    ("class %", "class_accuracy", 1, 100),
    ("kp px", "keypoint_px", 2, 1),
    ("kp Med", "keypoint_medae_px", 2, 1),
    ("flip %", "flip_rate", 1, 100),
)


def format_table(rows: Sequence[dict], columns: Columns = COLUMNS) -> str:
    """Return these columns of rows of `summarise` or `averages` as plain text, one line each.

    Where their method and variant differ, these stand in front.
    """
    names = []
    for row in rows:
        parts = [str(row[key]) for key in ("method", "variant") if row.get(key)]
        names.append(" ".join(parts))
    width = max(map(len, names)) + 2 if len(set(names)) > 1 else 0
    titles = ["scene", "drone", "frames", *(column[0] for column in columns)]
    lines = [" " * width + "  ".join(f"{title:>8}" for title in titles)]
    for name, row in zip(names, rows, strict=True):
        scene, drone = (row["scene"], row["drone"]) if "scene" in row else ("mean of", row["over"])
        cells = [f"{scene!s:>8}", f"{drone!s:>8}", f"{row['frames']:8d}"]
        for _, key, digits, factor in columns:
            cells.append(f"{factor * row[key]:8.{digits}f}")
        lines.append(f"{name[:width]:{width}s}" + "  ".join(cells))
    return "\n".join(lines)
