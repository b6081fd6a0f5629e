"""Measure a network's errors on a data set.

The constant answer, which every network has to beat, is measured here too.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset

from dronekeypp import data, rotations
from dronekeypp.classes import are_named, match, names_of
from dronekeypp.errors import InputError
from dronekeypp.evaluate.errors import frame_errors
from dronekeypp.evaluate.statistics import Frames
from dronekeypp.frame_dataset import FrameDataset, Relabelled
from dronekeypp.model.inputs import without_checks

# An error that must be finite, and the part of the output that it needs.
MUST_BE_FINITE = {"R_deg": "R", "t_m": "t", "keypoint_units": "keypoints"}

# What PyTorch says of a loading process that was killed, or that found /dev/shm full.
_LOADER_DIED = ("DataLoader worker (pid", "shared memory", "file </torch")


def to_device(batch: dict, device: torch.device | str) -> dict[str, torch.Tensor]:
    """Return the tensors of a batch on a device."""
    moved = {}
    for name, value in batch.items():
        if torch.is_tensor(value):
            moved[name] = value.to(device, non_blocking=True)
    return moved


def batches_of(dataset: Dataset, batch: int, workers: int = 0) -> DataLoader:
    """Return batches of the frames of a data set, in their order.

    Memory is pinned where a GPU will read it.
    """
    return DataLoader(
        dataset,
        batch_size=batch,
        num_workers=workers,
        generator=torch.Generator(),
        pin_memory=torch.cuda.is_available(),
    )


@contextlib.contextmanager
def loading(workers: int) -> Iterator[None]:
    """Say in one line that a process died that loads data.

    PyTorch notices it at any moment, not only where a batch is awaited, and raises RuntimeError.

    Raises:
        InputError: it died, or found no shared memory to hand its batches over.
    """
    try:
        yield
    except (RuntimeError, OSError) as error:
        lines = str(error).strip().splitlines() or [""]
        if workers == 0 or not any(sign in str(error) for sign in _LOADER_DIED):
            raise
        raise InputError(
            "a process that loads data died, of memory or of shared memory (Docker: --shm-size): "
            f"--set workers=0 needs neither, and --resume goes on ({lines[-1][:100]})"
        ) from None


def apply_model(model: nn.Module, batch: dict, truth_inputs: Sequence[str] = ()) -> dict:
    """Run a network on a batch, with the truths that `truth_inputs` names.

    In Table 4 these are keypoints and label.
    """
    truth = {name: batch[name] for name in truth_inputs}
    return model(batch["image"], batch["K"], batch["square"], **truth)


def evaluate(
    model: nn.Module | Callable[..., dict],
    dataset: Dataset,
    batch: int = 64,
    workers: int = 0,
    criterion: Callable[[dict, dict], dict[str, torch.Tensor]] | None = None,
    progress: Callable | None = None,
    keep: Sequence[str] = (),
) -> Frames:
    """Return the errors of every frame of a data set, in its order.

    They are the arrays of `frame_errors`, joined. The network is put in evaluation mode and left as it was.

    Args:
        model: a network, or anything that is called like one, for example an exported file.
        dataset: the frames.
        batch: frames at a time.
        workers: processes that load the data.
        criterion: `criterion(output, batch)` may add loss terms; their means come back as "losses".
        progress: may wrap the batches (tqdm).
        keep: outputs of the network that come back as arrays as well, those that it has.

    Raises:
        InputError: the data set is empty, lacks a truth, or has other drones than the network knows; or a
            prediction is not finite (the message names the frame); or a process that loads data died.
    """
    if len(dataset) == 0:
        raise InputError("nothing to evaluate: the data set has no frames")
    truth_inputs = getattr(model, "truth_inputs", ())
    data.require(dataset, (*truth_inputs, *data.EVALUATED), "an evaluation")
    check_drones(model, dataset)
    # An exported file has no mode and no parameters; an empty module stands for it.
    network = model if isinstance(model, nn.Module) else nn.Module()
    device = next((p.device for p in network.parameters()), torch.device("cpu"))
    parts, sums = [], {}
    must_be_finite: list[str] = []
    was_training = network.training
    network.eval()
    try:
        with loading(workers), torch.inference_mode(), asking(model, dataset):
            loader = batches_of(dataset, batch, workers)
            for items in progress(loader) if progress else loader:
                items = to_device(items, device)
                output = apply_model(model, items, truth_inputs)
                kept = {name: output[name].cpu().numpy() for name in keep if output.get(name) is not None}
                parts.append({**frame_errors(output, items), **kept})
                must_be_finite = measured_errors(output, items)
                for name, value in (criterion(output, items) if criterion else {}).items():
                    sums[name] = sums.get(name, 0.0) + value.item() * len(items["t"])
    finally:
        network.train(was_training)
    frames = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    check_finite(frames, must_be_finite)
    if criterion:
        frames["losses"] = {name: total / len(dataset) for name, total in sums.items()}
    return frames


def asking(
    model: nn.Module | Callable[..., dict], dataset: Dataset
) -> contextlib.AbstractContextManager[None]:
    """Return the context in which a network is asked about a data set.

    A data set on disk was checked when it was opened, and its crops are cut here. The items of any other are
    looked at, see `model.inputs`.
    """
    if isinstance(data.underlying(dataset), (FrameDataset, Relabelled)):
        return without_checks(model)
    return contextlib.nullcontext()


def measured_errors(output: dict, items: dict) -> list[str]:
    """Return the errors that must be finite.

    The network predicts their part, and the data set has its truth.
    """
    names = []
    for name, part in MUST_BE_FINITE.items():
        if output.get(part) is not None and part in items:
            names.append(name)
    return names


def check_finite(frames: Frames, names: Sequence[str]) -> None:
    """Check that the named errors are finite.

    Raises:
        InputError: one is not. The message names the frame.
    """
    bad = ~np.isfinite([frames[name] for name in names]).all(axis=0)
    if bad.any():
        i = int(bad.argmax())
        raise InputError(
            f"the error of frame {frames['frame'][i]} (scene {frames['scene'][i]}) is not finite: "
            "the annotation or the network's weights hold NaN"
        )


def tells_drones_apart(model: nn.Module | Callable) -> bool:
    """Say whether a class index means something to a network."""
    return hasattr(model, "drones") and hasattr(model.config, "classes")


def check_drones(model: nn.Module | Callable, dataset: Dataset) -> None:
    """Check that a class index means the same drone to the network and to the data set.

    Raises:
        InputError: it does not.
    """
    drones = data.drones_of(dataset)
    if drones is None or not tells_drones_apart(model):
        return
    if not are_named(model.drones) and len(model.drones) == len(drones):
        return  # nothing is known of its classes
    if match(drones, model.drones) != list(range(len(drones))):
        raise InputError(
            f"the data set's drones are {', '.join(names_of(drones))}; "
            f"the network's are {', '.join(names_of(model.drones))}: not the same, or their hubs differ"
        )


def share_drones(model: nn.Module | Callable, dataset: FrameDataset) -> tuple[Dataset, str]:
    """Return the frames of those drones that the network knows, with its class indices.

    Returns:
        the frames, and a sentence that says what was left out. It is empty if the two know the same drones in
        the same order.

    Raises:
        InputError: they have no drone in common.
    """
    if not tells_drones_apart(model):
        return dataset, ""
    if not are_named(model.drones) and len(model.drones) == len(dataset.drones):
        return dataset, "the checkpoint does not name its classes; they are taken in the data set's order"
    indices = match(dataset.drones, model.drones)
    shared, strange, reshaped = [], [], []
    for label in sorted(set(dataset.labels)):
        name = dataset.drones[label].name
        if indices[label] is not None:
            shared.append(name)
        else:
            (reshaped if name in names_of(model.drones) else strange).append(name)
    left_out = []
    if strange:
        left_out.append(f"the network does not know {', '.join(strange)}")
    if reshaped:
        left_out.append(f"the hubs of {', '.join(reshaped)} are not those that it was trained on")
    if not shared:
        raise InputError(
            f"{dataset.root} has no drone in common with the network, which knows "
            f"{', '.join(names_of(model.drones))}: {'; '.join(left_out)}"
        )
    if indices == list(range(len(indices))):
        return dataset, ""
    sentence = "; ".join([f"measured on {', '.join(shared)}", *left_out])
    return Relabelled(dataset, indices, model.drones), sentence


def constant_baseline(train_set: Dataset, test_set: Dataset) -> Frames:
    """Return the errors of the bar to beat: one answer for every frame.

    It is the training set's median translation, its best constant rotation, its commonest class and its mean
    keypoints. The errors have the form of those of `evaluate`, so `summarise`, `averages` and `format_table`
    take them like a network's.
    """
    train, test = data.read_annotations(train_set), data.read_annotations(test_set)
    n = len(test["t"])
    classes = int(max(train["label"].max(), test["label"].max())) + 1
    probs = torch.bincount(train["label"], minlength=classes).float()
    output = {
        "R": rotations.best_constant_rotation(train["R"]).expand(n, 3, 3),
        "t": train["t"].median(dim=0).values.expand(n, 3),
        "keypoints": train["keypoints"].mean(dim=0).expand(n, 4, 2),
        "class_probs": probs.expand(n, -1),
    }
    # Only the width of the images is read; one stands for all.
    image = torch.as_tensor(test_set[0]["image"])[None]
    return frame_errors(output, {**test, "image": image})
