"""This module makes the rows of the result, and the same as a table of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dronekeypp.bench.contender import YOLO, Contender
from dronekeypp.bench.stages import Facts
from dronekeypp.bench.worker import Round

NO_STAGES = ("whole", "peak_mb")  # what a round holds beside its stages


def detector_of(
    contender: Contender, chosen: Sequence[Contender], rounds: Sequence[list[Round]]
) -> list[Round] | None:
    """Return the rounds of the detector on the same device with the same batch.

    The answer is None where the detector took no part. `rounds` are those of each of the `chosen` contenders.
    """
    wanted = (YOLO, contender.device, contender.batch)
    for other, theirs in zip(chosen, rounds, strict=True):
        if (other.name, other.device, other.batch) == wanted:
            return theirs
    return None


def row_of(
    contender: Contender, facts: Facts, mine: list[Round], theirs: list[Round] | None
) -> dict[str, Any]:
    """Return a row of the result, from the rounds of a contender and of the detector."""
    whole = np.array([times["whole"] for times in mine])
    ratio = None
    if theirs:
        detector = np.array([times["whole"] for times in theirs])
        ratio = round(float(np.median(detector / whole)), 3)
    stages = {}
    for name in mine[0]:
        if name not in NO_STAGES:
            median = float(np.median([times[name] for times in mine]))
            stages[name] = round(1000 * median, 4)
    return {
        "name": contender.name,
        "engine": contender.engine,
        "device": contender.device,
        "batch": contender.batch,
        "threads": contender.threads,
        "frames_per_s": round(float(1 / np.median(whole)), 2),
        "ratio_to_yolov8n_pose": ratio,
        "peak_mb": round(max(times["peak_mb"] for times in mine)),
        **facts,
        "stages": stages,
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the rows as text, below a line with the names of the columns."""
    head = f"{'':26s} {'engine':13s} {'device':6s} {'batch':>5s} {'frames/s':>9s} {'× YOLO':>7s} {'MB':>6s}"
    lines = [f"{head} {'params':>7s} {'GFLOP':>6s}  ms a frame"]
    for row in rows:
        ratio = "–" if row["ratio_to_yolov8n_pose"] is None else f"{row['ratio_to_yolov8n_pose']:.2f}"
        stages = ", ".join(f"{name} {value:.2f}" for name, value in row["stages"].items())
        who = f"{row['name']:26s} {row['engine']:13s} {row['device']:6s} {row['batch']:5d}"
        speed = f"{row['frames_per_s']:9.1f} {ratio:>7s} {row['peak_mb']:6d}"
        size = f"{row['params'] / 1e6:6.1f}M {row['flops'] / 1e9:6.2f}"
        lines.append(f"{who} {speed} {size}  {stages}")
    return "\n".join(lines)
