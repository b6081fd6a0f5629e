"""Beyond the paper: its network and the one with the geometry put back, side by side at one budget; and whether the latter's doubt can be trusted.

The geometric network (`pose="geometric"`, see `model/geometry.py`) is measured in parts as well, from the same weights: its direct branch alone,
told the true class, and given true keypoints, with and without the noise that its own keypoints have (what its solver could do at best).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.ticker import LogLocator, NullFormatter
from scipy.stats import chi2
from torch import Tensor
from torch.nn.functional import one_hot
from torch.utils.data import DataLoader, Dataset, Subset

from dronekeypp import plots, rotations
from dronekeypp.camera import mirror_keypoints
from dronekeypp.evaluate import (
    evaluate,
    frame_errors,
    interval_of_mean,
    json_values,
    read_annotations,
    to_device,
)
from dronekeypp.files import write_beside
from dronekeypp.model import DroneKeyPP
from dronekeypp.model.geometry import chord
from dronekeypp.reproduce.priors import radius
from dronekeypp.reproduce.runner import Bench, Run, complete, result, rows_and_averages, say, write_result
from dronekeypp.reproduce.tables import (
    PRINTED,
    average,
    heading,
    interval,
    methods,
    number,
    panels,
    percent,
    write_figure,
)
from dronekeypp.sequences import LiveFilter, filtered, gaussian, inverse_variances
from dronekeypp.sixdronesyn.drones import DRONES
from dronekeypp.sixdronesyn.scenes import FPS
from dronekeypp.train import METRICS, choose_device

METHOD = DroneKeyPP.method
SETTINGS = {"pose": "geometric", "classifier": "features"}
PAPERS, GEOMETRIC = Run(METHOD), Run(METHOD, "geometric", SETTINGS)
# Each drone left out in turn would be seven trainings; these are the smallest and one whose size others have too. A quarter of the budget.
WITHOUT = {
    name: Run(METHOD, f"geometric without {name}", {**SETTINGS, "epochs": 10}, without=name)
    for name in ("Tello", "Air2")
}
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
FILTERS: dict[str, tuple[Callable, tuple[float, ...]]] = {  # (R, t, seconds, covariance, strength) -> R, t; the strengths to choose from
    "frame by frame": (lambda R, t, time, covariance, _: (R, t), (0.0,)),
    "Gaussian": (lambda R, t, time, covariance, sigma: gaussian(R, t, time, sigma), (0.03, 0.05, 0.1, 0.2)),
    "Gaussian, weighted by the covariance": (
        lambda R, t, time, covariance, sigma: gaussian(R, t, time, sigma, inverse_variances(covariance)), (0.03, 0.05, 0.1, 0.2)
    ),
    "live filter": (lambda R, t, time, covariance, a: filtered(R, t, time, LiveFilter(a, a)), (1.0, 3.0, 10.0, 30.0)),
    "live filter, told the covariance": (
        lambda R, t, time, covariance, a: filtered(R, t, time, LiveFilter(a, a), covariance), (1.0, 3.0, 10.0, 30.0)
    ),
}  # fmt: skip


@torch.inference_mode()
def answers(model: DroneKeyPP, dataset: Dataset, parts: Iterable[str] = PARTS) -> dict[str, Any]:
    """Every answer of a geometric network to every frame: {"": frames of `frame_errors`, and one for each of `parts`; "error", "covariance"}.

    error (F, 6): the turn (axis times 2 sin(angle / 2), camera axes) and the shift (m) from the answer to the truth; covariance (F, 6, 6) as
    claimed for it.
    """
    device = next(model.parameters()).device
    model.eval()
    found: dict[str, list] = {name: [] for name in ("", *parts, "error", "covariance")}
    shuffle = torch.Generator().manual_seed(0)
    for items in DataLoader(dataset, 64):
        items = to_device(items, device)
        K, square = items["K"], items["square"]
        encoded = model.encode(items["image"])
        mirrored = model.encode(items["image"].flip(3)) if "twice" in parts else None
        probs = encoded["class_logits"].softmax(dim=1)
        true_class = one_hot(items["label"], model.config.classes).to(probs)
        order = torch.randperm(len(K), generator=shuffle).to(
            device
        )  # another frame's noise, and what was claimed for it
        noise = (encoded["keypoints"] - items["keypoints"])[order]
        exact = {
            **encoded,
            "keypoints": items["keypoints"],
            "keypoint_sigma": torch.full_like(encoded["keypoint_sigma"], 1e-3),
        }
        noisy = {
            **encoded,
            "keypoints": items["keypoints"] + noise,
            "keypoint_sigma": encoded["keypoint_sigma"][order],
        }
        whole = model.decode(encoded, probs, K, square)
        answer = {"": whole, "direct": {**whole, "R": whole["R_direct"], "t": whole["t_direct"]}}
        for name, given in (("told", encoded), ("noisy", noisy), ("exact", exact)):
            if name in parts:
                answer[name] = {**model.decode(given, true_class, K, square), "keypoints": given["keypoints"]}
        if mirrored:
            both = merged(encoded, mirrored)
            answer["twice"] = {**model.decode(both, probs, K, square), "keypoints": both["keypoints"]}
        for name in ("", *parts):
            found[name].append(
                frame_errors({"keypoints": encoded["keypoints"], "class_probs": probs, **answer[name]}, items)
            )
        found["error"].append(
            torch.cat([chord(items["R"], whole["R"]), items["t"] - whole["t"]], dim=1).cpu()
        )
        found["covariance"].append(whole["covariance"].cpu())
    joined: dict[str, Any] = {
        name: torch.cat(found.pop(name)).numpy().astype(np.float64) for name in ("error", "covariance")
    }
    return joined | {
        name: {key: np.concatenate([part[key] for part in batches]) for key in batches[0]}
        for name, batches in found.items()
    }


def merged(encoded: dict[str, Tensor], mirrored: dict[str, Tensor]) -> dict[str, Tensor]:
    """What a crop showed, with the keypoints averaged with those of its mirror, each weighted by its own claim; the claim is the average one's,
    not smaller: two looks at one picture err alike."""
    swap = [1, 0, 3, 2]  # FL, FR, RR, RL
    one, other = (
        sigma.pow(-2) for sigma in (encoded["keypoint_sigma"], mirrored["keypoint_sigma"][:, swap])
    )  # (B, 4)
    keypoints = (
        one[..., None] * encoded["keypoints"] + other[..., None] * mirror_keypoints(mirrored["keypoints"])
    ) / (one + other)[..., None]
    return {**encoded, "keypoints": keypoints, "keypoint_sigma": (2 / (one + other)).sqrt()}


def surprise(error: np.ndarray, covariance: np.ndarray) -> dict[str, np.ndarray]:
    """Squared Mahalanobis distance (F,) of the turn and of the shift: chi-squared with 3 degrees of freedom, if the covariance is right."""
    return {
        name: np.einsum(
            "fi,fij,fj->f", error[:, part], np.linalg.inv(covariance[:, part, part]), error[:, part]
        )
        for name, part in HALVES.items()
    }


def calibration(error: np.ndarray, covariance: np.ndarray) -> list[float]:
    """What the deviations of turn and shift have to be multiplied with, so that the 50 % and the 90 % region hold their share of these frames.

    One factor cannot always serve both; it is the geometric mean of the two.
    """
    factors = []
    for squared in surprise(error, covariance).values():
        ratios = [np.quantile(squared, level) / chi2.ppf(level, 3) for level in (0.5, 0.9)]
        factors.append(float(np.prod(ratios) ** 0.25))
    return factors


def coverage(error: np.ndarray, covariance: np.ndarray) -> dict[str, list[float]]:
    """Share of the frames whose error lies in the region claimed to hold LEVELS of them, for turn and shift."""
    return {
        name: [float((squared <= chi2.ppf(level, 3)).mean()) for level in LEVELS]
        for name, squared in surprise(error, covariance).items()
    }


def claimed(covariance: np.ndarray) -> dict[str, np.ndarray]:
    """The deviation (F,) that a covariance claims: of the turn in degrees, of the shift in metres (root of the trace)."""
    trace = {
        name: np.sqrt(np.trace(covariance[:, part, part], axis1=1, axis2=2)) for name, part in HALVES.items()
    }
    return {"turn": np.degrees(trace["turn"]), "shift": trace["shift"]}


class Hidden(Dataset):
    """A data set with a grey square over a random place of each crop, `share` of its area. The truth stays."""

    def __init__(self, dataset: Dataset, share: float):
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


def occlusion(models: dict[str | None, DroneKeyPP], dataset: Dataset) -> list[dict[str, Any]]:
    """Medians against the hidden share of the crop, of every network; of the geometric one also what it claims."""
    rows = []
    for share in HIDDEN:
        for variant, model in models.items():
            part = Hidden(dataset, share)
            row: dict[str, Any] = {"hidden": share, "variant": variant}
            if model.head is not None:
                found = answers(model, part, ())
                frames = found[""]
                row |= {
                    f"claimed_{name}": float(np.median(v)) for name, v in claimed(found["covariance"]).items()
                }
                row["coverage90"] = {
                    name: values[-1] for name, values in coverage(found["error"], found["covariance"]).items()
                }
            else:
                frames = evaluate(model, part)
            rows.append(
                row | {"R_deg": float(np.median(frames["R_deg"])), "t_m": float(np.median(frames["t_m"]))}
            )
    return rows


def over_flights(
    seen: dict[str, Any], truth: dict[str, Tensor], smooth: Callable, strength: float, every: int = 1
) -> np.ndarray:
    """Mean rotation error (degrees) and translation error (m) of every flight (F, 2), after `smooth` (see FILTERS); of every `every`-th flight."""
    frames = seen[""]
    keys = np.stack([frames["scene"], frames["label"], frames["subsequence"]], axis=1)
    _, flight = np.unique(keys, axis=0, return_inverse=True)
    rows = []
    for which in range(0, flight.max() + 1, every):
        mine = np.flatnonzero(flight.ravel() == which)
        R, t = (frames[name][mine].astype(float) for name in ("R", "t"))
        R, t = smooth(R, t, frames["frame"][mine] / FPS, seen["covariance"][mine], strength)
        turned = rotations.geodesic_degrees(torch.tensor(R), truth["R"][mine].double())
        rows.append(
            (
                float(turned.mean()),
                float(np.linalg.norm(t - truth["t"][mine].double().numpy(), axis=1).mean()),
            )
        )
    return np.array(rows)


def sequences(
    seen: dict[str, Any], truth: dict[str, Tensor], val: dict[str, Any], val_truth: dict[str, Tensor]
) -> list[dict[str, Any]]:
    """Every filter on the test flights, as strong as serves it best on every second validation flight; with the change against single frames."""
    rows, raw = [], None
    for name, (smooth, strengths) in FILTERS.items():
        tried = [
            over_flights(val, val_truth, smooth, strength, every=2).mean(axis=0) for strength in strengths
        ]  # (R, t) each
        best = strengths[int(np.argmin([R / tried[0][0] + t / tried[0][1] for R, t in tried]))]
        found = over_flights(seen, truth, smooth, best)
        raw = found if raw is None else raw
        row = {"filter": name, "strength": best, "flights": len(found)}
        for k, key in enumerate(("R_deg", "t_m")):
            row |= {
                key: float(found[:, k].mean()),
                f"{key}_change_ci95": interval_of_mean((found - raw)[:, k]),
            }
        rows.append(row)
    return rows


def load(bench: Bench, run: Run, seed: int) -> tuple[DroneKeyPP, dict[str, Any] | None]:
    """A run's network; a geometric one calibrated on the validation flights, and then its answers to them, too."""
    model = DroneKeyPP.from_pretrained(bench.train(run, seed)).to(choose_device(bench.settings(run, seed)[1]))
    if model.head is None:
        return model, None
    seen = answers(model, bench.split("val", run, seed), ())
    factors = calibration(seen["error"], seen["covariance"])
    model.decoder.calibration.copy_(torch.tensor(factors))
    scale = np.repeat(factors, 3)
    return model, {**seen, "covariance": seen["covariance"] * scale[:, None] * scale}


