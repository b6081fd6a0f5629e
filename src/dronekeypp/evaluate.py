"""Errors of every frame, their summary by scene and drone, and the constant answer to beat (Sec. V-A, Eq. 13-14).

The paper's Eq. 13 divides the angle by pi, its tables print degrees; we print degrees. Its translation MAE fits a per-axis
mean and its median a Euclidean distance; we report Euclidean for both and the per-axis mean beside them.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset, Subset
from tqdm import tqdm

from dronekeypp import rotations
from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP
from dronekeypp.model.network import write_beside

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
    "flip_rate": lambda f: f["flip"].mean(),
}
INTERVALS = ("R_mae_deg", "R_medae_deg", "t_mae_m", "t_medae_m", "class_accuracy")


def frame_errors(output: dict, batch: dict) -> dict[str, np.ndarray]:
    """Errors of one batch, an array per measure.

    R_deg: geodesic angle · t_m: Euclidean distance · t_axis_m (B, 3): per camera axis · class_correct, label, predicted ·
    keypoint_px: mean distance of the four keypoints in full-frame pixels, keypoint_crop_px: in pixels of the resized crop ·
    flip: the predicted nose points more than 90 degrees away from the true one.
    """
    R, t, square = batch["R"], batch["t"], batch["square"]
    units = (output["keypoints"] - batch["keypoints"]).norm(dim=-1).mean(dim=-1)  # (B,) crop units
    predicted = output["class_probs"].argmax(dim=-1)
    errors = {
        "R_deg": rotations.geodesic_degrees(output["R"], R),
        "t_m": (output["t"] - t).norm(dim=-1),
        "t_axis_m": (output["t"] - t).abs(),
        "distance_m": t.norm(dim=-1),
        "class_correct": predicted == batch["label"],
        "label": batch["label"],
        "predicted": predicted,
        "keypoint_px": units * square[:, 2],
        "keypoint_crop_px": units * batch["image"].shape[-1],
        "flip": (output["R"][:, :, 0] * R[:, :, 0]).sum(dim=-1) < 0,
        "R": output["R"],
        "t": output["t"],
    }
    for name in ("scene", "frame", "subsequence"):
        errors[name] = batch[name]
    return {name: value.detach().cpu().numpy() for name, value in errors.items()}


def to_device(batch: dict, device: torch.device | str) -> dict:
    return {name: value.to(device, non_blocking=True) for name, value in batch.items() if torch.is_tensor(value)}


def apply_model(model: nn.Module, batch: dict, encoder: str = "learned") -> dict:
    """Run a network on a batch; with encoder="truth" (Table 4) it is handed the true keypoints and label."""
    truth = (batch["keypoints"], batch["label"]) if encoder == "truth" else ()
    return model(batch["image"], batch["K"], batch["square"], *truth)


def evaluate(
    model: nn.Module,
    dataset: Dataset,
    batch: int = 64,
    workers: int = 0,
    criterion: Callable[[dict, dict], dict[str, torch.Tensor]] | None = None,
    progress: Callable | None = None,
) -> dict[str, np.ndarray]:
    """Errors of every frame of `dataset`, in its order: the arrays of `frame_errors`, joined, and the predicted R and t.

    `criterion(output, batch)` may add loss terms: they come back as "losses", their means. `progress` may wrap the batches (tqdm).
    The network is put in evaluation mode and left as it was found.

    Raises:
        InputError: an empty data set, or a prediction that is not finite (it names the frame).
    """
    if len(dataset) == 0:
        raise InputError("nothing to evaluate: the data set has no frames")
    device = next(model.parameters()).device
    loader = DataLoader(dataset, batch_size=batch, num_workers=workers, generator=torch.Generator())
    encoder = getattr(getattr(model, "config", None), "encoder", "learned")
    parts, losses, was_training = [], {}, model.training
    model.eval()
    try:
        with torch.inference_mode():
            for items in progress(loader) if progress else loader:
                items = to_device(items, device)
                output = apply_model(model, items, encoder)
                parts.append(frame_errors(output, items))
                for name, value in (criterion(output, items) if criterion else {}).items():
                    losses[name] = losses.get(name, 0.0) + value.item() * len(items["t"])
    finally:
        model.train(was_training)
    frames = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    bad = ~(np.isfinite(frames["R_deg"]) & np.isfinite(frames["t_m"]))
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


def averages(frames: dict[str, np.ndarray], draws: int = 1000, seed: int = 0, **labels) -> list[dict]:
    """Two rows: "over": "rows" (mean of the scene-and-drone rows, as a table's last column) and "over": "frames".

    The second carries 95 % bootstrap intervals, KEY_ci95: [low, high]. Frames of a flight resemble each other, so whole
    subsequences (scene, drone, subsequence) are drawn, not frames: an honest interval is wider.
    """
    rows = summarise(frames, names=[str(i) for i in range(int(frames["label"].max()) + 1)])
    by_rows = {name: float(np.mean([row[name] for row in rows])) for name in MEASURES}
    by_frames = measure(frames)
    keys = np.stack([frames["scene"], frames["label"], frames["subsequence"]], axis=1)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    members = [np.flatnonzero(group.ravel() == g) for g in range(group.max() + 1)]
    generator = np.random.default_rng(seed)
    drawn: dict[str, list[float]] = {name: [] for name in INTERVALS}
    for _ in range(draws):
        chosen = np.concatenate([members[g] for g in generator.integers(len(members), size=len(members))])
        for name in INTERVALS:
            drawn[name].append(float(MEASURES[name]({key: v[chosen] for key, v in _of(frames, name).items()})))
    intervals = {f"{name}_ci95": [float(q) for q in np.percentile(v, [2.5, 97.5])] for name, v in drawn.items() if v}
    n = len(frames["label"])
    return [
        {**labels, "over": "rows", "rows": len(rows), "frames": n, **by_rows},
        {**labels, "over": "frames", "rows": len(rows), "frames": n, **by_frames, **intervals},
    ]


def _of(frames: dict[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    """Only the array that a measure of INTERVALS reads: resampling the others a thousand times would cost minutes."""
    key = {"R": "R_deg", "t": "t_m", "c": "class_correct"}[name[0]]
    return {key: frames[key]}


def format_table(rows: Sequence[dict]) -> str:
    """Rows of `summarise` or `averages` as plain text, one line each."""
    head = ("scene", "drone", "frames", "R MAE°", "R Med°", "t MAE m", "t Med m", "t axis m", "class %", "kp px", "kp Med", "flip %")
    lines = ["  ".join(f"{title:>8}" for title in head)]
    for row in rows:
        where = (row["scene"], row["drone"]) if "scene" in row else ("mean of", row["over"])
        lines.append(
            f"{where[0]!s:>8}  {where[1]!s:>8}  {row['frames']:8d}  {row['R_mae_deg']:8.2f}  {row['R_medae_deg']:8.2f}  "
            f"{row['t_mae_m']:8.3f}  {row['t_medae_m']:8.3f}  {row['t_axis_mae_m']:8.3f}  {100 * row['class_accuracy']:8.1f}  "
            f"{row['keypoint_px']:8.2f}  {row['keypoint_medae_px']:8.2f}  {100 * row['flip_rate']:8.1f}"
        )
    return "\n".join(lines)


def poses(dataset: Dataset) -> dict[str, torch.Tensor]:
    """Annotations of a whole data set without its images, stacked: keypoints, K, square, label, R, t, scene, …

    A data set with a method `annotations()` gives them at once; of any other every item is read.
    """
    if isinstance(dataset, Subset) and hasattr(dataset.dataset, "annotations"):
        return {name: value[torch.as_tensor(dataset.indices)] for name, value in dataset.dataset.annotations().items()}
    if hasattr(dataset, "annotations"):
        return dataset.annotations()
    items = [{k: v for k, v in dataset[i].items() if k != "image"} for i in range(len(dataset))]
    return {name: torch.stack([torch.as_tensor(item[name]) for item in items]) for name in items[0]}


def best_constant_rotation(R: torch.Tensor, candidates: int = 256, frames: int = 2048) -> torch.Tensor:
    """The rotation (3, 3) with the smallest median geodesic error to R (F, 3, 3), among evenly spaced ones of R and their chordal mean.

    The chordal mean (the rotation nearest to the mean matrix) minimises the mean *squared* chord, not the median; so both compete.
    """
    u, _, vh = torch.linalg.svd(R.double().mean(dim=0))
    mean = u @ torch.diag(torch.tensor([1.0, 1.0, float(torch.sign(torch.det(u @ vh)))], dtype=torch.double)) @ vh
    tried = torch.cat([mean[None], R[:: max(1, len(R) // candidates)].double()])  # (C, 3, 3)
    judged = R[:: max(1, len(R) // frames)].double()
    medians = torch.stack([rotations.geodesic_degrees(one[None], judged).median() for one in tried])
    return tried[medians.argmin()].to(R.dtype)


def constant_baseline(train_set: Dataset, test_set: Dataset) -> dict[str, np.ndarray]:
    """The bar to beat: one pose for every frame, the training set's median translation and best constant rotation.

    Returns the frames of `evaluate` for it (class and keypoints likewise constant: the commonest class, the mean keypoints), so that
    `summarise`, `averages` and `format_table` take it like a network's.
    """
    train, test = poses(train_set), poses(test_set)
    n = len(test["t"])
    classes = int(max(train["label"].max(), test["label"].max())) + 1
    probs = torch.bincount(train["label"], minlength=classes).float()
    output = {
        "R": best_constant_rotation(train["R"]).expand(n, 3, 3),
        "t": train["t"].median(dim=0).values.expand(n, 3),
        "keypoints": train["keypoints"].mean(dim=0).expand(n, 4, 2),
        "class_probs": probs.expand(n, -1),
    }
    # Only the width of the images is read; one stands for all.
    image = torch.as_tensor(test_set[0]["image"])[None]
    return frame_errors(output, {**test, "image": image})


def evaluate_checkpoint(
    checkpoint: str | Path, dataset_root: str | Path, split: str = "test", json_file: str | Path | None = None, progress: bool = True
) -> list[dict]:
    """Measure a saved network on one split of a data set on disk: print the table, return (and write as JSON) its rows.

    `checkpoint` is a folder of `save_pretrained`, or a run folder, of which best/ is taken.

    Raises:
        InputError: the checkpoint or the data set cannot be read.
    """
    from dronekeypp.sixdronesyn.dataset import SixDroneSyn

    if json_file and not Path(json_file).resolve().parent.is_dir():  # before the work, not after it
        raise InputError(f"{json_file}: its folder does not exist; make it first")
    checkpoint = Path(checkpoint)
    best = checkpoint / "best"
    model = DroneKeyPP.from_pretrained(best if (best / "config.json").is_file() else checkpoint)
    model.to("cuda" if torch.cuda.is_available() else "cpu")
    dataset = SixDroneSyn(dataset_root, split, size=model.config.image_size)
    hidden = not (progress and sys.stderr.isatty())
    frames = evaluate(model, dataset, progress=lambda batches: tqdm(batches, split, leave=False, disable=hidden))
    rows, means = summarise(frames, method="DroneKey++"), averages(frames, method="DroneKey++")
    print(format_table(rows + means))
    if json_file:
        digest = getattr(dataset, "manifest", {}).get("digest")
        result = {"name": "evaluate", "dataset": {"split": split, "digest": digest}, "rows": rows, "averages": means}
        write_beside(Path(json_file), (json.dumps(result, indent=1) + "\n").encode())
    return rows
