"""How far is one set of pictures from another? Features of crops, and four distances between two sets of features (the paper's Fig. 6, with numbers).

A set is a matrix of features (n, D), a row a picture, with a group a row: the video or flight it was cut from. Pictures of one group resemble each
other, so a group is never split: not between the halves of a classifier's test, and not by the bootstrap.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold
from sklearn.neighbors import NearestNeighbors
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from torch import Tensor, nn

from .errors import InputError

RINGS, CELLS, DIRECTIONS, TONES = 16, 4, 8, 8  # of `descriptor`
NEIGHBOURS = 5  # of `coverage`


@torch.inference_mode()
def descriptor(images: Tensor) -> np.ndarray:
    """What a picture looks like, without any training: images (B, 3, S, S) RGB in [0, 1] -> (B, 168).

    Three parts. Tones: a histogram of each colour channel (3 x 8 shares). Sharpness: the log of the power spectrum of the grey picture in 16 rings
    of rising frequency, where noise, blur and compression leave their marks. Edges: in 4 x 4 cells, the shares of 8 directions of the gradient
    (after Dalal & Triggs, CVPR 2005).
    """
    B, _, S, _ = images.shape
    level = (images.clamp(0, 1 - 1e-6) * TONES).long().flatten(2)  # (B, 3, S*S)
    tones = torch.zeros(B, 3, TONES).scatter_add_(2, level, torch.ones_like(level, dtype=torch.float32)) / (S * S)

    grey = images.mean(dim=1)  # (B, S, S)
    window = torch.hann_window(S, periodic=False)
    power = torch.fft.fft2((grey - grey.mean(dim=(1, 2), keepdim=True)) * window[:, None] * window).abs().square()  # (B, S, S)
    frequency = torch.fft.fftfreq(S)
    radius = (frequency[:, None].square() + frequency.square()).sqrt()
    ring = (radius / 0.5 * RINGS).long().clamp(max=RINGS)  # the corners beyond the last ring are left out
    rings = torch.stack([power[:, ring == k].mean(dim=1) for k in range(RINGS)], dim=1)  # (B, 16)

    dy, dx = torch.gradient(grey, dim=(1, 2))
    strength = (dx.square() + dy.square()).sqrt()
    direction = ((torch.atan2(dy, dx) / torch.pi + 1) * DIRECTIONS / 2 + 0.5).long() % DIRECTIONS
    cell = (torch.arange(S) * CELLS // S)[:, None] * CELLS + torch.arange(S) * CELLS // S  # (S, S)
    place = (cell * DIRECTIONS + direction).flatten(1)  # (B, S*S)
    edges = torch.zeros(B, CELLS * CELLS * DIRECTIONS).scatter_add_(1, place, strength.flatten(1)).view(B, CELLS * CELLS, DIRECTIONS)
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
    """Squared maximum mean discrepancy with the kernel (x·y / D + 1)³, unbiased (Bińkowski et al. 2018): around 0 for two sets of one kind."""
    kernel = lambda x, y: (x @ y.T / x.shape[1] + 1) ** 3  # noqa: E731
    within = [(kernel(x, x).sum() - np.trace(kernel(x, x))) / (len(x) * (len(x) - 1)) for x in (a, b)]
    return float(sum(within) - 2 * kernel(a, b).mean())


def classifier_auc(a: np.ndarray, b: np.ndarray, groups_a: np.ndarray, groups_b: np.ndarray, folds: int = 5) -> float:
    """How well a linear classifier tells the sets apart on groups it has not seen: area under the ROC curve, 0.5 not at all, 1 always.

    Raises:
        InputError: fewer groups than folds in one of the sets.
    """
    if min(len(set(groups_a)), len(set(groups_b))) < folds:
        raise InputError(f"a classifier tested in {folds} folds needs as many groups (videos, flights) in each set")
    scores, y = [], np.r_[np.zeros(len(a)), np.ones(len(b))]
    parts = [GroupKFold(folds).split(x, groups=g) for x, g in ((a, groups_a), (b, groups_b))]
    x = np.concatenate([a, b])
    for (train_a, test_a), (train_b, test_b) in zip(*parts, strict=True):
        train, test = np.r_[train_a, len(a) + train_b], np.r_[test_a, len(a) + test_b]
        model = make_pipeline(StandardScaler(), LogisticRegression(C=0.1, max_iter=2000)).fit(x[train], y[train])
        scores.append(roc_auc_score(y[test], model.decision_function(x[test])))
    return float(np.mean(scores))


def coverage(real: np.ndarray, made: np.ndarray) -> float:
    """Share of the real pictures that have a made one no farther than their own 5th real neighbour (Naeem et al., ICML 2020)."""
    reach = NearestNeighbors(n_neighbors=NEIGHBOURS + 1).fit(real).kneighbors(real)[0][:, -1]  # the first neighbour is itself
    nearest = NearestNeighbors(n_neighbors=1).fit(made).kneighbors(real)[0][:, 0]
    return float((nearest <= reach).mean())


def interval(measure: Callable[..., float], sets: list[np.ndarray], groups: list[np.ndarray], draws: int = 200, seed: int = 0) -> list[float]:
    """95 % bootstrap interval [low, high] of measure(*sets): whole groups are drawn with replacement, in each set by itself."""
    rng, found = np.random.default_rng(seed), []
    members = [[np.flatnonzero(g == one) for one in np.unique(g)] for g in groups]
    for _ in range(draws):
        chosen = [np.concatenate([rows[i] for i in rng.integers(len(rows), size=len(rows))]) for rows in members]
        found.append(measure(*(x[rows] for x, rows in zip(sets, chosen, strict=True))))
    return [float(v) for v in np.percentile(found, [2.5, 97.5])]