def reproduce(bench: Bench, seeds: int = 1) -> dict[str, Any]:
    """Train and measure whatever is missing. Returns the recorded result; the calibrated network goes to data_samples/beyond."""
    bench.render()
    jobs = [(bench, run, seed) for seed in range(seeds) for run in (PAPERS, GEOMETRIC)] + [
        (bench, run, 0) for run in WITHOUT.values()
    ]
    return complete(jobs, Bench.finished, measured, lambda parts: record(bench, parts))


def measured(bench: Bench, run: Run, seed: int) -> dict[str, Any]:
    """One run: rows of its answers and, of a geometric one, how far its covariance can be trusted."""
    bench.train(run, seed)
    found: dict[str, Any] = {
        "story": bench.story(run, seed),
        "rows": [],
        "averages": [],
        "doubt": [],
        "occlusion": [],
        "shapes": [],
        "sequences": [],
    }
    if run is PAPERS:
        variants = bench.measure(run, seed)
    else:
        say(f"asking {run.variant} seed {seed}", bench.progress)
        (model, val), test = load(bench, run, seed), bench.split("test", run, seed)
        seen = answers(model, test, () if run.without else PARTS)
        chosen = (
            seen[""]["label"] == DRONES[run.without].index
            if run.without
            else np.ones(len(seen["error"]), bool)
        )
        error, covariance = seen["error"][chosen], seen["covariance"][chosen]
        found["doubt"] = [
            {"variant": run.variant, "seed": seed, **json_values(doubt(error, covariance, model))}
        ]
        variants = {run.variant: {key: value[chosen] for key, value in seen[""].items()}}
        variants |= {title: seen[name] for name, title in PARTS.items() if name in seen}
        if seed == 0 and not run.without:
            ship(bench, model, bench.folder(run, seed) / METRICS)
            both = {None: load(bench, PAPERS, seed)[0], run.variant: model}
            found["sequences"] = json_values(
                sequences(seen, read_annotations(test), val, read_annotations(bench.split("val", run, seed)))
            )
            found["occlusion"] = json_values(occlusion(both, Subset(test, range(0, len(test), 10))))
            found["shapes"] = json_values(shapes(model))
    for variant, each in variants.items():
        rows, means = rows_and_averages(each, method=METHOD, variant=variant, seed=seed)
        found["rows"] += rows
        found["averages"] += means
    return found


