"""This module trains ultralytics' own keypoint detector from scratch on our crops (YOLOv8n-pose, Sec. V-B).

PnP turns its keypoints into a pose. The library is ultralytics, under AGPL-3.0, and no part of this project's
MIT code. It is an optional extra: nothing else needs it, and it is used through its own interface. It runs
only in a process of its own, because it changes threads, print options and settings of the process it runs
in. Install it with `pip install -e ".[yolo]"`.

It has its own training loop, augmentation and checkpoints (.pt, pickled: a file of somebody else's may run
what it likes). A training that goes on reads only files that it wrote itself, which it knows by their
digests. Whose file `detect` reads is up to the caller.
"""

from __future__ import annotations

import csv
import functools
import importlib.util
import multiprocessing
import os
import shutil
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from dronekeypp.baselines.yolo_layout import HIDDEN, SEEN, label_line, write_data_yaml
from dronekeypp.classes import names_of
from dronekeypp.data import FrameDataset
from dronekeypp.errors import InputError
from dronekeypp.files import digest, write_beside, write_json
from dronekeypp.schema import Open, read

METHOD = "YOLOv8n-pose + PnP"
CONFIDENCE = 0.001  # every crop holds one drone, so the likeliest box counts, however unlikely
BROKEN = "remove {} and train again"
LOG, SETTINGS = "epochs.csv", "settings.json"
WRITTEN = "written.json"  # beside the copies: {digest of a checkpoint: the number of epochs behind it}
KEPT = "kept"  # folder of the checkpoints' copies, and of the number of epochs behind them

# What YOLO says of one picture: the keypoints (4, 2) in pixels and the class, or None where it found nothing.
Detection = tuple[list[list[float]], int] | None


def installed() -> bool:
    """Return whether the optional extra is there."""
    return importlib.util.find_spec("ultralytics") is not None


def check_installed() -> None:
    """Raise InputError, saying what to install, where the optional extra is missing."""
    if not installed():
        raise InputError(
            'YOLOv8n-pose is an optional extra (ultralytics, AGPL-3.0): pip install -e ".[yolo]"'
        )


def _own_process() -> ProcessPoolExecutor:
    """Return a fresh process for the library."""
    check_installed()
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))


