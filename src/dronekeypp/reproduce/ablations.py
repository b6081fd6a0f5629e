"""Train and measure Tables 4, 5 and 6, and the heads that the paper does not try.

Every row is a few settings of the one network, trained at one budget. To add an ablation, add one entry to
ABLATIONS. `python -m dronekeypp reproduce NAME` (or `reproduce(NAME)` in the script that added it) trains it,
measures it, and writes its table, its figure and data_samples/results/NAME.json. Rows with the same settings
are one training, whatever table they stand in.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch

from dronekeypp.data import read_annotations
from dronekeypp.errors import InputError
from dronekeypp.evaluate import Difference, frame_errors, json_values, to_device
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.model import ModelConfig
from dronekeypp.model.network import decoder_class
from dronekeypp.presets import TrainConfig
from dronekeypp.presets import preset as find_preset
from dronekeypp.reproduce import ablation_report
from dronekeypp.reproduce.ablation_report import (
    METHOD,
    as_csv,
    difference,
    draw,
    mean_and_spread,
    paper_value,
)
from dronekeypp.reproduce.headings import measure_by_heading
from dronekeypp.reproduce.protocol import SPLITS, Job, Part, Table, add_entries
from dronekeypp.reproduce.results import measurements
from dronekeypp.reproduce.runner import Bench, Run

__all__ = [
    "ABLATIONS",
    "METHOD",
    "Ablation",
    "AblationTable",
    "Bench",
    "Difference",
    "Row",
    "as_csv",
    "difference",
    "draw",
    "markdown",
    "mean_and_spread",
    "paper_value",
    "reproduce",
    "run_of",
]


@dataclass(frozen=True)
class Row:
    """Describe a line of an ablation.

    Every seed costs a training. A row about which nothing will be claimed may have only one.

    Args:
        name: the paper's name, where the paper has this row.
        changes: the settings in which it differs from the preset.
        seeds: how many seeds it is trained with; None takes as many as its table.
    """

    name: str
    changes: dict[str, Any] = field(default_factory=dict)
    seeds: int | None = None


@dataclass(frozen=True)
class Ablation:
    """Describe a table of rows.

    Args:
        title: the question that it asks.
        rows: its lines.
        reference: the name of the row that the others are compared with.
        seeds: the number of trainings of a row.
        gains: pairs of rows, the first of whose gain in rotation over the second is split by heading.
    """

    title: str
    rows: tuple[Row, ...]
    reference: str
    seeds: int = 3
    gains: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        names = [row.name for row in self.rows]
        assert self.reference in names and len(set(names)) == len(names), names
        for pair in self.gains:
            assert set(pair) <= set(names), pair

    def seeds_of(self, row: Row, seeds: int | None) -> int:
        """Return how many trainings a row gets.

        If `seeds` is given, it holds for every row.
        """
        return seeds or row.seeds or self.seeds


TRUTH = {"encoder": "truth"}
# How many times the loss of six numbers is that of three angles, for the same small turn θ about one axis.
# The former is the mean square over the 9 numbers of R, 8 sin²(θ/2) / 9, about 2 θ² / 9. The latter is Eq. 10
# in turns, (θ / 2π)² / 3. The ratio is 8 π² / 3 = 26.3.
MATRIX_OVER_ANGLES = 26
ANGLES, SIX_NUMBERS = "the paper's heads", "rotation: 6D"
LIGHT_SIX_NUMBERS = f"rotation: 6D, L_rot / {MATRIX_OVER_ANGLES}"
HEAVY_ANGLES = f"rotation: angles, L_rot × {MATRIX_OVER_ANGLES}"


def _ray_rows() -> tuple[Row, ...]:
    """Return a row for every combination of keypoints, ray features and rotation head."""
    rows = []
    for source, encoder in (("predicted", "learned"), ("true", "truth")):
        for rays in ("raw", "standardised", "split"):
            for head, rotation in (("Euler", "euler"), ("6D", "sixd")):
                changes = {"encoder": encoder, "rays": rays, "rotation": rotation}
                rows.append(Row(f"{source} keypoints, {rays} rays, {head}", changes))
    return tuple(rows)


ABLATIONS: dict[str, Ablation] = {
    "table4": Ablation(
        "Table 4: is the encoder needed?",
        (Row("ground-truth annotations, no encoder", TRUTH), Row("encoder")),
        reference="encoder",
    ),
    "table5": Ablation(
        "Table 5: the parts of the decoder",
        (
            Row("(1) only MLP_pose", {"use_rays": False, "use_3d": False, "use_class": False}),
            Row("(2) RayEmbed + MLP_pose", {"use_3d": False, "use_class": False}),
            Row("(3) RayEmbed + MLP_pose + MLP_3D", {"use_class": False}),
            Row("(4) full decoder"),
        ),
        reference="(4) full decoder",
    ),
    "table6": Ablation(
        "Table 6: weights of the losses",
        (
            Row("tanh-weighted", {"schedule": "tanh"}),
            Row("smoothly-shifted", {"schedule": "shifted"}),
            Row("3D-biased", {"schedule": "biased"}),
            Row("equal"),
        ),
        reference="equal",
    ),
    "heads": Ablation(
        "Heads, gates and inputs that the paper does not try",
        (
            Row(ANGLES),
            Row(SIX_NUMBERS, {"rotation": "sixd"}),
            Row(LIGHT_SIX_NUMBERS, {"rotation": "sixd", "rotation_weight": 1 / MATRIX_OVER_ANGLES}),
            Row(HEAVY_ANGLES, {"rotation_weight": MATRIX_OVER_ANGLES}),
            Row("translation: SITE", {"translation": "site"}),
            Row("keypoints: every layer the same input", {"layer_input": "same"}),
            Row("keypoints: heatmap", {"keypoint_head": "heatmap"}),
            Row("gate: last layer only", {"gate": "last"}),
            Row("gate: uniform", {"gate": "uniform"}),
            Row("class: from the features, which it may not change", {"classifier": "features"}),
        ),
        reference=ANGLES,
        # As they come; with both losses as light as that of angles; with both as heavy as that of numbers.
        gains=((SIX_NUMBERS, ANGLES), (LIGHT_SIX_NUMBERS, ANGLES), (SIX_NUMBERS, HEAVY_ANGLES)),
    ),
    "degraded": Ablation(
        "Training crops as a small, compressed video shows them",
        (Row("crops as rendered"), Row("half of them degraded", {"degrade": True})),
        reference="crops as rendered",
        seeds=1,
    ),
    "rays": Ablation(
        "What the ray embedding is fed, with each rotation head, from predicted and from true keypoints",
        _ray_rows(),
        reference="predicted keypoints, split rays, Euler",
    ),
}


def run_of(row: Row, preset: str) -> Run:
    """Return the training behind a row.

    If the row sets something to the preset's own value, it is left out, so that equal settings are one run.

    Raises:
        InputError: The row sets something that neither the training nor the network that it chooses has.
    """
    model, training = find_preset(preset)
    usual = {**training.to_dict(), **model.to_dict()}
    settings = TrainConfig.keys() + ModelConfig.known_keys({**usual, **row.changes})
    unknown = sorted(set(row.changes) - set(settings))
    if unknown:
        raise InputError(f"row {row.name!r}: unknown setting {unknown[0]!r}; known: {', '.join(settings)}")
    changes = {}
    for key, value in row.changes.items():
        if key not in usual or value != usual[key]:
            changes[key] = value
    words = []
    for key, value in sorted(changes.items()):
        words.append(f"{key}={value:g}" if isinstance(value, float) else f"{key}={value}")
    return Run(METHOD, " ".join(words) or None, changes)


class AblationTable(Table):
    """An `AblationTable` measures and shows one entry of ABLATIONS."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.ablation = ABLATIONS[name]
        if self.ablation.gains:
            self.lists = (*self.lists, "by_heading")

    def prepare(self, bench: Bench) -> None:
        """Render the data set.

        Raises:
            InputError: The budget sets something in which the rows differ. Then they would not be what they
                are called.
        """
        varied: set[str] = set()
        for row in self.ablation.rows:
            varied |= set(row.changes)
        clash = sorted(varied & set(bench.budget))
        if clash:
            raise InputError(
                f"--set {clash[0]}: the rows of {self.name} differ in it; "
                "leave it out, or write an ablation of your own"
            )
        super().prepare(bench)

    def jobs(self, bench: Bench, seeds: int | None) -> list[Job]:
        rows = self.ablation.rows
        most = max(self.ablation.seeds_of(row, seeds) for row in rows)
        jobs = []
        for seed in range(most):
            for row in rows:
                if seed < self.ablation.seeds_of(row, seeds):
                    jobs.append(Job(bench, run_of(row, bench.preset), seed, label=row.name))
        return jobs

    def measure(self, job: Job) -> Part:
        """Measure one row with one seed."""
        bench, run, seed = job.bench, job.run, job.seed
        labels = {"method": METHOD, "variant": job.label, "seed": seed}
        part: Part = {}
        for split in SPLITS:
            frames = bench.measure(run, seed, split)[run.variant]
            add_entries(part, measurements(frames, bench.names, split, **labels))
        if self.ablation.gains:
            part["by_heading"] = measure_by_heading(bench, run, seed, job.label)
        part["run"] = self.training_record(job)
        return part

    def training_record(self, job: Job) -> dict[str, Any]:
        """Return the record of a training, with its gate and with what its decoder does on true keypoints."""
        bench, run, seed = job.bench, job.run, job.seed
        frames = bench.measure(run, seed)[run.variant]
        record = {**bench.training_record(run, seed), "variant": job.label}
        if "gate" in frames:
            record["gate"] = [round(float(weight), 4) for weight in frames["gate"].mean(axis=0)]
        model, _ = bench.settings(run, seed)
        # Without a picture a geometric network does not know how sure its keypoints are.
        if model.encoder == "learned" and not decoder_class(model.pose).needs_image:
            record["keypoints"] = {
                "its own": medians(frames),
                "true": medians(with_true_keypoints(bench, run, seed, frames)),
            }
        return record

    def details(self, bench: Bench) -> dict[str, Any]:
        return {"reference": self.ablation.reference}

    def markdown(self, recorded: dict[str, Any]) -> str:
        return markdown(recorded)

    def as_csv(self, recorded: dict[str, Any]) -> str:
        return as_csv(recorded)

    def draw(self, recorded: dict[str, Any]) -> dict[str, plt.Figure]:
        return {self.name: draw(recorded)}