def doubt(error: np.ndarray, covariance: np.ndarray, model: DroneKeyPP) -> dict[str, Any]:
    """Coverage; and by tenths of the frames, the surest first: what was claimed and the root mean square of what happened."""
    claims, found = (
        claimed(covariance),
        {
            "calibration": model.decoder.calibration.tolist(),
            "coverage": coverage(error, covariance),
            "tenths": {},
        },
    )
    for name, part in HALVES.items():
        happened = np.linalg.norm(error[:, part], axis=1) * (180 / np.pi if name == "turn" else 1)
        tenths = np.array_split(np.argsort(claims[name]), min(10, len(error)))
        found["tenths"][name] = [
            {
                "claimed": float(np.sqrt(np.mean(claims[name][t] ** 2))),
                "error": float(np.sqrt(np.mean(happened[t] ** 2))),
            }
            for t in tenths
        ]
        found[f"claimed_{name}"] = float(np.median(claims[name]))
    return found


def shapes(model: DroneKeyPP) -> list[dict[str, Any]]:
    """How far the learned hubs of each drone lie from the true ones (root mean square, mm) and the size it believes over the true size."""
    rows = []
    for drone, learned in zip(DRONES.values(), model.decoder.shapes.hubs.detach().cpu().numpy(), strict=True):
        off = float(np.sqrt(np.square(learned - drone.hubs).sum(axis=1).mean()))
        rows.append(
            {"drone": drone.name, "off_mm": 1000 * off, "size_ratio": radius(learned) / radius(drone.hubs)}
        )
    return rows


