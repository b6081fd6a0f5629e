"""This module draws random quadrotors: number n from a seed, without end.

A quadrotor is a wheelbase, a family of bodies that is built at that size, hubs, propellers, a mass and
colours. Its body follows from the same numbers (see quadrotor_bodies.py). Data sets always use seed 0, so the
name alone says which quadrotor it is. Lengths are metres in the body frame, and shares of the wheelbase in
the table of families.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn.drone import Drone, spread_hubs
from dronekeypp.sixdronesyn.quadrotor_colours import colours

PREFIX = "Quad"
WHEELBASE = (0.08, 0.8)  # metres, the smallest and the largest
NUMBERS, COLOURS = 1, 2  # what a generator is for; the body's is in quadrotor_plan.py
CLEARANCE = 0.995  # of the room between two hubs, the most that a propeller's diameter may take

Range = tuple[float, float]


@dataclass(frozen=True)
class Family:
    """A family of bodies has ranges that its quadrotors are drawn from.

    Attributes:
        weight: how often it is chosen among the families of a size.
        size: the wheelbases that it is built with, metres.
        height: the height on the ground without antennas, as a share of the wheelbase.
        hub_height: the height of the hubs above the ground, as a share of that height.
        aspect: the logarithm of how far apart left and right hubs are, over front and rear.
        taper: the logarithm of the front hubs' distance over the rear hubs'.
        rise: how far the front hubs lie above the rear ones, as a share of the wheelbase.
        propeller: the diameter, as a share of the room between neighbouring hubs.
        motor: the motor's radius as a share of the wheelbase, for a wheelbase of 0.3 m.
        three_blades: how often a propeller has three blades; a quarter as often it has four.
    """

    weight: float
    size: Range
    height: Range
    hub_height: Range
    aspect: Range
    taper: Range
    rise: Range
    propeller: Range
    motor: Range
    three_blades: float


FAMILIES: dict[str, Family] = {
    # a smooth hull with arms that fold and a camera on a gimbal in front
    "folding": Family(
        weight=3.4,
        size=(0.11, 0.60),
        height=(0.21, 0.33),
        hub_height=(0.68, 0.98),
        aspect=(-0.2, 0.42),
        taper=(-0.12, 0.28),
        rise=(-0.07, 0.08),
        propeller=(0.78, 0.99),
        motor=(0.038, 0.05),
        three_blades=0.06,
    ),
    # a moulded shell whose arms are part of it, on landing legs
    "shell": Family(
        weight=2.0,
        size=(0.11, 0.65),
        height=(0.34, 0.58),
        hub_height=(0.74, 0.92),
        aspect=(-0.1, 0.2),
        taper=(-0.08, 0.1),
        rise=(-0.02, 0.02),
        propeller=(0.78, 0.98),
        motor=(0.036, 0.05),
        three_blades=0.05,
    ),
    # carbon plates, a battery under a strap and a camera that looks up
    "racer": Family(
        weight=1.8,
        size=(0.09, 0.40),
        height=(0.21, 0.31),
        hub_height=(0.36, 0.5),
        aspect=(-0.3, 0.3),
        taper=(-0.12, 0.25),
        rise=(0.0, 0.0),
        propeller=(0.72, 0.94),
        motor=(0.046, 0.062),
        three_blades=0.72,
    ),
    # two plates with round or moulded arms
    "plate": Family(
        weight=1.2,
        size=(0.20, 0.80),
        height=(0.24, 0.46),
        hub_height=(0.62, 0.85),
        aspect=(-0.2, 0.2),
        taper=(-0.12, 0.12),
        rise=(-0.01, 0.01),
        propeller=(0.6, 0.92),
        motor=(0.036, 0.048),
        three_blades=0.05,
    ),
    # a ring around every propeller
    "ducted": Family(
        weight=1.1,
        size=(0.08, 0.26),
        height=(0.24, 0.38),
        hub_height=(0.5, 0.68),
        aspect=(-0.18, 0.18),
        taper=(-0.05, 0.05),
        rise=(0.0, 0.0),
        propeller=(0.74, 0.86),
        motor=(0.05, 0.065),
        three_blades=0.6,
    ),
    # a small moulded body on thin legs, now and then with guards
    "toy": Family(
        weight=1.4,
        size=(0.08, 0.32),
        height=(0.26, 0.4),
        hub_height=(0.78, 0.98),
        aspect=(-0.18, 0.22),
        taper=(-0.06, 0.12),
        rise=(-0.02, 0.02),
        propeller=(0.66, 0.93),
        motor=(0.032, 0.042),
        three_blades=0.15,
    ),
    # a box with batteries and antennas on tall legs
    "enterprise": Family(
        weight=2.4,
        size=(0.30, 0.80),
        height=(0.34, 0.56),
        hub_height=(0.7, 0.92),
        aspect=(-0.12, 0.34),
        taper=(-0.1, 0.2),
        rise=(-0.05, 0.05),
        propeller=(0.66, 0.96),
        motor=(0.036, 0.046),
        three_blades=0.04,
    ),
}

RINGED = ("ducted", "toy")  # the families with something around the propellers


def number_of(name: str) -> int | None:
    """Return the number of a random quadrotor's name ("Quad17" is 17), or None for any other name."""
    digits = name.removeprefix(PREFIX)
    if not digits.isdecimal():
        return None
    return int(digits) if name_of(int(digits)) == name else None


