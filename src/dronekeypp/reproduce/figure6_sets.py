"""Make the sets of pictures of Figure 6, real and made, and ask networks about them."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import torchvision
from torch import Tensor

from dronekeypp import checkpoint
from dronekeypp.augment import degrade
from dronekeypp.camera import clamp_square, crop_image, square_around
from dronekeypp.classes import names_of
from dronekeypp.data import open_dataset
from dronekeypp.errors import InputError
from dronekeypp.evaluate import frame_errors, json_values, measure
from dronekeypp.files import repository_root
from dronekeypp.footage import read_picture
from dronekeypp.model import Backbone, DroneKeyPP, ModelConfig
from dronekeypp.predict import mirror_doubt
from dronekeypp.realism import backbone_features, descriptor, interval
from dronekeypp.reproduce import ablations
from dronekeypp.reproduce.results import describe
from dronekeypp.reproduce.runner import Bench
from dronekeypp.sixdronesyn.folders import read_manifest
from dronekeypp.sixdronesyn.scenes import SCENES, count_frames
from dronekeypp.train import BEST

PICTURES = 500  # of a made set, evenly spaced over the test flights
BATCH = 64  # pictures that a network sees at a time
PANORAMAS = 22  # of the plain set
TEST = [number for number, scene in SCENES.items() if scene.split == "test"]
# Set: label, colour, marker. Blue, red and green are the paper's; told apart by the marker too.
SETS = {
    "real": ("real frames", "#0072B2", "o"),
    "plain": ("ours, plain backgrounds", "#D55E00", "^"),
    "drawn": ("ours, drawn places", "#009E73", "s"),
    "photographs": ("ours, photographed places", "#CC79A7", "D"),
}
# A made set once more, with the same drones and places: as small as the real ones, and as a small, compressed
# video shows them.
VERSIONS = {"": "as made", " small": "as small as real ones", " degraded": "small, noisy, compressed"}
# A camera for frames whose own is not known. Keypoints and class come from the picture alone.
ANY_CAMERA = ((1500.0, 0.0, 960.0), (0.0, 1500.0, 540.0), (0.0, 0.0, 1.0))

ANSWERED = ("keypoints", "keypoints_px", "class_probs", "R", "t")  # what `answer` reads of the outputs

Features = dict[str, np.ndarray]  # "SET/KIND" (n, D) float16 and "SET/groups" (n,)


@dataclass(frozen=True)
class Pictures:
    """Hold crops of drones, all of one size.

    Args:
        images: (n, S, S, 3) uint8 RGB.
        groups: (n,) the video or flight that each was cut from.
        squares: (n, 3) their x, y, side in frame pixels.
        boxes: (n, 4) the drones' x, y, w, h in frame pixels.
        truth: annotations of made ones, stacked.
    """

    images: np.ndarray
    groups: np.ndarray
    squares: np.ndarray
    boxes: np.ndarray
    truth: dict[str, Tensor] | None = None

    @property
    def tensor(self) -> Tensor:
        """Return the images as networks take them, (n, 3, S, S) in [0, 1]."""
        return torch.from_numpy(self.images).permute(0, 3, 1, 2).float() / 255


# --- the sets ---------------------------------------------------------------------------------------------


def real_pictures(folder: Path, size: int) -> Pictures:
    """Read the crops that FOLDER/boxes.csv names, with one drone in each row.

    Its columns are file, video, and a box x, y, w, h in pixels (or tight_x, …).

    Raises:
        InputError: There is no such file, a column or an image is missing, or a box is not valid.
    """
    path = folder / "boxes.csv"
    if not path.is_file():
        raise InputError(
            f"{path} not found: real frames need a table with the columns file, video, x, y, w, h"
        )
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    columns = set(rows[0]) if rows else set()
    box_columns = [f"tight_{key}" for key in "xywh"] if "tight_x" in columns else list("xywh")
    if "video" not in columns:
        raise InputError(
            f"{path}: column 'video' is missing; frames of one video are alike, so it has to be known"
        )
    missing = {"file", *box_columns} - columns
    if missing:
        raise InputError(f"{path}: column {min(missing)!r} is missing")
    images, squares, boxes = [], [], []
    for number, row in enumerate(rows, start=2):
        try:
            box = [float(row[key]) for key in box_columns]
        except (TypeError, ValueError):
            raise InputError(f"{path}, line {number}: the box is not four numbers") from None
        image = read_picture(folder / row["file"])
        if image is None:
            raise InputError(f"{path}, line {number}: {folder / row['file']} is missing or no picture")
        square = clamp_square(square_around(box), image.shape[1], image.shape[0])
        images.append(crop_image(image, square, size))
        squares.append(square)
        boxes.append(box)
    groups = np.unique([row["video"] for row in rows], return_inverse=True)[1]
    return Pictures(np.stack(images), groups, np.stack(squares), np.array(boxes))


def made_pictures(data: Path, size: int) -> Pictures:
    """Return PICTURES crops of the test flights, evenly spaced."""
    dataset = open_dataset(data, "test", size=size)
    chosen = np.linspace(0, len(dataset) - 1, min(PICTURES, len(dataset))).round().astype(int)
    images, annotations = [], []
    for i in chosen:
        item = dict(dataset[i])
        image = item.pop("image")  # not needed beside the bytes
        images.append((image.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8))
        annotations.append(item)
    truth = {}
    for key in annotations[0]:
        truth[key] = torch.stack([item[key] for item in annotations])
    boxes = np.stack([dataset.frames[i].box for i in chosen])
    return Pictures(np.stack(images), truth["subsequence"].numpy(), truth["square"].numpy(), boxes, truth)


def as_small(pictures: Pictures, sides: np.ndarray) -> Pictures:
    """Show each crop at the resolution of a real one that is drawn at random.

    It is shrunk to that many pixels and enlarged again. `sides` (m,) are the real crops' sides in pixels.
    """
    size, rng = pictures.images.shape[1], np.random.default_rng(0)
    drawn = rng.choice(sides, len(pictures.images)).round().astype(int).clip(4, size)
    images = []
    for image, side in zip(pictures.images, drawn, strict=True):
        small = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA)
        images.append(cv2.resize(small, (size, size), interpolation=cv2.INTER_LINEAR))
    return replace(pictures, images=np.stack(images))


def as_video(pictures: Pictures) -> Pictures:
    """Show each crop as `augment.degrade` shows it."""
    images = []
    for i, image in enumerate(pictures.images):
        images.append(degrade(image, np.random.default_rng([0, i])))
    return replace(pictures, images=np.stack(images))


def paint_plain(folder: Path) -> Path:
    """Paint panoramas of one colour above the horizon and one below, and return `folder`.

    They stand for the virtual backgrounds of older synthetic data.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(PANORAMAS):
        darkest, brightest = [[120] * 3, [50] * 3], [[240] * 3, [160] * 3]
        above, below = np.random.default_rng([0, i]).uniform(darkest, brightest)
        image = np.where(np.arange(256)[:, None, None] < 128, above, below) * np.ones((1, 512, 1))
        blurred = cv2.GaussianBlur(image.round().astype(np.uint8), (0, 0), 2)
        cv2.imwrite(str(folder / f"plain_{i:02d}.png"), blurred)
    return folder


