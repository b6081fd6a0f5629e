"""This module writes the drones' numbers, and where each is from, as Markdown tables."""

from collections.abc import Sequence

import numpy as np

from dronekeypp.sixdronesyn.drone import Drone
from dronekeypp.sixdronesyn.measured import MEASURED, rms_after_rigid_fit

HEAD = (
    "drone",
    "wheelbase",
    "across front",
    "across rear",
    "fore to aft",
    "front above rear",
    "propeller",
    "length x width x height",
    "motor radius",
    "nose up, degrees",
    "mass, g",
)
LEGEND = (
    "Millimetres unless said. p: published, m: measured on a model that others made, e: estimated, "
    "?: not written down. Colours and the width of blades are estimated."
)


def hub_distances(hubs: np.ndarray) -> tuple[float, float, float, float]:
    """Return four distances of hubs (4, 3), in their unit.

    They are: across the front, across the rear, fore to aft, and front above rear.
    """
    front, rear = hubs[:2].mean(axis=0), hubs[2:].mean(axis=0)
    across_front = float(np.linalg.norm(hubs[0] - hubs[1]))
    across_rear = float(np.linalg.norm(hubs[3] - hubs[2]))
    return across_front, across_rear, float(front[0] - rear[0]), float(front[2] - rear[2])


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of cells as a Markdown table; the first row is its head."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    lines.insert(1, "|---" * len(rows[0]) + "|")
    return "\n".join(lines)


def _numbers(drone: Drone) -> list[str]:
    """Return a drone's row of the table, each number with the first letter of its source."""
    distances = hub_distances(1000 * drone.hubs)
    values = [
        ("wheelbase", f"{1000 * drone.wheelbase:.0f}"),
        *[("hubs", f"{distance:.0f}") for distance in distances],
        ("propeller_diameter", f"{1000 * drone.propeller_diameter:.0f}"),
        ("body_mm", " x ".join(f"{size:g}" for size in drone.body_mm)),
        ("motor_radius", f"{1000 * drone.motor_radius:.1f}"),
        ("hull_pitch", f"{np.degrees(drone.hull_pitch):.1f}"),
        ("mass", f"{1000 * drone.mass:.0f}"),
    ]
    return [drone.label, *[f"{value} {drone.sources.get(field, '?')[0]}" for field, value in values]]


def _notes(drone: Drone) -> list[str]:
    """Return a line for each source of a drone that has a note."""
    lines = []
    for field, source in drone.sources.items():
        kind, colon, note = source.partition(": ")
        if colon:
            lines.append(f"- {drone.label}, {field}, {kind}: {note}")
    return lines


def _fits(drones: Sequence[Drone]) -> list[list[str]]:
    """Return rows that compare the drones' hubs with the measured ones, or say that there are none."""
    rows = [
        ["drone", "measured on", "RMS after a rigid fit, mm", "the same, measured hubs at our diagonal, mm"]
    ]
    for drone in drones:
        fits = [one for one in MEASURED if one.drone == drone.name]
        for one in fits:
            hubs, measured = 1000 * drone.hubs, np.array(one.hubs_mm)
            scale = np.linalg.norm(hubs[0] - hubs[2]) / np.linalg.norm(measured[0] - measured[2])
            rigid = rms_after_rigid_fit(hubs, measured)
            scaled = rms_after_rigid_fit(hubs, scale * measured)
            rows.append([drone.label, one.source, f"{rigid:.1f}", f"{scaled:.1f}"])
        if not fits:
            rows.append([drone.label, "not measured", "-", "-"])
    return rows


def shape_table(drones: Sequence[Drone]) -> str:
    """Return Markdown that gives the drones' numbers, where each is from, and how far measured hubs are.

    Every field of the second edition's drones has a source. The retired shapes of the first do not say all.
    """
    table = _markdown([HEAD, *[_numbers(drone) for drone in drones]])
    notes = []
    for drone in drones:
        notes += _notes(drone)
    return "\n\n".join([table, LEGEND, "\n".join(notes), _markdown(_fits(drones))])
