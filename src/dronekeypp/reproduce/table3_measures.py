"""Do what only Table 3 does: measure YOLOv8n-pose, which has its own loop, and store files of DroneKey++."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from dronekeypp.baselines import yolo
from dronekeypp.baselines.pnp_pose import PnPPose
from dronekeypp.camera import from_crop
from dronekeypp.checkpoint import WEIGHTS
from dronekeypp.data import FrameDataset, open_dataset, read_annotations
from dronekeypp.evaluate import batches_of, frame_errors, to_device
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.files import digest, write_beside
from dronekeypp.model import PoseNetwork
from dronekeypp.predict import mirror_doubt
from dronekeypp.reproduce.field import field_errors, has_field_errors
from dronekeypp.reproduce.results import (
    RESULTS,
    describe,
    keep_hardware,
    read_hardware,
    read_npz,
    source_digest,
    write_npz,
)
from dronekeypp.reproduce.runner import Bench, Run
from dronekeypp.train import METRICS, choose_device

BATCH = 64  # pictures in memory at a time
FLIGHT_ARRAYS = ("subsequence", "frame", "label", "predicted", "t", "layer_spread", "keypoint_units")

# --- YOLOv8n-pose -----------------------------------------------------------------------------------------


def yolo_epochs(bench: Bench, run: Run, seed: int) -> int:
    """Return how many epochs over all training frames YOLO gets.

    They show it as many frames as the budget shows the other methods.
    """
    _, training = bench.settings(run, seed)
    frames = describe(bench.data)["train_frames"]
    shown = min(training.frames or frames, frames)
    return max(1, round(training.epochs * shown / frames))


def yolo_finished(bench: Bench, run: Run, seed: int) -> bool:
    """Tell whether YOLO was trained to its end."""
    return yolo.epochs_done(bench.folder(run, seed)) >= yolo_epochs(bench, run, seed)


def train_yolo(bench: Bench, run: Run, seed: int) -> Path:
    """Train what is left of YOLOv8n-pose, which trains itself, and return the file of its best weights."""
    model, training = bench.settings(run, seed)
    folder = bench.folder(run, seed)
    bench.say(f"{run.method} seed {seed}: {folder}")
    val_set = bench.split("val", run, seed)
    if training.val_frames:
        stride = max(1, len(val_set) // training.val_frames)
        val_set = open_dataset(bench.data, "val", size=model.image_size, stride=stride)
    train_set = open_dataset(bench.data, "train", size=model.image_size)
    settings = {
        "size": model.image_size,
        "epochs": yolo_epochs(bench, run, seed),
        "batch": training.batch,
        "seed": seed,
        "digest": describe(bench.data)["digest"],
    }
    weights = yolo.train({"train": train_set, "val": val_set}, folder, settings, str(choose_device(training)))
    keep_hardware(folder, training)
    return weights


def measure_yolo(
    bench: Bench, run: Run, seed: int, split: str = "test", field: bool = False
) -> dict[str | None, Frames]:
    """Do the work of `Bench.measure` for YOLOv8n-pose.

    Its PnP gets the class of the true drone, as DroneKey's does.
    """
    model, training = bench.settings(run, seed)
    folder = bench.folder(run, seed)
    weights = train_yolo(bench, run, seed)
    made_from = source_digest(weights, bench.data)
    pnp = PnPPose(model.classes)
    pnp.learn(read_annotations(open_dataset(bench.data, "train", size=model.image_size)))
    dataset = bench.split(split, run, seed)
    answer = None
    frames_of = {}
    for hypothesis in run.hypotheses:
        path = folder / f"{split}-{hypothesis}.npz"
        frames = read_npz(path, made_from)
        if frames is None:
            if answer is None:
                pictures = (items["image"] for items in batches_of(dataset, BATCH))
                answer = yolo.detect(weights, pictures, model.classes, str(choose_device(training)))
            pnp.hypothesis = hypothesis
            frames = detector_errors(answer, dataset, pnp)
            write_npz(path, frames, made_from)
        if field and not has_field_errors(frames):
            frames |= field_errors(frames, dataset)
            write_npz(path, frames, made_from)
        frames_of[run.row_name(hypothesis)] = frames
    return frames_of


def yolo_record(bench: Bench, run: Run, seed: int) -> dict[str, Any]:
    """Do the work of `Bench.training_record` for YOLOv8n-pose, which starts from no backbone of ours."""
    folder = bench.folder(run, seed)
    return {
        "method": run.method,
        "variant": None,
        "seed": seed,
        **yolo.training_record(folder),
        "changes": {},
        "backbone": None,
        "weights": digest(train_yolo(bench, run, seed).read_bytes()),
        "hardware": read_hardware(folder),
    }


def detector_errors(answer: dict[str, torch.Tensor], dataset: FrameDataset, pnp: PnPPose) -> Frames:
    """Return the errors of every frame of a data set, from a detector's answer followed by PnP.

    For the `answer`, see `yolo.detect`.
    """
    truth = read_annotations(dataset)
    pixels = from_crop(answer["keypoints"], truth["square"])
    pixels[~answer["detected"]] = torch.nan  # to which PnP answers with its constant
    output = {**answer, **pnp(pixels, truth["label"], truth["K"])}
    # Only the width of the pictures is read; one stands for all.
    return frame_errors(output, {**truth, "image": dataset[0]["image"][None]})


# --- what is kept of DroneKey++ ---------------------------------------------------------------------------


def keep_checkpoint(bench: Bench, run: Run, seed: int) -> None:
    """Write the run's best network as float16, and its curve, to data_samples/checkpoint."""
    folder = bench.root / "data_samples" / "checkpoint"
    run.network.from_pretrained(bench.train(run, seed)).save_pretrained(folder, half=True)
    write_beside(folder / METRICS, (bench.folder(run, seed) / METRICS).read_bytes())


