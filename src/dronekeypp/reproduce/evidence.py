"""Hold the claims of the paper against the recorded results, by values and by conditions on them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from typing import Any

from dronekeypp.reproduce import ablations, priors
from dronekeypp.reproduce.results import PAPER, read_result
from dronekeypp.reproduce.tables import average
from dronekeypp.sixdronesyn.scenes import count_frames

REPRODUCED, DIFFERS, NOT_ATTEMPTED = "reproduced", "differs", "not attempted"

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

    def row(self, name: str, method: str = "DroneKey++", variant: str | None = None) -> Row:
        """Return every measure of a row, averaged over the seeds and the 14 columns."""
        return average(self[name], method, variant)

    def pose(self, name: str, method: str = "DroneKey++", variant: str | None = None) -> str:
        """Return the four numbers of a row as text."""
        return pose(self.row(name, method, variant))

    def pose_step(self, name: str, before: str, after: str) -> str:
        """Return the four numbers of two rows of an ablation, with an arrow between them."""
        return f"{self.pose(name, variant=before)} → {self.pose(name, variant=after)}"

    def step(self, name: str, before: str, after: str, key: str) -> ablations.Difference:
        """Return by how much, and how surely, the ablation row `after` differs from the row `before`."""
        return ablations.difference({**self[name], "reference": before}, after, key)

    def fps(self, name: str, engine: str, key: str = "frames_per_s") -> float:
        """Return the frames a second on the CPU at batch 1, or another value of that speed row."""
        wanted = (name, engine, "cpu", 1)
        for row in self["speed"]["rows"]:
            if (row["name"], row["engine"], row["device"], row["batch"]) == wanted:
                return row[key]
        raise KeyError(wanted)


@dataclass(frozen=True)
class Claim:
    """Describe a line of the table of claims.

    Args:
        where: the place in the paper.
        says: what the paper says there.
        code: a dotted name below dronekeypp.
        test: FILE::FUNCTION below tests.
        notebook: the stem of its file.
        section: the number of the notebook's section.
        verdict: REPRODUCED, DIFFERS or NOT_ATTEMPTED.
        why: in what sense it was reproduced, or what stands against it.
        paper: the paper's values, where there are any.
        ours: a function that makes our values from the results.
        holds: a function that says whether the verdict stands, by the results.
    """

    where: str
    says: str
    code: str
    test: str
    notebook: str
    section: str
    verdict: str
    why: str = ""
    paper: str = ""
    ours: Callable[[Results], str] | None = None
    holds: Callable[[Results], bool] | None = None


# --- four numbers of a row --------------------------------------------------------------------------------


def four_numbers(R_mae: float, R_medae: float, t_mae: float, t_medae: float) -> str:
    """Write rotation MAE / MedAE in degrees, and translation MAE / MedAE in metres."""
    return f"{R_mae:.1f}° / {R_medae:.1f}°, {t_mae:.3f} / {t_medae:.3f} m"


def pose(row: Row) -> str:
    """Write the four numbers of a row of ours.

    The translation's MAE is per axis, as the paper's seems to be.
    """
    return four_numbers(*[row[key] for key in PRINTED_KEYS])


def printed(table: str, row: str) -> str:
    """Write the same four numbers as the paper prints them."""
    values = PAPER[table][row]
    if isinstance(values, dict):
        values = [values[key]["average_printed"] for key in PRINTED_KEYS.values()]
    return four_numbers(*values)


def printed_step(table: str, before: str, after: str) -> str:
    """Write the printed numbers of two rows, with an arrow between them."""
    return f"{printed(table, before)} → {printed(table, after)}"


def lower(row: Row, other: Row, keys: Iterable[str] = tuple(PRINTED_KEYS)) -> bool:
    """Tell whether a row's errors are lower than another's in every one of the measures."""
    return all(row[key] < other[key] for key in keys)


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
    return f"a drone in training → left out: {in_training:.2f} → {left_out:.2f} m"


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


def below_the_paper(results: Results) -> bool:
    """Tell whether DroneKey++ beats its printed row of Table 3 in all four numbers."""
    paper = PAPER["table3"]["DroneKey++"]
    values = {ours: paper[theirs]["average_printed"] for ours, theirs in PRINTED_KEYS.items()}
    return lower(results.row("table3"), values)


def dronekey_is_ahead_but_for_the_mean(results: Results) -> bool:
    """Tell whether DroneKey++ beats DroneKey in the mean rotation only.

    The upright DroneKey must not be beaten in any number.
    """
    ours, dronekey = results.row("table3"), results.row("table3", "DroneKey")
    upright = results.row("table3", "DroneKey", "upright")
    others = [key for key in PRINTED_KEYS if key != "R_mae_deg"]
    return lower(ours, dronekey, ["R_mae_deg"]) and lower(dronekey, ours, others) and lower(upright, ours)


def true_keypoints_are_better(results: Results) -> bool:
    """Tell whether the row of Table 4 without an encoder has the lower mean rotation error."""
    without_encoder = results.row("table4", variant=NO_ENCODER)
    return lower(without_encoder, results.row("table4", variant="encoder"), ["R_mae_deg"])


def rays_help(results: Results) -> bool:
    """Tell whether the ray embedding makes both translation and rotation better."""
    for key in ("t_medae_m", "R_mae_deg"):
        if "better" not in results.step("table5", ONLY_POSE, WITH_RAYS, key).verdict:
            return False
    return True


def the_class_helps_translation_alone(results: Results) -> bool:
    """Tell whether the class makes the translation better, while the rotation is not told apart."""
    for key in ("t_axis_mae_m", "t_medae_m"):
        if "better" not in results.step("table5", WITHOUT_CLASS, FULL_DECODER, key).verdict:
            return False
    for key in ("R_mae_deg", "R_medae_deg"):
        if results.step("table5", WITHOUT_CLASS, FULL_DECODER, key).verdict != "not told apart":
            return False
    return True


def weights_make_no_difference(results: Results) -> bool:
    """Tell whether no other weights of the losses are told apart from equal ones in the mean rotation."""
    for row in ablations.ABLATIONS["table6"].rows:
        if row.name != "equal":
            if results.step("table6", "equal", row.name, "R_mae_deg").verdict != "not told apart":
                return False
    return True


def photographs_lie_nearest(results: Results) -> bool:
    """Tell whether the Fréchet distance to real frames falls from plain to drawn to photographed places."""
    distance = {row["set"]: row["frechet"] for row in of_figure_6(results)}
    return distance["photographs"] < distance["drawn"] < distance["plain"]


def real_frames_are_doubted(results: Results) -> bool:
    """Tell whether the shipped network's mirror doubt is more than three times as large on real frames."""
    doubt = {row["set"]: row["doubt_px"] for row in shipped_answers(results)}
    return doubt["real"] > 3 * doubt["drawn"]


def sizes_are_learned(results: Results) -> bool:
    """Tell whether the network's answers show that it has learned the drones' sizes.

    It has if a wrong class gives a wrong distance, and a drone left out of training is put much farther off.
    """
    slope, _ = priors.told_slope(results["priors"])
    in_training, left_out = left_out_errors(results)
    return slope > 0.5 and left_out > 3 * in_training
