"""Measure how far one set of pictures is from another (Fig. 6 of the paper, with numbers).

This module computes features of crops, and four distances between two sets of features: `frechet`,
`kernel_mmd`, the AUC of a classifier (`held_out_scores` and `auc`), and the coverage (`covered`).

A set is a matrix of features (n, D) with one row for each picture. Every row also has a group: the video or
flight that the picture was cut from. Pictures of one group resemble each other, so a group is never split:
neither between the training and test halves of a classifier, nor by an interval.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy.spatial.distance import cdist
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold
from sklearn.neighbors import NearestNeighbors
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from torch import Tensor, nn

from dronekeypp.errors import InputError

RINGS, CELLS, DIRECTIONS, TONES = 16, 4, 8, 8  # of `descriptor`
PARTS = {  # the columns of `descriptor`
    "tones": slice(0, 3 * TONES),
    "sharpness": slice(3 * TONES, 3 * TONES + RINGS),
    "edges": slice(3 * TONES + RINGS, None),
}
NEIGHBOURS = 5  # of `covered`


@torch.inference_mode()
def descriptor(images: Tensor) -> np.ndarray:
    """Describe what pictures look like, without any training.

    The features have three parts:

    - Tones: a histogram of each colour channel, 3 × 8 shares.
    - Sharpness: the log of the power spectrum of the grey picture in 16 rings of rising frequency. Noise,
      blur and compression change it.
    - Edges: in each of 4 × 4 cells, the shares of 8 directions of the gradient (after Dalal & Triggs, CVPR
      2005).

    Args:
        images: (B, 3, S, S) RGB in [0, 1].

    Returns:
        (B, 168) features, with the columns of PARTS.
    """
    return torch.cat([_tones(images), _sharpness(images), _edges(images)], dim=1).numpy()


def _tones(images: Tensor) -> Tensor:
    """Return the share of the pixels in each of 8 tones of each colour channel, (B, 24)."""
    B, _, S, _ = images.shape
    tone = (images.clamp(0, 1 - 1e-6) * TONES).long().flatten(2)  # (B, 3, S*S)
    ones = torch.ones_like(tone, dtype=torch.float32)
    counts = torch.zeros(B, 3, TONES).scatter_add_(2, tone, ones)  # (B, 3, 8)
    return (counts / (S * S)).flatten(1)


def _sharpness(images: Tensor) -> Tensor:
    """Return the log of the mean power in each of 16 rings of frequency, (B, 16)."""
    grey = images.mean(dim=1)  # (B, S, S)
    S = grey.shape[-1]
    window = torch.hann_window(S, periodic=False)
    windowed = (grey - grey.mean(dim=(1, 2), keepdim=True)) * window[:, None] * window
    power = torch.fft.fft2(windowed).abs().square()  # (B, S, S)
    frequency = torch.fft.fftfreq(S)
    radius = (frequency[:, None].square() + frequency.square()).sqrt()  # (S, S)
    ring = (radius / 0.5 * RINGS).long().clamp(max=RINGS)  # the corners beyond the last ring are left out
    mean_power = [power[:, ring == k].mean(dim=1) for k in range(RINGS)]
    return (torch.stack(mean_power, dim=1) + 1e-6).log()


def _edges(images: Tensor) -> Tensor:
    """Return the shares of 8 directions of the gradient in each of 4 × 4 cells, (B, 128)."""
    grey = images.mean(dim=1)  # (B, S, S)
    B, S, _ = grey.shape
    dy, dx = torch.gradient(grey, dim=(1, 2))
    strength = (dx.square() + dy.square()).sqrt()
    direction = ((torch.atan2(dy, dx) / torch.pi + 1) * DIRECTIONS / 2 + 0.5).long() % DIRECTIONS
    row_or_column = torch.arange(S) * CELLS // S  # (S,) of the cell
    cell = row_or_column[:, None] * CELLS + row_or_column  # (S, S)
    bin_index = (cell * DIRECTIONS + direction).flatten(1)  # (B, S*S)
    sums = torch.zeros(B, CELLS * CELLS * DIRECTIONS).scatter_add_(1, bin_index, strength.flatten(1))
    edges = sums.view(B, CELLS * CELLS, DIRECTIONS)
    return (edges / edges.sum(dim=2, keepdim=True).clamp(min=1e-6)).flatten(1)


@torch.inference_mode()
def backbone_features(backbone: nn.Module, images: Tensor, batch: int = 64) -> np.ndarray:
    """Average the feature maps of a backbone over the picture: images (B, 3, S, S) -> (B, C)."""
    was_training = backbone.training
    backbone.eval()
    try:
        return torch.cat([backbone(part).mean(dim=(2, 3)) for part in images.split(batch)]).numpy()
    finally:
        backbone.train(was_training)


def frechet(a: np.ndarray, b: np.ndarray) -> float:
    """Return the Fréchet distance of the normal distributions fitted to two sets (Heusel et al. 2017).

    It is |mean difference|² + tr(A + B - 2 (A B)^½) for the covariances A and B. Few pictures make it larger,
    so compare only sets of the same size.

    Args:
        a: (n, D) features.
        b: (m, D) features.
    """
    A = np.cov(a, rowvar=False)
    B = np.cov(b, rowvar=False)
    # tr (A B)^½ is the sum of the roots of the eigenvalues of A B. These are also the eigenvalues of the
    # symmetric matrix A^½ B A^½.
    values, vectors = np.linalg.eigh(A)
    root = (vectors * np.sqrt(np.clip(values, 0, None))) @ vectors.T
    cross = np.sqrt(np.clip(np.linalg.eigvalsh(root @ B @ root), 0, None)).sum()
    return float(np.square(a.mean(axis=0) - b.mean(axis=0)).sum() + np.trace(A) + np.trace(B) - 2 * cross)


def kernel_mmd(a: np.ndarray, b: np.ndarray) -> float:
    """Return the squared maximum mean discrepancy, unbiased (Gretton et al., JMLR 2012, eq. 3).

    It is around 0 for two sets of the same kind, and at most 2. The kernel is Gaussian, and its width is the
    median squared distance between two pictures of `a`. So distances from one set `a` to several sets can be
    compared.

    Args:
        a: (n, D) features.
        b: (m, D) features.
    """
    within_a = cdist(a, a, "sqeuclidean")
    within_b = cdist(b, b, "sqeuclidean")
    across = cdist(a, b, "sqeuclidean")
    width = np.median(within_a[np.triu_indices(len(a), 1)])
    similarity = _mean_similarity(within_a, width) + _mean_similarity(within_b, width)
    return float(similarity - 2 * np.exp(-across / (2 * width)).mean())


def _mean_similarity(squared: np.ndarray, width: float) -> float:
    """Return the mean similarity of two different pictures of a set.

    Args:
        squared: (n, n) squared distances. The diagonal is left out.
        width: of the kernel, a squared distance.
    """
    n = len(squared)
    return (np.exp(-squared / (2 * width)).sum() - n) / (n * (n - 1))


def held_out_scores(
    a: np.ndarray, b: np.ndarray, groups_a: np.ndarray, groups_b: np.ndarray, folds: int = 5
) -> tuple[np.ndarray, np.ndarray]:
    """Let a linear classifier tell two sets apart, and score every picture by one trained on other groups.

    Args:
        a: (n, D) features of the first set.
        b: (m, D) features of the second set.
        groups_a: (n,) groups of the first set.
        groups_b: (m,) groups of the second set.
        folds: how many parts the groups are split into; each part is scored once.

    Returns:
        The scores (n,) and (m,). A high score means the second set.

    Raises:
        InputError: One of the sets has fewer groups than folds.
    """
    if min(len(set(groups_a)), len(set(groups_b))) < folds:
        raise InputError(
            f"a classifier tested in {folds} folds needs as many groups (videos, flights) in each set"
        )
    x, y = np.concatenate([a, b]), np.r_[np.zeros(len(a)), np.ones(len(b))]
    scores = np.empty(len(x))
    splits_a = GroupKFold(folds).split(a, groups=groups_a)
    splits_b = GroupKFold(folds).split(b, groups=groups_b)
    for (train_a, test_a), (train_b, test_b) in zip(splits_a, splits_b, strict=True):
        train = np.r_[train_a, len(a) + train_b]
        test = np.r_[test_a, len(a) + test_b]
        regression = LogisticRegression(C=0.1, max_iter=2000, class_weight="balanced")
        classifier = make_pipeline(StandardScaler(), regression).fit(x[train], y[train])
        scores[test] = classifier.decision_function(x[test])
    return scores[: len(a)], scores[len(a) :]


def auc(scores_a: np.ndarray, scores_b: np.ndarray) -> float:
    """Return the area under the ROC curve of scores (n,) and (m,).

    This is the chance that a picture of the second set scores higher than one of the first. At 0.5 the scores
    cannot tell the sets apart, and at 1 they always can.
    """
    labels = np.r_[np.zeros(len(scores_a)), np.ones(len(scores_b))]
    return float(roc_auc_score(labels, np.r_[scores_a, scores_b]))


def covered(real: np.ndarray, made: np.ndarray) -> np.ndarray:
    """Tell which real pictures have a made picture near them.

    Near means no farther from the real picture than its own 5th nearest real neighbour. The mean of the
    answers is the coverage of Naeem et al. (ICML 2020).

    Args:
        real: (n, D) features.
        made: (m, D) features.

    Returns:
        (n,) bool.
    """
    # Every real picture is its own first neighbour, so the 5th other one is the last of six.
    real_distances = NearestNeighbors(n_neighbors=NEIGHBOURS + 1).fit(real).kneighbors(real)[0]  # (n, 6)
    made_distances = NearestNeighbors(n_neighbors=1).fit(made).kneighbors(real)[0]  # (n, 1)
    return made_distances[:, 0] <= real_distances[:, -1]


def interval(
    measure: Callable[..., float],
    sets: list[np.ndarray],
    groups: list[np.ndarray],
    paired: tuple[int, ...] = (),
) -> list[float]:
    """Return the 95 % interval [low, high] of `measure(*sets)` by the jackknife (Efron & Stein 1981).

    Each group is left out in turn, in each set by itself. A bootstrap would draw pictures twice. For a
    distance between sets, a picture and its copy are neighbours that do not occur in real data.

    Args:
        measure: takes the sets and returns a number.
        sets: features, one matrix (n, D) for each set.
        groups: the groups (n,) of each set.
        paired: positions of sets that show the same groups, such as the same flights in front of other
            backgrounds. A group is left out of all of them at once.
    """
    families = [[i] for i in range(len(sets)) if i not in paired]
    if paired:
        families.append(list(paired))
    value, variance = measure(*sets), 0.0
    for family in families:
        names = np.unique(np.concatenate([groups[i] for i in family]))
        values = []
        for name in names:
            remaining = list(sets)
            for i in family:
                remaining[i] = sets[i][groups[i] != name]
            values.append(measure(*remaining))
        variance += (len(names) - 1) * float(np.var(values))
    return [value - 1.96 * variance**0.5, value + 1.96 * variance**0.5]
