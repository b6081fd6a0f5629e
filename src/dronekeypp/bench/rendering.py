"""This module measures how fast `generate` renders."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

SIZE = 128  # of the crops, pixels


def rendering_speed(
    workers: int,
    scene_numbers: tuple[int, ...] = (6, 7),
    drone_names: tuple[str, ...] | None = None,
    stride: int = 1,
) -> dict[str, Any]:
    """Render crops of the second edition, and return how many a second.

    The start-up does not count: the panoramas are drawn, and the processes and their windows are there, when
    the clock starts.

    Args:
        workers: the number of processes.
        scene_numbers, drone_names, stride: what is rendered, as in `generate`.

    Returns:
        {"frames", "size", "workers", "frames_per_s"}.

    Raises:
        InputError: this machine cannot render.
        ImportError: pyvista is not installed, which nothing else here needs.
    """
    from dronekeypp.sixdronesyn.generate import generate

    def render(folder: Path, stride: int) -> int:
        scenes, drones = list(scene_numbers), drone_names and list(drone_names)
        manifest = generate(
            folder, scenes, drones, size=SIZE, stride=stride, workers=workers, progress=False, edition=2
        )
        return manifest["planned_frames"]

    with tempfile.TemporaryDirectory(prefix="dronekeypp-bench-") as folder:
        render(Path(folder) / "start-up", stride=60)
        start = time.perf_counter()
        frames = render(Path(folder) / "timed", stride=stride)
        seconds = time.perf_counter() - start
    return {"frames": frames, "size": SIZE, "workers": workers, "frames_per_s": round(frames / seconds, 1)}