def ship(bench: Bench, model: DroneKeyPP, history: Path) -> None:
    """The calibrated network as float16, and its curve, in data_samples/beyond."""
    folder = bench.root / "data_samples" / "beyond"
    model.save_pretrained(folder, half=True)
    write_beside(folder / METRICS, history.read_bytes())


def record(bench: Bench, parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Write the result, its table and its figures from what there is; returns the result."""
    joined = {
        key: [row for part in parts for row in part[key]]
        for key in ("rows", "averages", "doubt", "occlusion", "shapes", "sequences")
    }
    recorded = result("beyond", bench, [part["story"] for part in parts], **joined)
    write_result(bench.root, recorded)
    folder = bench.root / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    write_beside(folder / "beyond.md", markdown(recorded).encode())
    write_figure(folder / "beyond.png", draw(recorded))
    if recorded["doubt"] and recorded["occlusion"]:
        write_figure(folder / "beyond_doubt.png", draw_doubt(recorded))
    return recorded


def side_by_side(recorded: dict[str, Any]) -> list[tuple[str, str | None]]:
    """The rows that are about all drones."""
    return [name for name in methods(recorded) if "without" not in (name[1] or "")]


def markdown(recorded: dict[str, Any]) -> str:
    """Both networks and their parts; then what the covariance is worth."""
    lines = ["# Beyond the paper: the geometry put back", "", heading(recorded), ""]
    lines += ["Mean of the 14 columns of Table 3, 95 % interval over them.", ""]
    lines += [
        "| | "
        + " | ".join(title for title, *_ in PRINTED)
        + " | class | flips | keypoints (px of the crop) |"
    ]
    lines += ["|---|" + "---:|" * (len(PRINTED) + 3)]
    for name in side_by_side(recorded):
        row = average(recorded, *name)
        cells = [interval(row, key, digits) for _, key, _, digits in PRINTED]
        cells += [
            percent(row["class_accuracy"]),
            percent(row["flip_rate"]),
            number(row["keypoint_crop_px"], 1),
        ]
        lines.append(f"| {name[1] or 'the paper’s network'} | {' | '.join(cells)} |")
    lines += ["", "## What its covariance is worth", ""]
    lines += [
        "Share of the frames whose error lies inside the region claimed for 50 % and 90 % of them; test scenes.",
        "",
    ]
    lines += [
        "| | turn 50 % | turn 90 % | shift 50 % | shift 90 % | claimed turn (deg) | claimed shift (m) |",
        "|---|" + "---:|" * 6,
    ]
    for row in recorded["doubt"]:
        shares = [
            percent(row["coverage"][name][LEVELS.index(level)]) for name in HALVES for level in (0.5, 0.9)
        ]
        lines.append(
            f"| {row['variant']} | {' | '.join(shares)} | {row['claimed_turn']:.1f} | {row['claimed_shift']:.3f} |"
        )
    if recorded["sequences"]:
        lines += ["", "## Over whole flights", ""]
        lines += [
            "Test flights; the strength of each filter chosen on validation flights; change against single frames."
        ]
        lines += [
            "",
            "| | strength | R MAE (deg) | change, 95 % | t MAE (m) | change, 95 % |",
            "|---|" + "---:|" * 5,
        ]
        for row in recorded["sequences"]:
            turn, shift = (
                f"[{low:+.{d}f}, {high:+.{d}f}]"
                for d, (low, high) in ((1, row["R_deg_change_ci95"]), (3, row["t_m_change_ci95"]))
            )
            lines.append(
                f"| {row['filter']} | {row['strength']:g} | {row['R_deg']:.1f} | {turn} | {row['t_m']:.3f} | {shift} |"
            )
    left_out = [
        row for row in recorded["averages"] if "without" in (row["variant"] or "") and row["over"] == "frames"
    ]
    if left_out:
        lines += [
            "",
            "## A drone it was never trained on",
            "",
            "Its frames of the test scenes, a quarter of the training.",
            "",
        ]
        lines += ["| | R MedAE (deg) | t MedAE (m) | predicted / true distance |", "|---|---:|---:|---:|"]
        lines += [
            f"| {row['variant']} | {row['R_medae_deg']:.1f} | {row['t_medae_m']:.2f} | {row['distance_ratio']:.2f} |"
            for row in left_out
        ]
    return "\n".join(lines) + "\n"


def draw(recorded: dict[str, Any]) -> plt.Figure:
    """Both networks, and the parts of ours, a panel a metric."""
    names = side_by_side(recorded)
    return panels(
        recorded, names, [variant or "the paper's network" for _, variant in names], lambda name, key: None
    )


def draw_doubt(recorded: dict[str, Any]) -> plt.Figure:
    """Coverage, claimed against happened, and error against what is hidden."""
    plots.style()
    figure, axes = plt.subplots(1, 4, figsize=(13, 3.2))
    mine = next(row for row in recorded["doubt"] if row["variant"] == GEOMETRIC.variant)
    for name, marker in zip(HALVES, "os", strict=True):
        axes[0].plot(LEVELS, mine["coverage"][name], f"{marker}-", label=name)
    axes[0].plot([0, 1], [0, 1], color="grey", linestyle="--", linewidth=1)
    axes[0].set(
        xlabel="claimed share of frames inside",
        ylabel="share inside",
        title="coverage",
        xlim=(0, 1),
        ylim=(0, 1),
    )
    axes[0].legend()
    for ax, name, unit in ((axes[1], "turn", "degrees"), (axes[2], "shift", "m")):
        claims, errors = ([tenth[key] for tenth in mine["tenths"][name]] for key in ("claimed", "error"))
        ax.loglog(claims, errors, "o-")
        low, high = min(claims + errors), max(claims + errors)
        ax.plot([low, high], [low, high], color="grey", linestyle="--", linewidth=1)
        ax.set(
            xlabel=f"claimed deviation, {unit}",
            ylabel=f"error, {unit}",
            title=f"{name}: tenths of the frames",
        )
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 3)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
    for variant, style in ((None, "s--"), (GEOMETRIC.variant, "o-")):
        rows = [row for row in recorded["occlusion"] if row["variant"] == variant]
        axes[3].plot(
            [100 * row["hidden"] for row in rows],
            [row["R_deg"] for row in rows],
            style,
            label=variant or "the paper's",
        )
    axes[3].set(
        xlabel="hidden, % of the crop", ylabel="rotation MedAE, degrees", ylim=(0, None), title="occlusion"
    )
    axes[3].legend()
    return figure
