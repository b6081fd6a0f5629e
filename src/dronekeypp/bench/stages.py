"""This module builds the stages of each contender, one after the other, from frames to R and t."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from dronekeypp import checkpoint
from dronekeypp.baselines import DronePose, yolo
from dronekeypp.baselines.pnp_pose import PnPPose
from dronekeypp.bench.contender import COMPILED, LIBRARY, ONNX, PAPER_SIZED, POSE34, Contender
from dronekeypp.camera import crop_image, from_crop, intrinsics, square_around
from dronekeypp.exported import OnnxNetwork
from dronekeypp.model import DroneKeyPP
from dronekeypp.presets import preset
from dronekeypp.sixdronesyn.drones import DRONES

WIDTH, HEIGHT, FOCAL = 1920, 1080, 1500.0  # of the made-up footage, pixels
YOLO_SIZE = 256  # px, of the detector's input

Frame = tuple[np.ndarray, np.ndarray]  # a picture (1080, 1920, 3) uint8 and a box (4,)
Inputs = tuple[Tensor, Tensor, Tensor]  # image (B, 3, S, S), K (B, 3, 3), square (B, 3)
Stages = dict[str, Callable[[Any], Any]]  # each takes what the one before returned; the first takes frames
Facts = dict[str, int]  # "params" and "flops" of one frame; a multiplication and an addition are two


def build(contender: Contender, folder: Path) -> tuple[Facts, Stages]:
    """Load or make a contender.

    What its library has to write goes to `folder`.
    """
    if contender.engine == LIBRARY:
        return _detector(contender, folder)
    if contender.engine == ONNX:
        return _exported(contender)
    if contender.name == POSE34:
        return _dronepose(contender)
    return _dronekeypp(contender)


# --- the footage ------------------------------------------------------------------------------------------


def pictures(batch: int) -> list[Frame]:
    """Return frames of made-up footage.

    They share one picture of noise, and each of the `batch` frames has a box of its own.
    """
    rng = np.random.default_rng(0)
    frame = rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    frames = []
    for _ in range(batch):
        box = np.array([rng.uniform(0, 1600), rng.uniform(0, 900), 240.0, 120.0])
        frames.append((frame, box))
    return frames


def cut(frames: Sequence[Frame], size: int, device: str) -> Inputs:
    """Return what a network is given of some frames: their crops of `size` pixels, cameras and squares."""
    crops, squares = [], []
    for frame, box in frames:
        square = square_around(box)
        squares.append(square)
        crops.append(crop_image(frame, square, size))
    image = torch.from_numpy(np.stack(crops)).to(device).permute(0, 3, 1, 2).float() / 255
    square = torch.tensor(np.stack(squares), dtype=torch.float32, device=device)
    return image, _cameras(len(frames)).contiguous().to(device), square


def _cameras(batch: int) -> Tensor:
    """Return the camera matrix of the footage, once for each frame: (B, 3, 3)."""
    return torch.tensor(intrinsics(FOCAL, WIDTH, HEIGHT), dtype=torch.float32).expand(batch, 3, 3)


def _facts(network: nn.Module, *inputs: Tensor) -> Facts:
    """Return the number of parameters of a network, and of its operations for these inputs."""
    with torch.inference_mode(), FlopCounterMode(display=False) as counter:
        network(*inputs)
    return {"params": sum(p.numel() for p in network.parameters()), "flops": counter.get_total_flops()}


# --- the methods ------------------------------------------------------------------------------------------


def _dronekeypp(contender: Contender) -> tuple[Facts, Stages]:
    """Make a DroneKey++ in PyTorch, from a checkpoint or from the preset `paper`."""
    if contender.name == PAPER_SIZED:
        config, _ = preset("paper", {"backbone_weights": None})
        network = DroneKeyPP(config)
    else:
        network = checkpoint.load(contender.checkpoint)
    device, size = contender.device, network.config.image_size
    network = network.to(device).eval()
    facts = _facts(network, *cut(pictures(1), size, device))

    def encode(image: Tensor) -> dict[str, Tensor | None]:
        encoded = network.encode(image)
        # Without the attention of each layer, a list that no decoder reads.
        return {name: value for name, value in encoded.items() if not isinstance(value, list)}

    def decode(encoded: dict[str, Tensor | None], K: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        probs = encoded["class_logits"].softmax(dim=-1)
        answer = network.decode(encoded, probs, K, square)
        return answer["R"], answer["t"]

    if contender.engine == COMPILED:
        encode, decode = torch.compile(encode), torch.compile(decode)
    return facts, {
        "crop": lambda frames: cut(frames, size, device),
        "network": lambda inputs: (encode(inputs[0]), *inputs[1:]),
        "pose": lambda encoded: [part.cpu() for part in decode(*encoded)],
    }


def _exported(contender: Contender) -> tuple[Facts, Stages]:
    """Load an exported DroneKey++, which ONNX Runtime runs.

    It is one graph, so its network and its pose cannot be told apart.
    """
    session = OnnxNetwork(contender.checkpoint, contender.threads)
    size = session.config.image_size
    network = DroneKeyPP(session.config, load_backbone=False).eval()  # to count in
    facts = _facts(network, *cut(pictures(1), size, "cpu"))
    return facts, {
        "crop": lambda frames: cut(frames, size, "cpu"),
        "network and pose": lambda inputs: session(*inputs),
    }


def _dronepose(contender: Contender) -> tuple[Facts, Stages]:
    """Make DronePose with a ResNet-34, on a crop of 224 px."""
    config, _ = preset("paper", {"backbone": "resnet34", "backbone_weights": None}, DronePose)
    device, size = contender.device, config.image_size
    network = DronePose(config, load_backbone=False).to(device).eval()

    def answer(inputs: Inputs) -> list[Tensor]:
        output = network(*inputs)
        return [output["R"].cpu(), output["t"].cpu()]

    facts = _facts(network, *cut(pictures(1), size, device))
    return facts, {"crop": lambda frames: cut(frames, size, device), "network and pose": answer}


def _detector(contender: Contender, folder: Path) -> tuple[Facts, Stages]:
    """Make YOLOv8n-pose, and PnP with the true size.

    The untrained detector finds nothing. So PnP gets four points as a Mini 2 would show them.
    """
    library = yolo.library(folder)
    shape = {**library("yolov8n-pose.yaml").model.yaml, "kpt_shape": [4, 3], "nc": len(DRONES)}
    (folder / "yolov8n-pose.yaml").write_text(json.dumps(shape))  # JSON is YAML
    model = library(str(folder / "yolov8n-pose.yaml"))
    torch.set_num_threads(contender.threads)  # the library chose its own
    facts = _facts(model.model.eval(), torch.zeros(1, 3, YOLO_SIZE, YOLO_SIZE))
    pnp, B = PnPPose(len(DRONES)), contender.batch
    pnp.hubs.copy_(torch.tensor(np.stack([drone.hubs for drone in DRONES.values()])))
    K, label = _cameras(B), torch.full((B,), DRONES["Mini2"].index)
    points = torch.tensor([[0.3, 0.4], [0.7, 0.4], [0.75, 0.6], [0.25, 0.6]]).expand(B, 4, 2)
    squares = torch.tensor([700.0, 400.0, 250.0]).expand(B, 3)

    def crop(frames: Sequence[Frame]) -> list[np.ndarray]:
        # BGR, as the library wants it.
        return [crop_image(frame, square_around(box), YOLO_SIZE)[..., ::-1] for frame, box in frames]

    def detect(images: list[np.ndarray]) -> list[Any]:
        return model.predict(
            images,
            imgsz=YOLO_SIZE,
            conf=yolo.CONFIDENCE,
            max_det=1,
            verbose=False,
            device=contender.device,
        )

    return facts, {
        "crop": crop,
        "network": detect,
        "pose": lambda _: pnp(from_crop(points, squares), label, K),
    }
