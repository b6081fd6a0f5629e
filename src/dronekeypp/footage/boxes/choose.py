"""Choose the drone's box of each frame, and count what becomes of all the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from dronekeypp.errors import InputError
from dronekeypp.footage.boxes.content import BoxRow, Kind

LISTED = 8  # kinds that a message names


def choose_kind(path: Path, rows: Sequence[BoxRow], wanted: Sequence[str]) -> list[BoxRow]:
    """Return the boxes of the wanted classes.

    Args:
        path: the file, for messages.
        rows: the boxes on frames of the footage.
        wanted: names or numbers of classes; none, where the file has only one.

    Raises:
        InputError: There are several classes and none is chosen, or a chosen one is not there.
    """

    def names(kind: Kind) -> set[str]:
        return {str(kind), kind.number or "", kind.name or ""} - {""}

    kinds = Counter(row.kind for row in rows)
    if not wanted and len(kinds) <= 1:
        return list(rows)
    if wanted and set(kinds) == {None}:
        raise InputError(f"{path}: its boxes have no class; leave --class out")
    if not wanted or None in kinds:
        raise InputError(
            f"{path}: boxes of several classes: {_listed(kinds)}"
            + ("; give every box its class" if None in kinds else "; choose with --class")
        )
    _check_wanted(path, "class", wanted, kinds, names)
    return [row for row in rows if row.kind and names(row.kind) & set(wanted)]


def choose_track(path: Path, rows: Sequence[BoxRow], wanted: Sequence[str]) -> list[BoxRow]:
    """Return the boxes of the wanted tracks. Where the file has tracks, boxes without one are left out.

    The arguments and what is raised are as in `choose_kind`.
    """
    tracks = Counter(row.track for row in rows if row.track is not None)
    if not wanted and not tracks:
        return list(rows)
    if not wanted and len(tracks) > 1:
        raise InputError(f"{path}: boxes of several tracks: {_listed(tracks)}; choose with --track")
    if wanted:
        _check_wanted(path, "track", wanted, tracks, lambda track: {track})
    return [row for row in rows if row.track is not None and (not wanted or row.track in wanted)]


def _check_wanted(
    path: Path, what: str, wanted: Sequence[str], found: Counter, names: Callable[..., set[str]]
) -> None:
    """Refuse a choice that the file does not have."""
    known = {name for thing in found for name in names(thing)}
    for name in wanted:
        if name not in known:
            raise InputError(f"{path}: no {what} {name} on these frames; it has {_listed(found) or 'none'}")


def _listed(found: Counter) -> str:
    """Return kinds and how many boxes each has."""
    listed = []
    for kind, count in found.most_common(LISTED):
        listed.append(f"{'none' if kind is None else kind} in {count}")
    return ", ".join(listed) + (" …" if len(found) > LISTED else "")


def surest(path: Path, rows: Sequence[BoxRow], frame: str) -> BoxRow:
    """Return the box of a frame with the highest score.

    Raises:
        InputError: Several boxes have it, or one has no score.
    """
    if len({row.box for row in rows}) == 1:
        return rows[0]
    scores = [row.score for row in rows if row.score is not None]
    best = [row for row in rows if row.score is not None and row.score == max(scores)]
    if len(scores) < len(rows) or len({row.box for row in best}) > 1:
        raise InputError(
            f"{path}: frame {frame} has {len(rows)} boxes, and no score tells which is the drone's: "
            f"{rows[0].where}, {rows[1].where}; leave one, or choose with --class or --track"
        )
    return best[0]