def name_of(number: int) -> str:
    """Return the name of random quadrotor `number`."""
    return f"{PREFIX}{number}"


def split_of(number: int) -> str:
    """Return the split that quadrotor `number` flies in.

    Numbers that end in 0 to 7 are for training, in 8 for validation, in 9 for the test.
    """
    return {8: "val", 9: "test"}.get(number % 10, "train")


def _family(wheelbase: float, rng: np.random.Generator) -> str:
    """Return the family of a quadrotor of that wheelbase in metres."""
    fitting = [name for name, family in FAMILIES.items() if family.size[0] <= wheelbase <= family.size[1]]
    weights = np.array([FAMILIES[name].weight for name in fitting])
    return fitting[rng.choice(len(fitting), p=weights / weights.sum())]


def _hubs(family: Family, wheelbase: float, height: float, rng: np.random.Generator) -> np.ndarray:
    """Return hubs (4, 3) in metres for a drone of that wheelbase and height in metres."""
    level = (rng.uniform(*family.hub_height) - 0.5) * height
    rise = rng.uniform(*family.rise) * wheelbase
    aspect = np.exp(rng.uniform(*family.aspect))
    taper = np.exp(rng.uniform(*family.taper))
    if rng.random() < 0.25:
        aspect, taper = 1.0, 1.0  # a plain X is the most frequent shape of all
    across = np.sqrt(wheelbase**2 - rise**2) * aspect / np.hypot(1, aspect)
    front, rear = across * taper / (1 + taper), across / (1 + taper)
    return spread_hubs(
        1000 * wheelbase,
        (1000 * front, 1000 * (level + rise / 2)),
        (1000 * rear, 1000 * (level - rise / 2)),
    )


def neighbour_distance(hubs: np.ndarray) -> float:
    """Return the smallest horizontal distance between two of four hubs (4, 3)."""
    distances = np.linalg.norm((hubs[:, None] - hubs)[..., :2], axis=-1)
    return float(distances[np.triu_indices(4, 1)].min())


@lru_cache(maxsize=64)
def quadrotor(number: int, seed: int = 0) -> Drone:
    """Return quadrotor `number`, which follows from (seed, number) alone.

    Raises:
        InputError: the number or the seed is negative.
    """
    if number < 0 or seed < 0:
        raise InputError(f"quadrotor {number} of seed {seed}: both count from 0")
    rng = np.random.default_rng([seed, number, NUMBERS])
    wheelbase = float(np.exp(rng.uniform(*np.log(WHEELBASE))))
    name = _family(wheelbase, rng)
    family = FAMILIES[name]
    height = rng.uniform(*family.height) * wheelbase
    hubs = _hubs(family, wheelbase, height, rng)
    share = min(rng.uniform(*family.propeller), CLEARANCE)
    diameter = share * neighbour_distance(hubs)
    # a small drone has large motors for its size
    motor = rng.uniform(*family.motor) * wheelbase * (0.3 / wheelbase) ** 0.2
    # and no motor is much flatter than it is wide
    motor = min(motor, 0.2 * diameter, 0.65 * (hubs[:, 2].min() + height / 2))
    blades = 2
    if rng.random() < family.three_blades:
        blades = 3 if rng.random() < 0.8 else 4
    edge = 0.52 * neighbour_distance(hubs) if name in RINGED else motor
    length, width = 2 * np.abs(hubs[:, :2]).max(axis=0) + 2 * edge
    return Drone(
        name=name_of(number),
        label=f"Quadrotor {number}",
        index=number,
        body_mm=(1000 * length, 1000 * width, 1000 * height),
        wheelbase=wheelbase,
        propeller_diameter=diameter,
        # from 0.03 kg at 0.08 m to 6 kg at 0.8 m
        mass=float(0.03 * (wheelbase / 0.08) ** 2.3 * np.exp(rng.uniform(-0.35, 0.35))),
        motor_radius=motor,
        hubs=hubs,
        blades=blades,
        blade_width=float(np.exp(rng.uniform(-0.35, 0.35))),
        number=number,
        family=name,
        body_seed=seed,
        **colours(name, np.random.default_rng([seed, number, COLOURS])),
    )