def keep_flights(bench: Bench, run: Run, seed: int) -> None:
    """Write what that network says of every validation and test flight, and the truth, for smoothing.

    data_samples/results/flights.npz holds SPLIT/NAME. The names subsequence, frame, label and predicted have
    shape (F,). The names rotvec, t, true_rotvec and true_t have shape (F, 3). Three more are about the
    keypoints, each (F,) in crop units: their error keypoint_units, and two signs of doubt, layer_spread (see
    `encoder.layer_spread`) and mirror (see `predict.mirror_doubt`).
    """
    path = bench.root / RESULTS / "flights.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    made_from = source_digest(bench.train(run, seed) / WEIGHTS, bench.data)
    if read_npz(path, made_from) is not None:
        return
    network = bench.network(run, seed)
    arrays: dict[str, np.ndarray] = {}
    for split in ("val", "test"):
        frames = bench.measure(run, seed, split)[run.variant]
        dataset = bench.split(split, run, seed)
        truth = read_annotations(dataset)
        values = {name: frames[name] for name in FLIGHT_ARRAYS}
        values["true_t"] = truth["t"].numpy()
        values["rotvec"] = Rotation.from_matrix(frames["R"]).as_rotvec()
        values["mirror"] = mirror_doubts(network, dataset)
        values["true_rotvec"] = Rotation.from_matrix(truth["R"].numpy()).as_rotvec()
        for name, value in values.items():
            arrays[f"{split}/{name}"] = shrink(value)
    write_npz(path, arrays, made_from)


@torch.inference_mode()
def mirror_doubts(network: PoseNetwork, dataset: FrameDataset) -> np.ndarray:
    """Measure how far each frame's keypoints move when its crop is mirrored (F,), in crop units."""
    device = next(network.parameters()).device
    doubts = []
    for items in batches_of(dataset, BATCH):
        items = to_device(items, device)
        image, K, square = items["image"], items["K"], items["square"]
        keypoints = network(image, K, square)["keypoints"]
        doubts.append(mirror_doubt(network, image, K, square, keypoints).cpu())
    return torch.cat(doubts).numpy()


def shrink(values: np.ndarray) -> np.ndarray:
    """Return the same values in fewer bytes.

    Three digits and small integers are enough for a figure.
    """
    if values.dtype.kind == "f":
        return values.astype(np.float16)
    if values.dtype.kind == "i":
        return values.astype(np.int16 if values.max() < 2**15 else np.int32)
    return values
