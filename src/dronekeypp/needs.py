"""`python -m dronekeypp check`: what the course needs of this machine: [ok]; [missing], with the mend; [extra], it can do without."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dronekeypp.errors import InputError

ROOT = Path(__file__).parents[2]
SAMPLES = ("backbone/compact.safetensors", "checkpoint/model.safetensors", "beyond/model.safetensors", "crops/manifest.json",
           "frames/manifest.json", "flight/manifest.json", "results/table3.json")  # fmt: skip
FREE_GB, MEMORY_GB = 2, 4  # for notebooks and tests, beside the installation


@dataclass(frozen=True)
class Need:
    """One need: `look` returns what was found and raises InputError, with the mend, if it is missing; an optional one is never an error."""

    name: str
    look: Callable[[], str]
    optional: bool = False


def python() -> str:
    if sys.version_info < (3, 11):  # noqa: UP036 (whoever has another Python is who should read this)
        raise InputError(
            f"this is Python {sys.version.split()[0]}: make the environment with Python 3.11 or newer"
        )
    return sys.version.split()[0]


def packages() -> str:
    """Every package of environment.txt, whatever its version; other versions than the tested ones are named."""
    wanted = re.findall(r"^([\w-]+)(?:\[\w+\])?==(\S+)$", (ROOT / "environment.txt").read_text(), re.M)
    missing, others = [], []
    for name, version in wanted:
        try:
            there = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
            continue
        if there.partition("+")[0] != version:
            others.append(f"{name} {there} (tested: {version})")
    if missing:
        raise InputError(f"{', '.join(missing)}: pip install -r environment.txt")
    return f"{len(wanted)} packages" + (f", of other versions: {', '.join(others)}" if others else "")


def opengl() -> str:
    from dronekeypp.sixdronesyn.render import check_opengl

    check_opengl()
    return "a picture was rendered off-screen"


def samples() -> str:
    missing = [name for name in SAMPLES if not (ROOT / "data_samples" / name).is_file()]
    if missing:
        raise InputError(
            f"data_samples/{missing[0]}"
            + (f" and {len(missing) - 1} more" if len(missing) > 1 else "")
            + ": git checkout data_samples"
        )
    return "all there"


def video() -> str:
    """`predict` writes its overlay with OpenCV."""
    import cv2
    import numpy as np

    with tempfile.TemporaryDirectory() as folder:
        writer = cv2.VideoWriter(str(Path(folder) / "a.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 30, (64, 64))
        if not writer.isOpened():
            raise InputError(
                "OpenCV cannot write an mp4: use the wheel opencv-python-headless, or predict --no-overlay"
            )
        writer.write(np.zeros((64, 64, 3), np.uint8))
        writer.release()
    return "mp4 can be written"


def disk() -> str:
    free = shutil.disk_usage(ROOT).free / 1e9
    if free < FREE_GB:
        raise InputError(f"{free:.1f} GB free, {FREE_GB} needed: make room")
    return f"{free:.0f} GB free"


def memory() -> str:
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    except (ValueError, OSError, AttributeError):  # Windows does not tell
        return "not known here"
    if total < MEMORY_GB:
        raise InputError(
            f"{total:.1f} GB, {MEMORY_GB} needed: close something, or run the notebooks one at a time"
        )
    return f"{total:.0f} GB"


def dataset() -> str:
    if not (ROOT / "data" / "6dronesyn" / "manifest.json").is_file():
        raise InputError(
            "not rendered; the notebooks do without. python -m dronekeypp generate data/6dronesyn --workers 2"
        )
    return "data/6dronesyn"


def gpu() -> str:
    import torch

    if not torch.cuda.is_available():
        raise InputError("none; every preset trains without")
    return torch.cuda.get_device_name()


def onnx() -> str:
    from dronekeypp.export import EXTRA, need

    need(*EXTRA)
    return "export and the exported file"


def detector() -> str:
    from dronekeypp.baselines import yolo

    if not yolo.installed():
        raise InputError('the detector of Table 3: pip install -e ".[yolo]" (AGPL-3.0)')
    return "YOLOv8n-pose"


NEEDS = (
    Need("Python", python), Need("packages", packages), Need("OpenGL", opengl), Need("sample data", samples), Need("video", video),
    Need("disk", disk), Need("memory", memory), Need("6DroneSyn", dataset, True), Need("GPU", gpu, True), Need("ONNX", onnx, True),
    Need("YOLO", detector, True),
)  # fmt: skip


def check() -> bool:
    """Print a line for every need; returns whether all that are not optional are met."""
    met = True
    for need in NEEDS:
        try:
            sign, text = "[ok]", need.look()
        except InputError as error:
            sign, text = ("[extra]" if need.optional else "[missing]"), str(error)
            met = met and need.optional
        except ImportError as error:
            sign, text, met = "[missing]", f"{error}: pip install -r environment.txt", False
        print(f"{sign:9s} {need.name:12s} {text}")
    return met
