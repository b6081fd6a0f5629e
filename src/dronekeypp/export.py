"""Write DroneKey++ as one ONNX file.

Its inputs are the crop, the camera matrix and the square; its outputs are keypoints, class, rotation and
translation. `export` needs the optional extra: `pip install -e ".[onnx]"`. The file runs wherever ONNX
Runtime does, from 1.17 on. `exported.OnnxNetwork` runs it here, with the same call and the same answers as
the network that it was made from. So `checkpoint.load`, and with it every command, takes either. The file's
metadata (`metadata_props`) say what config.json of the checkpoint says: the method, the drones with their
hubs, the settings.
"""

from __future__ import annotations

import json
import logging
import warnings
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from dronekeypp import checkpoint
from dronekeypp.errors import InputError
from dronekeypp.exported import DESCRIPTION, INPUTS, OnnxNetwork, outputs, require_packages
from dronekeypp.files import check_replaceable, remove_unfinished, writing_beside
from dronekeypp.model import DroneKeyPP

# The oldest version of ONNX's file format that can hold the graph. ONNX Runtime up to 1.17 refuses 10, which
# the exporter writes.
IR_VERSION = 9


class _Tuple(nn.Module):
    """This module makes a network answer with a tuple of tensors, as ONNX wants it."""

    def __init__(self, network: DroneKeyPP) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor, K: Tensor, square: Tensor) -> tuple[Tensor, ...]:
        answer = self.network(image, K, square)
        return tuple(answer[name] for name in outputs(self.network.config))


def export(source: str | Path, out_file: str | Path) -> Path:
    """Write a checkpoint as an ONNX file, for batches of any size.

    Args:
        source: a checkpoint or a run folder.
        out_file: the file to write; its name ends in .onnx.

    Returns:
        the path of the file.

    Raises:
        InputError: the extra is not installed, the checkpoint cannot be read or needs true keypoints, or the
            name of `out_file` does not end in .onnx.
    """
    require_packages("onnx", "onnxscript")
    out_file = Path(out_file)
    if not checkpoint.is_exported(out_file):
        raise InputError(f"{out_file}: call it .onnx")
    check_replaceable(out_file)
    network = checkpoint.load(source)
    if not isinstance(network, DroneKeyPP) or network.encoder is None:
        raise InputError(f"{source} is no DroneKey++ with an encoder: nothing to export")
    program = _program(network)
    program.model.ir_version = IR_VERSION
    program.model.metadata_props[DESCRIPTION] = json.dumps(checkpoint.describe(network))
    out_file.parent.mkdir(parents=True, exist_ok=True)
    remove_unfinished(out_file.parent, (out_file.name,))
    with writing_beside(out_file) as beside:
        program.save(str(beside))
    return out_file


def _program(network: DroneKeyPP) -> torch.onnx.ONNXProgram:
    """Return the network's graph, traced on two made-up crops."""
    S = network.config.image_size
    K = torch.tensor([[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]])
    square = torch.tensor([900.0, 500, 90])
    example = torch.rand(2, 3, S, S), K.repeat(2, 1, 1), square.repeat(2, 1)
    batch = torch.export.Dim("batch", min=1, max=65536)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter's notes to its own makers
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        return torch.onnx.export(
            _Tuple(network).eval(),
            example,
            input_names=INPUTS,
            output_names=outputs(network.config),
            dynamo=True,
            verbose=False,
            dynamic_shapes={name: {0: batch} for name in INPUTS},
        )


def largest_differences(
    network: DroneKeyPP, exported: OnnxNetwork, dataset: Dataset, batch: int = 64
) -> dict[str, float]:
    """Return the largest absolute difference of every output over a data set.

    Args:
        network: the network.
        exported: the file that was made from it.
        dataset: the frames to compare them on.
        batch: frames at a time.

    Returns:
        a dict from the name of an output to its largest difference, in the unit of that output.

    Raises:
        InputError: an output of either is not finite.
    """
    largest = dict.fromkeys(outputs(network.config), 0.0)
    with torch.inference_mode():
        for items in DataLoader(dataset, batch):
            inputs = [items[name] for name in INPUTS]
            ours, theirs = network(*inputs), exported(*inputs)
            for name in largest:
                difference = float((ours[name] - theirs[name]).abs().max())
                if not np.isfinite(difference):
                    raise InputError("the network's answer is not finite: its weights hold NaN, or nearly")
                largest[name] = max(largest[name], difference)
    return largest