def rendered(bench: Bench, name: str, environments: Path | None) -> Path:
    """Return the folder of a made set, after rendering its test flights if they are missing."""
    folder = bench.data if name == "drawn" else bench.data.with_name(f"{bench.data.name}-{name}")
    manifest = read_manifest(folder)
    usual = max(bench.stride, 10) if name == "plain" else bench.stride  # plain: just enough
    stride = manifest.get("settings", {}).get("stride", usual)
    if manifest.get("frames", {}).get("test", 0) < count_frames(TEST, stride=stride):
        bench.say(f"rendering into {folder}")
        from dronekeypp.sixdronesyn.generate import generate  # here, as in `Bench.render`

        generate(
            folder,
            TEST,
            stride=stride,
            environments=environments,
            workers=bench.workers,
            progress=bench.progress,
        )
    return folder


def all_sets(bench: Bench, real: Path, size: int) -> tuple[dict[str, Pictures], dict[str, Any]]:
    """Return every set and version by its name, and what the data of the made ones are.

    The real set comes first.

    Raises:
        InputError: The real frames cannot be read.
    """
    sets, datasets = {"real": real_pictures(real, size)}, {}
    sides = sets["real"].squares[:, 2]
    sources = {
        "plain": paint_plain(bench.root / "data" / "plain"),
        "drawn": bench.environments,
        "photographs": bench.photographs,
    }
    for name, environments in sources.items():
        if name == "photographs" and environments is None:
            continue
        folder = rendered(bench, name, environments)
        datasets[name] = describe(folder)
        made = made_pictures(folder, size)
        sets[name], sets[f"{name} small"], sets[f"{name} degraded"] = (
            made,
            as_small(made, sides),
            as_video(made),
        )
    return sets, datasets


# --- features and answers ---------------------------------------------------------------------------------


def from_pictures(bench: Bench, real: Path) -> tuple[Features, list[dict], dict[str, Any]]:
    """Measure everything that needs pictures.

    Returns:
        The features of every set and version ("drawn small/backbone") and their groups; what networks answer;
        and what the data of the made sets are.
    """
    shipped = checkpoint.load(repository_root() / "data_samples" / "checkpoint")
    assert isinstance(shipped, DroneKeyPP)
    sets, datasets = all_sets(bench, real, shipped.config.image_size)
    arrays = {f"{name}/groups": pictures.groups.astype(np.int32) for name, pictures in sets.items()}
    kinds = feature_kinds(shipped)
    for name, pictures in sets.items():
        for kind, features_of in kinds.items():
            arrays[f"{name}/{kind}"] = features_of(pictures.tensor).astype(np.float16)
    answers = []
    for title, network in {"shipped": shipped, **trained_on_degraded(bench)}.items():
        for name, pictures in sets.items():
            answers.append({"network": title, "set": name, **answer(network, pictures)})
    return arrays, answers, datasets


