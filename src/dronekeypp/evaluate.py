"""Errors of every frame, their summary by scene and drone, and the constant answer to beat (Sec. V-A, Eq. 13-14).

The paper's Eq. 13 divides the angle by pi, its tables print degrees; we print degrees. Its translation MAE fits a per-axis
mean and its median a Euclidean distance; we report Euclidean for both and the per-axis mean beside them.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset, Subset
from tqdm import tqdm

from dronekeypp import rotations
from dronekeypp.errors import InputError
from dronekeypp.files import write_beside
from dronekeypp.model.encoder import layer_spread

# One column of a row of results: its key and what makes it from the frames of that row.
MEASURES: dict[str, Callable[[dict[str, np.ndarray]], float]] = {
    "R_mae_deg": lambda f: f["R_deg"].mean(),
    "R_medae_deg": lambda f: np.median(f["R_deg"]),
    "t_mae_m": lambda f: f["t_m"].mean(),
    "t_medae_m": lambda f: np.median(f["t_m"]),
    "t_axis_mae_m": lambda f: f["t_axis_m"].mean(),
    "class_accuracy": lambda f: f["class_correct"].mean(),
    "keypoint_px": lambda f: f["keypoint_px"].mean(),
    "keypoint_medae_px": lambda f: np.median(f["keypoint_px"]),
    "keypoint_crop_px": lambda f: f["keypoint_crop_px"].mean(),
    "pck": lambda f: f["pck"].mean(),
    "distance_ratio": lambda f: np.median(f["distance_ratio"]),
    "direction_deg": lambda f: np.median(f["direction_deg"]),
    "flip_rate": lambda f: f["flip"].mean(),
    "failed": lambda f: f["failed"].mean(),
}
MARGIN = 1.2  # of the crops that are evaluated: their side over the longer side of the box (`camera.square_around`)
PCK = 0.05  # of the box's longer side
PARTS = {"R_deg": "R", "t_m": "t", "keypoint_units": "keypoints"}  # which part of the output an error needs
FORMAT = 2  # of `frame_errors`: raised when an array is added or means something else, so that stored ones are made again
INTERVALS = ("R_mae_deg", "R_medae_deg", "t_mae_m", "t_medae_m", "class_accuracy")


def frame_errors(output: dict, batch: dict) -> dict[str, np.ndarray]:
    """Errors of one batch, an array per measure; NaN where `output` lacks the part (a baseline without a class, say).

    `output` is what a network answers, see `PoseNetwork`; class_probs all 0 say "no answer". `batch` needs R, t, square, label, scene, frame,
    subsequence, and keypoints if any are predicted: a batch of `SixDroneSyn`, or its `poses`; of image only the width is read, for
    keypoint_crop_px.

    R_deg: geodesic angle · t_m: Euclidean distance · t_axis_m (B, 3): per camera axis · class_correct, label, predicted (-1: none) ·
    keypoint_units: mean distance of the four keypoints in crop units, keypoint_px in full-frame pixels, keypoint_crop_px in pixels of the
    resized crop · pck: share of the four within 5 % of the box's longer side (of crops with the margin 1.2, as all are but augmented ones) ·
    flip: the predicted nose points more than 90 degrees away from the true one · distance_ratio: predicted over true distance ·
    direction_deg: angle between the predicted and the true way to the drone ·
    heading_deg: angle between the true nose and the way to the camera (0: it looks at us, 180: away from us) ·
    failed: no pose was found, and R and t are the method's constant answer · gate (B, N): Eq. 3, and layer_spread,
    crop units: of a network that has them.
    """
    R, t, square = batch["R"], batch["t"], batch["square"]
    output = {
        name: value.to(t.dtype) if torch.is_tensor(value) and value.is_floating_point() else value
        for name, value in output.items()
    }
    nothing = torch.full_like(t[:, 0], torch.nan)
    has = {name: output.get(name) is not None for name in ("R", "t", "keypoints", "class_probs", "failed")}
    apart = (
        (output["keypoints"] - batch["keypoints"]).norm(dim=-1)
        if has["keypoints"]
        else nothing[:, None].expand(-1, 4)
    )  # (B, 4)
    units = apart.mean(dim=-1)
    away = output["t"] - t if has["t"] else nothing[:, None].expand(-1, 3)
    predicted = torch.full_like(batch["label"], -1)
    if has["class_probs"]:  # all zeros: no answer (a detector that found nothing); NaN is none either
        answered = (output["class_probs"] != 0).any(dim=-1) & output["class_probs"].isfinite().all(dim=-1)
        predicted = torch.where(answered, output["class_probs"].argmax(dim=-1), predicted)
    nose = (output["R"][:, :, 0] * R[:, :, 0]).sum(dim=-1) if has["R"] else nothing
    across = (
        torch.linalg.cross(output["t"], t).norm(dim=-1) if has["t"] else nothing
    )  # exact at 0 degrees, where acos is not
    errors = {
        "R_deg": rotations.geodesic_degrees(output["R"], R) if has["R"] else nothing,
        "t_m": away.norm(dim=-1),
        "t_axis_m": away.abs(),
        "distance_m": t.norm(dim=-1),
        "distance_ratio": output["t"].norm(dim=-1) / t.norm(dim=-1) if has["t"] else nothing,
        "direction_deg": torch.rad2deg(torch.atan2(across, (output["t"] * t).sum(dim=-1)))
        if has["t"]
        else nothing,
        "heading_deg": torch.rad2deg(
            torch.acos((-(R[:, :, 0] * t).sum(dim=-1) / t.norm(dim=-1)).clamp(-1, 1))
        ),
        "class_correct": (predicted == batch["label"]).to(t.dtype) if has["class_probs"] else nothing,
        "label": batch["label"],
        "predicted": predicted,
        "keypoint_units": units,
        "keypoint_px": units * square[:, 2],
        "keypoint_crop_px": units * batch["image"].shape[-1] if "image" in batch else nothing,
        "pck": torch.where(apart.isnan(), apart, (apart * MARGIN < PCK).to(t.dtype)).mean(dim=-1),
        "flip": torch.where(nose.isnan(), nose, (nose < 0).to(t.dtype)),
        "failed": output["failed"] if has["failed"] else torch.zeros_like(predicted, dtype=torch.bool),
        "R": output["R"] if has["R"] else nothing[:, None, None].expand(-1, 3, 3),
        "t": output["t"] if has["t"] else nothing[:, None].expand(-1, 3),
        "keypoints": output["keypoints"] if has["keypoints"] else nothing[:, None, None].expand(-1, 4, 2),
    }
    if output.get("cr") is not None:
        errors |= {"gate": output["gate"], "layer_spread": layer_spread(output)}
    for name in ("scene", "frame", "subsequence"):
        errors[name] = batch[name]
    return {name: value.detach().cpu().numpy() for name, value in errors.items()}


def to_device(batch: dict, device: torch.device | str) -> dict:
    return {
        name: value.to(device, non_blocking=True) for name, value in batch.items() if torch.is_tensor(value)
    }


def apply_model(model: nn.Module, batch: dict, truth_inputs: Sequence[str] = ()) -> dict:
    """Run a network on a batch, with the truths that `truth_inputs` names (`PoseNetwork.truth_inputs`; Table 4 hands over keypoints and label)."""
    return model(batch["image"], batch["K"], batch["square"], **{name: batch[name] for name in truth_inputs})


def evaluate(
    model: nn.Module | Callable[..., dict],
    dataset: Dataset,
    batch: int = 64,
    workers: int = 0,
    criterion: Callable[[dict, dict], dict[str, torch.Tensor]] | None = None,
    progress: Callable | None = None,
) -> dict[str, np.ndarray]:
    """Errors of every frame of `dataset`, in its order: the arrays of `frame_errors`, joined, and the predicted R, t and keypoints.

    `criterion(output, batch)` may add loss terms: they come back as "losses", their means. `progress` may wrap the batches (tqdm).
    The network is put in evaluation mode and left as it was found. Anything that is called like one will do, an `OnnxNetwork` say.

    Raises:
        InputError: an empty data set, or a prediction that is not finite (it names the frame).
    """
    if len(dataset) == 0:
        raise InputError("nothing to evaluate: the data set has no frames")
    network = (
        model if isinstance(model, nn.Module) else nn.Module()
    )  # what is none has no mode and no parameters
    device = next((p.device for p in network.parameters()), torch.device("cpu"))
    loader = DataLoader(dataset, batch_size=batch, num_workers=workers, generator=torch.Generator())
    truth_inputs = getattr(model, "told", ())
    parts, losses, present, was_training = [], {}, [], network.training
    network.eval()
    try:
        with torch.inference_mode():
            for items in progress(loader) if progress else loader:
                items = to_device(items, device)
                output = apply_model(model, items, truth_inputs)
                parts.append(frame_errors(output, items))
                present = [error for error, part in PARTS.items() if output.get(part) is not None]
                for name, value in (criterion(output, items) if criterion else {}).items():
                    losses[name] = losses.get(name, 0.0) + value.item() * len(items["t"])
    finally:
        network.train(was_training)
    frames = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    bad = ~np.isfinite([frames[error] for error in present]).all(axis=0)
    if bad.any():
        i = int(bad.argmax())
        raise InputError(
            f"the error of frame {frames['frame'][i]} (scene {frames['scene'][i]}) is not finite: "
            "the annotation or the network's weights hold NaN"
        )
    if criterion:
        frames["losses"] = {name: value / len(dataset) for name, value in losses.items()}
    return frames


def measure(frames: dict[str, np.ndarray], chosen: np.ndarray | slice = slice(None)) -> dict[str, float]:
    """Every measure over the chosen frames (an index array or a mask)."""
    part = {name: value[chosen] for name, value in frames.items() if isinstance(value, np.ndarray)}
    return {name: float(make(part)) for name, make in MEASURES.items()}


def drone_names() -> list[str]:
    from dronekeypp.sixdronesyn.drones import DRONES

    return list(DRONES)


def summarise(frames: dict[str, np.ndarray], names: Sequence[str] | None = None, **labels) -> list[dict]:
    """One row per scene and drone, in order: {**labels, "scene", "drone", "frames", and every measure}.

    `labels` are put in front of every row (method=, variant=, seed=); `names` are the drones in class order.
    """
    names = names if names is not None else drone_names()
    rows = []
    for scene in np.unique(frames["scene"]):
        for label in np.unique(frames["label"]):
            chosen = (frames["scene"] == scene) & (frames["label"] == label)
            if chosen.any():
                row = {**labels, "scene": int(scene), "drone": names[label], "frames": int(chosen.sum())}
                rows.append({**row, **measure(frames, chosen)})
    return rows


def averages(frames: dict[str, np.ndarray], draws: int = 1000, **labels) -> list[dict]:
    """Two rows: "over": "rows" (mean of the scene-and-drone rows, as a table's last column) and "over": "frames".

    Both carry 95 % bootstrap intervals, KEY_ci95: [low, high]. Frames of a flight resemble each other, so frames are never drawn: the first
    draws the rows, the second whole subsequences (scene, drone, subsequence). An honest interval is wider.
    """
    rows = summarise(frames, names=[str(i) for i in range(int(frames["label"].max()) + 1)])
    by_rows = {name: float(np.mean([row[name] for row in rows])) for name in MEASURES}
    by_frames = measure(frames)
    keys = np.stack([frames["scene"], frames["label"], frames["subsequence"]], axis=1)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    members = [np.flatnonzero(group.ravel() == g) for g in range(group.max() + 1)]
    generator = np.random.default_rng(0)
    drawn: dict[str, list[float]] = {name: [] for name in INTERVALS}
    for _ in range(draws):
        chosen = np.concatenate([members[g] for g in generator.integers(len(members), size=len(members))])
        for name in INTERVALS:
            drawn[name].append(
                float(MEASURES[name]({key: v[chosen] for key, v in _of(frames, name).items()}))
            )
    intervals = {f"{name}_ci95": percentiles(v) for name, v in drawn.items() if np.isfinite(v).all()}
    columns = {name: [row[name] for row in rows] for name in MEASURES}
    by_rows |= {
        f"{name}_ci95": interval_of_mean(v, draws) for name, v in columns.items() if np.isfinite(v).all()
    }
    n = len(frames["label"])
    return [
        {**labels, "over": "rows", "rows": len(rows), "frames": n, **by_rows},
        {**labels, "over": "frames", "rows": len(rows), "frames": n, **by_frames, **intervals},
    ]


def interval_of_mean(values: Sequence[float], draws: int = 1000, seed: int = 0) -> list[float]:
    """95 % bootstrap interval [low, high] of the mean of a table's columns (one a sequence): they are drawn with replacement."""
    chosen = np.random.default_rng(seed).integers(len(values), size=(draws, len(values)))
    return percentiles(np.asarray(values)[chosen].mean(axis=1))


def percentiles(values: Sequence[float] | np.ndarray) -> list[float]:
    """The middle 95 % of bootstrap draws: [low, high]."""
    return [float(q) for q in np.percentile(values, [2.5, 97.5])]


def _of(frames: dict[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    """Only the array that a measure of INTERVALS reads: resampling the others a thousand times would cost minutes."""
    key = {"R": "R_deg", "t": "t_m", "c": "class_correct"}[name[0]]
    return {key: frames[key]}


def json_values(value: Any) -> Any:
    """For JSON: numbers rounded to six digits, NaN (a part that a method does not predict) as None."""
    if isinstance(value, dict):
        return {key: json_values(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_values(v) for v in value]
    if isinstance(value, (float, np.floating)):
        return None if np.isnan(value) else float(f"{value:.6g}")
    return value.item() if isinstance(value, np.generic) else value


def format_table(rows: Sequence[dict]) -> str:
    """Rows of `summarise` or `averages` as plain text, one line each; in front, where they differ, their method and variant."""
    names = [" ".join(str(row[key]) for key in ("method", "variant") if row.get(key)) for row in rows]
    width = max(map(len, names)) + 2 if len(set(names)) > 1 else 0
    head = (
        "scene",
        "drone",
        "frames",
        "R MAE°",
        "R Med°",
        "t MAE m",
        "t Med m",
        "t axis m",
        "class %",
        "kp px",
        "kp Med",
        "flip %",
    )
    lines = [" " * width + "  ".join(f"{title:>8}" for title in head)]
    for name, row in zip(names, rows, strict=True):
        where = (row["scene"], row["drone"]) if "scene" in row else ("mean of", row["over"])
        lines.append(
            f"{name[:width]:{width}s}{where[0]!s:>8}  {where[1]!s:>8}  {row['frames']:8d}  {row['R_mae_deg']:8.2f}  {row['R_medae_deg']:8.2f}  "
            f"{row['t_mae_m']:8.3f}  {row['t_medae_m']:8.3f}  {row['t_axis_mae_m']:8.3f}  {100 * row['class_accuracy']:8.1f}  "
            f"{row['keypoint_px']:8.2f}  {row['keypoint_medae_px']:8.2f}  {100 * row['flip_rate']:8.1f}"
        )
    return "\n".join(lines)


def read_annotations(dataset: Dataset) -> dict[str, torch.Tensor]:
    """Annotations of a whole data set without its images, stacked: keypoints, K, square, label, R, t, scene, …

    A data set with a method `annotations()` gives them at once; of any other every item is read.
    """
    if isinstance(dataset, Subset) and hasattr(dataset.dataset, "annotations"):
        return {
            name: value[torch.as_tensor(dataset.indices)]
            for name, value in dataset.dataset.annotations().items()
        }
    if hasattr(dataset, "annotations"):
        return dataset.annotations()
    items = [{k: v for k, v in dataset[i].items() if k != "image"} for i in range(len(dataset))]
    return {name: torch.stack([torch.as_tensor(item[name]) for item in items]) for name in items[0]}


def constant_baseline(train_set: Dataset, test_set: Dataset) -> dict[str, np.ndarray]:
    """The bar to beat: one pose for every frame, the training set's median translation and best constant rotation.

    Returns the frames of `evaluate` for it (class and keypoints likewise constant: the commonest class, the mean keypoints), so that
    `summarise`, `averages` and `format_table` take it like a network's.
    """
    train, test = read_annotations(train_set), read_annotations(test_set)
    n = len(test["t"])
    classes = int(max(train["label"].max(), test["label"].max())) + 1
    probs = torch.bincount(train["label"], minlength=classes).float()
    output = {
        "R": rotations.best_constant_rotation(train["R"]).expand(n, 3, 3),
        "t": train["t"].median(dim=0).values.expand(n, 3),
        "keypoints": train["keypoints"].mean(dim=0).expand(n, 4, 2),
        "class_probs": probs.expand(n, -1),
    }
    # Only the width of the images is read; one stands for all.
    image = torch.as_tensor(test_set[0]["image"])[None]
    return frame_errors(output, {**test, "image": image})


def evaluate_checkpoint(
    checkpoint: str | Path,
    dataset_root: str | Path,
    split: str = "test",
    json_file: str | Path | None = None,
    progress: bool = True,
) -> list[dict]:
    """Measure a saved network on one split of a data set on disk: print the table, return (and write as JSON) its rows.

    `checkpoint` is a folder of `save_pretrained`, or a run folder, of which best/ is taken.

    Raises:
        InputError: the checkpoint or the data set cannot be read.
    """
    from dronekeypp.baselines import load_network
    from dronekeypp.sixdronesyn.dataset import SixDroneSyn

    if json_file and (
        Path(json_file).is_dir() or not Path(json_file).resolve().parent.is_dir()
    ):  # before the work, not after it
        raise InputError(
            f"{json_file}: {'a folder, not a file' if Path(json_file).is_dir() else 'its folder does not exist; make it first'}"
        )
    checkpoint = Path(checkpoint)
    best = checkpoint / "best"
    model = load_network(best if (best / "config.json").is_file() else checkpoint)
    model.to("cuda" if torch.cuda.is_available() else "cpu")
    dataset = SixDroneSyn(dataset_root, split, size=model.config.image_size)
    hidden = not (progress and sys.stderr.isatty())
    frames = evaluate(
        model, dataset, progress=lambda batches: tqdm(batches, split, leave=False, disable=hidden)
    )
    rows, means = summarise(frames, method=model.method), averages(frames, method=model.method)
    print(format_table(rows + means))
    if json_file:
        digest = getattr(dataset, "manifest", {}).get("digest")
        result = json_values(
            {
                "name": "evaluate",
                "dataset": {"split": split, "digest": digest},
                "rows": rows,
                "averages": means,
            }
        )
        write_beside(Path(json_file), (json.dumps(result, indent=1) + "\n").encode())
    return rows
