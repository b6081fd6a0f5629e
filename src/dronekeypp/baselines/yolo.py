"""YOLOv8n-pose + PnP (Sec. V-B): the library's own keypoint detector, trained from scratch on our crops. An optional extra.

The library is ultralytics, AGPL-3.0, and no part of this project's MIT code: nothing else needs it, it is used through its own interface,
and only in a process of its own, because it changes threads, print options and settings of the process it runs in. Install it with
`pip install -e ".[yolo]"`.

It has its own training loop, augmentation and checkpoints (.pt, pickled: read only those you made yourself).
"""

from __future__ import annotations

import csv
import importlib.util
import json
import multiprocessing
import os
import shutil
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from dronekeypp.errors import InputError
from dronekeypp.files import write_beside

METHOD = "YOLOv8n-pose + PnP"
CONFIDENCE = 0.001  # every crop holds one drone, so the likeliest box counts, however unlikely
LOG, SETTINGS = "epochs.csv", "settings.json"


def installed() -> bool:
    """Whether the optional extra is there."""
    return importlib.util.find_spec("ultralytics") is not None


def _in_own_process(function: Callable, *arguments) -> Any:
    """The value of `function(*arguments)`, called in a fresh process."""
    if not installed():
        raise InputError(
            'YOLOv8n-pose is an optional extra (ultralytics, AGPL-3.0): pip install -e ".[yolo]"'
        )
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def library(folder: Path):
    """The library's YOLO class, its settings kept in `folder`, without a network call. It changes the process: call it in one of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    os.environ |= {"YOLO_OFFLINE": "true", "YOLO_VERBOSE": "false", "YOLO_CONFIG_DIR": str(folder)}
    from ultralytics import YOLO, settings

    settings.update({"sync": False})
    return YOLO


def export(datasets: dict[str, Any], out: str | Path, names: Sequence[str]) -> Path:
    """Data sets ({"train": SixDroneSyn, "val": …}) as the crops every method sees, in YOLO's layout; returns its data.yaml.

    images/SPLIT/*.jpg and labels/SPLIT/*.txt. A line of a label: class, box (centre, width, height), four keypoints (x, y, visibility:
    2 seen, 1 hidden), all in units of the picture. What is there already is kept.
    """
    out = Path(out)
    for split, data in datasets.items():
        for kind in ("images", "labels"):
            (out / kind / split).mkdir(parents=True, exist_ok=True)
        for i, frame in enumerate(data.frames):
            name = f"{data.folders[i].name}_{frame.number:06d}"
            label = out / "labels" / split / f"{name}.txt"
            if label.exists():  # written last: its picture is there
                continue
            item, square = data[i], data.square(i)
            picture = np.ascontiguousarray(pixels(item["image"][None])[0])
            write_beside(
                out / "images" / split / f"{name}.jpg",
                cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes(),
            )
            write_beside(label, (label_line(item, frame.box, square) + "\n").encode())
    listed = "".join(f"  {i}: {name}\n" for i, name in enumerate(names))
    text = f"path: {out.resolve()}\ntrain: images/train\nval: images/val\nkpt_shape: [4, 3]\nflip_idx: [1, 0, 3, 2]\nnames:\n{listed}"
    write_beside(out / "data.yaml", text.encode())
    return out / "data.yaml"


def pixels(images: Tensor) -> np.ndarray:
    """images (B, 3, S, S) RGB in [0, 1] -> (B, S, S, 3) uint8 BGR, as OpenCV and the library want them."""
    return (images.flip(1).permute(0, 2, 3, 1).cpu().numpy() * 255).round().astype(np.uint8)


def label_line(item: dict[str, Tensor], box: Sequence[float], square: Sequence[float]) -> str:
    """One annotated crop, its box and square in full-frame pixels, as a line of YOLO's label file."""
    (x, y, w, h), (left, top, side) = box, square
    numbers = [(x + w / 2 - left) / side, (y + h / 2 - top) / side, w / side, h / side]
    points = [
        text for (u, v), seen in zip(item["keypoints"].tolist(), item["visible"].tolist(), strict=True)
        for text in (f"{u:.6f}", f"{v:.6f}", "2" if seen else "1")
    ]  # fmt: skip
    return " ".join([str(int(item["label"])), *(f"{value:.6f}" for value in numbers), *points])


def train(
    datasets: dict[str, Any],
    out: str | Path,
    names: Sequence[str],
    settings: dict[str, Any],
    device: str = "cpu",
) -> Path:
    """Train yolov8n-pose from scratch on crops ({"train": SixDroneSyn, "val": …}) into the folder `out`; returns the best checkpoint.

    `settings`: size, epochs, batch, seed, and the digest of the data. A finished training is left alone; one that was killed goes on
    from its last whole epoch.

    Raises:
        InputError: the extra is not installed, or `out` was started with other settings.
    """
    out = Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    if (out / SETTINGS).is_file():
        old = json.loads((out / SETTINGS).read_text())
        for key, value in settings.items():
            if old.get(key) != value:
                raise InputError(
                    f"cannot resume {out}: {key} was {old.get(key)!r} and is now {value!r}; use the old one or another folder"
                )
    elif not installed():
        _in_own_process(print)  # says what to install
    write_beside(out / SETTINGS, (json.dumps(settings) + "\n").encode())
    if epochs_done(out) < settings["epochs"]:
        _in_own_process(_train, export(datasets, out / "data", names), out, settings, device)
    return out / "kept" / "best.pt"


def epochs_done(out: Path) -> int:
    """Whole epochs behind the checkpoints that were kept."""
    done = out / "kept" / "epoch"
    return int(done.read_text()) if done.is_file() else 0


def _train(data: Path, out: Path, settings: dict[str, Any], device: str) -> None:
    """In a process of its own: train, or go on, and keep both checkpoints after every epoch."""
    YOLO, kept = library(out / "library"), out / "kept"
    kept.mkdir(exist_ok=True)
    tic = time.monotonic()

    def keep(trainer) -> None:
        # The library writes its checkpoints in place, and strips them at the end so that they cannot be resumed: keep copies.
        nonlocal tic
        with open(out / LOG, "a") as file:
            file.write(f"{trainer.epoch + 1},{time.monotonic() - tic:.2f}\n")
        tic = time.monotonic()
        for path in (trainer.best, trainer.last):
            shutil.copyfile(path, kept / f".{path.name}")
            os.replace(kept / f".{path.name}", kept / path.name)
        write_beside(kept / "epoch", str(trainer.epoch + 1).encode())

    last = kept / "last.pt"
    # A kill between the two writes leaves last.pt one epoch ahead of its number.
    behind = last.is_file() and torch.load(last, map_location="cpu", weights_only=False)["epoch"] + 1
    if behind and behind >= settings["epochs"]:
        write_beside(kept / "epoch", str(behind).encode())
        return
    model = YOLO(str(last) if behind else "yolov8n-pose.yaml")
    model.add_callback("on_model_save", keep)
    common = {
        "data": str(data),
        "imgsz": settings["size"],
        "batch": settings["batch"],
        "workers": 0,
        "device": device,
        "plots": False,
    }
    if behind:
        model.train(resume=True, save_dir=str(out / "run"), **common)
    else:
        model.train(
            epochs=settings["epochs"], seed=settings["seed"], pretrained=False, cos_lr=True, amp=False,
            project=str(out), name="run", exist_ok=True, **common,
        )  # fmt: skip


def detect(weights: str | Path, images: Tensor, classes: int, device: str = "cpu") -> dict[str, Tensor]:
    """images (B, 3, S, S) in [0, 1] -> keypoints (B, 4, 2) crop units, class_probs (B, classes) one-hot, found (B,) bool.

    Where nothing is found the keypoints are the middle of the crop and the class is none: zeros.
    """
    answers = _in_own_process(_detect, Path(weights).resolve(), pixels(images), device)
    keypoints, probs = torch.full((len(images), 4, 2), 0.5), torch.zeros(len(images), classes)
    found = torch.tensor([answer is not None for answer in answers])
    for i, answer in enumerate(answers):
        if answer is not None:
            keypoints[i], probs[i, answer[1]] = torch.tensor(answer[0]) / images.shape[-1], 1
    return {"keypoints": keypoints, "class_probs": probs, "found": found}


def _detect(weights: Path, pictures: np.ndarray, device: str) -> list[tuple[list, int] | None]:
    """In a process of its own: (keypoints in pixels, class) of each picture (B, S, S, 3) uint8 BGR, or None."""
    model = library(weights.parents[1] / "library")(str(weights))
    found = []
    for start in range(0, len(pictures), 64):
        part = list(pictures[start : start + 64])
        for answer in model.predict(
            part, imgsz=pictures.shape[1], conf=CONFIDENCE, max_det=1, verbose=False, device=device
        ):
            found.append(
                (answer.keypoints.xy[0].tolist(), int(answer.boxes.cls[0])) if len(answer.boxes) else None
            )
    return found


def story(out: str | Path) -> dict[str, Any]:
    """Epochs and minutes of a training, over all the legs it was cut into."""
    with open(Path(out) / LOG, newline="") as file:
        seconds = {int(epoch): float(value) for epoch, value in csv.reader(file)}
    return {"epochs": len(seconds), "minutes": round(sum(seconds.values()) / 60, 1)}
