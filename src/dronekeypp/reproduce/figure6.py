"""Figure 6: real drone frames, older-style synthetic ones, and ours before drawn and before photographed places.

The paper reads realism off two scatter plots. Here they stand beside four distances to the real frames, each with an interval.

With `--real DIR` everything is measured from pictures; without it, from the features an earlier call recorded in
data_samples/results/figure6_features.npz (numbers: no picture can be made from them). ImageNet features join in where torchvision has once
downloaded the weights of its ResNet-18.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import matplotlib.pyplot as plt
import numpy as np
import torch
import torchvision
from scipy.spatial.distance import cdist
from sklearn.decomposition import PCA
from sklearn.manifold import TSNE
from sklearn.preprocessing import StandardScaler

from dronekeypp import plots
from dronekeypp.baselines import load_network
from dronekeypp.camera import clamp_square, crop_image, square_around
from dronekeypp.errors import InputError
from dronekeypp.evaluate import MEASURES as ERRORS
from dronekeypp.evaluate import frame_errors, json_values
from dronekeypp.files import write_beside
from dronekeypp.footage import read_picture
from dronekeypp.model import Backbone, DroneKeyPP, ModelConfig
from dronekeypp.predict import mirror_doubt
from dronekeypp.realism import (
    auc,
    backbone_features,
    covered,
    descriptor,
    frechet,
    held_out_scores,
    interval,
    kernel_mmd,
)
from dronekeypp.reproduce import ablations
from dronekeypp.reproduce.runner import Bench, describe, read_result, result, say, write_npz, write_result
from dronekeypp.reproduce.tables import number, write_figure
from dronekeypp.sixdronesyn.bop import read_json
from dronekeypp.sixdronesyn.dataset import SixDroneSyn, degrade
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.scenes import SCENES, count_frames
from dronekeypp.train import BEST

FEATURES = "data_samples/results/figure6_features.npz"  # below the root
PICTURES = 500  # of a made set, evenly spaced over the test flights
TEST = [number for number, scene in SCENES.items() if scene.split == "test"]
COMPONENTS = 32  # principal components the distances are measured in
NEIGHBOURS = 10  # of `purity`
# Set: label, colour, marker. Blue, red and green are the paper's; told apart by the marker too.
SETS = {
    "real": ("real frames", "#0072B2", "o"),
    "plain": ("ours, plain backgrounds", "#D55E00", "^"),
    "drawn": ("ours, drawn places", "#009E73", "s"),
    "photographs": ("ours, photographed places", "#CC79A7", "D"),
}
# A made set once more, with the same drones and places: as small as the real ones, and as a small, compressed video shows them.
VERSIONS = {"": "as made", " small": "as small as real ones", " degraded": "small, noisy, compressed"}
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


@dataclass(frozen=True)
class Pictures:
    """Crops (n, S, S, 3) uint8 RGB, the video or flight (n,) each was cut from, their squares (n, 3) and the drones' boxes (n, 4), frame pixels.

    truth: annotations of made ones, stacked.
    """

    images: np.ndarray
    groups: np.ndarray
    squares: np.ndarray
    boxes: np.ndarray
    truth: dict[str, torch.Tensor] | None = None

    @property
    def tensor(self) -> torch.Tensor:
        return torch.from_numpy(self.images).permute(0, 3, 1, 2).float() / 255


def real_pictures(folder: Path, size: int) -> Pictures:
    """The crops that FOLDER/boxes.csv names: columns file, video, and a box x, y, w, h in pixels (or tight_x, …), one drone a row.

    Raises:
        InputError: no such file, a column or an image missing, a box that is none.
    """
    path = folder / "boxes.csv"
    if not path.is_file():
        raise InputError(
            f"{path} not found: real frames need a table with the columns file, video, x, y, w, h"
        )
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    columns = set(rows[0]) if rows else set()
    prefix = "tight_" if "tight_x" in columns else ""
    missing = {"file", "video", *(prefix + key for key in "xywh")} - columns
    if missing:
        why = "; frames of one video are alike, so it has to be known" if "video" in missing else ""
        raise InputError(f"{path}: column {'video' if why else min(missing)!r} is missing{why}")
    images, squares, boxes = [], [], []
    for line, row in enumerate(rows, start=2):
        try:
            box = [float(row[prefix + key]) for key in "xywh"]
        except (TypeError, ValueError):
            raise InputError(f"{path}, line {line}: the box is not four numbers") from None
        image = read_picture(folder / row["file"])
        if image is None:
            raise InputError(f"{path}, line {line}: {folder / row['file']} is missing or no picture")
        square = clamp_square(square_around(box), image.shape[1], image.shape[0])
        images.append(crop_image(image, square, size))
        squares.append(square)
        boxes.append(box)
    groups = np.unique([row["video"] for row in rows], return_inverse=True)[1]
    return Pictures(np.stack(images), groups, np.stack(squares), np.array(boxes))


def made_pictures(data: Path, size: int) -> Pictures:
    """PICTURES crops of the test flights, evenly spaced."""
    dataset = SixDroneSyn(data, "test", size=size)
    chosen = np.linspace(0, len(dataset) - 1, min(PICTURES, len(dataset))).round().astype(int)
    items = [dataset[i] for i in chosen]
    images = [(item["image"].permute(1, 2, 0).numpy() * 255).round().astype(np.uint8) for item in items]
    flights, squares = (
        np.array([int(item["subsequence"]) for item in items]),
        np.stack([item["square"].numpy() for item in items]),
    )
    truth = torch.utils.data.default_collate(
        [{name: value for name, value in item.items() if name != "image"} for item in items]
    )
    return Pictures(
        np.stack(images), flights, squares, np.stack([dataset.frames[i].box for i in chosen]), truth
    )


def as_small(pictures: Pictures, sides: np.ndarray) -> Pictures:
    """Each crop at the resolution of a real one drawn at random: shrunk to that many pixels, and enlarged again."""
    size, rng = pictures.images.shape[1], np.random.default_rng(0)
    drawn = rng.choice(sides, len(pictures.images)).round().astype(int).clip(4, size)
    shrunk = [
        cv2.resize(image, (s, s), interpolation=cv2.INTER_AREA)
        for image, s in zip(pictures.images, drawn, strict=True)
    ]
    return replace(
        pictures,
        images=np.stack(
            [cv2.resize(image, (size, size), interpolation=cv2.INTER_LINEAR) for image in shrunk]
        ),
    )


def as_video(pictures: Pictures) -> Pictures:
    """Each crop as `dataset.degrade` shows it."""
    return replace(
        pictures,
        images=np.stack(
            [degrade(image, np.random.default_rng([0, i])) for i, image in enumerate(pictures.images)]
        ),
    )


def paint_plain(folder: Path) -> Path:
    """22 panoramas of one colour above the horizon and one below: the virtual backgrounds of older synthetic data. Returns `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(22):
        above, below = np.random.default_rng([0, i]).uniform([[120] * 3, [50] * 3], [[240] * 3, [160] * 3])
        image = np.where(np.arange(256)[:, None, None] < 128, above, below) * np.ones((1, 512, 1))
        cv2.imwrite(
            str(folder / f"plain_{i:02d}.png"), cv2.GaussianBlur(image.round().astype(np.uint8), (0, 0), 2)
        )
    return folder


def rendered(bench: Bench, name: str, environments: Path | None) -> Path:
    """The folder of a made set, its test flights rendered if they are not there."""
    folder = bench.data if name == "drawn" else bench.data.with_name(f"{bench.data.name}-{name}")
    there = read_json(folder / "manifest.json") if (folder / "manifest.json").is_file() else {}
    stride = there.get("settings", {}).get(
        "stride", max(bench.stride, 10) if name == "plain" else bench.stride
    )  # plain: just enough
    if there.get("frames", {}).get("test", 0) < count_frames(TEST, stride=stride):
        say(f"rendering into {folder}", bench.progress)
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


def from_pictures(bench: Bench, real: Path) -> tuple[dict[str, np.ndarray], list[dict], dict[str, Any]]:
    """Features of every set and version ("drawn small/backbone"), their groups; what networks answer; what the made sets are."""
    shipped = load_network(Path(__file__).parents[3] / "data_samples" / "checkpoint")
    assert isinstance(shipped, DroneKeyPP)
    size = shipped.config.image_size
    extract: dict[str, Callable[[torch.Tensor], np.ndarray]] = {
        "descriptor": descriptor,
        "backbone": lambda images: backbone_features(shipped.backbone, images),
    }
    if (
        Path(torch.hub.get_dir())
        / "checkpoints"
        / Path(torchvision.models.ResNet18_Weights.IMAGENET1K_V1.url).name
    ).is_file():
        imagenet = Backbone(ModelConfig(backbone="resnet18", backbone_weights="imagenet"))
        extract["imagenet"] = lambda images: backbone_features(imagenet, images)
    sets, datasets = {"real": real_pictures(real, size)}, {}
    sources = {
        "plain": paint_plain(bench.root / "data" / "plain"),
        "drawn": bench.environments,
        "photographs": bench.photographs,
    }
    for name, environments in sources.items():
        if name == "photographs" and environments is None:
            continue
        folder = rendered(bench, name, environments)
        sets[name], datasets[name] = made_pictures(folder, size), describe(folder)
        sets[f"{name} small"], sets[f"{name} degraded"] = (
            as_small(sets[name], sets["real"].squares[:, 2]),
            as_video(sets[name]),
        )
    arrays = {f"{name}/groups": pictures.groups.astype(np.int32) for name, pictures in sets.items()}
    for name, pictures in sets.items():
        arrays |= {f"{name}/{kind}": of(pictures.tensor).astype(np.float16) for kind, of in extract.items()}
    networks = {"shipped": shipped}
    for row in ablations.ABLATIONS[
        "degraded"
    ].rows:  # before and after, if `reproduce degraded` has trained them
        best = bench.folder(ablations.run_of(row, bench.preset), 0) / BEST
        if best.is_dir():
            networks[row.name] = load_network(best)
    answers = [
        {"network": who, "set": name, **answer(network, sets[name])}
        for who, network in networks.items()
        for name in sets
    ]
    return arrays, answers, datasets


@torch.inference_mode()
def answer(network: DroneKeyPP, pictures: Pictures) -> dict[str, Any]:
    """What can be asked of a network without the truth.

    How far its keypoints move when the crop is mirrored (`predict.mirror_doubt`, pixels of the crop: the median of each video, their mean with
    an interval); the share of them inside the box, a tenth of its longer side around it included; the median probability of the class it
    names; how often it names which drone. And where the truth is known, the median errors.
    """
    network.eval()
    size, doubt, parts = pictures.images.shape[1], [], []
    K = torch.tensor([[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]]).expand(len(pictures.images), 3, 3)
    if (
        pictures.truth is not None
    ):  # otherwise any camera will do: keypoints and class come from the picture alone
        K = pictures.truth["K"]
    for inputs in zip(
        *(v.split(64) for v in (pictures.tensor, K, torch.from_numpy(pictures.squares).float())), strict=True
    ):
        found = network(*inputs)
        doubt.append(size * mirror_doubt(network, *inputs, found["keypoints"]))
        parts.append({name: found[name] for name in ("keypoints", "keypoints_px", "class_probs", "R", "t")})
    output = {name: torch.cat([part[name] for part in parts]) for name in parts[0]}
    values, (share, named) = torch.cat(doubt).numpy(), output["class_probs"].max(dim=1)
    low = pictures.boxes[:, None, :2] - 0.1 * pictures.boxes[:, 2:].max(axis=1)[:, None, None]
    high = (
        2 * pictures.boxes[:, None, :2] + pictures.boxes[:, None, 2:] - low
    )  # as far beyond the other corner
    points = output["keypoints_px"].numpy()
    videos = np.unique(pictures.groups)
    medians = np.array([np.median(values[pictures.groups == video]) for video in videos])
    mean = lambda v: float(v.mean())  # noqa: E731
    answers = {
        "doubt_px": mean(medians), "doubt_px_ci95": interval(mean, [medians], [videos]), "doubt_px_by_video": medians.round(2).tolist(),
        "inside": float(((points >= low) & (points <= high)).all(axis=-1).mean()), "class_probability": float(share.median()),
        "named": {drone: int((named == k).sum()) for k, drone in enumerate(DRONES)},
    }  # fmt: skip
    if pictures.truth is not None:
        errors = frame_errors(output, {**pictures.truth, "image": pictures.tensor[:1]})
        answers |= {key: ERRORS[key](errors) for key in ("R_medae_deg", "t_medae_m", "class_accuracy")}
    return json_values(answers)


# --- from features on ------------------------------------------------------------------------------------------------------------------


def kinds_of(arrays: dict[str, np.ndarray]) -> list[str]:
    return [kind for kind in KINDS if f"real/{kind}" in arrays]


def sets_of(arrays: dict[str, np.ndarray]) -> list[str]:
    """Names of the sets and their versions, real first."""
    return [key.removesuffix("/groups") for key in arrays if key.endswith("/groups")]


def components(arrays: dict[str, np.ndarray], kind: str) -> tuple[dict[str, np.ndarray], float]:
    """Every set in the first COMPONENTS principal components of the standardised features, and the share of the variance they hold.

    Scaler and components are fitted to the four sets as they are (the paper's StandardScaler and PCA).
    """
    features = {name: arrays[f"{name}/{kind}"].astype(np.float64) for name in sets_of(arrays)}
    fitted = np.concatenate([features[name] for name in SETS if name in features])
    scaler = StandardScaler().fit(fitted)
    pca = PCA(min(COMPONENTS, *fitted.shape), random_state=0).fit(scaler.transform(fitted))
    return {name: pca.transform(scaler.transform(x)) for name, x in features.items()}, float(
        pca.explained_variance_ratio_.sum()
    )


def distances(x: dict[str, np.ndarray], arrays: dict[str, np.ndarray]) -> Iterator[dict[str, Any]]:
    """The four measures of every set against the real one, with their intervals; of the real one, see `among_themselves`."""
    real, groups = x["real"], arrays["real/groups"]
    yield among_themselves(real, groups)
    for name, theirs in x.items():
        if name == "real":
            continue
        mine, of = real, [groups, arrays[f"{name}/groups"]]
        scores, cover = held_out_scores(mine, theirs, *of), covered(mine, theirs).astype(float)
        share = lambda v: float(v.mean())  # noqa: E731
        row: dict[str, Any] = {"set": name, "pictures": len(theirs)}
        for key, measure, parts, by in (
            ("frechet", frechet, [mine, theirs], of), ("mmd", kernel_mmd, [mine, theirs], of), ("auc", auc, list(scores), of),
            ("coverage", share, [cover], of[:1]),
        ):  # fmt: skip
            low, high = interval(measure, parts, by)
            row |= {
                key: measure(*parts),
                f"{key}_ci95": [max(low, 0.0), min(high, 1.0)] if key in ("auc", "coverage") else [low, high],
            }
        yield row


def among_themselves(real: np.ndarray, groups: np.ndarray, splits: int = 40) -> dict[str, Any]:
    """The four measures between a random half of the real videos and the other half: what no distance can be expected to fall below.

    The mean over `splits` of them, and where the middle 95 % of them lie.
    """
    draw, found = np.random.default_rng(0), []
    for _ in range(splits):
        half = np.isin(groups, draw.permutation(np.unique(groups))[::2])
        one, other, of = real[half], real[~half], (groups[half], groups[~half])
        found.append(
            (
                frechet(one, other),
                kernel_mmd(one, other),
                auc(*held_out_scores(one, other, *of)),
                float(covered(one, other).mean()),
            )
        )
    row: dict[str, Any] = {"set": "real", "pictures": len(real) // 2}
    for key, values in zip(MEASURES, np.transpose(found), strict=True):
        row |= {key: float(values.mean()), f"{key}_ci95": np.percentile(values, [2.5, 97.5]).tolist()}
    return row


def gains(
    x: dict[str, np.ndarray], arrays: dict[str, np.ndarray], pairs: list[tuple[str, str]]
) -> Iterator[dict[str, Any]]:
    """How much nearer to the real frames the second set of each pair is than the first: the difference of two distances, with its interval."""
    for before, after in pairs:
        for key, measure in (("frechet", frechet), ("mmd", kernel_mmd)):
            apart = lambda real, a, b, measure=measure: measure(real, b) - measure(real, a)  # noqa: E731
            names = ("real", before, after)
            parts, by = [x[name] for name in names], [arrays[f"{name}/groups"] for name in names]
            low_high = interval(apart, parts, by, paired=(1, 2))  # the same flights
            yield {
                "before": before,
                "after": after,
                "measure": key,
                "difference": apart(*parts),
                "difference_ci95": low_high,
            }


def tsne(x: dict[str, np.ndarray], perplexity: float, seed: int) -> np.ndarray:
    """Every picture of the sets as made on a plane, (sum of n, 2), in the order of SETS (van der Maaten & Hinton 2008)."""
    points = np.concatenate([x[name] for name in SETS if name in x])
    return TSNE(
        perplexity=min(perplexity, (len(points) - 1) / 3), random_state=seed, init="random"
    ).fit_transform(points)


def tsne_name(perplexity: float, seed: int) -> str:
    return f"t-SNE, perplexity {perplexity}, seed {seed}"


def labels_of(x: dict[str, np.ndarray]) -> np.ndarray:
    """The set of each row of `tsne`."""
    return np.concatenate([[name] * len(x[name]) for name in SETS if name in x])


def flights_of(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """The video or flight of each row of `tsne`: a flight has one number before every background, a video one of its own."""
    return np.concatenate(
        [
            arrays[f"{name}/groups"] if name != "real" else -1 - arrays["real/groups"]
            for name in SETS
            if f"{name}/groups" in arrays
        ]
    )


def purity(points: np.ndarray, labels: np.ndarray, flights: np.ndarray) -> dict[str, float]:
    """By label: the share of a picture's 10 nearest neighbours from other videos and flights that are of its own label."""
    apart = cdist(points, points, "sqeuclidean")
    apart[flights[:, None] == flights] = np.inf
    same = (labels[np.argpartition(apart, NEIGHBOURS, axis=1)[:, :NEIGHBOURS]] == labels[:, None]).mean(
        axis=1
    )
    return {name: float(same[labels == name].mean()) for name in dict.fromkeys(labels.tolist())}


def centre_order(points: np.ndarray, labels: np.ndarray) -> list[str]:
    """The made sets by the distance of their centre from the real ones', nearest first: what an eye reads off a scatter plot."""
    centres = {name: points[labels == name].mean(axis=0) for name in dict.fromkeys(labels)}
    real = centres.pop("real")
    return sorted(centres, key=lambda name: float(np.linalg.norm(centres[name] - real)))


def reproduce(bench: Bench) -> dict[str, Any]:
    """Measure the distances, draw the figures, record both (and, from pictures, the features). Returns the recorded result.

    Raises:
        InputError: real frames that cannot be read, or neither pictures nor recorded features.
    """
    if bench.real is not None:
        arrays, answers, datasets = from_pictures(bench, bench.real)
        (bench.root / FEATURES).parent.mkdir(parents=True, exist_ok=True)
        write_npz(bench.root / FEATURES, arrays)
    else:
        earlier = read_result("figure6", bench.root)
        arrays, answers, datasets = read_features(bench.root), earlier["answers"], earlier["datasets"]
    made = [name for name in list(SETS)[1:] if name in sets_of(arrays)]
    pairs = [
        *zip(made, made[1:], strict=False),
        (made[0], made[-1]),
        *((name, name + version) for name in made for version in list(VERSIONS)[1:]),
    ]
    rows, nearer, maps, kept, planes = [], [], [], {}, {}
    for kind in kinds_of(arrays):
        say(f"measuring: {KINDS[kind]}", bench.progress)
        x, kept[kind] = components(arrays, kind)
        rows += [{"features": kind, **row} for row in distances(x, arrays)]
        nearer += [{"features": kind, **row} for row in gains(x, arrays, pairs)]
        labels = labels_of(x)
        together = np.concatenate([x[name] for name in dict.fromkeys(labels)])
        planes[kind] = {"all components": together, "two components": together[:, :2]}
        planes[kind] |= {tsne_name(*one): tsne(x, *one) for one in MAPS}
        for title, points in planes[kind].items():
            maps.append(
                {
                    "features": kind,
                    "map": title,
                    "purity": purity(points, labels, flights_of(arrays)),
                    "order": centre_order(points, labels),
                }
            )
    parts = {
        "datasets": datasets,
        "variance_kept": kept,
        "rows": rows,
        "nearer": nearer,
        "maps": maps,
        "answers": answers,
    }
    recorded = result("figure6", bench, [], dataset=datasets["drawn"], of=len(arrays["real/groups"]), **parts)
    write_result(bench.root, recorded)
    folder = bench.root / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    write_beside(folder / "figure6.md", markdown(recorded).encode())
    write_figure(folder / "figure6.png", draw_maps(planes, labels))
    write_figure(folder / "figure6_distances.png", draw_distances(recorded))
    return recorded


def read_features(root: Path | None = None) -> dict[str, np.ndarray]:
    """The recorded features, from `root` or the repository: "SET/KIND" (n, D) float16 and "SET/groups" (n,)."""
    path = (root or Path(__file__).parents[3]) / FEATURES
    if not path.is_file():
        raise InputError(
            f"{path} not found: make it with `python -m dronekeypp reproduce figure6 --real DIR`"
        )
    with np.load(io.BytesIO(path.read_bytes())) as stored:
        return dict(stored)


def set_label(name: str) -> str:
    """ "drawn small" -> "ours, drawn places: as small as the real ones"."""
    base, _, version = name.partition(" ")
    if base == "real":
        return "real frames among themselves"
    return SETS[base][0] + (f": {VERSIONS[' ' + version]}" if version else "")


def with_interval(row: dict[str, Any], key: str) -> str:
    digits = 1 if key in ("frechet", "doubt_px") else 2
    low, high = row[f"{key}_ci95"]
    return f"{row[key]:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def markdown(recorded: dict[str, Any]) -> str:
    """The distances to the real frames, set by set, and what the changes are worth."""
    lines = [
        "# Figure 6: how far the made pictures are from real ones",
        "",
        f"{recorded['of']} real frames; of every other set up to {PICTURES} crops of the test flights. "
        "95 % intervals by leaving out whole videos and flights.",
    ]
    for kind, kept in recorded["variance_kept"].items():
        rows, nearer = (
            [row for row in recorded[part] if row["features"] == kind] for part in ("rows", "nearer")
        )
        lines += [
            "",
            f"## {KINDS[kind]}",
            "",
            f"{COMPONENTS} principal components hold {100 * kept:.0f} % of the variance.",
            "",
        ]
        lines += ["| set | " + " | ".join(MEASURES.values()) + " |", "|---|" + "---:|" * len(MEASURES)]
        lines += [
            f"| {set_label(row['set'])} | " + " | ".join(with_interval(row, key) for key in MEASURES) + " |"
            for row in rows
        ]
        lines += ["", "| from | to | measure | change |", "|---|---|---|---:|"]
        for row in nearer:
            (low, high), digits = row["difference_ci95"], 1 if row["measure"] == "frechet" else 2
            names = (set_label(row["before"]), set_label(row["after"]), MEASURES[row["measure"]])
            lines.append(
                f"| {' | '.join(names)} | {row['difference']:+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}] |"
            )
    lines += ["", "## What a network answers", ""]
    lines += [
        "Mirror doubt: how far its keypoints move when the crop is mirrored, pixels of a 96 px crop; mean of the videos' medians.",
        "",
    ]
    lines += [
        "| network | set | mirror doubt (px) | class probability, median | R MedAE (deg) | t MedAE (m) |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for row in recorded["answers"]:
        name = "real frames" if row["set"] == "real" else set_label(row["set"])
        errors = [number(row.get(key), digits) for key, digits in (("R_medae_deg", 1), ("t_medae_m", 3))]
        sure = f"{100 * row['class_probability']:.0f} %"
        lines.append(
            f"| {' | '.join([row['network'], name, with_interval(row, 'doubt_px'), sure, *errors])} |"
        )
    return "\n".join(lines) + "\n"


def scatter(ax: plt.Axes, points: np.ndarray, labels: np.ndarray) -> plt.Axes:
    """The sets on a plane, (n, 2), the real ones on top."""
    for name in [*list(SETS)[1:], "real"]:
        if name in labels:
            text, colour, marker = SETS[name]
            chosen = points[labels == name]
            ax.scatter(
                *chosen.T,
                s=9,
                c=colour,
                marker=marker,
                alpha=0.6,
                linewidths=0,
                label=text,
                zorder=3 if name == "real" else 2,
            )
    return ax


def draw_maps(planes: dict[str, dict[str, np.ndarray]], labels: np.ndarray) -> plt.Figure:
    """The paper's two scatter plots, once for each kind of features: {kind: {"two components" or the name of a t-SNE: points (n, 2)}}."""
    plots.style()
    figure, axes = plt.subplots(len(planes), 2, figsize=(9, 3.9 * len(planes)), squeeze=False)
    for line, (kind, maps) in zip(axes, planes.items(), strict=True):
        scatter(line[0], maps["two components"], labels).set(
            title=f"PCA, {KINDS[kind]}", xlabel="first component", ylabel="second component"
        )
        scatter(line[1], maps[tsne_name(*MAPS[0])], labels).set(
            title=f"t-SNE, {KINDS[kind]}", xticks=[], yticks=[]
        )
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, ncols=4, loc="outside lower center", markerscale=2)
    return figure


def draw_distances(recorded: dict[str, Any]) -> plt.Figure:
    """One panel a measure, one line a set (filled: as made), its interval drawn; one row of panels for each kind of features."""
    plots.style()
    kinds = list(dict.fromkeys(row["features"] for row in recorded["rows"]))
    names = list(dict.fromkeys(row["set"] for row in recorded["rows"]))[::-1]
    figure, axes = plt.subplots(
        len(kinds),
        len(MEASURES),
        figsize=(12, 0.7 + 2.8 * len(kinds)),
        sharex="col",
        sharey=True,
        squeeze=False,
    )
    for line, kind in zip(axes, kinds, strict=True):
        for ax, key in zip(line, MEASURES, strict=True):
            for i, name in enumerate(names):
                row = next(r for r in recorded["rows"] if (r["features"], r["set"]) == (kind, name))
                _, colour, marker = SETS[name.partition(" ")[0]]
                ax.plot(row[f"{key}_ci95"], [i, i], color=colour, linewidth=1.5)
                ax.plot(
                    row[key],
                    i,
                    marker,
                    color=colour,
                    markersize=5,
                    markerfacecolor=colour if " " not in name else "white",
                )
            ax.grid(axis="x", alpha=0.3)
        line[0].set_yticks(range(len(names)), [short_label(name) for name in names])
        line[0].set_ylabel(KINDS[kind], fontweight="bold")
        line[2].axvline(0.5, color="grey", linestyle=":", linewidth=1)
    for ax, title in zip(axes[0], MEASURES.values(), strict=True):
        ax.set_title(title)
    axes[0, 2].set_xlim(0.2, 1.03)
    axes[0, 3].set_xlim(-0.04, 1.04)
    return figure


def short_label(name: str) -> str:
    """Of a set or one of its versions, for an axis."""
    base, _, version = name.partition(" ")
    return VERSIONS[" " + version] if version else set_label(base)
