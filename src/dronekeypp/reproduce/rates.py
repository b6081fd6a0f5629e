"""Choose a learning rate for each method on the validation scenes: `python -m dronekeypp reproduce rates`.

One rate for all methods would be a choice in favour of the method that it was found with. So each method of
Table 3, and the geometric network of `beyond`, is trained at three rates with the ablations' budget. Only
metrics.csv is read, which holds the validation scenes. The test scenes are never asked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dronekeypp import presets
from dronekeypp.baselines import yolo
from dronekeypp.errors import InputError
from dronekeypp.evaluate import json_values
from dronekeypp.reproduce.ablations import METHOD, Row, run_of
from dronekeypp.reproduce.beyond_runs import GEOMETRIC
from dronekeypp.reproduce.protocol import Job, Part, Table
from dronekeypp.reproduce.runner import Bench, Run, read_history
from dronekeypp.reproduce.table3_runs import PAPERS, RUNS
from dronekeypp.reproduce.tables import heading, line, number, percent, title

FACTORS = (0.3, 1.0, 3.0)  # of the preset's rate; for `cpu` they make 3e-4, 1e-3 and 3e-3
NOISE_SEEDS = 3  # trainings of the paper's network that say how far seeds lie apart
MEASURES = ("val_R_medae_deg", "val_t_medae_m", "score")  # columns of metrics.csv
REFERENCE = title(PAPERS.method, PAPERS.variant)  # the paper's network

# What is trained, by the name of its row.
METHODS: dict[str, Run] = {
    title(run.method, run.variant): run for run in (*RUNS, GEOMETRIC) if run.method != yolo.METHOD
}


def at_rate(run: Run, rate: float, preset: str) -> Run:
    """Return the training of a row of Table 3 or `beyond` at a learning rate.

    Of DroneKey++ it is the one that an ablation with these settings makes, so that none is made twice.
    """
    changes = {**run.changes, "lr": rate}
    if run.method == METHOD:
        return run_of(Row(title(run.method, run.variant), changes), preset)
    words = [run.variant] if run.variant else []
    if rate == usual_rate(preset):
        del changes["lr"]
    else:
        words.append(f"lr={rate:g}")
    return Run(run.method, " ".join(words) or None, changes)


def usual_rate(preset: str) -> float:
    """Return a preset's learning rate."""
    return presets.preset(preset)[1].lr


class Rates(Table):
    """Train every method at three learning rates.

    Each has one seed unless another number is given. The paper's network has three at the preset's rate:
    their spread is the noise that a difference between two rates has to exceed.
    """

    name = "rates"
    lists = ("rates",)

    def check(self, bench: Bench, seeds: int | None) -> None:
        """Raise InputError also where the budget sets the learning rate, in which the rows differ."""
        if "lr" in bench.budget:
            raise InputError("--set lr: the rows of rates differ in it; leave it out")
        super().check(bench, seeds)

    def jobs(self, bench: Bench, seeds: int | None) -> list[Job]:
        usual = usual_rate(bench.preset)
        jobs = []
        for name, method in METHODS.items():
            for factor in FACTORS:
                rate = float(f"{factor * usual:.6g}")
                run = at_rate(method, rate, bench.preset)
                count = seeds or 1
                if name == REFERENCE and rate == usual:
                    count = max(count, NOISE_SEEDS)
                jobs += [Job(bench, run, seed, label=name) for seed in range(count)]
        return jobs

    def measure(self, job: Job) -> Part:
        """Read a training's best epoch and return {"run", "rates"}, with one entry of the latter."""
        bench, run, seed = job.bench, job.run, job.seed
        bench.train(run, seed)
        history = read_history(bench.folder(run, seed))
        best = min(history, key=lambda row: float(row["score"]))
        _, training = bench.settings(run, seed)
        measured = {key: float(best[key]) for key in MEASURES}
        labels = {"name": job.label, "method": run.method, "seed": seed, "lr": training.lr}
        entry = {**labels, "best_epoch": int(best["epoch"]), **json_values(measured)}
        return {"run": bench.training_record(run, seed), "rates": [entry]}

    def details(self, bench: Bench) -> dict[str, Any]:
        return {"usual_lr": usual_rate(bench.preset)}

    def markdown(self, recorded: dict[str, Any]) -> str:
        return markdown(recorded)


# --- the choice -------------------------------------------------------------------------------------------


def scores_of(recorded: dict[str, Any], name: str) -> dict[float, list[float]]:
    """Return the scores of a method by learning rate, {lr: one for each seed}; lower is better.

    Raises:
        InputError: The result has no such method.
    """
    scores: dict[float, list[float]] = {}
    for entry in recorded["rates"]:
        if entry["name"] == name:
            scores.setdefault(entry["lr"], []).append(entry["score"])
    if not scores:
        known = ", ".join(dict.fromkeys(entry["name"] for entry in recorded["rates"]))
        raise InputError(f"rates: no method {name!r}; known: {known}")
    return dict(sorted(scores.items()))


