"""Run an exported network, a file of `export`, with ONNX Runtime.

It is called like the network that it was made from.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dronekeypp import checkpoint
from dronekeypp.errors import InputError
from dronekeypp.files import parse_json
from dronekeypp.model import DECODERS, ModelConfig
from dronekeypp.model.inputs import check_input_shapes, check_values

EXTRA = ("onnx", "onnxscript", "onnxruntime")  # what the optional extra installs
INPUTS = ("image", "K", "square")
OUTPUTS = ("keypoints", "keypoints_px", "class_probs", "R", "t")
# The key of the file's metadata under which stands what config.json of a checkpoint says.
DESCRIPTION = "dronekeypp"


def require_packages(*packages: str) -> None:
    """Check that optional packages are installed.

    Raises:
        InputError: one is missing. The message says what to install.
    """
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    if missing:
        raise InputError(f'{", ".join(missing)} not installed: pip install -e ".[onnx]"')


def outputs(config: ModelConfig) -> tuple[str, ...]:
    """Return the names of what an exported network answers.

    They are the parts of the pose, and what its decoder adds.
    """
    return OUTPUTS + DECODERS[config.pose].outputs


class OnnxNetwork:
    """This class runs a file of `export` on the CPU.

    It gives those of the network's answers that `outputs` names.

    Args:
        path: the file.
        threads: threads of ONNX Runtime; 0 means as many as there are cores.

    Raises:
        InputError: ONNX Runtime is not installed, or the file was not written by `export`.
    """

    method = "DroneKey++"
    truth_inputs = ()
    checks_inputs = True

    def __init__(self, path: str | Path, threads: int = 0) -> None:
        require_packages("onnxruntime")
        import onnxruntime

        if not Path(path).is_file():
            raise InputError(
                f"{path} not found: make it with `python -m dronekeypp export CHECKPOINT {path}`"
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 3
        try:
            providers = ["CPUExecutionProvider"]
            self.session = onnxruntime.InferenceSession(str(path), options, providers=providers)
        # ONNX Runtime's errors have no common class; nothing else runs in this block.
        except Exception as error:
            reason = str(error).strip().splitlines()[0][:120]
            raise InputError(f"{path} is not a readable ONNX file ({reason})") from None
        metadata = self.session.get_modelmeta().custom_metadata_map
        if DESCRIPTION not in metadata:
            raise InputError(f"{path} was not written by `python -m dronekeypp export`")
        description = parse_json(metadata[DESCRIPTION], f"{path}: its settings")
        _, self.config, self.drones = checkpoint.parse(description, path)
        self._check_graph(path)

    def _check_graph(self, path: str | Path) -> None:
        """Check that the graph has the inputs and outputs that the settings promise, and finite answers.

        Raises:
            InputError: it has not.
        """
        given = self.session.get_inputs()
        answers = {output.name for output in self.session.get_outputs()}
        named = [entry.name for entry in given] == list(INPUTS)
        sized = given[0].shape[2:] == [self.config.image_size] * 2
        if not named or not sized or answers != set(outputs(self.config)):
            raise InputError(f"{path}: its settings are not those of its graph; export it again")
        S = self.config.image_size
        K = torch.tensor([[[1500.0, 0, 960], [0, 1500, 540], [0, 0, 1]]])
        answer = self(torch.full((1, 3, S, S), 0.5), K, torch.tensor([[900.0, 500, 90]]))
        if not all(value.isfinite().all() for value in answer.values()):
            raise InputError(f"{path}: its answer to a grey picture is not finite: its weights hold NaN")

    @staticmethod
    def installed() -> bool:
        """Say whether the packages of the optional extra are installed."""
        return all(importlib.util.find_spec(package) is not None for package in EXTRA)

    def __call__(self, image: Tensor, K: Tensor, square: Tensor) -> dict[str, Tensor]:
        """Answer as `DroneKeyPP.forward` does.

        Args:
            image: (B, 3, S, S) RGB in [0, 1]. An array will do as well as a tensor, here and below.
            K: (B, 3, 3) full-frame camera matrix, pixels.
            square: (B, 3) the crop's x, y and side in full-frame pixels.

        Returns:
            a tensor for each name of `outputs`.

        Raises:
            InputError: an argument does not fit, see `model.inputs`.
        """
        given = {}
        for name, value in zip(INPUTS, (image, K, square), strict=True):
            given[name] = torch.as_tensor(value).detach().cpu()
        check_input_shapes(given, self.config.image_size)
        if not given["image"].is_floating_point():
            raise InputError(f"image is {given['image'].dtype}, RGB in [0, 1] is needed: divide by 255")
        if self.checks_inputs:
            check_values(given, None)
        arrays = {}
        for name, value in given.items():
            arrays[name] = np.ascontiguousarray(value, dtype=np.float32)
        names = outputs(self.config)
        answers = self.session.run(list(names), arrays)
        return {name: torch.from_numpy(value) for name, value in zip(names, answers, strict=True)}
