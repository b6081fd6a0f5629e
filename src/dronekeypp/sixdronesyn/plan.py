"""This module is the flight plan of 6DroneSyn (paper Sec. IV, Table 2): scenes, splits and backgrounds.

`scenes` adds the camera and the path of each flight. Every random draw comes from a generator seeded by
(seed, scene, drone, subsequence), so each flight can be remade without the others.

The paper leaves some things open. We take:
- A subsequence mounts its camera anew (height, tilt, where it looks), with a lens of its own, and flies its
  own path. That makes 273 flights; the paper has 91 flights, each before three backgrounds. In the first
  edition all flights of a scene have one lens.
- The 22 environments are split like the scenes (14 train, 3 validation, 5 test), so a test frame has a
  background that no training frame had.
"""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from dronekeypp.sixdronesyn import quadrotors
from dronekeypp.sixdronesyn.drones import EDITION, EDITIONS, SEVEN, Drone, find_drone

FPS = 30
SUBSEQUENCES = 3  # backgrounds a scene and drone
# of one data set, by edition: the name of a flight's folder has 1 or 3 digits for them
MOST_DRONES = {1: 10, 2: 1000}
PURPOSES = ("camera", "flight", "exposure", "propellers", "lens")  # what is drawn at random; new ones go last

SPLITS = ("train", "val", "test")
# environment numbers, modulo 22; the others are for training
VALIDATION_ENVIRONMENTS = (5, 12, 17)
TEST_ENVIRONMENTS = (3, 7, 11, 15, 19)
QUARTER_TURNS = range(4)


@dataclass(frozen=True)
class Scene:
    """A scene is one row of Table 2.

    `motion` is "linear" or "non-linear".
    """

    number: int
    motion: str
    seconds: int
    split: str

    @property
    def frames(self) -> int:
        """Return the number of frames of each flight in this scene."""
        return self.seconds * FPS


_TABLE_2 = (
    Scene(1, "linear", 4, "train"),
    Scene(2, "linear", 4, "train"),
    Scene(3, "linear", 4, "val"),
    Scene(4, "non-linear", 4, "train"),
    Scene(5, "non-linear", 4, "train"),
    Scene(6, "non-linear", 4, "test"),
    Scene(7, "linear", 4, "test"),
    Scene(8, "linear", 4, "train"),
    Scene(9, "linear", 4, "val"),
    Scene(10, "non-linear", 12, "train"),
    Scene(11, "non-linear", 12, "train"),
    Scene(12, "non-linear", 12, "train"),
    Scene(13, "non-linear", 12, "val"),
)
SCENES = {scene.number: scene for scene in _TABLE_2}


@dataclass(frozen=True)
class Subsequence:
    """A subsequence is one flight: a scene, a drone, and which of its three backgrounds (`take`, 0 to 2).

    `number` is the drone's number in its data set, from 0; None means its place among all drones here. A
    drone of your own gets it from the data set, so that another drone of your own does not change it.
    `edition` is that of the data set.
    """

    scene: int
    drone: str
    take: int
    number: int | None = None
    edition: int = EDITION

    @property
    def airframe(self) -> Drone:
        """Return the drone that flies."""
        return find_drone(self.drone, self.edition)

    @property
    def drone_number(self) -> int:
        """Return the drone's number in its data set, from 0, which is part of the folder's name."""
        return self.airframe.index if self.number is None else self.number

    @property
    def id(self) -> int:
        """Return the BOP scene number, which also names the folder.

        Its last digit is the take. Before it come the drone's number, in one digit in the first edition and
        in three in the second, and the scene.
        """
        return (self.scene * MOST_DRONES[self.edition] + self.drone_number) * 10 + self.take

    @property
    def split(self) -> str:
        """Return the split of the flight's scene, one of `SPLITS`."""
        return SCENES[self.scene].split

    @property
    def frames(self) -> int:
        """Return how many frames the flight has."""
        return SCENES[self.scene].frames

    def generator(self, seed: int, purpose: str, frame: int = 0) -> np.random.Generator:
        """Return a random generator for one purpose, of this flight or of one frame of it.

        The purpose is one of `PURPOSES`.
        """
        drone = self.airframe.seed
        return np.random.default_rng([seed, self.scene, drone, self.take, frame, PURPOSES.index(purpose)])


