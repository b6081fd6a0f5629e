"""Refuse by arithmetic a training that asks for more memory than there is, before anything is built."""

from __future__ import annotations

import torch

from dronekeypp.checkpoint import count_numbers
from dronekeypp.errors import InputError
from dronekeypp.model import PoseNetwork
from dronekeypp.presets import TrainConfig
from dronekeypp.processes import total_memory
from dronekeypp.settings import Settings

FLOAT = 4  # bytes
COPIES = 4  # of each weight: itself, its gradient and Adam's two moments
ACTIVATIONS = 10  # times a picture is in memory at least while a network that looks at it learns from it
LOADER = 30e6  # bytes that a loading process needs at least


def check_memory(
    network: type[PoseNetwork], model: Settings, config: TrainConfig, frames: int, device: torch.device
) -> None:
    """Check that what a training needs at the very least fits into this machine.

    Args:
        network: the class of the network.
        model: its settings.
        config: those of the training.
        frames: of the training set.
        device: that the network learns on.

    Raises:
        InputError: it does not. The message names the settings that ask for most.
    """
    total = total_memory()
    if total is None:
        return
    picture = 3 * model.image_size**2 * FLOAT
    batch = min(config.batch, frames) * picture
    loading = config.workers * (LOADER + 2 * batch)
    if loading > total:
        raise _refusal(f"workers={config.workers} with batch={config.batch}", loading, total)
    weights = count_numbers(network, model) * FLOAT * COPIES
    if getattr(model, "encoder", "learned") == "learned":
        batch *= ACTIVATIONS
    if device.type == "cuda":
        total = torch.cuda.get_device_properties(device).total_memory
    if weights > total:
        raise _refusal("a network of this size", weights, total)
    if weights + batch > total:
        raise _refusal(f"batch={config.batch} with image_size={model.image_size}", weights + batch, total)


def _refusal(what: str, needed: float, total: float) -> InputError:
    return InputError(
        f"{what} needs {needed / 1e9:.0f} GB of memory at least, and there are {total / 1e9:.0f} GB; "
        "choose smaller settings"
    )
