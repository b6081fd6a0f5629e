"""Turn frames into rows of the journal, a batch at a time: find the box, cut the crop, ask the network."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from dronekeypp import checkpoint
from dronekeypp.camera import (
    clamp_square,
    crop_image,
    mirror_image,
    mirror_keypoints,
    mirror_square,
    square_around,
)
from dronekeypp.errors import InputError
from dronekeypp.footage import Calibration, Tracker
from dronekeypp.predict.ahead import ahead, side_by_side
from dronekeypp.predict.journal import BOX, GOOD, KEYPOINTS, ROTATION, SIGMAS, TRANSLATION, Row

BATCH = 16
READ_AHEAD = 1  # batches
AT_ONCE = 4  # batches, at most: each takes memory, and one thread reads for all of them
LARGE_BLOCK = 31 * 2**20  # bytes, see `_keep_memory`
ANSWERS = ("keypoints", "keypoints_px", "class_probs", "R", "t")  # what a network must answer


@dataclass(frozen=True)
class Crop:
    """Hold one view of a drone that the network is asked about."""

    row: Row  # of the journal, without an answer yet
    image: np.ndarray  # (S, S, 3) uint8 RGB
    square: np.ndarray  # (3,) x, y, side in the undistorted frame, pixels
    K: np.ndarray  # (3, 3) camera matrix of that frame, pixels


def load_network(path: str | Path) -> checkpoint.Network:
    """Load a checkpoint that finds pose and class from the picture alone.

    It is loaded onto the GPU, if there is one.

    Raises:
        InputError: It cannot be read, or its network needs the truth or does not name the drone.
    """
    # Of ONNX Runtime for a batch. `predicted` asks about several at once.
    network = checkpoint.load(path, threads=max(1, torch.get_num_threads() // AT_ONCE))
    if isinstance(network, nn.Module):
        network.to("cuda" if torch.cuda.is_available() else "cpu")
    if network.truth_inputs or not _answers_all(network):
        method = network.method
        if "keypoints" in network.truth_inputs:
            method += " without an encoder"
        raise InputError(
            f"{checkpoint.find(path)} holds a network of {method}; "
            "this takes DroneKey++, which names the drone itself"
        )
    # The camera is compared with the frames' size, which the network does not know, and the crops are ours.
    network.checks_inputs = False
    return network


def _answers_all(network: checkpoint.Network) -> bool:
    """Tell whether a network answers all that a pose consists of.

    It is asked about an empty picture.
    """
    size = network.config.image_size
    device = _device(network)
    K = torch.tensor([[[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]]], device=device)
    square = torch.tensor([[900.0, 500, 90]], device=device)
    with torch.inference_mode():
        answer = network(torch.zeros(1, 3, size, size, device=device), K, square)
    return all(answer.get(name) is not None for name in ANSWERS)


def _device(network: checkpoint.Network) -> torch.device:
    """Return the device on which a network wants its inputs."""
    return next(network.parameters()).device if isinstance(network, nn.Module) else torch.device("cpu")


def predicted(
    network: checkpoint.Network,
    calibrations: Sequence[Calibration],
    size: tuple[int, int],
    frames: Iterable[tuple[int, np.ndarray | None]],
    given: Mapping[int, np.ndarray] | None,
    tracker: Tracker | None,
) -> Iterator[list[Row]]:
    """Yield rows of the journal without the frames' names, a list a batch, in the order of the frames.

    While the network looks at several batches on the cores, a thread reads the next one.

    Args:
        network: it is asked.
        calibrations: the camera's, for every frame.
        size: width and height that every frame must have, pixels.
        frames: (number, image) of each, see `Footage.read`.
        given: {frame number: box (x, y, w, h)}; a frame without one has no box.
        tracker: it finds the boxes where none are given.
    """
    side = network.config.image_size
    at_once = min(torch.get_num_threads(), AT_ONCE) if _device(network).type == "cpu" else 1

    def answered(batch: tuple[list[Row], list[Crop]]) -> list[Row]:
        rows, crops = batch
        fill(network, crops)
        return rows

    _keep_memory()
    reading = ahead(_read_batches(side, calibrations, size, frames, given, tracker), READ_AHEAD)
    with contextlib.closing(reading) as batches:
        yield from side_by_side(answered, batches, at_once)


def _keep_memory() -> None:
    """Let the C library keep memory that is freed, and not give it back and ask for it anew in every layer.

    glibc gives back at once what is larger than the blocks that were freed before, up to 32 MB (mallopt(3),
    M_MMAP_THRESHOLD). So it is shown a large block, to which nothing is written. The pages of new memory cost
    a sixth of the network's time. Other C libraries do not care.
    """
    torch.empty(LARGE_BLOCK, dtype=torch.uint8)


def _read_batches(
    side: int,
    calibrations: Sequence[Calibration],
    size: tuple[int, int],
    frames: Iterable[tuple[int, np.ndarray | None]],
    given: Mapping[int, np.ndarray] | None,
    tracker: Tracker | None,
) -> Iterator[tuple[list[Row], list[Crop]]]:
    """Yield batches: the rows without an answer, and the crops of those that have a box.

    `side` is that of the crops in their own pixels. For the others see `predicted`.
    """
    rows: list[Row] = []
    crops: list[Crop] = []
    for number, image in frames:
        status, box = _find_box(number, image, size, given, tracker)
        row = {"frame": str(number), "status": status}
        rows.append(row)
        if box is not None:
            row.update(zip(BOX, [f"{value:.2f}" for value in box], strict=True))
            calibration = calibrations[number]
            straight = calibration.undistort_box(box)
            if _centre_inside(straight, size):
                square = clamp_square(square_around(straight), *size)
                straight_image = calibration.undistort(image)
                crop = crop_image(straight_image, square, side)
                crops.append(Crop(row, crop, square, calibration.K))
            else:  # straightening cuts the corners off
                row["status"] = "outside the undistorted frame"
        if len(rows) == BATCH:
            yield rows, crops
            rows, crops = [], []
    if rows:
        yield rows, crops


def _find_box(
    number: int,
    image: np.ndarray | None,
    size: tuple[int, int],
    given: Mapping[int, np.ndarray] | None,
    tracker: Tracker | None,
) -> tuple[str, np.ndarray | None]:
    """Return the status and the box of a frame.

    The status says why there is no box.
    """
    if image is None:
        return "cannot be read", None
    if image.shape[1::-1] != size:
        return f"is {image.shape[1]}x{image.shape[0]}, the first frame {size[0]}x{size[1]}", None
    if given is not None:
        box, missing = given.get(number), "no box"
    else:
        box, missing = tracker.follow(image), "lost by the tracker"
    return (missing if box is None else GOOD), box


def _centre_inside(box: np.ndarray, size: tuple[int, int]) -> bool:
    """Tell whether the centre of a box (x, y, w, h) lies in a frame of (width, height)."""
    x, y, w, h = box
    return 0 <= x + w / 2 < size[0] and 0 <= y + h / 2 < size[1]


def fill(network: checkpoint.Network, crops: Sequence[Crop]) -> None:
    """Ask the network about the crops of a batch, and write its answers into their rows."""
    if not crops:
        return
    device = _device(network)
    started = time.perf_counter()
    pixels = torch.from_numpy(np.stack([crop.image for crop in crops]))  # (B, S, S, 3) uint8
    images = pixels.permute(0, 3, 1, 2).float().div(255).to(device)
    sides = np.stack([crop.square for crop in crops])
    squares = torch.tensor(sides, dtype=torch.float32, device=device)  # (B, 3)
    matrices = np.stack([crop.K for crop in crops])
    K = torch.tensor(matrices, dtype=torch.float32, device=device)  # (B, 3, 3)
    with torch.inference_mode():
        answer = {}
        for name, value in network(images, K, squares).items():
            if torch.is_tensor(value):
                answer[name] = value.cpu()
        seconds = (time.perf_counter() - started) / len(crops)
        doubt = mirror_doubt(network, images, K, squares, answer["keypoints"].to(device)).cpu()  # crop units
    for i, crop in enumerate(crops):
        crop.row.update(_answer_columns(network, answer, i))
        crop.row["doubt_px"] = f"{doubt[i] * crop.square[2]:.3f}"
        crop.row["seconds"] = f"{seconds:.5f}"


def _answer_columns(network: checkpoint.Network, answer: Mapping[str, Tensor], i: int) -> Row:
    """Return the columns of the journal that a network's answer to the crop with index `i` fills."""
    score, drone = answer["class_probs"][i].max(dim=0)
    row = {"drone": network.drones[int(drone)].name, "score": f"{score:.4f}"}
    pose = torch.cat([answer["keypoints_px"][i].flatten(), answer["R"][i].flatten(), answer["t"][i]])
    for column, value in zip((*KEYPOINTS, *ROTATION, *TRANSLATION), pose.tolist(), strict=True):
        row[column] = f"{value:.6f}"
    row["status"] = GOOD if pose.isfinite().all() else "the network's answer is not finite"
    if "covariance" in answer:
        variances = answer["covariance"][i].diagonal()  # (6,) turn, rad²; shift, m²
        turn, shift = math.degrees(variances[:3].sum().sqrt()), variances[3:].sum().sqrt()
        row.update(zip(SIGMAS, (f"{turn:.3f}", f"{shift:.4f}"), strict=True))
    return row


def mirror_doubt(
    network: Callable[[Tensor, Tensor, Tensor], Mapping[str, Tensor]],
    image: Tensor,
    K: Tensor,
    square: Tensor,
    keypoints: Tensor,
) -> Tensor:
    """Measure by how much a network's keypoints move when the crop is mirrored, and they are mirrored back.

    A mirror swaps left and right hubs and changes nothing else, so a network that sees clearly answers the
    same. No truth is needed to ask.

    Args:
        network: answers (image, K, square) with "keypoints" (B, 4, 2), crop units.
        image, K, square: (B, 3, S, S), (B, 3, 3) and (B, 3), as the network takes them.
        keypoints: (B, 4, 2) its answer to them, crop units.

    Returns:
        (B,) mean distance over the four keypoints, crop units.
    """
    mirrored = network(mirror_image(image), K, mirror_square(square, K))["keypoints"]
    distances = (mirror_keypoints(mirrored.to(keypoints)) - keypoints).norm(dim=-1)  # (B, 4)
    return distances.mean(dim=-1)