def best_rate(recorded: dict[str, Any], method: str) -> float:
    """Return the learning rate with the lowest score on the validation scenes, averaged over the seeds.

    Args:
        recorded: the result of `reproduce rates`.
        method: the method as its row is called, for example "DronePose (told the crop)".

    Raises:
        InputError: The result has no such method.
    """
    scores = scores_of(recorded, method)
    return min(scores, key=lambda rate: float(np.mean(scores[rate])))


def noise(recorded: dict[str, Any]) -> float:
    """Return by what share the score of one training varies with its seed: a standard deviation.

    It is that of the paper's network at the preset's rate, and stands for every method. It is NaN while fewer
    than two of its seeds are there.
    """
    scores = scores_of(recorded, REFERENCE).get(recorded["usual_lr"], [])
    return float(np.std(scores, ddof=1) / np.mean(scores)) if len(scores) > 1 else math.nan


def excess(recorded: dict[str, Any], method: str) -> float:
    """Return by what share the score at the preset's rate lies above that at the best one.

    It is NaN while the training at the preset's rate is missing.
    """
    scores = scores_of(recorded, method)
    usual = scores.get(recorded["usual_lr"], [math.nan])
    return float(np.mean(usual) / np.mean(scores[best_rate(recorded, method)])) - 1


def is_noise(recorded: dict[str, Any], method: str) -> bool:
    """Say whether the preset's rate is as good as the best one, for all that can be told.

    Both scores vary. So the excess is called noise up to two standard deviations of a difference, which are
    2 √2 times `noise`, less with more seeds.
    """
    scores, usual, best = scores_of(recorded, method), recorded["usual_lr"], best_rate(recorded, method)
    if usual == best or usual not in scores:
        return usual == best
    variance = 1 / len(scores[usual]) + 1 / len(scores[best])
    return excess(recorded, method) <= 2 * math.sqrt(variance) * noise(recorded)


def chosen_rate(recorded: dict[str, Any], method: str) -> float:
    """Return the learning rate that Table 3 should give a method, see `table3_runs.RATES`.

    It is the preset's, unless the best one is better by more than the noise.
    """
    return recorded["usual_lr"] if is_noise(recorded, method) else best_rate(recorded, method)


# --- the table --------------------------------------------------------------------------------------------


def markdown(recorded: dict[str, Any]) -> str:
    """Return a table of methods by learning rates, with the best rate of each in bold, and the choice."""
    rates = sorted({entry["lr"] for entry in recorded["rates"]})
    names = list(dict.fromkeys(entry["name"] for entry in recorded["rates"]))
    usual, spread = recorded["usual_lr"], noise(recorded)
    lines = [
        "# Learning rates, chosen on the validation scenes",
        "",
        heading(recorded),
        "",
        "A cell holds the score of the best epoch, and in brackets the median rotation and translation "
        "errors of that epoch, all on validation frames. The score is the median rotation error / 90° + the "
        "median translation error / the median distance; for DroneKey, which learns keypoints alone, their "
        "mean error in crop units. Lower is better, and the best rate is bold. The test scenes were not "
        f"asked. {yolo.METHOD} is not here: it trains itself, at rates that its library chooses.",
        "",
        "| | " + " | ".join(f"lr {rate:g}" for rate in rates) + f" | {usual:g} against the best |",
        "|---|" + "---:|" * len(rates) + "---|",
    ]
    for name in names:
        shown = [_cell(recorded, name, rate) for rate in rates]
        lines.append(line([name, *shown, _verdict(recorded, name)]))
    lines += [
        "",
        f"Trainings of {REFERENCE} at {usual:g} that differ in their seed alone vary by {percent(spread)} "
        "(standard deviation of the score). *Within the noise*: the preset's rate lies above the best one by "
        "no more than two standard deviations of a difference. Three seeds give that spread roughly, and it "
        "is taken for every method.",
    ]
    return "\n".join(lines) + "\n"


def _cell(recorded: dict[str, Any], name: str, rate: float) -> str:
    """Write a method at a rate as "0.123 (4.5°, 0.123 m)", or a dash where it was not trained."""
    entries: list[dict[str, Any]] = []
    for entry in recorded["rates"]:
        if (entry["name"], entry["lr"]) == (name, rate):
            entries.append(entry)
    if not entries:
        return "–"
    score = number(_mean(entries, "score"), 3)
    turn, shift = number(_mean(entries, "val_R_medae_deg"), 1), number(_mean(entries, "val_t_medae_m"), 3)
    shown = f"**{score}**" if rate == best_rate(recorded, name) else score
    return f"{shown} ({turn}°, {shift} m)"


def _mean(entries: Sequence[dict[str, Any]], key: str) -> float:
    """Return the mean of a measure over the seeds; NaN where one did not predict it."""
    return float(np.mean([math.nan if entry[key] is None else entry[key] for entry in entries]))


def _verdict(recorded: dict[str, Any], name: str) -> str:
    """Say whether the preset's rate is the best, within the noise of it, or worse."""
    above = excess(recorded, name)
    if math.isnan(above):
        return "not trained yet"
    if above == 0:
        return "the best"
    if math.isnan(noise(recorded)):
        return f"{percent(above)} above, noise unknown"
    return f"{percent(above)} above, {'within the noise' if is_noise(recorded, name) else 'worse'}"
