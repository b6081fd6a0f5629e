"""The domain table: trained {before drawn environments, before photographs} × tested {the same two}.

The paper puts its drones before 360° photographs and says they close the gap to reality. This measures what the background alone does:
drones, flights, cameras and budget are the same, and photographs are split by panorama, as the drawn environments are.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from dronekeypp.environments.cache import environment_files
from dronekeypp.errors import InputError
from dronekeypp.files import write_beside
from dronekeypp.reproduce.runner import Bench, Run, describe, result, rows_and_averages, write_result
from dronekeypp.reproduce.tables import average, interval, methods, percent

DOMAINS = ("drawn", "photographs")
RUN = Run("DroneKey++")  # the one of Table 3: trained before drawn environments it is the same run


def reproduce(bench: Bench, photographs: Path, seeds: int = 1) -> dict[str, Any]:
    """Train and measure whatever of the four cells is missing. Returns the recorded result.

    Raises:
        InputError: `photographs` is no folder of at least six equirectangular images (with fewer the splits would share them).
    """
    if len(environment_files(photographs)) < 6:
        raise InputError(f"{photographs}: a split by panorama needs six images or more")
    other = dataclasses.replace(
        bench,
        data=bench.data.with_name(bench.data.name + "-photographs"),
        environments=photographs,
        group=bench.group + "-photographs",
    )
    benches = dict(zip(DOMAINS, (bench, other), strict=True))
    for each in benches.values():
        each.render()
    rows, means, stories = [], [], []
    for seed in range(seeds):
        for trained, source in benches.items():
            for tested, target in benches.items():
                frames = source.measure(RUN, seed, name=f"test-{tested}", data=target.data)[None]
                labels = {
                    "method": RUN.method,
                    "variant": f"trained {trained}, tested {tested}",
                    "seed": seed,
                }
                found = rows_and_averages(frames, **labels)
                rows += found[0]
                means += found[1]
            stories.append({**source.story(RUN, seed), "trained": trained})
            recorded = result(
                "domains",
                bench,
                stories,
                datasets={d: describe(b.data) for d, b in benches.items()},
                rows=rows,
                averages=means,
            )
            write_result(bench.root, recorded)
            (bench.root / "figures").mkdir(exist_ok=True)
            write_beside(bench.root / "figures" / "domains.md", markdown(recorded).encode())
    return recorded


def markdown(recorded: dict[str, Any]) -> str:
    """One line a cell, with 95 % intervals over the 14 sequences."""
    lines = [
        "# What a background is worth: DroneKey++ trained and tested before drawn and photographed environments",
        "",
        "| trained | tested | R MAE (deg) | R MedAE (deg) | t MAE (m) | t MedAE (m) | class | keypoints (px) |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for method, variant in methods(recorded):
        row = average(recorded, method, variant)
        trained, tested = (part.split()[1] for part in variant.split(", "))
        cells = [
            interval(row, key, digits)
            for key, digits in (("R_mae_deg", 2), ("R_medae_deg", 2), ("t_mae_m", 3), ("t_medae_m", 3))
        ]
        lines.append(
            f"| {trained} | {tested} | {' | '.join(cells)} | {percent(row['class_accuracy'])} | {row['keypoint_px']:.1f} |"
        )
    return "\n".join(lines) + "\n"
