"""This module makes the rows of the result, and the same as a table of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dronekeypp.bench.contender import ONNX, YOLO, YOLO_IN_ONNX, Contender
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


def detectors_beside(
    contender: Contender, chosen: Sequence[Contender], rounds: Sequence[list[Round]]
) -> dict[str, list[Round]]:
    """Return the rounds of the detectors in ONNX Runtime by their names, for a contender that it runs too.

    They are those on the same device with the same batch. A contender in another engine has none.
    """
    beside: dict[str, list[Round]] = {}
    for other, theirs in zip(chosen, rounds, strict=True):
        alike = (other.engine, other.device, other.batch) == (ONNX, contender.device, contender.batch)
        if alike and contender.engine == ONNX and other.name in YOLO_IN_ONNX:
            beside[other.name] = theirs
    return beside


def ratio_of(mine: list[Round], theirs: list[Round]) -> float:
    """Return how many times as fast as a detector a contender is: the median of the ratios in a round."""
    whole = np.array([times["whole"] for times in mine])
    detector = np.array([times["whole"] for times in theirs])
    return round(float(np.median(detector / whole)), 3)


def row_of(
    contender: Contender,
    facts: Facts,
    mine: list[Round],
    theirs: list[Round] | None,
    beside: Mapping[str, list[Round]],
) -> dict[str, Any]:
    """Return a row of the result.

    Args:
        contender: who was measured.
        facts: its parameters and operations.
        mine: its rounds.
        theirs: the rounds of the detector in its own library, see `detector_of`.
        beside: those of the detectors in the same engine, see `detectors_beside`.
    """
    whole = np.array([times["whole"] for times in mine])
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
        "ratio_to_yolov8n_pose": ratio_of(mine, theirs) if theirs else None,
        "ratios_in_onnx_runtime": {name: ratio_of(mine, other) for name, other in beside.items()},
        "peak_mb": round(max(times["peak_mb"] for times in mine)),
        **facts,
        "stages": stages,
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the rows as text, below a line with the names of the columns.

    Behind the stages of a row in ONNX Runtime stands how many times as fast as the detectors there it is.
    """
    head = f"{'':26s} {'engine':13s} {'device':6s} {'batch':>5s} {'frames/s':>9s} {'× YOLO':>7s} {'MB':>6s}"
    lines = [f"{head} {'params':>7s} {'GFLOP':>6s}  ms a frame"]
    for row in rows:
        ratio = "–" if row["ratio_to_yolov8n_pose"] is None else f"{row['ratio_to_yolov8n_pose']:.2f}"
        notes = [f"{name} {value:.2f}" for name, value in row["stages"].items()]
        for name, value in row["ratios_in_onnx_runtime"].items():
            if name != row["name"]:
                notes.append(f"{value:.2f} × {name}")
        who = f"{row['name']:26s} {row['engine']:13s} {row['device']:6s} {row['batch']:5d}"
        speed = f"{row['frames_per_s']:9.1f} {ratio:>7s} {row['peak_mb']:6d}"
        size = f"{row['params'] / 1e6:6.1f}M {row['flops'] / 1e9:6.2f}"
        lines.append(f"{who} {speed} {size}  {', '.join(notes)}")
    return "\n".join(lines)
