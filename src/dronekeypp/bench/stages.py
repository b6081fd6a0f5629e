"""This module builds the stages of each contender, one after the other, from frames to R and t."""

from __future__ import annotations

import contextlib
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
from dronekeypp.bench.contender import (
    COMPILED,
    GRAPHS,
    LIBRARY,
    ONNX,
    PAPER_SIZED,
    POSE34,
    YOLO_IN_ONNX,
    Contender,
)
from dronekeypp.camera import crop_image, from_crop, intrinsics, square_around
from dronekeypp.exported import OnnxNetwork
from dronekeypp.model import DroneKeyPP
from dronekeypp.presets import preset
from dronekeypp.sixdronesyn.drones import DRONES

WIDTH, HEIGHT, FOCAL = 1920, 1080, 1500.0  # of the made-up footage, pixels
YOLO_SIZE = 256  # px, of the detector's input in its library

Frame = tuple[np.ndarray, np.ndarray]  # a picture (1080, 1920, 3) uint8 and a box (4,)
Inputs = tuple[Tensor, Tensor, Tensor]  # image (B, 3, S, S), K (B, 3, 3), square (B, 3)
Stages = dict[str, Callable[[Any], Any]]  # each takes what the one before returned; the first takes frames
Facts = dict[str, int]  # "params" and "flops" of one frame; a multiplication and an addition are two


def build(contender: Contender, folder: Path) -> tuple[Facts, Stages]:
    """Load or make a contender.

    What its library has to write goes to `folder`.
    """
    if contender.engine == LIBRARY or contender.name in YOLO_IN_ONNX:
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
    crops, squares = crops_of(frames, size)
    return as_images(crops.to(device)), _cameras(len(frames)).contiguous().to(device), squares.to(device)


def crops_of(frames: Sequence[Frame], size: int) -> tuple[Tensor, Tensor]:
    """Return the crops (B, size, size, 3) uint8 of some frames, and their squares (B, 3) in pixels."""
    crops, squares = [], []
    for frame, box in frames:
        square = square_around(box)
        squares.append(square)
        crops.append(crop_image(frame, square, size))
    return torch.from_numpy(np.stack(crops)), torch.tensor(np.stack(squares), dtype=torch.float32)


def as_images(crops: Tensor) -> Tensor:
    """Return crops (B, S, S, 3) uint8 as a network takes them: (B, 3, S, S) in [0, 1]."""
    return crops.permute(0, 3, 1, 2).float() / 255


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
    if contender.engine == GRAPHS:
        return facts, _graphed(network, contender)

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


def _graphed(network: DroneKeyPP, contender: Contender) -> Stages:
    """Make a DroneKey++ all of whose kernels are one CUDA graph. No GPU has run it so far.

    `mode="reduce-overhead"` records the kernels of one call and replays them in the next ones, so that Python
    starts one thing and not hundreds. A graph has fixed shapes, and nothing in it may wait for the CPU or
    come from there; a test traces it for that. Where it cannot be recorded, it is an error and not a slower
    run. The next replay overwrites what a graph returns, so the answer is copied out in the stage itself.
    """
    device, size = contender.device, network.config.image_size
    options = {**torch._inductor.list_mode_options("reduce-overhead"), "triton.cudagraph_or_error": True}
    answer = torch.compile(pose_of_crop(network), fullgraph=True, dynamic=False, options=options)
    K = _cameras(contender.batch).contiguous().to(device)

    def pose(inputs: tuple[Tensor, Tensor]) -> Tensor:
        crops, squares = inputs
        torch.compiler.cudagraph_mark_step_begin()
        return answer(crops, K, squares).cpu()

    return {
        "crop": lambda frames: [part.to(device) for part in crops_of(frames, size)],
        "network and pose": pose,
    }


def pose_of_crop(network: DroneKeyPP) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """Return a function from crops (B, S, S, 3) uint8, K (B, 3, 3) and squares (B, 3) to poses (B, 12).

    The poses are R by rows, and then t in metres: one tensor, so that one copy brings them back.
    """

    def answer(crops: Tensor, K: Tensor, squares: Tensor) -> Tensor:
        encoded = network.encode(as_images(crops))
        pose = network.decode(encoded, encoded["class_logits"].softmax(dim=-1), K, squares)
        return torch.cat([pose["R"].flatten(1), pose["t"]], dim=1)

    return answer


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
    size = YOLO_IN_ONNX.get(contender.name, YOLO_SIZE)
    library = yolo.library(folder)
    shape = {**library("yolov8n-pose.yaml").model.yaml, "kpt_shape": [4, 3], "nc": len(DRONES)}
    (folder / "yolov8n-pose.yaml").write_text(json.dumps(shape))  # JSON is YAML
    model = library(str(folder / "yolov8n-pose.yaml"))
    torch.set_num_threads(contender.threads)  # the library chose its own
    facts = _facts(model.model.eval(), torch.zeros(1, 3, size, size))
    if contender.engine == ONNX:
        model = _in_onnx_runtime(model, library, folder, size, contender)
    pnp, B = PnPPose(len(DRONES)), contender.batch
    pnp.hubs.copy_(torch.tensor(np.stack([drone.hubs for drone in DRONES.values()])))
    K, label = _cameras(B), torch.full((B,), DRONES["Mini2"].index)
    points = torch.tensor([[0.3, 0.4], [0.7, 0.4], [0.75, 0.6], [0.25, 0.6]]).expand(B, 4, 2)
    squares = torch.tensor([700.0, 400.0, 250.0]).expand(B, 3)

    def crop(frames: Sequence[Frame]) -> list[np.ndarray]:
        # BGR, as the library wants it.
        return [crop_image(frame, square_around(box), size)[..., ::-1] for frame, box in frames]

    return facts, {
        "crop": crop,
        "network": lambda images: _detections(model, images, size, contender.device),
        "pose": lambda _: pnp(from_crop(points, squares), label, K),
    }


def _detections(model: Any, images: list[np.ndarray], size: int, device: str) -> list[Any]:
    """Return what the library finds in pictures, with what it does before and after its network."""
    return model.predict(images, imgsz=size, conf=yolo.CONFIDENCE, max_det=1, verbose=False, device=device)


def _in_onnx_runtime(
    model: Any, library: Callable[..., Any], folder: Path, size: int, contender: Contender
) -> Any:
    """Return a detector that its library exported, and that it runs in ONNX Runtime.

    The library prepares the pictures and sorts out the boxes as it does for its own network, so both ends are
    counted. It does not let anyone choose the threads. So its session is replaced by one that has them.
    """
    import onnxruntime

    with contextlib.chdir(folder):  # the library writes to the working folder
        name = model.export(
            format="onnx", imgsz=size, batch=contender.batch, simplify=False, verbose=False, device="cpu"
        )
    file = str(folder / name)
    exported = library(file, task="pose")
    _detections(exported, [np.zeros((size, size, 3), np.uint8)] * contender.batch, size, "cpu")  # loads it
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = contender.threads
    session = onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
    exported.predictor.model.backend.session = session
    return exported