def feature_kinds(network: DroneKeyPP) -> dict[str, Callable[[Tensor], np.ndarray]]:
    """Return the functions that turn pictures (n, 3, S, S) into features (n, D), by their names in KINDS.

    ImageNet's features join in where torchvision has once downloaded the weights of its ResNet-18.
    """
    kinds: dict[str, Callable[[Tensor], np.ndarray]] = {
        "descriptor": descriptor,
        "backbone": lambda images: backbone_features(network.backbone, images),
    }
    file = Path(torchvision.models.ResNet18_Weights.IMAGENET1K_V1.url).name
    if (Path(torch.hub.get_dir()) / "checkpoints" / file).is_file():
        resnet = Backbone(ModelConfig(backbone="resnet18", backbone_weights="imagenet"))
        kinds["imagenet"] = lambda images: backbone_features(resnet, images)
    return kinds


def trained_on_degraded(bench: Bench) -> dict[str, DroneKeyPP]:
    """Return the networks of the ablation "degraded" by their rows, as far as they have been trained."""
    networks = {}
    for row in ablations.ABLATIONS["degraded"].rows:
        best = bench.folder(ablations.run_of(row, bench.preset), 0) / BEST
        if best.is_dir():
            networks[row.name] = checkpoint.load(best)
    return networks


@torch.inference_mode()
def answer(network: DroneKeyPP, pictures: Pictures) -> dict[str, Any]:
    """Ask a network what can be asked without the truth.

    Returns:
        doubt_px: how far its keypoints move when the crop is mirrored (`predict.mirror_doubt`, pixels of the
        crop). It is the median of each video, and their mean, with an interval.
        inside: the share of the keypoints inside the box, a tenth of its longer side around it included.
        class_probability: the median probability of the class that it names.
        named: how often it names which drone.
        Where the truth is known, the median errors follow.
    """
    network.eval()
    size, count = pictures.images.shape[1], len(pictures.images)
    images, squares = pictures.tensor, torch.from_numpy(pictures.squares).float()
    K = torch.tensor(ANY_CAMERA).expand(count, 3, 3) if pictures.truth is None else pictures.truth["K"]
    doubts, batches = [], []
    for start in range(0, count, BATCH):
        chosen = slice(start, start + BATCH)
        inputs = images[chosen], K[chosen], squares[chosen]
        output = network(*inputs)
        doubts.append(size * mirror_doubt(network, *inputs, output["keypoints"]))
        batches.append({name: output[name] for name in ANSWERED})
    output = {}
    for name in ANSWERED:
        output[name] = torch.cat([batch[name] for batch in batches])
    probability, named = output["class_probs"].max(dim=1)
    counts = {name: int((named == k).sum()) for k, name in enumerate(names_of(network.drones))}
    answers = {
        **doubt_by_video(torch.cat(doubts).numpy(), pictures.groups),
        "inside": share_inside(output["keypoints_px"].numpy(), pictures.boxes),
        "class_probability": float(probability.median()),
        "named": counts,
    }
    if pictures.truth is not None:
        errors = measure(frame_errors(output, {**pictures.truth, "image": images[:1]}))
        answers |= {key: errors[key] for key in ("R_medae_deg", "t_medae_m", "class_accuracy")}
    return json_values(answers)


def doubt_by_video(doubts: np.ndarray, groups: np.ndarray) -> dict[str, Any]:
    """Return the median doubt of each video, and their mean with its interval.

    `doubts` (n,) are in pixels.
    """
    videos = np.unique(groups)
    medians = np.array([np.median(doubts[groups == video]) for video in videos])
    return {
        "doubt_px": _mean(medians),
        "doubt_px_ci95": interval(_mean, [medians], [videos]),
        "doubt_px_by_video": medians.round(2).tolist(),
    }


def share_inside(points: np.ndarray, boxes: np.ndarray) -> float:
    """Return the share of the keypoints (n, 4, 2) that lie inside their drone's box (n, 4).

    A tenth of the box's longer side is added around it.
    """
    corner, extent = boxes[:, None, :2], boxes[:, None, 2:]
    low = corner - 0.1 * boxes[:, 2:].max(axis=1)[:, None, None]
    high = 2 * corner + extent - low  # as far beyond the other corner
    return float(((points >= low) & (points <= high)).all(axis=-1).mean())


def _mean(values: np.ndarray) -> float:
    return float(values.mean())
