"""Ask for the geometric network's answers, and measure whether the uncertainty it claims can be trusted.

The network (`pose="geometric"`, see `model/geometry.py`) is measured in parts as well, from the same weights:
its direct branch alone, given the true class, and given true keypoints, with and without the noise that its
own keypoints have. The parts on true keypoints show what its solver could do at best.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy.stats import chi2
from torch import Tensor
from torch.nn.functional import one_hot
from torch.utils.data import Dataset

from dronekeypp.camera import MIRRORED_KEYPOINTS, mirror_image, mirror_keypoints
from dronekeypp.evaluate import batches_of, evaluate, frame_errors, to_device
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.model import DroneKeyPP
from dronekeypp.rotations import chord

PARTS = {  # the geometric network's other answers
    "direct": "geometric, direct branch alone",
    "twice": "geometric, asked twice: the crop and its mirror",
    "told": "geometric, told the class",
    "noisy": "geometric, told class, true keypoints with its noise",
    "exact": "geometric, told class, true keypoints",
}
HALVES = {"turn": slice(0, 3), "shift": slice(3, 6)}  # of an error vector: radians, metres
LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
HIDDEN = (0.0, 0.05, 0.1, 0.2, 0.3)  # share of the crop's area
BATCH = 64

# --- what the network answers -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Answers:
    """Hold what a geometric network says of every frame of a data set.

    Args:
        whole: errors of its answer, arrays of `frame_errors`.
        parts: the same of its other answers, by the names of PARTS.
        error: (F, 6), from the answer to the truth: the turn (axis times 2 sin(angle / 2), camera axes), and
            the shift in metres.
        covariance: (F, 6, 6), the covariance that it claims for that error.
    """

    whole: Frames
    parts: dict[str, Frames]
    error: np.ndarray
    covariance: np.ndarray


@torch.inference_mode()
def answers(model: DroneKeyPP, dataset: Dataset, parts: Iterable[str] = tuple(PARTS)) -> Answers:
    """Ask a geometric network about every frame of a data set, and for the other answers named in `parts`."""
    device = next(model.parameters()).device
    model.eval()
    names = ["whole", *parts]
    frames: dict[str, list[Frames]] = {name: [] for name in names}
    errors, covariances = [], []
    shuffle = torch.Generator().manual_seed(0)
    for items in batches_of(dataset, BATCH):
        items = to_device(items, device)
        order = torch.randperm(len(items["K"]), generator=shuffle).to(device)
        outputs = outputs_of(model, items, order, parts)
        for name in names:
            frames[name].append(frame_errors(outputs[name], items))
        whole = outputs["whole"]
        turn = chord(items["R"], whole["R"])
        errors.append(torch.cat([turn, items["t"] - whole["t"]], dim=1).cpu())
        covariances.append(whole["covariance"].cpu())
    joined = {name: concatenated(batches) for name, batches in frames.items()}
    return Answers(
        joined.pop("whole"),
        joined,
        torch.cat(errors).numpy().astype(np.float64),
        torch.cat(covariances).numpy().astype(np.float64),
    )


def concatenated(batches: list[Frames]) -> Frames:
    """Join the arrays of several batches."""
    frames = {}
    for name in batches[0]:
        frames[name] = np.concatenate([batch[name] for batch in batches])
    return frames


def outputs_of(
    model: DroneKeyPP, items: dict[str, Tensor], order: Tensor, parts: Iterable[str]
) -> dict[str, dict[str, Tensor]]:
    """Return the network's output for one batch, as "whole", and for each of `parts`.

    For "noisy", frame i gets the keypoint noise of frame `order[i]`, and that frame's claim for it.
    `order` has shape (B,).
    """
    K, square = items["K"], items["square"]
    encoded = model.encode(items["image"])
    probs = encoded["class_logits"].softmax(dim=1)
    true_class = one_hot(items["label"], model.config.classes).to(probs)
    whole = model.decode(encoded, probs, K, square)
    outputs = {"whole": whole, "direct": {**whole, "R": whole["R_direct"], "t": whole["t_direct"]}}
    if "twice" in parts:
        both = merged(encoded, model.encode(mirror_image(items["image"])))
        outputs["twice"] = {**model.decode(both, probs, K, square), "keypoints": both["keypoints"]}
    if "told" in parts:
        outputs["told"] = model.decode(encoded, true_class, K, square)
    if "noisy" in parts:
        noise = (encoded["keypoints"] - items["keypoints"])[order]
        keypoints, sigma = items["keypoints"] + noise, encoded["keypoint_sigma"][order]
        noisy = {**encoded, "keypoints": keypoints, "keypoint_sigma": sigma}
        outputs["noisy"] = {**model.decode(noisy, true_class, K, square), "keypoints": keypoints}
    if "exact" in parts:
        keypoints, sigma = items["keypoints"], torch.full_like(encoded["keypoint_sigma"], 1e-3)
        exact = {**encoded, "keypoints": keypoints, "keypoint_sigma": sigma}
        outputs["exact"] = {**model.decode(exact, true_class, K, square), "keypoints": keypoints}
    seen = {"keypoints": encoded["keypoints"], "class_probs": probs}
    return {name: {**seen, **output} for name, output in outputs.items()}


def merged(encoded: dict[str, Tensor], mirrored: dict[str, Tensor]) -> dict[str, Tensor]:
    """Average the keypoints that a crop showed with those that its mirror image showed.

    Each is weighted by its own claim. The variance of the new claim is the harmonic mean of the two. It is
    not reduced further, because two looks at one picture err alike.
    """
    own_weight = encoded["keypoint_sigma"].pow(-2)  # (B, 4)
    mirror_weight = mirrored["keypoint_sigma"][:, MIRRORED_KEYPOINTS].pow(-2)
    total = own_weight + mirror_weight
    weighted = own_weight[..., None] * encoded["keypoints"]
    weighted = weighted + mirror_weight[..., None] * mirror_keypoints(mirrored["keypoints"])
    keypoints = weighted / total[..., None]
    return {**encoded, "keypoints": keypoints, "keypoint_sigma": (2 / total).sqrt()}


# --- what a covariance is worth ---------------------------------------------------------------------------


def surprise(error: np.ndarray, covariance: np.ndarray) -> dict[str, np.ndarray]:
    """Return the squared Mahalanobis distance (F,) of the turn and of the shift.

    It is chi-squared with 3 degrees of freedom if the covariance is right.
    """
    squared = {}
    for name, part in HALVES.items():
        inverse = np.linalg.inv(covariance[:, part, part])
        squared[name] = np.einsum("fi,fij,fj->f", error[:, part], inverse, error[:, part])
    return squared


def calibration(error: np.ndarray, covariance: np.ndarray) -> list[float]:
    """Return the factors by which the deviations of turn and shift have to be multiplied.

    With them the 50 % and the 90 % region hold their share of these frames. One factor cannot always serve
    both regions, so it is the geometric mean of the two that would.
    """
    factors = []
    for squared in surprise(error, covariance).values():
        ratios = [np.quantile(squared, level) / chi2.ppf(level, 3) for level in (0.5, 0.9)]
        factors.append(float(np.prod(ratios) ** 0.25))
    return factors


def coverage(error: np.ndarray, covariance: np.ndarray) -> dict[str, list[float]]:
    """Return the share of the frames with an error inside the region that is claimed to hold LEVELS."""
    shares = {}
    for name, squared in surprise(error, covariance).items():
        shares[name] = [float((squared <= chi2.ppf(level, 3)).mean()) for level in LEVELS]
    return shares


def claimed(covariance: np.ndarray) -> dict[str, np.ndarray]:
    """Return the deviations (F,) that a covariance claims: of the turn in degrees and of the shift in metres.

    Each is the root of the trace.
    """
    deviations = {}
    for name, part in HALVES.items():
        deviations[name] = np.sqrt(np.trace(covariance[:, part, part], axis1=1, axis2=2))
    return {"turn": np.degrees(deviations["turn"]), "shift": deviations["shift"]}


def doubt(error: np.ndarray, covariance: np.ndarray, model: DroneKeyPP) -> dict[str, Any]:
    """Compare what was claimed with what happened: the coverage, and the errors by tenths of the frames.

    The tenths begin with the surest frames. What was claimed and what happened are both root mean squares
    over a tenth.
    """
    claims = claimed(covariance)
    result = {
        "calibration": model.decoder.calibration.tolist(),
        "coverage": coverage(error, covariance),
        "tenths": {},
    }
    for name, part in HALVES.items():
        happened = np.linalg.norm(error[:, part], axis=1) * (180 / np.pi if name == "turn" else 1)
        rows = []
        for tenth in np.array_split(np.argsort(claims[name]), min(10, len(error))):
            rows.append(
                {
                    "claimed": float(np.sqrt(np.mean(claims[name][tenth] ** 2))),
                    "error": float(np.sqrt(np.mean(happened[tenth] ** 2))),
                }
            )
        result["tenths"][name] = rows
        result[f"claimed_{name}"] = float(np.median(claims[name]))
    return result


# --- a hidden part of the picture -------------------------------------------------------------------------


class Hidden(Dataset):
    """A `Hidden` data set has a grey square over a random place of each crop, `share` of its area.

    The truth stays the same.
    """

    def __init__(self, dataset: Dataset, share: float) -> None:
        self.dataset, self.share = dataset, share

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, i: int) -> dict[str, Tensor]:
        item = dict(self.dataset[i])
        size = item["image"].shape[-1]
        side = round(size * self.share**0.5)
        if side:
            x, y = np.random.default_rng([0, i]).integers(0, size - side + 1, 2)
            item["image"] = item["image"].clone()
            item["image"][:, y : y + side, x : x + side] = 0.5
        return item


def occlusion(models: Mapping[str | None, DroneKeyPP], dataset: Dataset) -> list[dict[str, Any]]:
    """Return every network's medians against the hidden share of the crop.

    For a geometric network the rows also hold what it claims. `models` are the networks by their variant.
    """
    rows = []
    for share in HIDDEN:
        for variant, model in models.items():
            covered = Hidden(dataset, share)
            row: dict[str, Any] = {"hidden": share, "variant": variant}
            if model.decoder.needs_image:
                answered = answers(model, covered, ())
                frames = answered.whole
                for name, deviations in claimed(answered.covariance).items():
                    row[f"claimed_{name}"] = float(np.median(deviations))
                shares = coverage(answered.error, answered.covariance)
                row["coverage90"] = {name: values[-1] for name, values in shares.items()}
            else:
                frames = evaluate(model, covered)
            row["R_deg"] = float(np.median(frames["R_deg"]))
            row["t_m"] = float(np.median(frames["t_m"]))
            rows.append(row)
    return rows
