"""`python -m dronekeypp bench`: how fast is it? Every contender waits in a process of its own and is asked in turn, round after round, so that a
busy moment hits all of them; ratios are taken within a round.

A frame is what the methods are given: a full HD picture and a box. *crop* cuts and resizes, *network* goes from the crop to keypoints and class,
*pose* from there to R and t; *whole* is all of them, one after the other.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode
from tqdm import tqdm

from dronekeypp import __version__
from dronekeypp.baselines import DronePose, yolo
from dronekeypp.baselines.pnp_pose import PnPPose
from dronekeypp.camera import crop_image, from_crop, intrinsics, square_around
from dronekeypp.errors import InputError
from dronekeypp.export import OnnxNetwork, export, load_checkpoint
from dronekeypp.files import write_beside
from dronekeypp.model import DroneKeyPP
from dronekeypp.presets import preset
from dronekeypp.sixdronesyn.drones import DRONES

WIDTH, HEIGHT = 1920, 1080
YOLO_SIZE = 256  # px, of the detector's input
YOLO, POSE34, PAPER_SIZED = yolo.METHOD, "DronePose, ResNet-34", "DroneKey++, paper-sized"
ENCODED = ("keypoints", "class_logits", "keypoint_sigma", "ir")  # what the pose needs of the network
EAGER, COMPILED, ONNX, LIBRARY = "eager", "compiled", "ONNX Runtime", "its library"


@dataclass(frozen=True)
class Contender:
    """One way to run one method."""

    name: str
    engine: str
    device: str
    batch: int
    threads: int
    checkpoint: str  # of DroneKey++ (a folder, or the exported file); the others' weights are random, which changes no time


def contenders(checkpoints: dict[str, str], exported: dict[str, str], threads: int) -> list[Contender]:
    """Batch 1 and large on the CPU and, where there is one, the GPU, of every {name: folder}; exported files and the detector where there are any."""
    found = []
    for device, large in (("cpu", 64), ("cuda", 512))[: 2 if torch.cuda.is_available() else 1]:
        for batch in (1, large):
            kinds = [
                (name, engine, folder) for name, folder in checkpoints.items() for engine in (EAGER, COMPILED)
            ]
            kinds += [(name, ONNX, file) for name, file in exported.items()] if device == "cpu" else []
            kinds += [(PAPER_SIZED, EAGER, ""), (POSE34, EAGER, "")]
            kinds += [(YOLO, LIBRARY, "")] if yolo.installed() else []
            found += [
                Contender(name, engine, device, batch, threads, source) for name, engine, source in kinds
            ]
    return found


# --- in a contender's process ----------------------------------------------------------------------------------------------------------

_here: dict[str, Any] = {}  # its stages and facts


def _prepare(contender: Contender, folder: Path) -> dict[str, int] | str:
    """Build the contender, with `folder` for what it may have to write, and run it once.

    Returns {"params", "flops"} (of one frame; a multiplication and an addition are two), or, in a line, why it cannot take part: there is no
    C++ compiler to compile with.
    """
    torch.set_num_threads(contender.threads)
    if contender.engine == LIBRARY:
        facts, stages = _detector(contender, folder / f"yolo-{contender.device}-{contender.batch}")
    else:
        facts, stages = (_dronepose if contender.name == POSE34 else _dronekeypp)(contender)
    _here.update(contender=contender, stages=stages, frames=pictures(contender.batch))
    try:
        _run(0.0)
    except Exception as error:
        if contender.engine != COMPILED:
            raise
        return f"torch.compile failed ({type(error).__name__}: {(str(error).strip().splitlines() or [''])[0][:100]})"
    return facts


def _run(seconds: float) -> dict[str, float]:
    """Seconds a frame of each stage, and of the whole, over calls that take about `seconds`; and the process's peak memory, MB."""
    contender, stages, frames = _here["contender"], _here["stages"], _here["frames"]
    spent, calls, began = dict.fromkeys(stages, 0.0), 0, time.perf_counter()
    with torch.inference_mode():
        while calls == 0 or time.perf_counter() - began < seconds:
            value = frames
            for name, stage in stages.items():
                tic = time.perf_counter()
                value = stage(value)
                if contender.device == "cuda":
                    torch.cuda.synchronize()
                spent[name] += time.perf_counter() - tic
            calls += 1
    found = {name: total / calls / contender.batch for name, total in spent.items()}
    if contender.device == "cuda":
        peak = torch.cuda.max_memory_allocated() / 1e6
    else:
        peak = _peak_memory()
    return {**found, "whole": sum(found.values()), "peak_mb": peak}


