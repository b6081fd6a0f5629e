"""Read and write what is recorded of a table.

This is data_samples/results/NAME.json, and the arrays that figures are drawn from.
"""

from __future__ import annotations

import io
import json
import os
import platform
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field

from dronekeypp.errors import InputError
from dronekeypp.evaluate import FORMAT, MEASURES, averages, flight_errors, json_values, summarise
from dronekeypp.evaluate.statistics import Frames, Measures
from dronekeypp.files import digest, repository_root, write_beside, write_json
from dronekeypp.presets import TrainConfig
from dronekeypp.schema import (
    CHECKSUM,
    Count,
    Digest,
    Length,
    Name,
    Open,
    Words,
    check_checksum,
    read,
    with_checksum,
)
from dronekeypp.sixdronesyn.folders import edition_of, require_manifest
from dronekeypp.train import choose_device

RESULTS = Path("data_samples") / "results"  # below the root
HARDWARE = "hardware.txt"  # in a run's folder: what it was trained on
# Every number the paper prints, by table and row.
PAPER: dict[str, Any] = json.loads((Path(__file__).parent / "paper.json").read_text(encoding="utf-8"))

# --- a recorded result ------------------------------------------------------------------------------------


class Entry(Open):
    """This is an entry of a list: what was measured of a method, or a training."""

    method: str | None = None
    variant: str | None = None
    seed: Count | None = None


class DataSet(Open):
    """This is what a result says of the data set that it was measured on, see `describe`."""

    edition: Count = 1
    seed: Count = 0
    digest: str = ""
    train_frames: Count = 0
    test_frames: Count = 0
    stride: Length = 1
    environments: str = ""


class Recorded(Open):
    """This is what every result holds. The rest is known to its table, and its checksum keeps it."""

    name: Name
    command: str | None = None  # None: not made by a command
    preset: str = ""
    budget: Words = {}
    dataset: DataSet | None = None
    datasets: dict[str, DataSet] = {}
    hardware: str | dict[str, Any]
    minutes: Annotated[float, Field(ge=0)] = 0
    versions: Words
    runs: list[Entry] = []
    rows: list[Entry] = []
    averages: list[Entry] = []
    validation: list[Entry] = []
    flights: list[Entry] = []
    checksum: Digest = ""


def read_result(name: str, root: Path | None = None) -> dict[str, Any]:
    """Read a recorded result by its name, such as "table3", from `root` or from the repository.

    Raises:
        InputError: Nothing of that name has been recorded, or there is no `root` and no repository.
    """
    path = result_path(root or repository_root(), name)
    if not path.is_file():
        raise InputError(f"{path} not found: make it with `python -m dronekeypp reproduce {name}`")
    return read_recorded(path)


def read_recorded(path: Path) -> dict[str, Any]:
    """Return what a file of `write_result` holds.

    Raises:
        InputError: it is missing, torn, or not as it was written: nobody types a result.
    """
    command = f"python -m dronekeypp reproduce {path.stem}"
    mend = f"take it from git again, or delete it and make it with `{command}`"
    recorded = read(Recorded, path, mend)
    check_checksum(recorded, path, mend)
    recorded.pop(CHECKSUM, None)
    return recorded


def result_path(root: Path, name: str) -> Path:
    """Return where a result is recorded below `root`."""
    return root / RESULTS / f"{name}.json"


def write_result(root: Path, recorded: dict[str, Any]) -> Path:
    """Write data_samples/results/NAME.json below `root`, and return its path."""
    path = result_path(root, recorded["name"])
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, with_checksum(recorded), indent=1)
    return path


def measurements(
    frames: Frames, names: Sequence[str], split: str, measures: Measures = MEASURES, **labels: Any
) -> dict[str, list[dict[str, Any]]]:
    """Return what is recorded of one row of a table and one split, for JSON.

    Of the test scenes these are "rows" and "averages", of the validation scenes "validation"; "flights" of
    both.

    Args:
        frames: the arrays of `evaluate`.
        names: the drones in class order.
        split: "test" or "val".
        measures: the columns.
        labels: entries that are put in front of every row (method=, variant=, seed=).
    """
    rows = json_values(summarise(frames, names, measures, **labels))
    flights = [{**labels, "split": split, **flight_errors(frames, names)}]
    if split == "val":
        return {"validation": rows, "flights": flights}
    means = json_values(averages(frames, measures=measures, **labels))
    return {"rows": rows, "averages": means, "flights": flights}


# --- what a measurement was made from ---------------------------------------------------------------------


def finished_manifest(data: Path) -> dict[str, Any]:
    """Return the manifest of a data set that `generate` has finished.

    Raises:
        InputError: it is missing, broken or not finished.
    """
    manifest = require_manifest(data)
    if "flights" not in manifest:
        raise InputError(f"{data}: no finished data set; run generate, it resumes")
    return manifest


def describe(data: Path) -> dict[str, Any]:
    """Describe a data set as a recorded result names it."""
    manifest = finished_manifest(data)
    settings, frames = manifest["settings"], manifest["frames"]
    return {
        "edition": edition_of(manifest),
        "seed": settings["seed"],
        "digest": manifest["digest"],
        "train_frames": frames["train"],
        "test_frames": frames["test"],
        "stride": settings["stride"],
        "environments": settings["environments"],
    }


def hardware(config: TrainConfig) -> str:
    """Return the device that a training runs on, in words, with its threads where that is a CPU."""
    device = choose_device(config)
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    threads = torch.get_num_threads()
    return f"{threads} thread{'s'[: threads != 1]} of {os.cpu_count()} CPU cores ({platform.machine()})"


def keep_hardware(folder: Path, config: TrainConfig) -> None:
    """Write what a training ran on into its folder, if nothing stands there yet."""
    if not (folder / HARDWARE).is_file():
        write_beside(folder / HARDWARE, f"{hardware(config)}\n".encode())


def read_hardware(folder: Path) -> str:
    """Return what a training ran on, in words."""
    return (folder / HARDWARE).read_text(encoding="utf-8").strip()


def source_digest(weights: Path, data: Path) -> str:
    """Return a digest of what a measurement was made from.

    It covers these weights, these frames, and this version of `frame_errors`.
    """
    frames = finished_manifest(data)["digest"]
    return f"{digest(weights.read_bytes())} on {frames}, measures {FORMAT}"


# --- arrays -----------------------------------------------------------------------------------------------


def write_npz(path: Path, arrays: Mapping[str, np.ndarray], made_from: str | None = None) -> None:
    """Write arrays beside `path` and rename the file, with a note of what they were made from.

    A value that is no array is left out.
    """
    stored = {name: value for name, value in arrays.items() if isinstance(value, np.ndarray)}
    if made_from:
        stored["made_from"] = np.array(made_from)
    content = io.BytesIO()
    np.savez_compressed(content, **stored)
    write_beside(path, content.getvalue())


def read_npz(path: Path, made_from: str) -> dict[str, np.ndarray] | None:
    """Read the arrays of `write_npz`.

    The answer is None if they are missing, broken, or made from something else.
    """
    try:
        with np.load(path) as stored:
            arrays = dict(stored)
    except (OSError, ValueError, zipfile.BadZipFile):
        return None
    source = str(arrays.pop("made_from", ""))
    return arrays if source == made_from else None
