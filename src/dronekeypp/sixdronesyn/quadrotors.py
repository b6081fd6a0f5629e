"""This module draws random quadrotors: number n from a seed, without end.

Being written.
"""

from functools import lru_cache

from dronekeypp.sixdronesyn.drone import Drone

PREFIX = "Quad"


def number_of(name: str) -> int | None:
    """Return the number of a random quadrotor's name ("Quad17" is 17), or None for any other name."""
    digits = name.removeprefix(PREFIX)
    return int(digits) if name.startswith(PREFIX) and digits.isdecimal() else None


def name_of(number: int) -> str:
    """Return the name of random quadrotor `number`."""
    return f"{PREFIX}{number}"


def split_of(number: int) -> str:
    """Return the split that quadrotor `number` flies in: eight of ten train, one validates, one tests."""
    return {8: "val", 9: "test"}.get(number % 10, "train")


@lru_cache(maxsize=64)
def quadrotor(number: int, seed: int = 0) -> Drone:
    """Return quadrotor `number`."""
    raise NotImplementedError