def subsequences(
    scenes: Container[int] | None = None,
    drones: Container[str] | None = None,
    numbers: Mapping[str, int] | None = None,
    edition: int = EDITION,
) -> list[Subsequence]:
    """Return every flight of the chosen scenes and drones (all by default), in a fixed order.

    `numbers` are those of drones of your own in the data set, see `Subsequence`.
    """
    numbers = numbers or {}
    chosen = [scene for scene in SCENES if scenes is None or scene in scenes]
    names = [name for name in EDITIONS[edition] if drones is None or name in drones]
    flights = []
    for scene, name, take in product(chosen, names, range(SUBSEQUENCES)):
        flights.append(Subsequence(scene, name, take, numbers.get(name), edition))
    return flights


def quadrotor_flights(chosen: range, scenes: Container[int] | None = None) -> list[Subsequence]:
    """Return the flights of random quadrotors in the chosen scenes (all by default), in a fixed order.

    A quadrotor flies only in the scenes of its own split (`quadrotors.split_of`), so no two splits share
    one. Object i + 1 of the data set is the i-th quadrotor of `chosen`.
    """
    flights = []
    for place, number in enumerate(chosen):
        split = quadrotors.split_of(number)
        for scene, take in product(SCENES.values(), range(SUBSEQUENCES)):
            if scene.split == split and (scenes is None or scene.number in scenes):
                flights.append(Subsequence(scene.number, quadrotors.name_of(number), take, place, 2))
    return flights


def frame_numbers(subsequence: Subsequence, stride: int = 1) -> range:
    """Return the frames of a flight that `--stride` keeps: every `stride`-th, with unchanged numbers."""
    return range(0, subsequence.frames, stride)


def count_frames(
    scenes: Container[int] | None = None, drones: Container[str] | None = None, stride: int = 1
) -> int:
    """Return how many frames a selection has, from the table alone.

    The whole data set has 52,920 frames.
    """
    return sum(len(frame_numbers(flight, stride)) for flight in subsequences(scenes, drones))


# --- backgrounds ---


def split_environments(n: int) -> dict[str, list[int]]:
    """Return the environment numbers of each split, for `n` environments.

    Of 22, the splits get 14, 3 and 5. Fewer than 6 are too few to split, and every split gets all of them.
    """
    if n < 6:
        return {split: list(range(n)) for split in SPLITS}
    groups = {split: [] for split in SPLITS}
    for number in range(n):
        if number % 22 in VALIDATION_ENVIRONMENTS:
            groups["val"].append(number)
        elif number % 22 in TEST_ENVIRONMENTS:
            groups["test"].append(number)
        else:
            groups["train"].append(number)
    return groups


def background(subsequence: Subsequence, environments: int, seed: int = 0) -> tuple[int, int]:
    """Return the background of a flight as (environment number, quarter turns about z).

    Each split deals out its environments, each in four turns, like a pack of cards, and shuffles the pack
    anew when it is used up. The seven drones share their packs, and each drone of your own has packs of its
    own. So it changes nobody else's frames.

    Args:
        subsequence: the flight.
        environments: how many environments there are.
        seed: the seed of the data set.
    """
    pack = list(product(split_environments(environments)[subsequence.split], QUARTER_TURNS))
    split = SPLITS.index(subsequence.split)
    ours = subsequence.drone in SEVEN
    names = SEVEN if ours else [subsequence.drone]
    split_scenes = [scene.number for scene in SCENES.values() if scene.split == subsequence.split]
    sharing = list(product(split_scenes, names, range(SUBSEQUENCES)))
    order = sharing.index((subsequence.scene, subsequence.drone, subsequence.take))
    round_number = order // len(pack)
    key = [seed, split, round_number, 88]
    if not ours:
        key.append(subsequence.airframe.seed)
    shuffled = np.random.default_rng(key).permutation(len(pack))
    return pack[shuffled[order % len(pack)]]