def reproduce(name: str, bench: Bench, seeds: int | None = None) -> dict[str, Any]:
    """Train and measure whatever is missing of an ablation, and return the recorded result.

    If `seeds` is given, every row gets that many, whatever the ablation says.

    Raises:
        InputError: The budget sets something in which the rows differ.
    """
    return AblationTable(name).reproduce(bench, seeds)


def markdown(recorded: dict[str, Any]) -> str:
    """Return the ablation's tables as Markdown.

    The first table is the paper's with ours beside it. The second compares every row with the reference. The
    third shows the decoders on true keypoints. Where the ablation asks for gains, a fourth splits them by
    heading.
    """
    ablation = ABLATIONS[recorded["name"]]
    pairs = [((METHOD, first), (METHOD, second)) for first, second in ablation.gains]
    return ablation_report.markdown(recorded, ablation.title, pairs)


def with_true_keypoints(bench: Bench, run: Run, seed: int, frames: Frames) -> Frames:
    """Return the errors of a trained network's decoder on true keypoints and the class that it named itself.

    Only the decoder runs. Perfect keypoints should do no harm. Where they do, the network's own keypoints
    carry more than the places of propellers.
    """
    network = bench.network(run, seed)
    device = next(network.parameters()).device
    truth = to_device(read_annotations(bench.split("test", run, seed)), device)
    named = torch.from_numpy(frames["predicted"]).to(truth["label"])
    with torch.inference_mode():
        output = network(None, truth["K"], truth["square"], truth["keypoints"], named)
    return frame_errors(output, truth)


def medians(frames: Frames) -> dict[str, float]:
    """Return medians over all frames: of the rotation, the translation and the distance's relative error."""
    values = {
        "R_deg": float(np.median(frames["R_deg"])),
        "t_m": float(np.median(frames["t_m"])),
        "distance": float(np.median(np.abs(frames["distance_ratio"] - 1))),
    }
    return json_values(values)