def _peak_memory() -> float:
    """Largest resident memory of this process so far, MB. On Linux not from getrusage: that hands a parent's peak on to its children."""
    try:
        status = Path("/proc/self/status").read_text()
        return (
            next(float(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM:"))
            * 1.024e-3
        )
    except (OSError, StopIteration):
        import resource  # not on Windows, see `bench`

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


def pictures(batch: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """(frame (1080, 1920, 3) uint8, box (4,)) of made-up footage."""
    rng = np.random.default_rng(0)
    frame = rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    return [
        (frame, np.array([rng.uniform(0, 1600), rng.uniform(0, 900), 240.0, 120.0])) for _ in range(batch)
    ]


def cut(
    frames: Sequence[tuple[np.ndarray, np.ndarray]], size: int, device: str
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """image (B, 3, size, size), K (B, 3, 3), square (B, 3)."""
    squares = np.stack([square_around(box) for _, box in frames])
    images = np.stack(
        [crop_image(frame, square, size) for (frame, _), square in zip(frames, squares, strict=True)]
    )
    K = (
        torch.tensor(intrinsics(1500.0, WIDTH, HEIGHT), dtype=torch.float32)
        .expand(len(frames), 3, 3)
        .contiguous()
    )
    image = torch.from_numpy(images).to(device).permute(0, 3, 1, 2).float() / 255
    return image, K.to(device), torch.tensor(squares, dtype=torch.float32, device=device)


def _facts(network: torch.nn.Module, *inputs: torch.Tensor) -> dict[str, int]:
    with torch.inference_mode(), FlopCounterMode(display=False) as counter:
        network(*inputs)
    return {"params": sum(p.numel() for p in network.parameters()), "flops": counter.get_total_flops()}


def _dronekeypp(contender: Contender) -> tuple[dict[str, int], dict[str, Callable]]:
    if contender.engine == ONNX:
        session = OnnxNetwork(contender.checkpoint, contender.threads)
        network = DroneKeyPP(session.config, load_backbone=False)  # to count in
    elif contender.name == PAPER_SIZED:
        network = DroneKeyPP(preset("paper", {"backbone_weights": None})[0])
    else:
        network, _ = load_checkpoint(contender.checkpoint)
    device, size = contender.device, network.config.image_size
    network = network.to(device).eval()
    facts = _facts(network, *cut(pictures(1), size, device))
    if contender.engine == ONNX:  # one graph: its two stages cannot be told apart
        return facts, {
            "crop": lambda frames: cut(frames, size, "cpu"),
            "network and pose": lambda inputs: session(*inputs),
        }

    def encode(image):
        return {name: value for name, value in network.encode(image).items() if name in ENCODED}

    def decode(encoded, K, square):
        found = network.decode(encoded, encoded["class_logits"].softmax(dim=-1), K, square)
        return found["R"], found["t"]

    if contender.engine == COMPILED:
        encode, decode = torch.compile(encode), torch.compile(decode)
    return facts, {
        "crop": lambda frames: cut(frames, size, device),
        "network": lambda inputs: (encode(inputs[0]), *inputs[1:]),
        "pose": lambda found: [part.cpu() for part in decode(*found)],
    }


def _dronepose(contender: Contender) -> tuple[dict[str, int], dict[str, Callable]]:
    """ResNet-34 on a crop of 224 px."""
    config, _ = preset("paper", {**DronePose.defaults, "backbone": "resnet34", "backbone_weights": None})
    network, device = DronePose(config, load_backbone=False).to(contender.device).eval(), contender.device

    def answer(inputs):
        found = network(*inputs)
        return [found[name].cpu() for name in ("R", "t")]

    facts = _facts(network, *cut(pictures(1), config.image_size, device))
    return facts, {"crop": lambda frames: cut(frames, config.image_size, device), "network and pose": answer}


def _detector(contender: Contender, folder: Path) -> tuple[dict[str, int], dict[str, Callable]]:
    """YOLOv8n-pose and PnP with the true size. Untrained the detector finds nothing, so PnP gets four points as a Mini 2 would show them."""
    library = yolo.library(folder)
    shape = {**library("yolov8n-pose.yaml").model.yaml, "kpt_shape": [4, 3], "nc": len(DRONES)}
    (folder / "yolov8n-pose.yaml").write_text(json.dumps(shape))  # JSON is YAML
    model = library(str(folder / "yolov8n-pose.yaml"))
    torch.set_num_threads(contender.threads)  # the library chose its own
    facts = _facts(model.model.eval(), torch.zeros(1, 3, YOLO_SIZE, YOLO_SIZE))
    pnp, B = PnPPose(len(DRONES)), contender.batch
    pnp.hubs.copy_(torch.tensor(np.stack([drone.hubs for drone in DRONES.values()])))
    K, label = (
        torch.tensor(intrinsics(1500.0, WIDTH, HEIGHT), dtype=torch.float32).expand(B, 3, 3),
        torch.full((B,), DRONES["Mini2"].index),
    )
    points = torch.tensor([[0.3, 0.4], [0.7, 0.4], [0.75, 0.6], [0.25, 0.6]]).expand(B, 4, 2)
    squares = torch.tensor([700.0, 400.0, 250.0]).expand(B, 3)

    def detect(images):
        return model.predict(
            list(images),
            imgsz=YOLO_SIZE,
            conf=yolo.CONFIDENCE,
            max_det=1,
            verbose=False,
            device=contender.device,
        )

    return facts, {
        "crop": lambda frames: [
            crop_image(frame, square_around(box), YOLO_SIZE)[..., ::-1] for frame, box in frames
        ],
        "network": detect,
        "pose": lambda _: pnp(from_crop(points, squares), label, K),
    }


# --- the one who asks ------------------------------------------------------------------------------------------------------------------


def named(checkpoints: Sequence[str | Path]) -> dict[str, str]:
    """{name: folder} of checkpoints of DroneKey++: the paper's network has its name, a geometric one says so; a name there was gets its folder's."""
    found: dict[str, str] = {}
    for checkpoint in checkpoints:
        name = DroneKeyPP.method + (
            ", geometric" if load_checkpoint(checkpoint)[0].config.pose == "geometric" else ""
        )
        found[name if name not in found else f"{name} ({Path(checkpoint).name})"] = str(checkpoint)
    return found


def bench(
    checkpoints: str | Path | Sequence[str | Path],
    json_file: str | Path | None = None,
    threads: int | None = None,
    rounds: int = 7,
    seconds: float = 1.0,
    chosen: Sequence[Contender] | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Measure one or several checkpoints, print the table, return (and write as JSON) {"hardware", "versions", "rows"}.

    A row: name, engine, device, batch, threads, frames_per_s (median over the rounds), ratio_to_yolov8n_pose (median of the ratios within a
    round; None without the detector), peak_mb (of its process; on a GPU of PyTorch's memory there), params, flops, stages (ms a frame).

    Raises:
        InputError: a checkpoint cannot be read, the folder of `json_file` does not exist, or this is Windows.
    """
    if json_file and not Path(json_file).resolve().parent.is_dir():  # before the work, not after it
        raise InputError(f"{json_file}: its folder does not exist; make it first")
    sources = named([checkpoints] if isinstance(checkpoints, (str, Path)) else checkpoints)
    threads = os.cpu_count() if threads is None else threads
    if os.name == "nt":
        raise InputError("bench cannot measure the memory of a process on Windows; run it in WSL")
    if rounds < 1 or threads < 1:
        raise InputError(f"rounds={rounds}, threads={threads}: at least 1 of each")
    hidden, spawn = not (progress and sys.stderr.isatty()), multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="dronekeypp-bench-")))
        if chosen is None:
            files = (
                {name: folder / f"net_{i}.onnx" for i, name in enumerate(sources)}
                if OnnxNetwork.installed()
                else {}
            )
            chosen = contenders(
                sources, {name: str(export(sources[name], file)) for name, file in files.items()}, threads
            )
        pools = [stack.enter_context(ProcessPoolExecutor(1, mp_context=spawn)) for _ in chosen]
        pairs = tqdm(list(zip(pools, chosen, strict=True)), "prepare", leave=False, disable=hidden)
        facts = [pool.submit(_prepare, contender, folder).result() for pool, contender in pairs]
        for c, fact in zip(chosen, facts, strict=True):
            if isinstance(fact, str):
                print(f"{c.name}, {c.engine}, {c.device} is left out: {fact}")
        taking_part = [isinstance(fact, dict) for fact in facts]
        pools, chosen, facts = (
            [one for one, here in zip(each, taking_part, strict=True) if here]
            for each in (pools, chosen, facts)
        )
        found: list[list[dict[str, float]]] = [[] for _ in chosen]
        for _ in tqdm(range(rounds), "rounds", leave=False, disable=hidden):
            for place, pool in enumerate(pools):
                found[place].append(pool.submit(_run, seconds).result())
    rows = [
        row_of(c, fact, mine, detector_of(c, chosen, found))
        for c, fact, mine in zip(chosen, facts, found, strict=True)
    ]
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    result = {
        "name": "speed", "hardware": {"cpu": processor(), "cores": threads, "gpu": gpu}, "rounds": rounds, "seconds": seconds,
        "versions": {"dronekeypp": __version__, "torch": torch.__version__, "python": platform.python_version()}, "rows": rows,
    }  # fmt: skip
    if progress:
        print(table(rows))
    if json_file:
        write_beside(Path(json_file), (json.dumps(result, indent=1) + "\n").encode())
    return result


def processor() -> str:
    """The CPU's name, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def detector_of(
    contender: Contender, chosen: Sequence[Contender], found: Sequence[list[dict]]
) -> list[dict] | None:
    """The rounds of the detector on the same device with the same batch."""
    same = [
        i
        for i, other in enumerate(chosen)
        if (other.name, other.device, other.batch) == (YOLO, contender.device, contender.batch)
    ]
    return found[same[0]] if same else None


def row_of(
    contender: Contender,
    facts: dict[str, int],
    mine: list[dict[str, float]],
    theirs: list[dict[str, float]] | None,
) -> dict[str, Any]:
    """A row of the result from the rounds of a contender and of the detector."""
    whole = np.array([one["whole"] for one in mine])
    ratios = np.array([one["whole"] for one in theirs]) / whole if theirs else None
    stages = {
        name: round(1000 * float(np.median([one[name] for one in mine])), 4)
        for name in mine[0]
        if name not in ("whole", "peak_mb")
    }
    described = {key: value for key, value in asdict(contender).items() if key != "checkpoint"}
    return {
        **described, "frames_per_s": round(float(1 / np.median(whole)), 2),
        "ratio_to_yolov8n_pose": None if ratios is None else round(float(np.median(ratios)), 3),
        "peak_mb": round(max(one["peak_mb"] for one in mine)), **facts, "stages": stages,
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The rows as text."""
    head = f"{'':26s} {'engine':13s} {'device':6s} {'batch':>5s} {'frames/s':>9s} {'× YOLO':>7s} {'MB':>6s}"
    lines = [f"{head} {'params':>7s} {'GFLOP':>6s}  ms a frame"]
    for row in rows:
        ratio = "–" if row["ratio_to_yolov8n_pose"] is None else f"{row['ratio_to_yolov8n_pose']:.2f}"
        stages = ", ".join(f"{name} {value:.2f}" for name, value in row["stages"].items())
        lines.append(
            f"{row['name']:26s} {row['engine']:13s} {row['device']:6s} {row['batch']:5d} {row['frames_per_s']:9.1f} {ratio:>7s} {row['peak_mb']:6d} "
            f"{row['params'] / 1e6:6.1f}M {row['flops'] / 1e9:6.2f}  {stages}"
        )
    return "\n".join(lines)
