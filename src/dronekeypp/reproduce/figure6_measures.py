"""Measure how far made pictures are from real ones by their features, and make maps (Figure 6)."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist
from sklearn.decomposition import PCA
from sklearn.manifold import TSNE
from sklearn.preprocessing import StandardScaler

from dronekeypp.realism import auc, covered, frechet, held_out_scores, interval, kernel_mmd
from dronekeypp.reproduce.figure6_sets import SETS, Features

COMPONENTS = 32  # principal components the distances are measured in
NEIGHBOURS = 10  # of `purity`
MEASURES = {
    "frechet": "Fréchet distance",
    "mmd": "MMD²",
    "auc": "AUC of a linear classifier",
    "coverage": "coverage of the real frames",
}
KINDS = {
    "descriptor": "training-free descriptor",
    "backbone": "our backbone",
    "imagenet": "ResNet-18 of ImageNet",
}
MAPS = ((30, 0), (30, 1), (10, 0), (100, 0))  # t-SNE: perplexity, seed; the first is drawn
# The two measures whose change from one set to another is given, see `gains`.
DISTANCES: dict[str, Callable[[np.ndarray, np.ndarray], float]] = {"frechet": frechet, "mmd": kernel_mmd}

# --- what there is ----------------------------------------------------------------------------------------


def kinds_of(arrays: Features) -> list[str]:
    """Return the kinds of features that have been recorded."""
    return [kind for kind in KINDS if f"real/{kind}" in arrays]


def sets_of(arrays: Features) -> list[str]:
    """Return the names of the sets and their versions, real first."""
    return [key.removesuffix("/groups") for key in arrays if key.endswith("/groups")]


def components(arrays: Features, kind: str) -> tuple[dict[str, np.ndarray], float]:
    """Return every set in the first COMPONENTS principal components of the standardised features.

    Scaler and components are fitted to the four sets as they are (the paper's StandardScaler and PCA).

    Returns:
        {set: (n, COMPONENTS)}, and the share of the variance that the components hold.
    """
    features = {name: arrays[f"{name}/{kind}"].astype(np.float64) for name in sets_of(arrays)}
    fitted = np.concatenate([features[name] for name in SETS if name in features])
    scaler = StandardScaler().fit(fitted)
    pca = PCA(min(COMPONENTS, *fitted.shape), random_state=0).fit(scaler.transform(fitted))
    transformed = {name: pca.transform(scaler.transform(x)) for name, x in features.items()}
    return transformed, float(pca.explained_variance_ratio_.sum())


# --- distances --------------------------------------------------------------------------------------------


def distances(x: dict[str, np.ndarray], arrays: Features) -> Iterator[dict[str, Any]]:
    """Measure every set against the real one in four ways, with intervals.

    For the real set itself, see `among_themselves`. `x` are the sets as `components` returns them.
    """
    real, groups = x["real"], arrays["real/groups"]
    yield among_themselves(real, groups)
    for name, made in x.items():
        if name != "real":
            yield {
                "set": name,
                "pictures": len(made),
                **against(real, made, groups, arrays[f"{name}/groups"]),
            }


def against(
    real: np.ndarray, made: np.ndarray, real_groups: np.ndarray, made_groups: np.ndarray
) -> dict[str, Any]:
    """Return the four measures of one made set, each with its interval KEY_ci95."""
    both, groups = [real, made], [real_groups, made_groups]
    scores = list(held_out_scores(real, made, real_groups, made_groups))
    near = covered(real, made).astype(float)
    low, high = interval(auc, scores, groups)
    auc_interval = [max(low, 0.0), min(high, 1.0)]
    low, high = interval(_share, [near], [real_groups])
    return {
        "frechet": frechet(real, made),
        "frechet_ci95": interval(frechet, both, groups),
        "mmd": kernel_mmd(real, made),
        "mmd_ci95": interval(kernel_mmd, both, groups),
        "auc": auc(*scores),
        "auc_ci95": auc_interval,
        "coverage": _share(near),
        "coverage_ci95": [max(low, 0.0), min(high, 1.0)],
    }


def _share(values: np.ndarray) -> float:
    return float(values.mean())


def among_themselves(real: np.ndarray, groups: np.ndarray, splits: int = 40) -> dict[str, Any]:
    """Return the four measures between a random half of the real videos and the other half.

    No distance can be expected to fall below them. Each is the mean over `splits`, and its interval says
    where the middle 95 % of them lie.
    """
    rng, measured = np.random.default_rng(0), []
    for _ in range(splits):
        half = np.isin(groups, rng.permutation(np.unique(groups))[::2])
        first, second = real[half], real[~half]
        scores = held_out_scores(first, second, groups[half], groups[~half])
        near = float(covered(first, second).mean())
        measured.append((frechet(first, second), kernel_mmd(first, second), auc(*scores), near))
    row: dict[str, Any] = {"set": "real", "pictures": len(real) // 2}
    for key, values in zip(MEASURES, np.transpose(measured), strict=True):
        row[key] = float(values.mean())
        row[f"{key}_ci95"] = np.percentile(values, [2.5, 97.5]).tolist()
    return row


def pairs_of(arrays: Features) -> list[tuple[str, str]]:
    """Return the pairs of sets whose change is measured.

    They are each made set and the next, the first and the last, and each made set and its versions.
    """
    present = sets_of(arrays)
    made = [name for name in SETS if name in present and name != "real"]
    pairs = [(made[i], made[i + 1]) for i in range(len(made) - 1)]
    pairs.append((made[0], made[-1]))
    for name in made:
        pairs += [(name, f"{name} small"), (name, f"{name} degraded")]
    return pairs


def gains(
    x: dict[str, np.ndarray], arrays: Features, pairs: list[tuple[str, str]]
) -> Iterator[dict[str, Any]]:
    """Measure how much nearer to the real frames the second set of each pair is than the first.

    It is the difference of two distances, with its interval.
    """
    for before, after in pairs:
        for key, distance in DISTANCES.items():
            change = functools.partial(change_of, distance)
            names = ("real", before, after)
            parts = [x[name] for name in names]
            groups = [arrays[f"{name}/groups"] for name in names]
            yield {
                "before": before,
                "after": after,
                "measure": key,
                "difference": change(*parts),
                "difference_ci95": interval(change, parts, groups, paired=(1, 2)),  # the same flights
            }


def change_of(
    distance: Callable[[np.ndarray, np.ndarray], float],
    real: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
) -> float:
    """Return by how much `after` is farther from the real set than `before`."""
    return distance(real, after) - distance(real, before)


# --- maps -------------------------------------------------------------------------------------------------


def tsne(x: dict[str, np.ndarray], perplexity: float, seed: int) -> np.ndarray:
    """Put every picture of the sets as made on a plane, (sum of n, 2), in the order of SETS.

    This is t-SNE (van der Maaten & Hinton 2008).
    """
    points = np.concatenate([x[name] for name in SETS if name in x])
    most = (len(points) - 1) / 3
    return TSNE(perplexity=min(perplexity, most), random_state=seed, init="random").fit_transform(points)


def tsne_name(perplexity: float, seed: int) -> str:
    """Return the name of one of MAPS."""
    return f"t-SNE, perplexity {perplexity}, seed {seed}"


def labels_of(x: dict[str, np.ndarray]) -> np.ndarray:
    """Return the set of each row of `tsne`."""
    return np.concatenate([[name] * len(x[name]) for name in SETS if name in x])


def flights_of(arrays: Features) -> np.ndarray:
    """Return the video or flight of each row of `tsne`.

    A flight has the same number with every background. A video has a number of its own.
    """
    numbers = []
    for name in SETS:
        if f"{name}/groups" in arrays:
            groups = arrays[f"{name}/groups"]
            numbers.append(-1 - groups if name == "real" else groups)
    return np.concatenate(numbers)


def purity(points: np.ndarray, labels: np.ndarray, flights: np.ndarray) -> dict[str, float]:
    """Return, by label, the share of a picture's 10 nearest neighbours that have its label.

    Neighbours come from other videos and flights only.

    Args:
        points: (n, D) places.
        labels: (n,) their labels.
        flights: (n,) the video or flight of each.
    """
    apart = cdist(points, points, "sqeuclidean")
    apart[flights[:, None] == flights] = np.inf
    neighbours = np.argpartition(apart, NEIGHBOURS, axis=1)[:, :NEIGHBOURS]
    same = (labels[neighbours] == labels[:, None]).mean(axis=1)
    return {name: float(same[labels == name].mean()) for name in dict.fromkeys(labels.tolist())}


def centre_order(points: np.ndarray, labels: np.ndarray) -> list[str]:
    """Sort the made sets by the distance of their centre from the real ones' centre, nearest first.

    This is what an eye reads off a scatter plot.
    """
    centres = {name: points[labels == name].mean(axis=0) for name in dict.fromkeys(labels)}
    real = centres.pop("real")
    return sorted(centres, key=lambda name: float(np.linalg.norm(centres[name] - real)))
