"""Go beyond the paper: compare its network with the one that has the geometry put back, at one budget.

The module also says whether the latter's uncertainty can be trusted.

The trainings stand in `beyond_runs.py`, what is asked of the geometric network in `beyond_uncertainty.py` and
`beyond_flights.py`, and the page and the figures in `beyond_report.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from torch.utils.data import Subset

from dronekeypp.classes import DroneClass
from dronekeypp.data import FrameDataset, read_annotations
from dronekeypp.evaluate import ENOUGH_SEEDS, json_values
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.files import write_beside
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce.beyond_flights import FILTERS, over_flights, sequences
from dronekeypp.reproduce.beyond_report import draw, draw_doubt, markdown
from dronekeypp.reproduce.beyond_runs import GEOMETRIC, METHOD, NO_SEARCH, WITHOUT
from dronekeypp.reproduce.beyond_uncertainty import (
    HALVES,
    HIDDEN,
    LEVELS,
    PARTS,
    Answers,
    Hidden,
    answers,
    calibration,
    claimed,
    coverage,
    doubt,
    merged,
    occlusion,
    surprise,
)
from dronekeypp.reproduce.field import field_errors, measures_of
from dronekeypp.reproduce.priors import radius
from dronekeypp.reproduce.protocol import SPLITS, Job, Part, Table, add_entries
from dronekeypp.reproduce.results import measurements
from dronekeypp.reproduce.runner import Bench, Run
from dronekeypp.reproduce.table3_runs import PAPERS
from dronekeypp.train import METRICS

__all__ = [
    "FILTERS",
    "GEOMETRIC",
    "HALVES",
    "HIDDEN",
    "LEVELS",
    "NO_SEARCH",
    "PAPERS",
    "PARTS",
    "WITHOUT",
    "Answers",
    "Beyond",
    "Hidden",
    "answers",
    "calibration",
    "claimed",
    "coverage",
    "doubt",
    "draw",
    "draw_doubt",
    "markdown",
    "merged",
    "occlusion",
    "over_flights",
    "reproduce",
    "sequences",
    "shapes",
    "surprise",
]


class Beyond(Table):
    """Compare both networks, ours without its search, and two that were never shown one of the drones.

    Each has three seeds unless another number is given; those that were never shown one have one. The
    calibrated network is written to data_samples/beyond.
    """

    name = "beyond"
    full_budget = True
    lists = (*Table.lists, "doubt", "occlusion", "shapes", "sequences")

    def jobs(self, bench: Bench, seeds: int | None) -> list[Job]:
        jobs = []
        for seed in range(seeds or ENOUGH_SEEDS):
            jobs += [Job(bench, run, seed) for run in (PAPERS, GEOMETRIC, NO_SEARCH)]
        return jobs + [Job(bench, run, 0) for run in WITHOUT.values()]

    def measure(self, job: Job) -> Part:
        """Measure one run.

        The part holds rows of its answers and, for a geometric network, how far its covariance can be
        trusted.
        """
        bench, run, seed = job.bench, job.run, job.seed
        if run == PAPERS:
            part: Part = {}
            for split in SPLITS:
                add_rows(part, bench, job, split, bench.measure(run, seed, split, field=split == "test"))
        else:
            part = self.measure_geometric(job)
        part["run"] = bench.training_record(run, seed)
        return part

    def measure_geometric(self, job: Job) -> Part:
        """Measure a geometric network, its parts and its covariance."""
        bench, run, seed = job.bench, job.run, job.seed
        bench.train(run, seed)
        bench.say(f"asking {run.variant} seed {seed}")
        model, val = load(bench, run, seed)
        part: Part = {}
        for split in SPLITS:
            dataset = bench.split(split, run, seed, all_drones=True)
            answered = answers(model, dataset, tuple(PARTS) if run == GEOMETRIC else ())
            frames_of = {run.variant: answered.whole}
            for name, frames in answered.parts.items():
                frames_of[PARTS[name]] = frames
            if split == "test":
                for frames in frames_of.values():
                    frames |= field_errors(frames, dataset)
            chosen = slice(None)
            if run.without:
                chosen = answered.whole["label"] == bench.names.index(run.without)
                for name, frames in frames_of.items():
                    frames_of[name] = {key: value[chosen] for key, value in frames.items()}
            add_rows(part, bench, job, split, frames_of)
            if split == "test":
                uncertainty = doubt(answered.error[chosen], answered.covariance[chosen], model)
                part["doubt"] = [{"variant": run.variant, "seed": seed, **json_values(uncertainty)}]
                if seed == 0 and run == GEOMETRIC:
                    keep_network(bench, model, bench.folder(run, seed) / METRICS)
                    part |= self.details_of(job, model, answered, val, dataset)
        return part

    def details_of(
        self, job: Job, model: DroneKeyPP, answered: Answers, val: Answers, test_set: FrameDataset
    ) -> Part:
        """Measure what only the first geometric network is asked: flights, hidden parts and shapes."""
        bench, run, seed = job.bench, job.run, job.seed
        truth, val_truth = read_annotations(test_set), read_annotations(bench.split("val", run, seed))
        networks = {None: load(bench, PAPERS, seed)[0], run.variant: model}
        some = Subset(test_set, range(0, len(test_set), 10))
        return {
            "sequences": json_values(sequences(answered, truth, val, val_truth)),
            "occlusion": json_values(occlusion(networks, some)),
            "shapes": json_values(shapes(model, bench.drones)),
        }

    def markdown(self, recorded: dict[str, Any]) -> str:
        return markdown(recorded)

    def draw(self, recorded: dict[str, Any]) -> dict[str, plt.Figure]:
        figures = {"beyond": draw(recorded)}
        if recorded["doubt"] and recorded["occlusion"]:
            figures["beyond_doubt"] = draw_doubt(recorded)
        return figures


def reproduce(bench: Bench, seeds: int | None = None) -> dict[str, Any]:
    """Train and measure whatever is missing, and return the recorded result."""
    return Beyond().reproduce(bench, seeds)


def add_rows(part: Part, bench: Bench, job: Job, split: str, frames_of: dict[str | None, Frames]) -> None:
    """Add what is recorded of a job's variants and one split to its part."""
    for variant, frames in frames_of.items():
        labels = {"method": METHOD, "variant": variant, "seed": job.seed}
        add_entries(part, measurements(frames, bench.names, split, measures_of(frames), **labels))


