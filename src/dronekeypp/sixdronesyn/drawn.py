"""This module knows what is drawn already in a data set's folder, and so what its settings must still fit.

A panorama or a drone of your own may be mended as long as no frame shows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dronekeypp.errors import InputError
from dronekeypp.files import read_json, write_json
from dronekeypp.sixdronesyn import bop, frame_log, scenes
from dronekeypp.sixdronesyn.folders import drone_names

PARTIAL = ".partial"  # below the data set: flights that are not finished
MOST_NAMED = 5  # flights in a message


def drawn_flights(root: Path, settings: dict[str, Any]) -> dict[Path, scenes.Subsequence]:
    """Return the flights of which a frame at least is drawn, by their folders: finished ones, and others.

    Args:
        root: the data set.
        settings: those that its manifest holds.
    """
    folders = []
    for split in scenes.SPLITS:
        folders += bop.flight_folders(root, split)
    for folder in bop.flight_folders(root, PARTIAL):
        log = folder / frame_log.NAME
        begun = log.is_file() and log.stat().st_size
        if begun or (folder / "flight.json").is_file():  # the list goes before the folder gets its name
            folders.append(folder)
    names = drone_names(settings)
    flights = {}
    for folder in folders:
        place, take = divmod(int(folder.name), 10)
        scene, number = divmod(place, scenes.MOST_DRONES[settings["edition"]])
        if scene in scenes.SCENES and number < len(names) and take < scenes.SUBSEQUENCES:
            flights[folder] = scenes.Subsequence(scene, names[number], take, number)
    return flights


def check_panoramas(
    path: Path,
    old: Mapping[str, str],
    new: Mapping[str, str],
    flights: Mapping[Path, scenes.Subsequence],
    seed: int,
) -> None:
    """Check that the panoramas are those that the flights were drawn before. Others may have changed.

    Args:
        path: of the manifest, for messages.
        old, new: {name of the file: digest}, of the data set and of now.
        flights: what is drawn.
        seed: that of the data set.

    Raises:
        InputError: they are not. The message names the panorama and the flights.
    """
    if old.keys() != new.keys():
        missing = sorted(old.keys() - new.keys())
        other = missing or sorted(new.keys() - old.keys())
        raise InputError(
            f"{path}: this data set was begun with another set of panoramas: "
            f"{other[0]} was {'there' if missing else 'not there'}; "
            f"{'put it back' if missing else 'take it away'}, or choose another folder"
        )
    for place, name in enumerate(new):
        if old[name] == new[name]:
            continue
        shown = [folder for folder, flight in flights.items() if _shows(flight, place, len(new), seed)]
        if shown:
            raise InputError(
                f"{path}: {name} is not the panorama that flights were drawn before; "
                f"put the old one back, or delete {_listed(shown)} and run generate again"
            )


def _shows(flight: scenes.Subsequence, environment: int, environments: int, seed: int) -> bool:
    """Tell whether a flight is before this environment; a drone that is not known here may be before any."""
    try:
        return scenes.background(flight, environments, seed)[0] == environment
    except InputError:
        return True


def flights_of(drone: str, flights: Mapping[Path, scenes.Subsequence]) -> str:
    """Return the folders of a drone's flights for a message; it is empty where none is drawn."""
    return _listed([folder for folder, flight in flights.items() if flight.drone == drone])


def _listed(folders: list[Path]) -> str:
    """Return folders for a message, the first few by name."""
    names = [f"{folder.parent.name}/{folder.name}" for folder in folders]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more


def forget_model(root: Path, number: int) -> None:
    """Take an object out of models_info.json, so that its mesh is written anew.

    Args:
        root: the data set.
        number: of the object, from 1.
    """
    path = root / bop.MODELS / "models_info.json"
    info = read_json(path) if path.is_file() else None
    if isinstance(info, dict) and info.pop(str(number), None) is not None:
        write_json(path, info, indent=1)
