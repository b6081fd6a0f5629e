"""Hold the claims of the paper against the recorded results, by values and by conditions on them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from statistics import mean
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.evaluate import ENOUGH_SEEDS, Difference
from dronekeypp.model import DroneKeyPP
from dronekeypp.reproduce import ablations, priors
from dronekeypp.reproduce.comparisons import difference
from dronekeypp.reproduce.flights import Name
from dronekeypp.reproduce.results import PAPER, read_result
from dronekeypp.reproduce.tables import average, seeds_of, title
from dronekeypp.sixdronesyn.scenes import count_frames

METHOD = DroneKeyPP.method
HALF_AN_ORDER = 0.5  # of magnitude: numbers of one order are less than a factor of √10 apart
# A row of a table as the paper prints it: our key of a measure, and its. The translation's MAE is per axis.
PRINTED_KEYS = {
    "R_mae_deg": "R_deg_MAE",
    "R_medae_deg": "R_deg_MedAE",
    "t_axis_mae_m": "t_m_MAE",
    "t_medae_m": "t_m_MedAE",
}
NO_ENCODER = "ground-truth annotations, no encoder"  # the rows of Tables 4 and 5
ONLY_POSE, WITH_RAYS, WITHOUT_CLASS, FULL_DECODER = [row.name for row in ablations.ABLATIONS["table5"].rows]
Row = dict[str, Any]


class Results:
    """Give access to the recorded results below `root`, or to those of the repository: `results["table3"]`.

    Each result is read once.
    """

    def __init__(self, root: Path | None = None) -> None:
        self.root = root
        self._read: dict[str, dict[str, Any]] = {}

    def __getitem__(self, name: str) -> dict[str, Any]:
        if name not in self._read:
            self._read[name] = read_result(name, self.root)
        return self._read[name]

    def check_editions(self, names: Iterable[str]) -> None:
        """Check that all results were measured on one edition of the data set.

        Results that do not name it are of the first. A result that was not recorded is left out.

        Raises:
            InputError: they were not; the message names one result of each edition.
        """
        example: dict[int, str] = {}
        for name in names:
            try:
                recorded = self[name]
            except InputError:
                continue
            sets = [recorded.get("dataset"), *recorded.get("datasets", {}).values()]
            for described in filter(None, sets):
                example.setdefault(described.get("edition", 1), name)
        if len(example) > 1:
            first, second, *_ = (f"{name} is of edition {edition}" for edition, name in example.items())
            raise InputError(
                f"results of different editions do not go together: {first}, {second}; reproduce all"
            )

    def row(self, name: str, method: str = METHOD, variant: str | None = None) -> Row:
        """Return every measure of a row, averaged over the seeds and the 14 columns."""
        return average(self[name], method, variant)

    def seeds(self, name: str, row: Name) -> int:
        """Return the number of seeds behind a row."""
        return seeds_of(self[name], row)

    def pose(self, name: str, method: str = METHOD, variant: str | None = None) -> str:
        """Return the numbers of a row as text, with a question mark if it has fewer than three seeds."""
        mark = "?" if self.seeds(name, (method, variant)) < ENOUGH_SEEDS else ""
        return pose(self.row(name, method, variant)) + mark

    def pose_step(self, name: str, before: str, after: str) -> str:
        """Return the four numbers of two rows of an ablation, with an arrow between them."""
        return f"{self.pose(name, variant=before)} → {self.pose(name, variant=after)}"

    def difference(self, name: str, row: Name, reference: Name, key: str, split: str) -> Difference:
        """Return by how much, and how surely, a row differs from another.

        Raises:
            InputError: one of them was not measured.
        """
        apart = difference(self[name], row, reference, key, split)
        if apart is None:
            rows = f"{title(*row)} or {title(*reference)}"
            raise InputError(
                f"{name}: no {key} of {rows}; make it with `python -m dronekeypp reproduce {name}`"
            )
        return apart

    def fps(self, name: str, engine: str, key: str = "frames_per_s") -> float:
        """Return the frames a second on the CPU at batch 1, or another value of that speed row."""
        wanted = (name, engine, "cpu", 1)
        for row in self["speed"]["rows"]:
            if (row["name"], row["engine"], row["device"], row["batch"]) == wanted:
                return row[key]
        raise KeyError(wanted)


# --- four numbers of a row --------------------------------------------------------------------------------


def four_numbers(R_mae: float, R_medae: float, t_mae: float, t_medae: float, distance: str = "") -> str:
    """Write rotation MAE / MedAE in degrees, and translation MAE / MedAE in metres.

    `distance` stands after the translation's MAE.
    """
    return f"{R_mae:.1f}° / {R_medae:.1f}°, {t_mae:.3f}{distance} / {t_medae:.3f} m"


def pose(row: Row) -> str:
    """Write the four numbers of a row of ours.

    The translation's MAE is per axis, as the paper's seems to be. Behind it, in brackets, is the mean
    distance.
    """
    return four_numbers(*[row[key] for key in PRINTED_KEYS], distance=f" ({row['t_mae_m']:.3f})")


def paper_numbers(table: str, row: str) -> dict[str, float]:
    """Return the same four numbers as the paper prints them, by our keys."""
    values = PAPER[table][row]
    if isinstance(values, dict):
        values = [values[key]["average_printed"] for key in PRINTED_KEYS.values()]
    return dict(zip(PRINTED_KEYS, values, strict=True))


def printed(table: str, row: str) -> str:
    """Write the paper's numbers as it prints them."""
    return four_numbers(*paper_numbers(table, row).values())


