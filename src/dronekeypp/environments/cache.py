"""Which panoramas stand behind the drones: a folder of the user's, or the 22 procedural ones, drawn once and kept in a cache."""

import hashlib
import os
from pathlib import Path

import cv2
import joblib
from tqdm import tqdm

from dronekeypp.environments import ENVIRONMENTS, render_environment
from dronekeypp.errors import InputError

SUFFIXES = {".jpg", ".jpeg", ".png"}


def cache_folder():
    """Where drawn panoramas are kept: $DRONEKEYPP_CACHE, else the user's cache folder. Safe to delete."""
    base = os.environ.get("DRONEKEYPP_CACHE")
    return (
        Path(base)
        if base
        else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dronekeypp"
    )


def environment_files(directory=None, workers=1, progress=True):
    """Paths of the equirectangular images, in a fixed order.

    Args:
        directory: a folder of them (JPEG or PNG, sorted by name); None for the procedural ones, drawn first where they are missing.

    Raises:
        InputError: no such folder, or no image in it.
    """
    if directory is not None:
        directory = Path(directory)
        if not directory.is_dir():
            raise InputError(f"{directory}: no such folder of environments")
        files = sorted(p for p in directory.iterdir() if p.suffix.lower() in SUFFIXES)
        if not files:
            raise InputError(f"{directory}: no .jpg or .png in it; put equirectangular 2:1 images there")
        return files
    # The drawing code's own digest is part of the name: a changed painter never leaves old pictures behind.
    painters = sorted(p for p in Path(__file__).parent.glob("*.py") if p.name != Path(__file__).name)
    version = hashlib.sha256(b"".join(p.read_bytes() for p in painters)).hexdigest()[:12]
    folder = cache_folder() / f"environments-{version}"
    files = [folder / f"{name}.jpg" for name in ENVIRONMENTS]
    missing = [f for f in files if not f.exists()]
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        jobs = (joblib.delayed(_paint)(f) for f in missing)
        done = joblib.Parallel(n_jobs=min(workers, len(missing)), return_as="generator_unordered")(jobs)
        for _ in tqdm(done, total=len(missing), unit="panorama", disable=None if progress else True):
            pass
    return files


def _paint(path):
    image = render_environment(path.stem)
    beside = path.with_name(f".{path.stem}.{os.getpid()}.jpg")
    cv2.imwrite(str(beside), cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 92])
    beside.replace(path)
