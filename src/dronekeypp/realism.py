"""How far is one set of pictures from another? Features of crops, and four distances between two sets of features (the paper's Fig. 6, with numbers).

A set is a matrix of features (n, D), a row a picture, with a group a row: the video or flight it was cut from. Pictures of one group resemble each
other, so a group is never split: not between the halves of a classifier's test, and not by an interval.
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
PARTS = {
    "tones": slice(0, 3 * TONES),
    "sharpness": slice(3 * TONES, 3 * TONES + RINGS),
    "edges": slice(3 * TONES + RINGS, None),
}  # its columns
NEIGHBOURS = 5  # of `covered`


@torch.inference_mode()
def descriptor(images: Tensor) -> np.ndarray:
    """What a picture looks like, without any training: images (B, 3, S, S) RGB in [0, 1] -> (B, 168).

    Three parts. Tones: a histogram of each colour channel (3 x 8 shares). Sharpness: the log of the power spectrum of the grey picture in 16 rings
    of rising frequency, where noise, blur and compression leave their marks. Edges: in 4 x 4 cells, the shares of 8 directions of the gradient
    (after Dalal & Triggs, CVPR 2005).
    """
    B, _, S, _ = images.shape
    level = (images.clamp(0, 1 - 1e-6) * TONES).long().flatten(2)  # (B, 3, S*S)
    tones = torch.zeros(B, 3, TONES).scatter_add_(2, level, torch.ones_like(level, dtype=torch.float32)) / (
        S * S
    )

    grey = images.mean(dim=1)  # (B, S, S)
    window = torch.hann_window(S, periodic=False)
    power = (
        torch.fft.fft2((grey - grey.mean(dim=(1, 2), keepdim=True)) * window[:, None] * window).abs().square()
    )  # (B, S, S)
    frequency = torch.fft.fftfreq(S)
    radius = (frequency[:, None].square() + frequency.square()).sqrt()
    ring = (radius / 0.5 * RINGS).long().clamp(max=RINGS)  # the corners beyond the last ring are left out
    rings = torch.stack([power[:, ring == k].mean(dim=1) for k in range(RINGS)], dim=1)  # (B, 16)

    dy, dx = torch.gradient(grey, dim=(1, 2))
    strength = (dx.square() + dy.square()).sqrt()
    direction = ((torch.atan2(dy, dx) / torch.pi + 1) * DIRECTIONS / 2 + 0.5).long() % DIRECTIONS
    cell = (torch.arange(S) * CELLS // S)[:, None] * CELLS + torch.arange(S) * CELLS // S  # (S, S)
    place = (cell * DIRECTIONS + direction).flatten(1)  # (B, S*S)
    edges = (
        torch.zeros(B, CELLS * CELLS * DIRECTIONS)
        .scatter_add_(1, place, strength.flatten(1))
        .view(B, CELLS * CELLS, DIRECTIONS)
    )
    edges = edges / edges.sum(dim=2, keepdim=True).clamp(min=1e-6)
    return torch.cat([tones.flatten(1), (rings + 1e-6).log(), edges.flatten(1)], dim=1).numpy()


@torch.inference_mode()
def backbone_features(backbone: nn.Module, images: Tensor, batch: int = 64) -> np.ndarray:
    """Feature maps of a backbone, averaged over the picture: images (B, 3, S, S) -> (B, C)."""
    was_training = backbone.training
    backbone.eval()
    try:
        return torch.cat([backbone(part).mean(dim=(2, 3)) for part in images.split(batch)]).numpy()
    finally:
        backbone.train(was_training)


def frechet(a: np.ndarray, b: np.ndarray) -> float:
    """Fréchet distance of two normal distributions fitted to (n, D) and (m, D): |mean difference|² + tr(A + B - 2 (A B)^½) (Heusel et al. 2017).

    Few pictures make it larger; compare only sets of the same size.
    """
    A, B = (np.cov(x, rowvar=False) for x in (a, b))
    # tr (A B)^1/2 is the sum of the roots of the eigenvalues of A B, which are those of the symmetric A^1/2 B A^1/2
    values, vectors = np.linalg.eigh(A)
    root = (vectors * np.sqrt(np.clip(values, 0, None))) @ vectors.T
    cross = np.sqrt(np.clip(np.linalg.eigvalsh(root @ B @ root), 0, None)).sum()
    return float(np.square(a.mean(axis=0) - b.mean(axis=0)).sum() + np.trace(A) + np.trace(B) - 2 * cross)


def kernel_mmd(a: np.ndarray, b: np.ndarray) -> float:
    """Squared maximum mean discrepancy, unbiased: around 0 for two sets of one kind, at most 2 (Gretton et al., JMLR 2012, eq. 3).

    The kernel is Gaussian, as wide as the median distance between two pictures of `a`: distances from one set `a` to several can be compared.
    """
    within_a, within_b, across = (cdist(x, y, "sqeuclidean") for x, y in ((a, a), (b, b), (a, b)))
    width = np.median(within_a[np.triu_indices(len(a), 1)])
    mean = lambda squared: (
        (np.exp(-squared / (2 * width)).sum() - len(squared)) / (len(squared) * (len(squared) - 1))
    )  # noqa: E731
    return float(mean(within_a) + mean(within_b) - 2 * np.exp(-across / (2 * width)).mean())


def held_out_scores(
    a: np.ndarray, b: np.ndarray, groups_a: np.ndarray, groups_b: np.ndarray, folds: int = 5
) -> tuple[np.ndarray, np.ndarray]:
    """What a linear classifier, trained on other groups, says of every picture: two sets of features -> (n,) and (m,), high: of the second set.

    Raises:
        InputError: fewer groups than folds in one of the sets.
    """
    if min(len(set(groups_a)), len(set(groups_b))) < folds:
        raise InputError(
            f"a classifier tested in {folds} folds needs as many groups (videos, flights) in each set"
        )
    x, y = np.concatenate([a, b]), np.r_[np.zeros(len(a)), np.ones(len(b))]
    scores = np.empty(len(x))
    parts = [GroupKFold(folds).split(x, groups=g) for x, g in ((a, groups_a), (b, groups_b))]
    for (train_a, test_a), (train_b, test_b) in zip(*parts, strict=True):
        train, test = np.r_[train_a, len(a) + train_b], np.r_[test_a, len(a) + test_b]
        model = make_pipeline(
            StandardScaler(), LogisticRegression(C=0.1, max_iter=2000, class_weight="balanced")
        ).fit(x[train], y[train])
        scores[test] = model.decision_function(x[test])
    return scores[: len(a)], scores[len(a) :]


def auc(scores_a: np.ndarray, scores_b: np.ndarray) -> float:
    """Area under the ROC curve: the chance that a picture of the second set scores higher. 0.5: the sets cannot be told apart, 1: always."""
    return float(
        roc_auc_score(np.r_[np.zeros(len(scores_a)), np.ones(len(scores_b))], np.r_[scores_a, scores_b])
    )


def covered(real: np.ndarray, made: np.ndarray) -> np.ndarray:
    """Whether each real picture has a made one no farther than its own 5th real neighbour, (n,) bool.

    The mean is the coverage of Naeem et al. (ICML 2020).
    """
    reach = (
        NearestNeighbors(n_neighbors=NEIGHBOURS + 1).fit(real).kneighbors(real)[0][:, -1]
    )  # the first neighbour is itself
    return NearestNeighbors(n_neighbors=1).fit(made).kneighbors(real)[0][:, 0] <= reach


def interval(
    measure: Callable[..., float],
    sets: list[np.ndarray],
    groups: list[np.ndarray],
    paired: tuple[int, ...] = (),
) -> list[float]:
    """95 % interval [low, high] of measure(*sets) by the jackknife: each group left out in turn, in each set by itself (Efron & Stein 1981).

    Sets whose places are in `paired` show the same groups (the same flights before another background): a group is left out of all of them at
    once. A bootstrap would draw pictures twice, and to a distance between sets a picture and its double are neighbours that nature does not have.
    """
    families = [[i] for i in range(len(sets)) if i not in paired] + [list(paired)] * bool(paired)
    value, variance = measure(*sets), 0.0
    for family in families:
        names = np.unique(np.concatenate([groups[i] for i in family]))
        found = [
            measure(*(x[groups[i] != name] if i in family else x for i, x in enumerate(sets)))
            for name in names
        ]
        variance += (len(names) - 1) * float(np.var(found))
    return [value - 1.96 * variance**0.5, value + 1.96 * variance**0.5]
