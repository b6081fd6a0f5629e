"""Tables 4, 5 and 6, and the heads the paper does not try. Every row is a few settings of the one network, trained at one budget.

To add an ablation, add one entry to ABLATIONS. `python -m dronekeypp reproduce NAME` (or `reproduce(NAME)` in the script that added it) trains it,
measures it, and writes its table, its figure and data_samples/results/NAME.json. Rows with the same settings are one training, whatever table
they stand in.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch

from dronekeypp.errors import InputError
from dronekeypp.evaluate import frame_errors, interval_of_mean, json_values, read_annotations, to_device
from dronekeypp.files import write_beside
from dronekeypp.model import DroneKeyPP
from dronekeypp.presets import preset as find_preset
from dronekeypp.reproduce.runner import PAPER, Bench, Run, complete, result, rows_and_averages, write_result
from dronekeypp.reproduce.tables import (
    PRINTED,
    TEST_SCENES,
    average,
    by_seed,
    cells,
    drones,
    heading,
    methods,
    number,
    panels,
    percent,
    write_figure,
)
from dronekeypp.train import choose_device

METHOD = DroneKeyPP.method


@dataclass(frozen=True)
class Row:
    """A line of an ablation: its name (the paper's, where the paper has it), the settings it differs in from the preset, and its seeds.

    Every seed costs a training. A row that nothing will be claimed of may stop at one; None: as many as its table.
    """

    name: str
    changes: dict[str, Any] = field(default_factory=dict)
    seeds: int | None = None


@dataclass(frozen=True)
class Ablation:
    """A table: what it asks, its rows, and the row that the others are compared with (the whole method unless told otherwise)."""

    title: str
    rows: tuple[Row, ...]
    reference: str
    seeds: int = 3

    def __post_init__(self):
        names = [row.name for row in self.rows]
        assert self.reference in names and len(set(names)) == len(names), names


TRUTH = {"encoder": "truth"}

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
            Row("the paper's heads"),
            Row("rotation: 6D", {"rotation": "sixd"}),
            Row("rotation: allocentric 6D", {"rotation": "allocentric"}, seeds=1),
            Row("translation: SITE", {"translation": "site"}, seeds=1),
            Row("6D and SITE", {"rotation": "sixd", "translation": "site"}, seeds=1),
            Row("keypoints: mean pool", {"pool": "mean"}, seeds=1),
            Row("keypoints: every layer the same input", {"layer_input": "same"}),
            Row("keypoints: heatmap", {"keypoint_head": "heatmap"}),
            Row("gate: last layer only", {"gate": "last"}),
            Row("gate: uniform", {"gate": "uniform"}),
            Row("class: from the features, which it may not change", {"classifier": "features"}, seeds=1),
        ),
        reference="the paper's heads",
    ),
    "degraded": Ablation(
        "Training crops as a small, compressed video shows them",
        (Row("crops as rendered"), Row("half of them degraded", {"degrade": True})),
        reference="crops as rendered",
        seeds=1,
    ),
    "rays": Ablation(
        "What the ray embedding is fed, with each rotation head, from predicted and from true keypoints",
        tuple(
            Row(f"{source} keypoints, {fed} rays, {head}", {**told, "rays": fed, "rotation": rotation})
            for source, told in (("predicted", {}), ("true", TRUTH))
            for fed in ("raw", "standardised", "split")
            for head, rotation in (("Euler", "euler"), ("6D", "sixd"))
        ),
        reference="predicted keypoints, split rays, Euler",
    ),
}


def run_of(row: Row, preset: str) -> Run:
    """The training behind a row. What the row sets as the preset has it already is left out, so that equal settings are one run."""
    model, training = find_preset(preset)
    usual = {**training.to_dict(), **model.to_dict()}
    unknown = sorted(set(row.changes) - set(usual))
    if unknown:
        raise InputError(f"row {row.name!r}: unknown setting {unknown[0]!r}; known: {', '.join(usual)}")
    changes = {key: value for key, value in row.changes.items() if value != usual[key]}
    return Run(METHOD, " ".join(f"{key}={value}" for key, value in sorted(changes.items())) or None, changes)


def reproduce(name: str, bench: Bench, seeds: int | None = None) -> dict[str, Any]:
    """Train and measure whatever is missing of an ablation; write its table after every run that ends. Returns the recorded result.

    `seeds` gives every row that many, whatever the ablation says.

    Raises:
        InputError: the budget sets something in which the rows differ; then they would not be what they are called.
    """
    ablation = ABLATIONS[name]
    clash = sorted({key for row in ablation.rows for key in row.changes} & set(bench.budget))
    if clash:
        raise InputError(
            f"--set {clash[0]}: the rows of {name} differ in it; leave it out, or write an ablation of your own"
        )
    bench.render()
    wanted = {row.name: seeds or row.seeds or ablation.seeds for row in ablation.rows}
    jobs = [
        (bench, row, seed)
        for seed in range(max(wanted.values()))
        for row in ablation.rows
        if seed < wanted[row.name]
    ]
    known = lambda bench, row, seed: bench.finished(run_of(row, bench.preset), seed)  # noqa: E731
    return complete(jobs, known, measured, lambda parts: record(name, bench, parts))


def measured(bench: Bench, row: Row, seed: int) -> dict[str, Any]:
    """One row with one seed: {"story", "rows", "averages"}, trained first if need be."""
    run = run_of(row, bench.preset)
    frames = bench.measure(run, seed)[run.variant]
    rows, means = rows_and_averages(frames, method=METHOD, variant=row.name, seed=seed)
    story = {**bench.story(run, seed), "variant": row.name}
    if "gate" in frames:
        story["gate"] = [round(float(weight), 4) for weight in frames["gate"].mean(axis=0)]
    model, _ = bench.settings(run, seed)
    if (
        model.encoder == "learned" and model.pose == "mlp"
    ):  # without a picture a geometric network does not know how sure its keypoints are
        story["keypoints"] = {
            "its own": medians(frames),
            "true": medians(with_true_keypoints(bench, run, seed, frames)),
        }
    return {"story": story, "rows": rows, "averages": means}


def with_true_keypoints(
    bench: Bench, run: Run, seed: int, frames: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Errors of a trained network's decoder on true keypoints and the class it named itself. Only the decoder runs.

    Perfect keypoints should do no harm. Where they do, the network's own carry more than the places of propellers.
    """
    model = DroneKeyPP.from_pretrained(bench.train(run, seed)).to(choose_device(bench.settings(run, seed)[1]))
    truth = to_device(read_annotations(bench.split("test", run, seed)), next(model.parameters()).device)
    named = torch.from_numpy(frames["predicted"]).to(truth["label"])
    with torch.inference_mode():
        output = model(None, truth["K"], truth["square"], truth["keypoints"], named)
    return frame_errors(output, truth)


def medians(frames: dict[str, np.ndarray]) -> dict[str, float]:
    """Over all frames: rotation, translation, and by what share the distance is wrong."""
    off = np.abs(frames["distance_ratio"] - 1)
    return json_values(
        {
            "R_deg": float(np.median(frames["R_deg"])),
            "t_m": float(np.median(frames["t_m"])),
            "distance": float(np.median(off)),
        }
    )


def record(name: str, bench: Bench, parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Write the result, the table and the figure from what there is; returns the result."""
    joined = {key: [row for part in parts for row in part[key]] for key in ("rows", "averages")}
    recorded = result(
        name, bench, [part["story"] for part in parts], reference=ABLATIONS[name].reference, **joined
    )
    write_result(bench.root, recorded)
    folder = bench.root / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    write_beside(folder / f"{name}.md", markdown(recorded).encode())
    write_beside(folder / f"{name}.csv", as_csv(recorded).encode())
    write_figure(folder / f"{name}.png", draw(recorded))
    return recorded


def paper_value(name: str, variant: str, key: str) -> float | None:
    """The paper's number in one of PRINTED's keys, or None: it has no such row or column."""
    keys = [ours for _, ours, theirs, _ in PRINTED if theirs]
    printed = PAPER.get(name, {}).get(variant)
    return printed[keys.index(key)] if printed and key in keys else None


@dataclass(frozen=True)
class Difference:
    """A row's measure minus the reference's: over the sequences (seeds averaged), and of every seed of the one (first axis) against every seed of
    the other."""

    mean: float
    interval: tuple[float, float]
    seeds: np.ndarray

    @property
    def verdict(self) -> str:
        """ "better" or "worse" only if the interval leaves out 0 and three or more seeds lie wholly on one side; all our measures are errors."""
        if self.interval[0] <= 0 <= self.interval[1] or len(np.unique(np.sign(self.seeds))) > 1:
            return "not told apart"
        return ("better" if self.mean < 0 else "worse") + ("" if min(self.seeds.shape) >= 3 else "?")


def difference(recorded: dict[str, Any], variant: str, key: str) -> Difference | None:
    """A row against the reference, sequence by sequence; None where either was not measured."""
    reference = recorded["reference"]
    ours, theirs = (cells(recorded, METHOD, name, key)[:-1] for name in (variant, reference))
    apart = np.subtract(ours, theirs)
    if not np.isfinite(apart).all():
        return None
    seeds = [np.array(by_seed(recorded, METHOD, name, key)) for name in (variant, reference)]
    return Difference(float(apart.mean()), tuple(interval_of_mean(apart)), np.subtract.outer(*seeds))


def mean_and_spread(recorded: dict[str, Any], variant: str, key: str, digits: int) -> str:
    """ "16.5 ± 0.4": mean and standard deviation over the seeds; a single seed has no spread."""
    values = by_seed(recorded, METHOD, variant, key)
    if not values:
        return "–"
    return number(float(np.mean(values)), digits) + (
        f" ± {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else ""
    )


def markdown(recorded: dict[str, Any]) -> str:
    """The paper's table with ours beside it; then every row against the reference."""
    name, variants = recorded["name"], [variant for _, variant in methods(recorded)]
    minutes = [story["minutes"] for story in recorded["runs"]]
    printed = [(title, key, digits) for title, key, _, digits in PRINTED]
    with_paper = name in PAPER
    lines = [
        f"# {ABLATIONS[name].title}",
        "",
        f"{heading(recorded)} {len(minutes)} trainings of {min(minutes):g} to {max(minutes):g} minutes.",
        "",
        f"Mean of the {len(TEST_SCENES) * len(drones(recorded))} columns of Table 3"
        + (" ± standard deviation over the seeds (without it: one seed)" if any(story["seed"] for story in recorded["runs"]) else "")
        + (". The paper's value, on its own data, in brackets." if with_paper else "."),
        "",
        "| | " + " | ".join(title for title, *_ in printed) + " | direction (deg) | class | keypoints (px) |",
        "|---|" + "---:|" * (len(printed) + 3),
    ]  # fmt: skip
    for variant in variants:
        row, shown = average(recorded, METHOD, variant), []
        for _, key, digits in printed:
            theirs = paper_value(name, variant, key)
            shown.append(
                mean_and_spread(recorded, variant, key, digits)
                + (f" ({number(theirs, digits)})" if theirs is not None else "")
            )
        shown += [
            number(row["direction_deg"], 2),
            percent(row["class_accuracy"]),
            number(row["keypoint_px"], 1),
        ]
        lines.append(f"| {variant} | " + " | ".join(shown) + " |")
    reference = recorded["reference"]
    if reference in variants:
        lines += [
            "",
            f"## Against “{reference}”",
            "",
            "Difference of the errors, seeds averaged, with its 95 % interval over the sequences. *Better* or *worse*: the interval leaves out 0 "
            "and every seed is on the same side of every seed of the reference; with fewer than three a question mark stays.",
            "",
            "| | " + " | ".join(title for title, *_ in printed) + " |",
            "|---|" + "---|" * len(printed),
        ]
        for variant in variants:
            if variant != reference:
                shown = []
                for _, key, digits in printed:
                    apart = difference(recorded, variant, key)
                    low_high = "" if apart is None else ", ".join(f"{v:+.{digits}f}" for v in apart.interval)
                    shown.append(
                        "–" if apart is None else f"{apart.mean:+.{digits}f} [{low_high}] {apart.verdict}"
                    )
                lines.append(f"| {variant} | " + " | ".join(shown) + " |")
    own = {
        story["variant"]: story["keypoints"]
        for story in recorded["runs"]
        if story["seed"] == 0 and "keypoints" in story
    }
    if own:
        lines += [
            "",
            "## Given the true keypoints",
            "",
            "Medians over all test frames, seed 0. The class is the one it named itself.",
            "",
        ]
        lines += [
            "| | R, own keypoints (deg) | R, true | t, own (m) | t, true | distance off, own | distance off, true |",
            "|---|" + "---:|" * 6,
        ]
        for variant, found in own.items():
            shown = [
                number(found[whose][key], digits)
                for key, digits in (("R_deg", 1), ("t_m", 3))
                for whose in ("its own", "true")
            ]
            shown += [percent(found[whose]["distance"]) for whose in ("its own", "true")]
            lines.append(f"| {variant} | {' | '.join(shown)} |")
    return "\n".join(lines) + "\n"


def as_csv(recorded: dict[str, Any]) -> str:
    """Long format: variant, metric, source (paper | ours), seed (empty: the paper's), value."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["variant", "metric", "source", "seed", "value"])
    for _, variant in methods(recorded):
        for _, key, _, _ in PRINTED:
            for seed, value in enumerate(by_seed(recorded, METHOD, variant, key)):
                writer.writerow([variant, key, "ours", seed, f"{value:.6g}"])
            theirs = paper_value(recorded["name"], variant, key)
            if theirs is not None:
                writer.writerow([variant, key, "paper", "", f"{theirs:.6g}"])
    return text.getvalue()


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """One panel a metric, one line a row."""
    names = methods(recorded)
    return panels(
        recorded,
        names,
        [variant for _, variant in names],
        lambda name, key: paper_value(recorded["name"], name[1], key),
    )