def printed_step(table: str, before: str, after: str) -> str:
    """Write the printed numbers of two rows, with an arrow between them."""
    return f"{printed(table, before)} → {printed(table, after)}"


# --- our values as text -----------------------------------------------------------------------------------


def frames_again(results: Results) -> str:
    """Say how many frames the data set has."""
    return f"{count_frames():,} frames, made again from a seed"


def dronekey_and_upright(results: Results) -> str:
    """Give the numbers of DroneKey in Table 3, with either reading of its two poses."""
    upright = results.pose("table3", "DroneKey", "upright")
    return f"{results.pose('table3', 'DroneKey')}; upright {upright}"


def dronepose_and_told_the_crop(results: Results) -> str:
    """Give the numbers of DronePose in Table 3, without and with the place of its crop."""
    with_crop = results.pose("table3", "DronePose", "told the crop")
    return f"{results.pose('table3', 'DronePose')}; told the crop {with_crop}"


def equal_and_tanh(results: Results) -> str:
    """Give the numbers of two rows of Table 6, "equal" and "tanh-weighted"."""
    tanh = results.pose("table6", variant="tanh-weighted")
    return f"{results.pose('table6', variant='equal')}; tanh {tanh}"


def cpu_speed(results: Results) -> str:
    """Give the frames a second of our network and of one as large as the paper's."""
    ours = results.fps("DroneKey++", "ONNX Runtime")
    large = results.fps("DroneKey++, paper-sized", "eager")
    return f"{ours:.0f} frames/s (paper-sized {large:.0f})"


def with_and_without_a_drone(results: Results) -> str:
    """Give the translation error of a drone in training, and of a drone left out of it."""
    in_training, left_out = left_out_errors(results)
    few = len(results["priors"]["told"]) < ENOUGH_SEEDS
    return f"a drone in training → left out: {in_training:.2f} → {left_out:.2f} m{'?' if few else ''}"


def left_out_errors(results: Results) -> tuple[float, float]:
    """Return the median translation errors in metres of drones in training, and of drones left out of it.

    Both are means over the drones.
    """
    recorded = results["priors"]
    pairs = [priors.left_out(recorded, drone, "t_medae_m") for drone in recorded["hub_radius_m"]]
    return mean(pair[0] for pair in pairs), mean(pair[1] for pair in pairs)


def of_figure_6(results: Results) -> list[Row]:
    """Return the rows of Figure 6 that are about whole pictures, by the descriptor."""
    names = ("real", "plain", "drawn", "photographs")
    rows = []
    for row in results["figure6"]["rows"]:
        if row["features"] == "descriptor" and row["set"] in names:
            rows.append(row)
    return rows


def frechet_distances(results: Results) -> str:
    """Give the Fréchet distance of each made set of Figure 6."""
    words = [f"{row['set']} {row['frechet']:.0f}" for row in of_figure_6(results) if row["set"] != "real"]
    return "Fréchet " + ", ".join(words)


def shipped_answers(results: Results) -> list[Row]:
    """Return what the shipped network says to the sets of Figure 6."""
    return [row for row in results["figure6"]["answers"] if row["network"] == "shipped"]


def mirror_doubts(results: Results) -> str:
    """Give the shipped network's mirror doubt on real and on rendered frames."""
    doubt = {row["set"]: row["doubt_px"] for row in shipped_answers(results)}
    return f"doubt {doubt['real']:.0f} px of 96 (rendered {doubt['drawn']:.0f})"


def no_gpu_was_measured(results: Results) -> bool:
    """Tell whether the recorded speed has no row of a GPU."""
    return not any(row["device"] == "cuda" for row in results["speed"]["rows"])


# --- conditions on the results ----------------------------------------------------------------------------


def of_the_papers_order(results: Results) -> bool:
    """Tell whether the four numbers of DroneKey++ are of the order of magnitude of those that it prints."""
    ours, paper = results.row("table3"), paper_numbers("table3", METHOD)
    return all(abs(math.log10(ours[key] / paper[key])) < HALF_AN_ORDER for key in PRINTED_KEYS)


def true_keypoints_are_better(results: Results) -> bool:
    """Tell whether the row of Table 4 without an encoder has the lower mean rotation error."""
    apart = results.difference("table4", (METHOD, NO_ENCODER), (METHOD, "encoder"), "R_mae_deg", "val")
    return "better" in apart.verdict


def photographs_lie_nearest(results: Results) -> bool:
    """Tell whether the Fréchet distance to real frames falls from plain to drawn to photographed places.

    It does if the intervals of both changes leave out 0.
    """
    falls = {}
    for row in results["figure6"]["nearer"]:
        if (row["features"], row["measure"]) == ("descriptor", "frechet"):
            falls[row["before"], row["after"]] = row["difference_ci95"][1] < 0
    return falls["plain", "drawn"] and falls["drawn", "photographs"]


def real_frames_are_doubted(results: Results) -> bool:
    """Tell whether the shipped network's mirror doubt is more than three times as large on real frames."""
    doubt = {row["set"]: row["doubt_px"] for row in shipped_answers(results)}
    return doubt["real"] > 3 * doubt["drawn"]


def sizes_are_learned(results: Results) -> bool:
    """Tell whether the network's answers show that it has learned the drones' sizes.

    It has if a wrong class gives a wrong distance, and drones left out of training are put farther off.
    """
    slope, _ = priors.told_slope(results["priors"])
    pooled = priors.pooled(results["priors"])
    apart = difference(pooled, (METHOD, priors.LEFT_OUT), (METHOD, None), "t_medae_m")
    return slope > 0.5 and "worse" in apart.verdict
