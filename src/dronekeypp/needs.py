"""`python -m dronekeypp check` says what the course needs of this machine.

It prints a line for each need: [ok]; [missing], with the mend; or [extra] for what it can do without. Nothing
but Python itself is imported before it is asked for, so the command runs before anything is installed.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dronekeypp.errors import InputError
from dronekeypp.processes import total_memory

PINNED = "environment.txt"  # of the repository: the packages, with the versions that are tested
SAMPLES = (
    "backbone/compact.safetensors",
    "checkpoint/model.safetensors",
    "beyond/model.safetensors",
    "crops/manifest.json",
    "frames/manifest.json",
    "flight/manifest.json",
    "results/table3.json",
)
FREE_GB, MEMORY_GB = 2, 4  # for notebooks and tests, beside the installation


@dataclass(frozen=True)
class Need:
    """A need is one thing that the course needs of this machine.

    `look` returns what it found, and raises InputError with the mend if something is missing. An optional
    need is never an error.
    """

    name: str
    look: Callable[[], str]
    optional: bool = False


def repository() -> Path | None:
    """Return the folder of the repository, or None where the package was installed without it."""
    try:
        from dronekeypp.files import repository_root
    except ImportError:  # a package that it needs may be among the missing ones
        folder = Path(__file__).parents[2]
        return folder if (folder / PINNED).is_file() else None
    try:
        return repository_root()
    except InputError:
        return None


def workplace() -> Path:
    """Return where data sets are made: in the repository or, without it, in the current folder."""
    return repository() or Path.cwd()


def python() -> str:
    if sys.version_info < (3, 11):  # noqa: UP036 (whoever has another Python is who should read this)
        raise InputError(
            f"this is Python {sys.version.split()[0]}: make the environment with Python 3.11 or newer"
        )
    return sys.version.split()[0]


def packages() -> str:
    """Check that every package that is needed is installed, whatever its version.

    The answer names the packages of other versions than the tested ones.

    Raises:
        InputError: a package is missing.
    """
    wanted = required_packages()
    missing, others = [], []
    for name, tested in wanted.items():
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
            continue
        if tested and version.partition("+")[0] != tested:
            others.append(f"{name} {version} (tested: {tested})")
    if missing:
        raise InputError(f"{', '.join(missing)}: {_install()}")
    return f"{len(wanted)} packages" + (f", of other versions: {', '.join(others)}" if others else "")


def required_packages() -> dict[str, str | None]:
    """Return the packages by name, with their tested version where it is known.

    They are those of environment.txt or, without the repository, those that the installed package names.
    """
    folder = repository()
    if folder is not None:
        text = (folder / PINNED).read_text(encoding="utf-8")
        return dict(re.findall(r"^([\w-]+)(?:\[\w+\])?==(\S+)$", text, re.M))
    try:
        requirements = importlib.metadata.requires("dronekeypp") or []
    except importlib.metadata.PackageNotFoundError:
        raise InputError("dronekeypp itself is not installed: install it with pip") from None
    names: dict[str, str | None] = {}
    for requirement in requirements:
        name, _, condition = requirement.partition(";")
        if "extra" not in condition:
            names[re.match(r"[\w.-]+", name)[0]] = None
    return names


def _install() -> str:
    """Return how to install missing packages."""
    return "install dronekeypp again, with pip" if repository() is None else f"pip install -r {PINNED}"


def opengl() -> str:
    from dronekeypp.sixdronesyn.render import check_opengl

    check_opengl()
    return "a picture was rendered off-screen"


def samples() -> str:
    folder = repository()
    if folder is None:
        raise InputError("data_samples/ comes with the repository only: clone the repository")
    missing = [name for name in SAMPLES if not (folder / "data_samples" / name).is_file()]
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise InputError(f"data_samples/{missing[0]}{more}: git checkout data_samples")
    return "all there"


def video() -> str:
    """Check that OpenCV can write a video, because `predict` writes its overlay with it."""
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
    free = shutil.disk_usage(workplace()).free / 1e9
    if free < FREE_GB:
        raise InputError(f"{free:.1f} GB free, {FREE_GB} needed: make room")
    return f"{free:.0f} GB free"


def memory() -> str:
    whole = total_memory()
    if whole is None:
        return "not known here"
    total = whole / 1e9
    if total < MEMORY_GB:
        raise InputError(
            f"{total:.1f} GB, {MEMORY_GB} needed: close something, or run the notebooks one at a time"
        )
    return f"{total:.0f} GB"


def dataset() -> str:
    if not (workplace() / "data" / "6dronesyn" / "manifest.json").is_file():
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
    from dronekeypp.exported import EXTRA, require_packages

    require_packages(*EXTRA)
    return "export and the exported file"


def detector() -> str:
    from dronekeypp.baselines import yolo

    if not yolo.installed():
        raise InputError('the detector of Table 3: pip install -e ".[yolo]" (AGPL-3.0)')
    return "YOLOv8n-pose"


def cluster() -> str:
    if importlib.util.find_spec("distributed") is None:
        raise InputError('`generate` on a cluster: pip install -e ".[dask]"')
    return "generate on a cluster"


NEEDS = (
    Need("Python", python),
    Need("packages", packages),
    Need("OpenGL", opengl),
    Need("sample data", samples),
    Need("video", video),
    Need("disk", disk),
    Need("memory", memory),
    Need("6DroneSyn", dataset, optional=True),
    Need("GPU", gpu, optional=True),
    Need("ONNX", onnx, optional=True),
    Need("YOLO", detector, optional=True),
    Need("Dask", cluster, optional=True),
)


def check() -> bool:
    """Print a line for every need, and return whether all that are not optional are met."""
    met = True
    for need in NEEDS:
        try:
            sign, text = "[ok]", need.look()
        except InputError as error:
            sign, text = ("[extra]" if need.optional else "[missing]"), str(error)
            met = met and need.optional
        except ImportError as error:
            sign, text, met = "[missing]", f"{error}: {_install()}", False
        print(f"{sign:9s} {need.name:12s} {text}")
    return met
