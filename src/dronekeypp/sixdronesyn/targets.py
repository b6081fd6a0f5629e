"""This module lists what BOP's own scripts are to find in the test pictures: test_targets_bop19.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dronekeypp.files import write_json
from dronekeypp.sixdronesyn.folders import drone_of

NAME = "test_targets_bop19.json"


def targets(flights: dict[str, dict[str, Any]], edition: int) -> list[dict[str, int]]:
    """Return one target for each test picture, in the order of flights and frames.

    Args:
        flights: as the manifest of the data set lists them, see `manifest.totals`.
        edition: of the data set.
    """
    found = []
    for name, flight in sorted(flights.items()):
        if flight["split"] != "test":
            continue
        for number in sorted(flight["digests"], key=int):
            found.append(
                {
                    "scene_id": int(name),
                    "im_id": int(number),
                    "obj_id": drone_of(name, edition) + 1,
                    "inst_count": 1,
                }
            )
    return found


def write_targets(root: Path, flights: dict[str, dict[str, Any]], edition: int) -> None:
    """Write the targets of a data set in `root`, unless it has no test pictures."""
    found = targets(flights, edition)
    if found:
        write_json(root / NAME, found)
