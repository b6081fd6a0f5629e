"""This module says who takes part: a method, the engine that runs it, a device and a batch size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from dronekeypp import checkpoint
from dronekeypp.baselines import yolo
from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP, ModelConfig

# Methods that no checkpoint is needed for.
YOLO, POSE34, PAPER_SIZED = yolo.METHOD, "DronePose, ResNet-34", "DroneKey++, paper-sized"
# The detector as ONNX Runtime runs it, by the size of its input: its own, and that of our crops.
YOLO_IN_ONNX = {f"{YOLO}, {size} px": size for size in (640, 96)}
EAGER, COMPILED, ONNX, LIBRARY = "eager", "compiled", "ONNX Runtime", "its library"  # engines
GRAPHS = "CUDA graphs"  # one more: compiled, and all its kernels started as one
BATCHES = {"cpu": (1, 64), "cuda": (1, 512)}  # frames in a call, by device


@dataclass(frozen=True)
class Contender:
    """A contender is one way to run one method.

    `checkpoint` is that of a DroneKey++: a folder, or the exported file. It is empty for the other methods:
    their weights are random, which changes no time.
    """

    name: str
    engine: str
    device: str
    batch: int
    threads: int
    checkpoint: str


def contenders(checkpoints: dict[str, str], exported: dict[str, str], threads: int) -> list[Contender]:
    """Return every method with batch 1 and a large one, on the CPU and, where there is one, on the GPU.

    Args:
        checkpoints: {name: folder} of the networks to measure.
        exported: {name: file} of the same networks, where ONNX Runtime is there to run them.
        threads: the threads of each contender.
    """
    devices = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    chosen = []
    for device in devices:
        for batch in BATCHES[device]:
            for name, engine, source in _methods(checkpoints, exported, device, batch):
                chosen.append(Contender(name, engine, device, batch, threads, source))
    return chosen


def _methods(
    checkpoints: dict[str, str], exported: dict[str, str], device: str, batch: int
) -> list[tuple[str, str, str]]:
    """Return name, engine and checkpoint of all that run on a device, in the order of the table.

    CUDA graphs save the starting of kernels. That counts for one frame, and not for hundreds at a time.
    """
    graphs = device == "cuda" and batch == 1
    methods = []
    for name, folder in checkpoints.items():
        methods += [(name, EAGER, folder), (name, COMPILED, folder)]
        if graphs:
            methods.append((name, GRAPHS, folder))
    if device == "cpu":
        methods += [(name, ONNX, file) for name, file in exported.items()]
    methods.append((PAPER_SIZED, EAGER, ""))
    if graphs:
        methods.append((PAPER_SIZED, GRAPHS, ""))
    methods.append((POSE34, EAGER, ""))
    if yolo.installed():
        methods.append((YOLO, LIBRARY, ""))
        if device == "cpu" and exported:
            methods += [(name, ONNX, "") for name in YOLO_IN_ONNX]
    return methods


def named(checkpoints: Sequence[str | Path]) -> dict[str, str]:
    """Return {name: folder} of checkpoints of DroneKey++.

    The paper's network has the method's name. One with another decoder says which. Where two have the same
    name, the later one adds the name of its folder.

    Raises:
        InputError: a checkpoint cannot be read, or holds no DroneKey++ that sees a picture.
    """
    folders: dict[str, str] = {}
    for path in checkpoints:
        network = checkpoint.load(path)
        if not isinstance(network, DroneKeyPP) or network.encoder is None:
            raise InputError(f"{path} is no DroneKey++ with an encoder: bench takes the folder of one")
        name = network.method
        if network.config.pose != ModelConfig.pose:
            name += f", {network.config.pose}"
        if name in folders:
            name += f" ({Path(path).name})"
        folders[name] = str(path)
    return folders
