"""Where things stand in a place: houses, plants and props, from their descriptions in `specs`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dronekeypp.environments.buildings import Building
from dronekeypp.environments.facades import FACADES
from dronekeypp.environments.kinds import KINDS
from dronekeypp.environments.noise import fbm_tile, look
from dronekeypp.environments.plants import grow
from dronekeypp.environments.props import along_line, crane, fence, floodlight, lamp, power_line, pylon
from dronekeypp.environments.specs import Environment, Housing, Planting
from dronekeypp.environments.terrain import Terrain
from dronekeypp.environments.things import Plant, Thing
from dronekeypp.environments.vehicles import boat, car

_TRIES = 30  # how often a place is sought for a building


class Site:
    """A place that is being filled.

    Attributes:
        place: its description.
        terrain: its ground.
        rng: random numbers. The order of the draws is part of the picture.
    """

    def __init__(self, place: Environment, terrain: Terrain, rng: np.random.Generator) -> None:
        self.place = place
        self.terrain = terrain
        self.rng = rng

    def fill(self) -> list[Thing]:
        """Return everything that stands here: houses first, then plants, then props."""
        houses = self._houses()
        plants = self._plants(houses)
        things: list[Thing] = [*houses, *plants]
        for name, *arguments in self.place.props:
            things += PROPS[name](self, *arguments)
        return things

    def _houses(self) -> list[Building]:
        """Build the houses of every `Housing`."""
        houses: list[Building] = []
        for spec in self.place.housing:
            if spec.line:
                self._build_row(spec, houses)
            else:
                self._strew_houses(spec, houses)
        return houses

    def _build_row(self, spec: Housing, houses: list[Building]) -> None:
        """Add a row of houses."""
        degrees, offset, start, stop = spec.line
        heading = np.radians(degrees)
        along = start
        while along < stop:
            length, depth = self._house_size(spec)
            x, y = along_line(heading, along + length / 2, offset + np.sign(offset) * depth / 2)
            houses.append(self._house(spec, x, y, heading, length, depth))
            along += length + self.rng.uniform(*spec.gap)

    def _strew_houses(self, spec: Housing, houses: list[Building]) -> None:
        """Add houses at random positions that are free."""
        for _ in range(spec.count):
            for _ in range(_TRIES):
                x, y = self._point_in_sector(spec)
                length, depth = self._house_size(spec)
                reach = max(length, depth) / 2
                if spec.heading is not None:
                    heading = np.radians(spec.heading)
                else:
                    heading = self.rng.uniform(0, np.pi)
                if _is_free(x, y, reach, houses) and not self.terrain.is_blocked(x, y, reach):
                    houses.append(self._house(spec, x, y, heading, length, depth))
                    break

    def _house_size(self, spec: Housing) -> tuple[float, float]:
        """Draw the length and the depth of a house, metres."""
        length = self.rng.uniform(spec.size[0], spec.size[1])
        depth = self.rng.uniform(spec.size[2], spec.size[3])
        return length, depth

    def _house(
        self, spec: Housing, x: float, y: float, heading: float, length: float, depth: float
    ) -> Building:
        """Build one house at a position x, y in metres, with a heading in radians."""
        facade = FACADES[spec.facades[int(self.rng.integers(len(spec.facades)))]]
        ground = self.terrain.height_at(np.float32(x), np.float32(y))
        height = self.rng.uniform(*spec.height)
        rise = self.rng.uniform(*spec.rise)
        # On a slope the foot goes a little into the ground.
        ground = ground - 0.3 if abs(ground) > 0.05 else 0.0
        seed = int(self.rng.integers(1000))
        return Building(
            x, y, length, depth, height, heading, facade, rise, ground, seed, spec.snow, self.place.glow
        )

    def _point_in_sector(self, spec: Housing | Planting) -> tuple[float, float]:
        """Draw a position x, y in metres between `near` and `far`, within the sector."""
        rng = self.rng
        if spec.far < 4 * spec.near:
            distance = np.sqrt(rng.uniform(spec.near**2, spec.far**2))
        else:  # many plants close by would be missing from an even spread over the area
            distance = spec.near * (spec.far / spec.near) ** rng.random()
        azimuth = np.radians(spec.facing + spec.sector * (rng.random() - 0.5))
        return distance * np.cos(azimuth), distance * np.sin(azimuth)

    def _plants(self, houses: list[Building]) -> list[Plant]:
        """Plant every `Planting`, but not in houses or on roads."""
        groves = fbm_tile(1024, 1.5, 140 + self.terrain.seed)
        plants = []
        for spec in self.place.plants:
            if spec.line:
                spots = self._row_of_spots(spec)
            else:
                spots = self._strewn_spots(spec, groves)
            for x, y in spots:
                plant = self._plant(spec, x, y, houses)
                if plant is not None:
                    plants.append(plant)
        return plants

    def _row_of_spots(self, spec: Planting) -> list[tuple[float, float]]:
        """Return the positions of a row of plants, a little uneven."""
        degrees, offset, pitch = spec.line
        heading = np.radians(degrees)
        spots = []
        for i in range(spec.count):
            along = (i - spec.count / 2 + 0.5) * pitch + self.rng.normal() * 0.04 * pitch
            side = offset + self.rng.normal() * 0.03 * pitch
            spots.append(along_line(heading, along, side))
        return spots

    def _strewn_spots(self, spec: Planting, groves: np.ndarray) -> np.ndarray:
        """Return positions (n, 2) of strewn plants. groves: a tile of noise, high where groves stand."""
        points = np.array([self._point_in_sector(spec) for _ in range(spec.count * 12)])
        x = points[None, :, 0].astype(np.float32)
        y = points[None, :, 1].astype(np.float32)
        dense = look(groves, x, y, max(60.0, 1.4 * spec.far))[0]
        chance = spec.clump / (1 + np.exp(-6 * (dense - 0.6))) + 1 - spec.clump
        grows = self.rng.random(len(points)) < chance
        return points[grows][: spec.count]

    def _plant(self, spec: Planting, x: float, y: float, houses: list[Building]) -> Plant | None:
        """Return a plant at a position x, y in metres, or None where it cannot stand."""
        rng = self.rng
        height = rng.uniform(*spec.height)
        variant = int(rng.integers(4))
        mirrored = bool(rng.random() < 0.5)
        colour = spec.colours[int(rng.integers(len(spec.colours)))]
        shade = rng.uniform(0.8, 1.2)
        if not spec.near <= np.hypot(x, y) <= spec.far:
            return None
        width = KINDS[spec.kind].width  # in heights
        if not spec.line and self.terrain.is_blocked(x, y, 0.15 * height * width):
            return None
        if any(house.contains(x, y, min(3.0, 0.3 * height * width)) for house in houses):
            return None
        sunk = 0.16 if spec.kind == "rock" else 0.01  # share of it that is in the ground
        ground = self.terrain.height_at(np.float32(x), np.float32(y)) - sunk * height
        model = grow(spec.kind, variant)
        return Plant(model, x, y, height, np.array(colour) * shade, ground, mirrored, spec.snow)


def _is_free(x: float, y: float, reach: float, houses: list[Building]) -> bool:
    """Say whether a house that reaches `reach` metres from x, y stands clear of the others."""
    for house in houses:
        limit = 0.75 * (reach + max(house.length, house.depth) / 2)
        if np.hypot(x - house.x, y - house.y) <= limit:
            return False
    return True


# The props. In rows the heading is in degrees, the offset is metres to the left of the camera, and start,
# stop and pitch are metres along the heading.


def _cars(
    site: Site,
    heading: float,
    offset: float,
    start: float,
    stop: float,
    pitch: float,
    share: float,
    way: str,
) -> list[Thing]:
    """Park cars in a row. share: how many of the bays are taken. way: "along" the row or "across" it."""
    turn = np.radians(heading)
    cars: list[Thing] = []
    for along in np.arange(start, stop, pitch):
        if site.rng.random() >= share:
            continue
        x, y = along_line(turn, along, offset)
        lean = 0 if way == "along" else np.pi / 2
        lean = lean + np.pi * int(site.rng.integers(2)) + site.rng.normal() * 0.03
        cars += car(x, y, turn + lean, site.rng)
    return cars


def _lamps(
    site: Site, heading: float, offset: float, start: float, stop: float, pitch: float, height: float
) -> list[Thing]:
    """Set street lamps in a row. height: metres."""
    turn = np.radians(heading)
    lamps: list[Thing] = []
    for along in np.arange(start, stop, pitch):
        x, y = along_line(turn, along, offset)
        lamps += lamp(x, y, turn - np.sign(offset) * np.pi / 2, height, 4 * site.place.glow)
    return lamps


def _power_line(
    site: Site, heading: float, offset: float, height: float = 9.0, pitch: float = 42.0, spans: int = 9
) -> list[Thing]:
    """Set up a power line, see `props.power_line`."""
    turn = np.radians(heading)
    return power_line(turn, offset, height, pitch, spans, ground=site.terrain.height_at)


def _boats(site: Site, heading: float, offset: float, start: float, stop: float, pitch: float) -> list[Thing]:
    """Moor boats in a row, side by side."""
    turn = np.radians(heading)
    boats: list[Thing] = []
    for along in np.arange(start, stop, pitch):
        side = offset + site.rng.normal() * 0.8
        x, y = along_line(turn, along, side)
        boats += boat(x, y, turn + np.pi / 2 + site.rng.normal() * 0.06, site.rng)
    return boats


def _fence(
    site: Site, start: tuple[float, float], end: tuple[float, float], height: float, style: str
) -> list[Thing]:
    """Build a fence between two ground positions, see `props.fence`."""
    return fence(start, end, height, style)


def _pylon(site: Site, x: float, y: float, heading: float, height: float) -> list[Thing]:
    """Set up a mast for high voltage. heading: radians."""
    return pylon(x, y, heading, height, site.terrain.height_at(x, y))


def _crane(site: Site, x: float, y: float, heading: float, height: float) -> list[Thing]:
    """Set up a tower crane. heading: radians."""
    return crane(x, y, heading, height)


def _floodlight(site: Site, x: float, y: float, height: float) -> list[Thing]:
    """Set up a mast of floodlights."""
    return floodlight(x, y, height)


PROPS: dict[str, Callable[..., list[Thing]]] = {
    "cars": _cars,
    "lamps": _lamps,
    "power": _power_line,
    "boats": _boats,
    "fence": _fence,
    "pylon": _pylon,
    "crane": _crane,
    "floodlight": _floodlight,
}