def library(folder: Path) -> Callable[..., Any]:
    """Return the library's class YOLO, with its settings kept in `folder`.

    It makes no network call, and installs nothing. It changes the process: call it in one of its own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    os.environ |= {"YOLO_OFFLINE": "true", "YOLO_AUTOINSTALL": "false", "YOLO_VERBOSE": "false"}
    os.environ["YOLO_CONFIG_DIR"] = str(folder)
    from ultralytics import YOLO, settings

    settings.update({"sync": False})
    return YOLO


# --- the data ---------------------------------------------------------------------------------------------


def export(datasets: dict[str, FrameDataset], out: str | Path) -> Path:
    """Write data sets as the crops that every method sees, in YOLO's layout.

    The pictures are images/SPLIT/*.jpg, the labels labels/SPLIT/*.txt. A line of a label holds the class, the
    box (centre, width, height) and four keypoints (x, y, visibility: 2 seen, 1 hidden), all in units of the
    picture. What is there already is kept.

    Args:
        datasets: {"train": …, "val": …}. The names of the classes are those of the first one.
        out: the folder to write to.

    Returns:
        The path of its data.yaml.
    """
    out = Path(out)
    for split, dataset in datasets.items():
        for kind in ("images", "labels"):
            (out / kind / split).mkdir(parents=True, exist_ok=True)
        for i, frame in enumerate(dataset.frames):
            name = f"{dataset.folders[i].name}_{frame.number:06d}"
            label = out / "labels" / split / f"{name}.txt"
            if label.exists():  # written last: its picture is there
                continue
            item = dataset[i]
            picture = np.ascontiguousarray(pixels(item["image"][None])[0])
            jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
            write_beside(out / "images" / split / f"{name}.jpg", jpeg)
            square = dataset.square(i)
            line = label_line(
                int(item["label"]),
                (*(frame.box[:2] - square[:2]), *frame.box[2:]),
                (square[2], square[2]),
                item["keypoints"].numpy() * square[2],
                np.where(item["visible"], SEEN, HIDDEN),
            )
            write_beside(label, (line + "\n").encode())
    return write_data_yaml(out, list(datasets), names_of(next(iter(datasets.values())).drones))


def pixels(images: Tensor) -> np.ndarray:
    """Return images (B, 3, S, S) RGB in [0, 1] as (B, S, S, 3) uint8 BGR.

    OpenCV and the library want them so.
    """
    return (images.flip(1).permute(0, 2, 3, 1).cpu().numpy() * 255).round().astype(np.uint8)


# --- training ---------------------------------------------------------------------------------------------


def train(
    datasets: dict[str, FrameDataset],
    out: str | Path,
    settings: dict[str, Any],
    device: str = "cpu",
) -> Path:
    """Train yolov8n-pose from scratch on crops, and return the path of the best checkpoint.

    A finished training is left alone. One that was killed goes on from its last whole epoch.

    Args:
        datasets: {"train": …, "val": …}.
        out: the folder of the training.
        settings: size, epochs, batch, seed, and the digest of the data.
        device: "cpu", "cuda" or "cuda:0".

    Raises:
        InputError: the extra is not installed, or `out` was started with other settings.
    """
    out = Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    if (out / SETTINGS).is_file():
        old = read(Open, out / SETTINGS, BROKEN.format(out))
        for key, value in settings.items():
            if old.get(key) != value:
                raise InputError(
                    f"cannot resume {out}: {key} was {old.get(key)!r} and is now {value!r}; "
                    "use the old one or another folder"
                )
    else:
        check_installed()  # before anything is written
        write_json(out / SETTINGS, settings)
    if epochs_done(out) < settings["epochs"]:
        with _own_process() as process:
            process.submit(_train, export(datasets, out / "data"), out, settings, device).result()
    return out / KEPT / "best.pt"


def epochs_done(out: Path) -> int:
    """Return the number of whole epochs behind the checkpoints that were kept.

    Raises:
        InputError: the file that says so is broken.
    """
    number = out / KEPT / "epoch"
    if not number.is_file():
        return 0
    text = number.read_text(errors="replace")
    if not text.isdecimal():
        raise InputError(f"{number}: no number of epochs; " + BROKEN.format(out))
    return int(text)


def epochs_behind(last: Path, written: Any) -> int:
    """Return how many epochs are behind the checkpoint that a training goes on from.

    Args:
        last: the checkpoint, which the library will unpickle.
        written: what WRITTEN holds.

    Raises:
        InputError: this training did not write the file.
    """
    epochs = written.get(digest(last.read_bytes())) if isinstance(written, dict) else None
    if type(epochs) is not int:
        raise InputError(
            f"{last} is not a file that this training wrote, and reading it could run anything: "
            f"remove {last.parents[1]} and train again"
        )
    return epochs


def _train(data: Path, out: Path, settings: dict[str, Any], device: str) -> None:
    """Train or go on, in a process of its own, and keep both checkpoints after every epoch."""
    YOLO = library(out / "library")
    folder = out / KEPT
    folder.mkdir(exist_ok=True)
    written = {}
    if (folder / WRITTEN).is_file():
        written = read(Open, folder / WRITTEN, BROKEN.format(out))
    epoch_began = time.monotonic()

    def keep(trainer: Any) -> None:
        # The library writes its checkpoints in place, and strips them at the end so that they cannot be
        # resumed. So copies are kept.
        nonlocal epoch_began
        with open(out / LOG, "a") as file:
            file.write(f"{trainer.epoch + 1},{time.monotonic() - epoch_began:.2f}\n")
        epoch_began = time.monotonic()
        for path in (trainer.best, trainer.last):
            shutil.copyfile(path, folder / f".{path.name}")
        written[digest((folder / f".{trainer.last.name}").read_bytes())] = trainer.epoch + 1
        write_json(folder / WRITTEN, written)  # before the file itself has its name
        for path in (trainer.best, trainer.last):
            os.replace(folder / f".{path.name}", folder / path.name)
        write_beside(folder / "epoch", str(trainer.epoch + 1).encode())

    last = folder / "last.pt"
    epochs = epochs_behind(last, written) if last.is_file() else 0
    if epochs >= settings["epochs"]:
        # A kill between the two writes left last.pt one epoch ahead of its number.
        write_beside(folder / "epoch", str(epochs).encode())
        return
    model = YOLO(str(last) if epochs else "yolov8n-pose.yaml")
    model.add_callback("on_model_save", keep)
    common = {
        "data": str(data),
        "imgsz": settings["size"],
        "batch": settings["batch"],
        "workers": 0,
        "device": device,
        "plots": False,
    }
    if epochs:
        model.train(resume=True, save_dir=str(out / "run"), **common)
        return
    model.train(
        epochs=settings["epochs"],
        seed=settings["seed"],
        pretrained=False,
        cos_lr=True,
        amp=False,
        project=str(out),
        name="run",
        exist_ok=True,
        **common,
    )


def training_record(out: str | Path) -> dict[str, Any]:
    """Return the epochs and minutes of a training, over all the legs it was cut into."""
    with open(Path(out) / LOG, newline="") as file:
        seconds = {int(epoch): float(value) for epoch, value in csv.reader(file)}
    return {"epochs": len(seconds), "minutes": round(sum(seconds.values()) / 60, 1)}


# --- detection --------------------------------------------------------------------------------------------


def detect(
    weights: str | Path, batches: Iterable[Tensor], classes: int, device: str = "cpu"
) -> dict[str, Tensor]:
    """Run a trained detector over the pictures of a data set, batch by batch.

    Args:
        weights: the path of a checkpoint of `train`.
        batches: tensors (B, 3, S, S) in [0, 1]. Only one of them is in memory at a time.
        classes: the number of drones.
        device: "cpu", "cuda" or "cuda:0".

    Returns:
        keypoints (F, 4, 2) crop units, class_probs (F, classes) one-hot, detected (F,) bool, over all frames.
        Where nothing is detected the keypoints are the middle of the crop and the class is none: zeros.

    Raises:
        InputError: the extra is not installed.
    """
    weights = Path(weights).resolve()
    parts = []
    with _own_process() as process:
        for images in batches:
            detections = process.submit(_detect, weights, pixels(images), device).result()
            parts.append(_as_output(detections, images.shape[-1], classes))
    output = {}
    for name in parts[0]:
        output[name] = torch.cat([part[name] for part in parts])
    return output


def _as_output(detections: list[Detection], size: int, classes: int) -> dict[str, Tensor]:
    """Return the detections in one batch of pictures of `size` pixels in the form of a network's output."""
    keypoints = torch.full((len(detections), 4, 2), 0.5)
    probs = torch.zeros(len(detections), classes)
    detected = torch.zeros(len(detections), dtype=torch.bool)
    for i, detection in enumerate(detections):
        if detection is not None:
            points, label = detection
            keypoints[i] = torch.tensor(points) / size
            probs[i, label] = 1
            detected[i] = True
    return {"keypoints": keypoints, "class_probs": probs, "detected": detected}


@functools.cache
def _detector(weights: Path) -> Any:
    """Return the detector, which is loaded once for all batches, in a process of its own."""
    return library(weights.parents[1] / "library")(str(weights))


def _detect(weights: Path, pictures: np.ndarray, device: str) -> list[Detection]:
    """Return the detection in each picture (B, S, S, 3) uint8 BGR, in a process of its own."""
    answers = _detector(weights).predict(
        list(pictures),
        imgsz=pictures.shape[1],
        conf=CONFIDENCE,
        max_det=1,
        verbose=False,
        device=device,
    )
    detections: list[Detection] = []
    for answer in answers:
        if len(answer.boxes):
            detections.append((answer.keypoints.xy[0].tolist(), int(answer.boxes.cls[0])))
        else:
            detections.append(None)
    return detections
