"""Table 3: DroneKey++ beside three baselines on test scenes 6 and 7, seven drones each. Same crops and budget; the same loop but for YOLO's own."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from scipy.spatial.transform import Rotation
from sklearn.metrics import confusion_matrix
from torch.utils.data import DataLoader

from dronekeypp.baselines import network_class, yolo
from dronekeypp.baselines.pnp_pose import PnPPose
from dronekeypp.camera import from_crop
from dronekeypp.evaluate import drone_names, frame_errors, read_annotations, to_device
from dronekeypp.files import write_beside
from dronekeypp.model.base import WEIGHTS
from dronekeypp.predict import mirror_doubt
from dronekeypp.reproduce.runner import (
    PAPER,
    Bench,
    Run,
    complete,
    describe,
    hardware,
    read_npz,
    result,
    rows_and_averages,
    say,
    source_digest,
    variant_name,
    write_npz,
    write_result,
)
from dronekeypp.reproduce.tables import (
    PRINTED,
    TEST_SCENES,
    average,
    cells,
    drones,
    heading,
    interval,
    methods,
    number,
    panels,
    percent,
    title,
    write_figure,
)
from dronekeypp.sixdronesyn.dataset import SixDroneSyn
from dronekeypp.train import BEST, METRICS, choose_device

RUNS = (
    Run("DroneKey++"),
    Run("DroneKey", hypotheses=("fit", "upright")),
    Run("DronePose"),
    Run("DronePose", "told the crop", {"use_rays": True}),
    Run(yolo.METHOD, hypotheses=("fit", "upright")),
)
# What is kept of every test frame, for figures.
KEPT = (
    "R_deg", "t_m", "distance_m", "heading_deg", "keypoint_px", "keypoint_crop_px", "flip", "failed", "label", "predicted", "scene", "subsequence",
    "frame",
)  # fmt: skip


def reproduce(bench: Bench, seeds: int = 1) -> dict[str, Any]:
    """Render, train and measure whatever of Table 3 is missing; write the table after every run that ends. Returns the recorded result.

    YOLOv8n-pose is measured where the optional extra is installed.
    """
    bench.render()
    jobs = [(bench, run, seed) for seed in range(seeds) for run in RUNS]
    absent = [
        job for job in jobs if job[1].method == yolo.METHOD and not yolo.installed() and not finished(*job)
    ]
    if absent:
        say(
            'YOLOv8n-pose is left out: its extra is not installed (pip install -e ".[yolo]", AGPL-3.0)',
            bench.progress,
        )
    return complete(
        [job for job in jobs if job not in absent], finished, measured, lambda parts: record(bench, parts)
    )


def finished(bench: Bench, run: Run, seed: int) -> bool:
    """Whether a run, YOLO's too, was trained to its end."""
    if run.method == yolo.METHOD:
        return yolo.epochs_done(bench.folder(run, seed)) >= yolo_epochs(bench, run, seed)
    return bench.finished(run, seed)


def measured(bench: Bench, run: Run, seed: int) -> dict[str, Any]:
    """One run: {"story", "rows", "averages", "confusion", "arrays"}, trained first if need be."""
    if run.method == yolo.METHOD:
        frames_of, story = measure_yolo(bench, run, seed)
    else:
        frames_of, story = bench.measure(run, seed), bench.story(run, seed)
    if run == RUNS[0] and seed == 0:
        keep_checkpoint(bench, run, seed)
        keep_flights(bench, run, seed)
    found: dict[str, Any] = {"story": story, "rows": [], "averages": [], "confusion": [], "arrays": {}}
    for variant, frames in frames_of.items():
        labels = {"method": run.method, "variant": variant, "seed": seed}
        rows, means = rows_and_averages(frames, **labels)
        found["rows"] += rows
        found["averages"] += means
        answered = frames["predicted"] >= 0
        if answered.any():
            matrix = confusion_matrix(
                frames["label"][answered], frames["predicted"][answered], labels=range(len(drone_names()))
            )
            found["confusion"].append(
                {
                    **labels,
                    "drones": drone_names(),
                    "true_by_predicted": matrix.tolist(),
                    "unanswered": int((~answered).sum()),
                }
            )
        if seed == 0:
            found["arrays"].update(
                {f"{title(run.method, variant)}/{name}": shrink(frames[name]) for name in KEPT}
            )
    return found


