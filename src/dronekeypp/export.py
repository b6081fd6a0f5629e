"""DroneKey++ as one ONNX file: crop, camera matrix and square in; keypoints, class, rotation and translation out.

`export` needs the optional extra: `pip install -e ".[onnx]"`. The file runs wherever ONNX Runtime does; `OnnxNetwork` runs it here, with the same
call and the same answers as the network it was made from, so `predict` takes either.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import os
import warnings
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from dronekeypp.baselines import load_network
from dronekeypp.errors import InputError
from dronekeypp.model import DroneKeyPP, ModelConfig
from dronekeypp.model.base import WEIGHTS

EXTRA = ("onnx", "onnxscript", "onnxruntime")  # what the optional extra installs
INPUTS = ("image", "K", "square")
OUTPUTS = ("keypoints", "keypoints_px", "class_probs", "R", "t")
DOUBT = ("covariance",)  # of a network with pose="geometric"
CONFIG_KEY = "dronekeypp"  # of the file's metadata: the network's settings as JSON


def need(*packages: str) -> None:
    """Raise InputError, saying what to install, unless the optional packages are there."""
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    if missing:
        raise InputError(f'{", ".join(missing)} not installed: pip install -e ".[onnx]"')


def outputs(config: ModelConfig) -> tuple[str, ...]:
    """The names of what an exported network answers."""
    return OUTPUTS + DOUBT if config.pose == "geometric" else OUTPUTS


class _Tuple(nn.Module):
    """The network with a tuple of tensors as its answer, as ONNX wants it."""

    def __init__(self, network: DroneKeyPP):
        super().__init__()
        self.network = network

    def forward(self, image: Tensor, K: Tensor, square: Tensor) -> tuple[Tensor, ...]:
        found = self.network(image, K, square)
        return tuple(found[name] for name in outputs(self.network.config))


def load_checkpoint(checkpoint: str | Path) -> tuple[DroneKeyPP | OnnxNetwork, Path]:
    """A DroneKey++ from a folder of `save_pretrained`, a run folder (of which best/ is taken) or a file of `export`, and its file of weights.

    Raises:
        InputError: it cannot be read, or is a baseline's.
    """
    checkpoint = Path(checkpoint)
    if checkpoint.suffix == ".onnx":
        return OnnxNetwork(checkpoint), checkpoint
    folder = checkpoint / "best" if (checkpoint / "best" / WEIGHTS).is_file() else checkpoint
    network = load_network(folder)
    if not isinstance(network, DroneKeyPP):
        raise InputError(
            f"{folder} holds a network of {network.method}; this takes DroneKey++, which names the drone itself"
        )
    return network, folder / WEIGHTS


def export(checkpoint: str | Path, out_file: str | Path) -> Path:
    """Write a checkpoint as `out_file` (.onnx), for batches of any size.

    Raises:
        InputError: the extra is not installed, the checkpoint cannot be read or needs true keypoints, or `out_file` is not called .onnx.
    """
    need("onnx", "onnxscript")
    out_file = Path(out_file)
    if out_file.suffix != ".onnx":
        raise InputError(f"{out_file}: call it .onnx")
    network, _ = load_checkpoint(checkpoint)
    if not isinstance(network, DroneKeyPP) or network.encoder is None:
        raise InputError(f"{checkpoint} is no network with an encoder: nothing to export")
    S = network.config.image_size
    K, square = torch.tensor([[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]]), torch.tensor([900.0, 500, 90])
    example = torch.rand(2, 3, S, S), K.repeat(2, 1, 1), square.repeat(2, 1)
    batch = torch.export.Dim("batch", min=1, max=65536)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter's notes to its own makers
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program = torch.onnx.export(
            _Tuple(network).eval(), example, input_names=INPUTS, output_names=outputs(network.config), dynamo=True, verbose=False,
            dynamic_shapes={name: {0: batch} for name in INPUTS},
        )  # fmt: skip
    program.model.metadata_props[CONFIG_KEY] = json.dumps(network.config.to_dict())
    out_file.parent.mkdir(parents=True, exist_ok=True)
    beside = out_file.with_name(f".{out_file.name}.{os.getpid()}.onnx")
    try:
        program.save(str(beside))
        os.replace(beside, out_file)
    finally:
        beside.unlink(missing_ok=True)
    return out_file


class OnnxNetwork:
    """A file of `export`, run by ONNX Runtime on the CPU: called like the network, it gives its answers (those of `outputs`).

    Args:
        threads: of ONNX Runtime; 0: as many as there are cores.

    Raises:
        InputError: ONNX Runtime is not installed, or the file is none of ours.
    """

    method = DroneKeyPP.method

    @staticmethod
    def installed() -> bool:
        """Whether the optional extra is there."""
        return all(importlib.util.find_spec(package) is not None for package in EXTRA)

    def __init__(self, path: str | Path, threads: int = 0):
        need("onnxruntime")
        import onnxruntime

        if not Path(path).is_file():
            raise InputError(
                f"{path} not found: make it with `python -m dronekeypp export CHECKPOINT {path}`"
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 3
        try:
            self.session = onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
            self.config = ModelConfig.from_json(self.session.get_modelmeta().custom_metadata_map[CONFIG_KEY])
        except KeyError:
            raise InputError(f"{path} was not written by `python -m dronekeypp export`") from None
        except Exception as error:  # ONNX Runtime's errors have no common class
            raise InputError(
                f"{path} is not a readable ONNX file ({str(error).strip().splitlines()[0][:120]})"
            ) from None
        given, answers = self.session.get_inputs(), {output.name for output in self.session.get_outputs()}
        if (
            [one.name for one in given] != list(INPUTS)
            or given[0].shape[2:] != [self.config.image_size] * 2
            or answers != {*outputs(self.config)}
        ):
            raise InputError(f"{path}: its settings are not those of its graph; export it again")

    def __call__(self, image: Tensor, K: Tensor, square: Tensor) -> dict[str, Tensor]:
        """As `DroneKeyPP.forward`: image (B, 3, S, S) in [0, 1], K (B, 3, 3), square (B, 3); arrays will do."""
        inputs = zip(INPUTS, (image, K, square), strict=True)
        given = {
            name: np.ascontiguousarray(torch.as_tensor(value).detach().cpu(), dtype=np.float32)
            for name, value in inputs
        }
        names = outputs(self.config)
        return {
            name: torch.from_numpy(value)
            for name, value in zip(names, self.session.run(list(names), given), strict=True)
        }


def largest_differences(
    network: DroneKeyPP, exported: OnnxNetwork, dataset: Dataset, batch: int = 64
) -> dict[str, float]:
    """The largest absolute difference of every output over a data set: {name: difference}.

    Raises:
        InputError: an output of either is not finite.
    """
    found = dict.fromkeys(outputs(network.config), 0.0)
    with torch.inference_mode():
        for items in DataLoader(dataset, batch):
            inputs = [items[name] for name in INPUTS]
            one, other = network(*inputs), exported(*inputs)
            apart = {name: float((one[name] - other[name]).abs().max()) for name in found}
            if not np.isfinite(list(apart.values())).all():
                raise InputError("the network's answer is not finite: its weights hold NaN, or nearly")
            found = {name: max(found[name], apart[name]) for name in found}
    return found
