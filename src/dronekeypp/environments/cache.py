"""Which panoramas stand behind the drones: a folder of the user's own, or the 22 procedural ones.

The procedural ones are drawn once, in about 100 seconds of one core, and then read from a cache on disk.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import cv2
import joblib
from tqdm import tqdm

from dronekeypp.environments import ENVIRONMENTS, render_environment
from dronekeypp.errors import InputError
from dronekeypp.files import remove_unfinished, write_beside
from dronekeypp.processes import end_with_parent

SUFFIXES = {".jpg", ".jpeg", ".png"}


def cache_folder() -> Path:
    """Return the folder where drawn panoramas are cached. It is safe to delete.

    It is $DRONEKEYPP_CACHE if that is set, else `dronekeypp` in $XDG_CACHE_HOME, else ~/.cache/dronekeypp.
    """
    own_folder = os.environ.get("DRONEKEYPP_CACHE")
    if own_folder:
        return Path(own_folder)
    user_cache = os.environ.get("XDG_CACHE_HOME")
    if user_cache:
        return Path(user_cache) / "dronekeypp"
    return Path.home() / ".cache" / "dronekeypp"


def environment_files(
    directory: str | Path | None = None, workers: int = 1, progress: bool = True
) -> list[Path]:
    """Return the paths of the equirectangular images, in a fixed order.

    Args:
        directory: a folder of JPEG or PNG images; they are sorted by path. None for the 22 procedural
            environments, in the order of `ENVIRONMENTS`. Those that are not in the cache yet are drawn first.
        workers: processes that draw.
        progress: whether a progress bar is shown while drawing.

    Raises:
        InputError: there is no such folder, or no image in it.
    """
    if directory is not None:
        return _images_in(Path(directory))
    folder = cache_folder() / f"environments-{_code_version()}"
    files = [folder / f"{name}.jpg" for name in ENVIRONMENTS]
    missing = [file for file in files if not file.exists()]
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        remove_unfinished(folder, [file.name for file in files])
        jobs = [joblib.delayed(_draw)(file) for file in missing]
        workers = min(workers, len(missing))
        pool = joblib.Parallel(workers, return_as="generator_unordered", initializer=end_with_parent)
        for _ in tqdm(pool(jobs), total=len(missing), unit="panorama", disable=None if progress else True):
            pass
    return files


def _images_in(folder: Path) -> list[Path]:
    """Return the images in a folder, sorted. Raises InputError as `environment_files` does."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder of environments")
    files = sorted(file for file in folder.iterdir() if _is_image(file))
    if not files:
        raise InputError(f"{folder}: no .jpg or .png in it; put equirectangular 2:1 images there")
    return files


def _is_image(file: Path) -> bool:
    """Tell whether a file is meant: one with the suffix of an image, which no program hides."""
    return file.suffix.lower() in SUFFIXES and not file.name.startswith(".")


def _code_version() -> str:
    """Return a digest of the drawing code, so that changed code never meets pictures that older code drew."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        if source.name != Path(__file__).name:
            digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


def _draw(path: Path) -> None:
    """Draw the environment that `path` is named after, and write it there as a JPEG.

    The file appears at once under its name: another process that draws the same one does no harm.
    """
    image = cv2.cvtColor(render_environment(path.stem), cv2.COLOR_RGB2BGR)
    write_beside(path, cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes())