def record(bench: Bench, parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Write the result, its frames, the table and the figure from what there is; returns the result."""
    joined = {key: [row for part in parts for row in part[key]] for key in ("rows", "averages", "confusion")}
    recorded = result("table3", bench, [part["story"] for part in parts], **joined)
    arrays = {name: value for part in parts for name, value in part["arrays"].items()}
    write_npz(write_result(bench.root, recorded).with_name("table3_frames.npz"), arrays)
    write_table(recorded, bench.root / "figures")
    return recorded


def keep_checkpoint(bench: Bench, run: Run, seed: int) -> None:
    """The run's best network as float16, and its curve, in data_samples/checkpoint."""
    folder = bench.root / "data_samples" / "checkpoint"
    network_class(run.method).from_pretrained(bench.folder(run, seed) / BEST).save_pretrained(
        folder, half=True
    )
    write_beside(folder / METRICS, (bench.folder(run, seed) / METRICS).read_bytes())


def keep_flights(bench: Bench, run: Run, seed: int) -> None:
    """What that network says of every validation and test flight, and the truth, in data_samples/results/flights.npz, for smoothing.

    SPLIT/NAME: subsequence, frame, label, predicted (F,) · rotvec, t and true_rotvec, true_t (F, 3) · of the keypoints, all (F,) in crop units,
    their error keypoint_units and two signs of doubt: layer_spread, see `encoder.layer_spread`, and mirror, see `predict.mirror_doubt`.
    """
    path = bench.root / "data_samples" / "results" / "flights.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    made_from = source_digest(bench.train(run, seed) / WEIGHTS, bench.data)
    if read_npz(path, made_from) is not None:
        return
    device = choose_device(bench.settings(run, seed)[1])
    model = network_class(run.method).from_pretrained(bench.train(run, seed)).to(device)
    arrays: dict[str, np.ndarray] = {}
    for split in ("val", "test"):
        frames, dataset = (
            bench.measure(run, seed, name=split, split=split)[run.variant],
            bench.split(split, run, seed),
        )
        truth, doubts = read_annotations(dataset), []
        with torch.inference_mode():
            for items in DataLoader(dataset, 64):
                items = to_device(items, device)
                inputs = [items[name] for name in ("image", "K", "square")]
                doubts.append(mirror_doubt(model, *inputs, model(*inputs)["keypoints"]).cpu())
        found = {
            name: frames[name]
            for name in ("subsequence", "frame", "label", "predicted", "t", "layer_spread", "keypoint_units")
        }
        found |= {
            "true_t": truth["t"].numpy(),
            "rotvec": Rotation.from_matrix(frames["R"]).as_rotvec(),
            "mirror": torch.cat(doubts).numpy(),
        }
        found["true_rotvec"] = Rotation.from_matrix(truth["R"].numpy()).as_rotvec()
        arrays |= {f"{split}/{name}": shrink(value) for name, value in found.items()}
    write_npz(path, arrays, made_from)


def yolo_epochs(bench: Bench, run: Run, seed: int) -> int:
    """As many epochs of all training frames as show the detector what the budget shows the others."""
    training, frames = bench.settings(run, seed)[1], describe(bench.data)["train_frames"]
    return max(1, round(training.epochs * min(training.frames or frames, frames) / frames))


def measure_yolo(
    bench: Bench, run: Run, seed: int
) -> tuple[dict[str | None, dict[str, np.ndarray]], dict[str, Any]]:
    """`Bench.measure` and `Bench.story` for YOLOv8n-pose, which trains itself. Its PnP is told the true drone, as DroneKey's is."""
    (model, training), folder = bench.settings(run, seed), bench.folder(run, seed)
    say(f"{run.method} seed {seed}: {folder}", bench.progress)
    val = bench.split("val", run, seed)
    if training.val_frames:
        val = SixDroneSyn(
            bench.data, "val", size=model.image_size, stride=max(1, len(val) // training.val_frames)
        )
    sets = {"train": SixDroneSyn(bench.data, "train", size=model.image_size), "val": val}
    settings = {
        "size": model.image_size, "epochs": yolo_epochs(bench, run, seed), "batch": training.batch, "seed": seed,
        "digest": describe(bench.data)["digest"],
    }  # fmt: skip
    device = str(choose_device(training))
    weights = yolo.train(sets, folder, drone_names(), settings, device)
    made_from, found, answer = source_digest(weights, bench.data), {}, None
    pnp = PnPPose(model.classes)
    pnp.learn(read_annotations(sets["train"]))
    for hypothesis in run.hypotheses:
        path = folder / f"test-{hypothesis}.npz"
        frames = read_npz(path, made_from)
        if frames is None:
            items = next(iter(DataLoader(bench.split("test", run, seed), batch_size=10**6)))
            answer = answer or yolo.detect(weights, items["image"], model.classes, device)
            pixels = from_crop(answer["keypoints"], items["square"])
            pixels[~answer["found"]] = torch.nan  # to which PnP answers with its constant
            pnp.hypothesis = hypothesis
            frames = frame_errors({**answer, **pnp(pixels, items["label"], items["K"])}, items)
            write_npz(path, frames, made_from)
        found[variant_name(run, hypothesis)] = frames
    story = {
        "method": run.method,
        "variant": None,
        "seed": seed,
        **yolo.story(folder),
        "changes": {},
        "hardware": hardware(training),
    }
    return found, story


def shrink(values: np.ndarray) -> np.ndarray:
    """Three digits and small integers are enough for a figure."""
    if values.dtype.kind == "f":
        return values.astype(np.float16)
    return (
        values.astype(np.int16 if values.max() < 2**15 else np.int32) if values.dtype.kind == "i" else values
    )


def paper_cells(method: str, key: str, names: Sequence[str] = ()) -> list[float] | None:
    """The paper's columns of the drones `names`, NaN where it has none, and its printed average; None for a method that it does not have."""
    printed = PAPER["table3"].get(method, {}).get(key)
    if printed is None:
        return None
    return [
        *(printed[f"scene_{scene:02d}"].get(drone, np.nan) for scene in TEST_SCENES for drone in names),
        printed["average_printed"],
    ]


def write_table(recorded: dict[str, Any], folder: Path) -> None:
    """table3.md, table3.csv and table3.png in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    write_beside(folder / "table3.md", markdown(recorded).encode())
    write_beside(folder / "table3.csv", as_csv(recorded).encode())
    write_figure(folder / "table3.png", draw(recorded))


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """One panel a metric: our average with its interval, and the paper's."""
    printed = {key: theirs for _, key, theirs, _ in PRINTED}
    names = methods(recorded)

    def paper(name: tuple[str, str | None], key: str) -> float | None:
        found = paper_cells(name[0], printed[key]) if name[1] is None and printed[key] else None
        return found and found[-1]

    return panels(recorded, names, [title(*name) for name in names], paper)


def markdown(recorded: dict[str, Any]) -> str:
    """The paper's layout: methods by metrics, 14 columns and the average, the paper's value above ours; then what the paper does not print."""
    minutes: dict[str, float] = {}
    for story in recorded["runs"]:
        minutes.setdefault(title(story["method"], story["variant"]), story["minutes"])
    columns = [f"{scene}·{drone}" for scene in TEST_SCENES for drone in drones(recorded)]
    lines = [
        "# Table 3: test scenes 6 and 7",
        "",
        f"{heading(recorded)} Minutes of training: {', '.join(f'{k} {v:g}' for k, v in minutes.items())}.",
        "",
        "`paper` is the printed value, `ours` what we measured on our own 6DroneSyn: other renderings, other flights, so compare the order of the "
        "methods rather than single cells. The paper's t MAE fits a per-axis error (see `evaluate.py`), so it stands beside ours per axis.",
        "",
        "| method | metric | | " + " | ".join(columns) + " | average |",
        "|---|---|---|" + "---:|" * (len(columns) + 1),
    ]
    for method, variant in methods(recorded):
        for name, ours, theirs, digits in PRINTED:
            values = [("ours", cells(recorded, method, variant, ours))]
            if variant is None and theirs and (printed := paper_cells(method, theirs, drones(recorded))):
                values.insert(0, ("paper", printed))
            for who, numbers in values:
                lines.append(
                    f"| {title(method, variant)} | {name} | {who} | "
                    + " | ".join(number(v, digits) for v in numbers)
                    + " |"
                )
    lines += [
        "",
        "## Averages, with 95 % intervals",
        "",
        f"Mean of the {len(columns)} columns; the interval draws these sequences (scene and drone) with replacement. They are few: an interval this "
        "rough says only whether two methods are far apart. Seeds are averaged first.",
        "",
        "| method | "
        + " | ".join(name for name, *_ in PRINTED)
        + " | class | keypoints (px) | PCK@0.05 | heading flips | no pose |",
        "|---|" + "---:|" * (len(PRINTED) + 5),
    ]
    for method, variant in methods(recorded):
        row = average(recorded, method, variant)
        found = [interval(row, key, digits) for _, key, _, digits in PRINTED]
        found += [percent(row["class_accuracy"]), number(row["keypoint_px"], 1)]
        found += [percent(row[key]) for key in ("pck", "flip_rate", "failed")]
        lines.append(f"| {title(method, variant)} | " + " | ".join(found) + " |")
    return "\n".join(lines) + "\n"


def as_csv(recorded: dict[str, Any]) -> str:
    """Long format: method, variant, metric, source (paper | ours), scene, drone, value; scene "average" for the last column."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "variant", "metric", "source", "scene", "drone", "value"])
    places = [(scene, drone) for scene in TEST_SCENES for drone in drones(recorded)] + [("average", "")]
    for method, variant in methods(recorded):
        for _, ours, theirs, _ in PRINTED:
            values = [("ours", ours, cells(recorded, method, variant, ours))]
            if variant is None and theirs and (printed := paper_cells(method, theirs, drones(recorded))):
                values.append(("paper", ours, printed))
            for source, metric, numbers in values:
                for (scene, drone), value in zip(places, numbers, strict=True):
                    writer.writerow(
                        [
                            method,
                            variant or "",
                            metric,
                            source,
                            scene,
                            drone,
                            "" if np.isnan(value) else f"{value:.6g}",
                        ]
                    )
    return text.getvalue()