def load(bench: Bench, run: Run, seed: int) -> tuple[DroneKeyPP, Answers | None]:
    """Load a run's network.

    A geometric network is calibrated on the validation flights, and its answers to them are returned with it.
    """
    model = bench.network(run, seed)
    if not model.decoder.needs_image:
        return model, None
    answered = answers(model, bench.split("val", run, seed), ())
    factors = calibration(answered.error, answered.covariance)
    model.decoder.calibration.copy_(torch.tensor(factors))
    scale = np.repeat(factors, 3)
    covariance = answered.covariance * scale[:, None] * scale
    return model, Answers(answered.whole, answered.parts, answered.error, covariance)


def keep_network(bench: Bench, model: DroneKeyPP, history: Path) -> None:
    """Write the calibrated network as float16, and its training curve, to data_samples/beyond."""
    folder = bench.root / "data_samples" / "beyond"
    model.save_pretrained(folder, half=True)
    write_beside(folder / METRICS, history.read_bytes())


def shapes(model: DroneKeyPP, drones: Sequence[DroneClass]) -> list[dict[str, Any]]:
    """Compare the hubs and the size that the network has learned of each drone with the true ones.

    off_mm is the root mean square distance of the learned hubs from the true ones, in millimetres. size_ratio
    is the believed size over the true one.
    """
    rows = []
    learned_hubs = model.decoder.shapes.hubs.detach().cpu().numpy()  # (n, 4, 3)
    for drone, learned in zip(drones, learned_hubs, strict=True):
        off = float(np.sqrt(np.square(learned - drone.hubs).sum(axis=1).mean()))
        ratio = radius(learned) / radius(drone.hubs)
        rows.append({"drone": drone.name, "off_mm": 1000 * off, "size_ratio": ratio})
    return rows
