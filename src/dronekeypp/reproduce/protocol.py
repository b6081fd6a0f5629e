"""Define what a table is: the trainings it needs, what is measured of each, and how it is written down.

Every table of this package is a `Table`. The base class renders and trains what is missing, measures, and
writes the result after every training that ends. A table defines only what is its own.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import joblib
import matplotlib.pyplot as plt
import numpy as np
import torch

from dronekeypp import __version__
from dronekeypp.errors import InputError
from dronekeypp.files import command_line, write_beside
from dronekeypp.presets import TrainConfig
from dronekeypp.processes import end_with_parent
from dronekeypp.reproduce.asked import with_earlier
from dronekeypp.reproduce.results import describe, result_path, write_result
from dronekeypp.reproduce.runner import Bench, Run
from dronekeypp.reproduce.tables import write_figure

# What one job adds to a table: "run", the record of its training, and for each of `Table.lists` its entries.
Part = dict[str, Any]
# Every job is measured on both. Choices are made on the validation scenes; the test scenes are asked once.
SPLITS = ("test", "val")


def add_entries(part: Part, entries: dict[str, list]) -> None:
    """Add entries to the lists of a part."""
    for name, more in entries.items():
        part.setdefault(name, []).extend(more)


@dataclass(frozen=True)
class Job:
    """Describe one training of a table that is to be measured.

    Args:
        bench: where it is made.
        run: the training.
        seed: the seed of the training.
        label: the name of its row in the table, where that is not the run's variant.
    """

    bench: Bench
    run: Run
    seed: int
    label: str = ""


class Table:
    """A `Table` is the base of every table.

    A table of its own sets `name`, and defines `jobs`, `measure` and `markdown`. Where it needs more, it
    defines `prepare`, `finished`, `details`, `as_csv`, `draw` or `record` as well.
    """

    name: str  # of the result, of its table and of its figure
    full_budget = False  # whether its trainings have the full budget, or that of an ablation
    # What every job's part holds, joined in the result: rows and averages of the test scenes, rows of the
    # validation scenes, and the flights of both.
    lists: tuple[str, ...] = ("rows", "averages", "validation", "flights")

    def reproduce(self, bench: Bench, seeds: int | None = None) -> dict[str, Any]:
        """Train and measure whatever is missing, and return the recorded result.

        Args:
            bench: where it is made, and at what budget.
            seeds: trainings a row, with seeds 0, 1, …; None takes the table's own number.

        Raises:
            InputError: `prepare` raises it, or the budget has a setting that none of the trainings uses.
        """
        self.check(bench, seeds)
        self.prepare(bench)
        return self.run_jobs(bench, self.jobs(bench, seeds))

    def check(self, bench: Bench, seeds: int | None) -> None:
        """Raise InputError for what is wrong with the arguments, before anything is rendered."""
        quiet = replace(bench, progress=False)
        self.check_budget(quiet, self.jobs(quiet, seeds))

    def prepare(self, bench: Bench) -> None:
        """Make what all jobs need.

        The default renders the data set.
        """
        bench.render()

    def jobs(self, bench: Bench, seeds: int | None) -> list[Job]:
        """Return the trainings of the table, in the order of its rows."""
        raise NotImplementedError

    def check_budget(self, bench: Bench, jobs: Sequence[Job]) -> None:
        """Raise InputError, naming the setting, if the budget has one that no training uses."""
        settings = TrainConfig.keys()
        used: set[str] = set()
        for job in jobs:
            model, _ = job.bench.settings(job.run, job.seed)
            settings += [key for key in model.to_dict() if key not in settings]
            used |= set(job.bench.used_budget(job.run))
        for key, value in bench.budget.items():
            if key not in settings:
                names = ", ".join(settings)
                raise InputError(f"unknown setting {key!r} for the methods of {self.name}; known: {names}")
            if key not in used:
                raise InputError(f"{key}={value} is not used by any training of {self.name}")

    def run_jobs(self, bench: Bench, jobs: Sequence[Job]) -> dict[str, Any]:
        """Measure every job, record them in their order, and return the last record.

        The result is written anew after each job that was trained, so a kill loses nothing. What an earlier
        call finished comes first, so that nothing is recorded without it.
        """
        parts: dict[int, Part] = {}
        waiting = []
        for i, job in enumerate(jobs):
            if self.finished(job):
                parts[i] = self.measure(job)
            else:
                waiting.append(i)
        trained = self.train_in_turn([jobs[i] for i in waiting], bench.trainings)
        for i, _ in zip(waiting, trained, strict=True):
            parts[i] = self.measure(jobs[i])
            self.record(bench, [parts[k] for k in sorted(parts)])
        return self.record(bench, [parts[k] for k in sorted(parts)])

    def train_in_turn(self, jobs: Sequence[Job], side_by_side: int) -> Iterator[None]:
        """Train jobs, and yield after each of them in their order.

        Several side by side are processes of one thread or more. Small networks do not fill two cores: two
        trainings of one thread each take less time than two of two threads, one after the other.

        Args:
            jobs: what to train.
            side_by_side: how many at a time; they share the cores. 1 trains in this process.
        """
        if side_by_side == 1 or len(jobs) < 2:
            for job in jobs:
                self.train(job)
                yield
            return
        threads = max(1, torch.get_num_threads() // side_by_side)
        calls = [joblib.delayed(_train)(self, job, threads) for job in jobs]
        pool = joblib.Parallel(side_by_side, return_as="generator", batch_size=1, initializer=end_with_parent)
        yield from pool(calls)

    def train(self, job: Job) -> None:
        """Make the training of a job, or what is left of it."""
        job.bench.train(job.run, job.seed)

    def finished(self, job: Job) -> bool:
        """Tell whether the training of a job has ended."""
        return job.bench.finished(job.run, job.seed)

    def measure(self, job: Job) -> Part:
        """Return everything that one job adds to the table.

        The job's training is made first if need be.
        """
        raise NotImplementedError

    def details(self, bench: Bench) -> dict[str, Any]:
        """Return what the result holds beside the parts of the jobs.

        The default is nothing.
        """
        return {}

    def record(self, bench: Bench, parts: Sequence[Part]) -> dict[str, Any]:
        """Write the result, the table and its figures from the parts so far, and return the result."""
        joined = {}
        for key in self.lists:
            joined[key] = []
            for part in parts:
                joined[key] += part.get(key, [])
        runs = []
        for part in parts:
            variants = list(dict.fromkeys(row["variant"] for row in part.get("rows", [])))
            runs.append({**part["run"], "rows": variants})
        recorded = assemble(self.name, bench, runs, **self.details(bench), **joined)
        recorded = with_earlier(recorded, result_path(bench.root, self.name))
        self.write(bench, recorded)
        return recorded

    def write(self, bench: Bench, recorded: dict[str, Any]) -> None:
        """Write data_samples/results/NAME.json, figures/NAME.md and .csv, and every figure of `draw`."""
        write_result(bench.root, recorded)
        folder = bench.root / "figures"
        folder.mkdir(parents=True, exist_ok=True)
        write_beside(folder / f"{self.name}.md", self.markdown(recorded).encode())
        text = self.as_csv(recorded)
        if text is not None:
            write_beside(folder / f"{self.name}.csv", text.encode())
        for stem, figure in self.draw(recorded).items():
            write_figure(folder / f"{stem}.png", figure)

    def markdown(self, recorded: dict[str, Any]) -> str:
        """Return the table as Markdown."""
        raise NotImplementedError

    def as_csv(self, recorded: dict[str, Any]) -> str | None:
        """Return the table as CSV, or None where it has no such file."""
        return None

    def draw(self, recorded: dict[str, Any]) -> dict[str, plt.Figure]:
        """Return the figures by the stems of their files.

        The default is none.
        """
        return {}


def _train(table: Table, job: Job, threads: int) -> None:
    """Make the training of a job in a process of its own."""
    torch.set_num_threads(threads)
    table.train(job)


def assemble(
    name: str,
    bench: Bench,
    runs: Sequence[dict[str, Any]],
    dataset: dict[str, Any] | None = None,
    **parts: Any,
) -> dict[str, Any]:
    """Return a result as it is recorded: what was run, on what, for how long, and what was measured.

    Args:
        name: the name of the table.
        bench: where it was made.
        runs: the records of its trainings, see `Bench.training_record`.
        dataset: what the data were, see `describe`; the default describes the bench's data.
        parts: what was measured, by its name.
    """
    command = command_line() if sys.argv[1:2] == ["reproduce"] else None
    return {
        "name": name,
        "command": command,
        "preset": bench.preset,
        "budget": {key: str(value) for key, value in bench.budget.items()},
        "dataset": dataset or describe(bench.data),
        "hardware": ", ".join(dict.fromkeys(run["hardware"] for run in runs)),
        "minutes": round(sum(run["minutes"] for run in runs), 1),
        "versions": {
            "dronekeypp": __version__,
            "torch": torch.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "runs": list(runs),
        **parts,
    }
