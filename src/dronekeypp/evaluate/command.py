"""Measure a saved network on a data set on disk, print its tables, and write its poses for BOP's toolkit.

This is `python -m dronekeypp evaluate`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader
from tqdm import tqdm

from dronekeypp import checkpoint, data
from dronekeypp.classes import are_named, names_of
from dronekeypp.errors import InputError
from dronekeypp.evaluate.bop_measures import BOP_COLUMNS, BOP_MEASURES, LEGEND, OF_CROPS, bop_errors
from dronekeypp.evaluate.run import evaluate, share_drones, tells_drones_apart
from dronekeypp.evaluate.statistics import (
    MEASURES,
    Frames,
    averages,
    format_table,
    json_values,
    summarise,
)
from dronekeypp.files import check_writable, write_beside
from dronekeypp.frame_dataset import FrameDataset, Relabelled
from dronekeypp.sixdronesyn.object_shapes import ObjectShape, read_shapes
from dronekeypp.sixdronesyn.results import Estimate, object_numbers, results_csv
from dronekeypp.stored import StoredFrame


def evaluate_checkpoint(
    source: str | Path,
    dataset_root: str | Path,
    split: str = "test",
    json_file: str | Path | None = None,
    progress: bool = True,
    bop_file: str | Path | None = None,
) -> list[dict]:
    """Measure a saved network on one split of a data set on disk, and print its tables.

    The second table has the errors of the field (`bop_measures`). It needs a mesh of every object in the
    split; without one, a line says so.

    Args:
        source: a checkpoint, a run folder, of which best/ is taken, or a file of `export`.
        dataset_root: the data set.
        split: the split.
        json_file: a file to write the rows to; None for no file.
        progress: show a bar.
        bop_file: a file to write the poses to, in BOP's results format; None for no file.

    Returns:
        the rows of the tables, with the columns of both.

    Raises:
        InputError: the checkpoint or the data set cannot be read, they have no drone in common, or the poses
            cannot be written as BOP's results.
    """
    for file in (json_file, bop_file):
        if file:
            check_writable(Path(file))  # before the work, not after it
    model = checkpoint.load(source)
    if isinstance(model, nn.Module):
        model.to("cuda" if torch.cuda.is_available() else "cpu")
    whole = data.open_dataset(dataset_root, split, size=model.config.image_size)
    if bop_file:
        check_scene_numbers(whole.folders)
    dataset, left_out = share_drones(model, whole)
    shapes, no_shapes = shapes_of(dataset, whole)

    def show(batches: DataLoader) -> tqdm:
        return tqdm(batches, split, leave=False, disable=None if progress else True)

    frames = evaluate(model, dataset, progress=show, keep=("class_probs",))
    named = tells_drones_apart(model) and are_named(model.drones)
    classes = model.drones if named else whole.drones
    field, note = field_errors(frames, dataset, whole, shapes, no_shapes)
    frames |= field
    measures = {**MEASURES, **BOP_MEASURES} if field else MEASURES
    rows = summarise(frames, names_of(classes), measures, method=model.method)
    means = averages(frames, measures=measures, method=model.method)
    if json_file:
        described = {"split": split, "digest": whole.digest}
        result = json_values({"name": "evaluate", "dataset": described, "rows": rows, "averages": means})
        write_beside(Path(json_file), (json.dumps(result, indent=1) + "\n").encode())
    if bop_file:
        numbers = object_numbers(classes, whole.objects)
        estimates = estimates_of(frames, dataset.stored, numbers)
        write_beside(Path(bop_file), results_csv(estimates).encode())
    # Printed last: nobody may be reading, and what is computed must be kept.
    if left_out:
        print(f"{dataset_root}: {left_out}")
    if whole.left_out:
        print(
            f"{dataset_root}: {whole.left_out} drones left out, the middle of whose box is not in the picture"
        )
    print(format_table(rows + means))
    if field:
        print()
        print(format_table(rows + means, BOP_COLUMNS))
    print(note)
    if not whole.manifest:
        print(flight_legend(whole))
    return rows


def shapes_of(dataset: FrameDataset | Relabelled, whole: FrameDataset) -> tuple[dict[int, ObjectShape], str]:
    """Return the shapes of the objects in a data set by their numbers, and "".

    Where one of them is missing or cannot be read, there are no shapes, and the text says why.

    Args:
        dataset: the frames that are measured.
        whole: the data set that they are from.
    """
    try:
        return read_shapes(whole.root, {frame.annotation.obj_id for frame in dataset.stored})
    except InputError as error:
        return {}, str(error)


def field_errors(
    frames: Frames,
    dataset: FrameDataset | Relabelled,
    whole: FrameDataset,
    shapes: Mapping[int, ObjectShape],
    no_shapes: str,
) -> tuple[Frames, str]:
    """Return what `bop_errors` returns, and the line that goes under its table.

    Where the errors cannot be measured there are none, and the line says why.

    Args:
        frames: the arrays of `evaluate` on `dataset`.
        dataset: the frames that were measured.
        whole: the data set that they are from.
        shapes, no_shapes: what `shapes_of` returns.
    """
    if not answers_pose(frames):
        return {}, "no ADD, MSSD and MSPD: the network answers no pose"
    if no_shapes:
        return {}, f"no ADD, MSSD and MSPD: {no_shapes}"
    note = LEGEND
    if any(frame.annotation.square is not None for frame in dataset.stored):
        note += f"; {OF_CROPS}"
    symmetric = [whole.objects[number].name for number, shape in shapes.items() if shape.symmetric]
    if symmetric:
        note += f"; of {', '.join(symmetric)} ADD is ADD-S"
    return bop_errors(frames, dataset, shapes), note


def answers_pose(frames: Frames) -> bool:
    """Tell whether the network has answered a rotation and a translation for every frame."""
    return bool(np.isfinite(frames["R"]).all() and np.isfinite(frames["t"]).all())


def check_scene_numbers(folders: Sequence[Path]) -> None:
    """Check that every flight folder has a number of its own for a name, which BOP's results need.

    Raises:
        InputError: one has not.
    """
    folder_of: dict[int, Path] = {}
    for folder in folders:
        if not folder.name.isdecimal():
            raise InputError(f"{folder}: BOP's results need a number as the name of a flight folder")
        other = folder_of.setdefault(int(folder.name), folder)
        if other != folder:
            raise InputError(f"{folder} and {other} have one number: BOP's results cannot tell them apart")


def estimates_of(frames: Frames, stored: Sequence[StoredFrame], numbers: Sequence[int]) -> list[Estimate]:
    """Return the poses of a network in the data set's own numbers.

    The score is the probability of the class that the network names. A network that names none is told the
    object, as BOP's localisation task does, and its score is 1. A frame without a pose has no estimate, which
    BOP counts as missed.

    Args:
        frames: the arrays of `evaluate`, with the output "class_probs" if the network has it.
        stored: where each frame comes from.
        numbers: the object number of each class.

    Raises:
        InputError: the network answers no pose.
    """
    if not answers_pose(frames):
        raise InputError("BOP's results need a pose, and this network answers none")
    estimates = []
    for i, frame in enumerate(stored):
        if frames["failed"][i]:
            continue
        label = int(frames["predicted"][i])
        known = label >= 0
        estimates.append(
            Estimate(
                scene=int(frame.folder.name),
                image=frame.annotation.number,
                number=numbers[label] if known else frame.annotation.obj_id,
                score=float(frames["class_probs"][i, label]) if known else 1.0,
                R=frames["R"][i],
                t=frames["t"][i],
            )
        )
    return estimates


def flight_legend(dataset: FrameDataset) -> str:
    """Say which flight folder each scene number of a table stands for."""
    flights = {frame.scene: frame.folder.name for frame in dataset.stored}
    return "scenes: " + ", ".join(f"{number} {name}" for number, name in flights.items())
