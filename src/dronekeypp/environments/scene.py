"""From a description of a place to its picture: plant it, build it, cast the shadows, paint far to near, develop."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dronekeypp.environments import props
from dronekeypp.environments.buildings import FACADES, Building
from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.kinds import KINDS
from dronekeypp.environments.noise import fbm_tile, look
from dronekeypp.environments.plants import grow
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Clouds, Sky
from dronekeypp.environments.terrain import Relief, Strip, Terrain
from dronekeypp.environments.things import Plant

GREENS = ((0.062, 0.098, 0.022), (0.045, 0.080, 0.020), (0.080, 0.115, 0.028), (0.050, 0.072, 0.024))
DARK = ((0.026, 0.046, 0.018), (0.034, 0.055, 0.020), (0.030, 0.045, 0.022))
AUTUMN = (
    (0.30, 0.155, 0.030),
    (0.26, 0.085, 0.022),
    (0.20, 0.145, 0.030),
    (0.105, 0.105, 0.025),
    (0.075, 0.09, 0.022),
    (0.33, 0.20, 0.04),
)
DRY = ((0.17, 0.15, 0.06), (0.13, 0.125, 0.05), (0.20, 0.165, 0.075))
OLIVE = ((0.085, 0.095, 0.045), (0.10, 0.105, 0.055), (0.07, 0.085, 0.035))


@dataclass(frozen=True)
class Planting:
    """`count` plants of a kind, `near` to `far` metres away within `sector` degrees of azimuth `facing`; or, where
    `line` = (heading degrees, offset metres, spacing metres) is given, a row. height: metres (from, to). clump: 0
    even .. 1 in groves. snow: on their upper sides.
    """

    kind: str
    count: int
    near: float
    far: float
    height: tuple[float, float]
    colours: tuple = GREENS
    facing: float = 0.0
    sector: float = 360.0
    line: tuple[float, float, float] | None = None
    clump: float = 0.0
    snow: float = 0.0


@dataclass(frozen=True)
class Housing:
    """Buildings: in a row along `line` = (heading degrees, offset metres, from, to metres along), or `count` of them
    strewn `near` to `far` metres away. size: (length from, to, depth from, to). height, rise: metres (from, to). gap:
    metres between neighbours of a row.
    """

    facades: tuple[str, ...]
    height: tuple[float, float]
    size: tuple[float, float, float, float] = (12, 20, 10, 14)
    rise: tuple[float, float] = (0.0, 0.0)
    line: tuple[float, float, float, float] | None = None
    gap: tuple[float, float] = (0.0, 0.0)
    count: int = 0
    near: float = 40.0
    far: float = 200.0
    facing: float = 0.0
    sector: float = 360.0
    heading: float | None = None
    snow: float = 0.0


@dataclass(frozen=True)
class Environment:
    """A place at an hour. Angles in degrees (azimuth counter-clockwise from +x, the picture's middle column), lengths
    in metres.

    haze: 1 clean .. 8 murky air. visibility: metres at which two thirds of the contrast are lost. mirror_beyond: only
    what stands further away than this is reflected in water. waves: slope of the ripples. glow: radiance of lit
    windows and lamps. props: (name, arguments ...).
    """

    name: str
    sun_azimuth: float
    sun_elevation: float
    haze: float = 2.5
    clouds: Clouds = field(default_factory=Clouds)
    relief: Relief = field(default_factory=Relief)
    surface: str = "meadow"
    strips: tuple[Strip, ...] = ()
    plants: tuple[Planting, ...] = ()
    housing: tuple[Housing, ...] = ()
    props: tuple[tuple, ...] = ()
    eye: float = 1.7
    exposure: float = 1.0
    warmth: float = 0.0
    visibility: float = 22e3
    waves: float = 0.03
    deep: tuple[float, float, float] = (0.016, 0.03, 0.032)
    mirror_beyond: float = 60.0
    glow: float = 0.0


def _sector_point(rng, near, far, facing, sector):
    distance = (
        np.sqrt(rng.uniform(near**2, far**2)) if far < 4 * near else near * (far / near) ** rng.random()
    )
    azimuth = np.radians(facing + sector * (rng.random() - 0.5))
    return distance * np.cos(azimuth), distance * np.sin(azimuth)


def _house(spec: Housing, x, y, heading, size, rng, place, terrain, glow) -> Building:
    name = spec.facades[int(rng.integers(len(spec.facades)))]
    ground = float(terrain.height(np.array([[x]], np.float32), np.array([[y]], np.float32))[0, 0])
    height, rise = rng.uniform(*spec.height), rng.uniform(*spec.rise)
    ground = ground - 0.3 if abs(ground) > 0.05 else 0.0
    return Building(
        x, y, *size, height, heading, FACADES[name], rise, ground, int(rng.integers(1000)), spec.snow, glow
    )


def _houses(place: Environment, terrain: Terrain, rng: np.random.Generator) -> list[Building]:
    out: list[Building] = []
    for spec in place.housing:
        if spec.line:
            heading, offset, start, stop = np.radians(spec.line[0]), *spec.line[1:]
            at = start
            while at < stop:
                size = rng.uniform(spec.size[0], spec.size[1]), rng.uniform(spec.size[2], spec.size[3])
                along, across = at + size[0] / 2, offset + np.sign(offset) * size[1] / 2
                x, y = (
                    along * np.cos(heading) - across * np.sin(heading),
                    along * np.sin(heading) + across * np.cos(heading),
                )
                out.append(_house(spec, x, y, heading, size, rng, place, terrain, place.glow))
                at += size[0] + rng.uniform(*spec.gap)
            continue
        for _ in range(spec.count):
            for _ in range(30):
                x, y = _sector_point(rng, spec.near, spec.far, spec.facing, spec.sector)
                size = rng.uniform(spec.size[0], spec.size[1]), rng.uniform(spec.size[2], spec.size[3])
                reach = max(size) / 2
                clear = all(
                    np.hypot(x - b.x, y - b.y) > 0.75 * (reach + max(b.length, b.depth) / 2) for b in out
                )
                heading = np.radians(spec.heading) if spec.heading is not None else rng.uniform(0, np.pi)
                if clear and not _on_strip(terrain, x, y, reach):
                    out.append(_house(spec, x, y, heading, size, rng, place, terrain, place.glow))
                    break
    return out


def _on_strip(terrain: Terrain, x: float, y: float, margin: float) -> bool:
    for strip in terrain.strips:
        across, _ = terrain.across(strip, np.array([x]), np.array([y]))
        if abs(across[0]) < strip.width / 2 + margin + 0.5 * strip.wobble and strip.marks != "bays":
            return True
    return False


def _planted(
    place: Environment, terrain: Terrain, houses: list[Building], rng: np.random.Generator
) -> list[Plant]:
    out = []
    groves = fbm_tile(1024, 1.5, 140 + terrain.seed)
    for spec in place.plants:
        spots = []
        if spec.line:
            heading, offset, pitch = np.radians(spec.line[0]), *spec.line[1:]
            for i in range(spec.count):
                along = (i - spec.count / 2 + 0.5) * pitch + rng.normal() * 0.04 * pitch
                side = offset + rng.normal() * 0.03 * pitch
                spots.append(
                    (
                        along * np.cos(heading) - side * np.sin(heading),
                        along * np.sin(heading) + side * np.cos(heading),
                    )
                )
        else:
            points = np.array(
                [
                    _sector_point(rng, spec.near, spec.far, spec.facing, spec.sector)
                    for _ in range(spec.count * 12)
                ]
            )
            x, y = points.T[:, None].astype(np.float32)
            dense = look(groves, x, y, max(60.0, 1.4 * spec.far))[0]
            grows = rng.random(len(points)) < spec.clump / (1 + np.exp(-6 * (dense - 0.6))) + 1 - spec.clump
            spots = list(points[grows][: spec.count])
        wide = KINDS[spec.kind].width
        sunk = 0.16 if spec.kind == "rock" else 0.01
        for x, y in spots:
            height = rng.uniform(*spec.height)
            variant, mirrored, colour = (
                int(rng.integers(4)),
                bool(rng.random() < 0.5),
                spec.colours[int(rng.integers(len(spec.colours)))],
            )
            shade = rng.uniform(0.8, 1.2)
            distance = np.hypot(x, y)
            if not spec.near <= distance <= spec.far:
                continue
            if not spec.line and _on_strip(terrain, x, y, 0.15 * height * wide):
                continue
            if any(_inside(b, x, y, min(3.0, 0.3 * height * wide)) for b in houses):
                continue
            ground = float(terrain.height(np.array([[x]], np.float32), np.array([[y]], np.float32))[0, 0])
            out.append(
                Plant(
                    grow(spec.kind, variant),
                    x,
                    y,
                    height,
                    np.array(colour) * shade,
                    ground - sunk * height,
                    mirrored,
                    spec.snow,
                )
            )
    return out


def _inside(b: Building, x: float, y: float, margin: float) -> bool:
    c, s = np.cos(b.heading), np.sin(b.heading)
    a, d = (x - b.x) * c + (y - b.y) * s, -(x - b.x) * s + (y - b.y) * c
    return abs(a) < b.length / 2 + margin and abs(d) < b.depth / 2 + margin


def _props(place: Environment, terrain: Terrain, rng: np.random.Generator) -> list:
    out = []
    for name, *values in place.props:
        if name == "cars":  # heading degrees, offset, from, to, spacing, share taken, "along" or "across"
            heading, offset, start, stop, pitch, share, way = values
            turn = np.radians(heading)
            for along in np.arange(start, stop, pitch):
                if rng.random() < share:
                    x, y = (
                        along * np.cos(turn) - offset * np.sin(turn),
                        along * np.sin(turn) + offset * np.cos(turn),
                    )
                    lean = (
                        (0 if way == "along" else np.pi / 2)
                        + np.pi * int(rng.integers(2))
                        + rng.normal() * 0.03
                    )
                    out += props.car(x, y, turn + lean, rng)
        elif name == "lamps":  # heading, offset, from, to, spacing, height
            heading, offset, start, stop, pitch, height = values
            turn = np.radians(heading)
            for along in np.arange(start, stop, pitch):
                x, y = (
                    along * np.cos(turn) - offset * np.sin(turn),
                    along * np.sin(turn) + offset * np.cos(turn),
                )
                out += props.lamp(x, y, turn - np.sign(offset) * np.pi / 2, height, 4 * place.glow)
        elif name == "power":
            out += props.power_line(np.radians(values[0]), *values[1:], ground=terrain.height)
        elif name == "boats":  # heading, offset, from, to, spacing
            heading, offset, start, stop, pitch = values
            turn = np.radians(heading)
            for along in np.arange(start, stop, pitch):
                side = offset + rng.normal() * 0.8
                fleet = props.boat(
                    along * np.cos(turn) - side * np.sin(turn),
                    along * np.sin(turn) + side * np.cos(turn),
                    turn + np.pi / 2 + rng.normal() * 0.06,
                    rng,
                )
                for part in fleet:
                    part.afloat = True
                out += fleet
        elif name == "fence":
            out += props.fence(*values)
        elif name == "pylon":
            x, y, heading, height = values
            out += props.pylon(
                x, y, heading, height, float(terrain.height(np.array([[x]]), np.array([[y]]))[0, 0])
            )
        else:
            out += getattr(props, name)(*values)
    return out


def paint(place: Environment, height: int, seed: int) -> np.ndarray:
    """The panorama (height, 2 height, 3) uint8. The same (place, height, seed) gives the same pixels."""
    code = sum(ord(c) * 31**i for i, c in enumerate(place.name)) % 1_000_003
    rng = np.random.default_rng((code, seed))
    field_seed = int(rng.integers(1, 10_000))
    canvas = Canvas(height, place.eye)
    canvas.visibility = place.visibility
    sky = Sky(
        np.radians(place.sun_azimuth), np.radians(place.sun_elevation), place.haze, place.clouds, field_seed
    )
    sky.paint(canvas)
    light = sky.light
    terrain = Terrain(place.relief, place.surface, place.strips, light, field_seed)
    houses = _houses(place, terrain, rng)
    things = [*houses, *_planted(place, terrain, houses, rng), *_props(place, terrain, rng)]
    shadows = Shadows(light.sun)
    for thing in things:
        if thing.distance < 500:
            thing.cast(shadows)
    shadows.soften()
    terrain.paint(canvas, shadows)
    things.sort(key=lambda t: -t.distance)
    mirrored = [t for t in things if t.distance >= place.mirror_beyond]
    for thing in mirrored:
        thing.paint(canvas, light)
    terrain.paint_water(canvas, place.waves, place.deep)
    afloat = [t for t in mirrored if getattr(t, "afloat", False)]  # the water has run over their hulls
    for thing in afloat + things[len(mirrored) :]:
        thing.paint(canvas, light)
    # White balance, most of the way: a camera (and an eye) takes the light's colour out.
    whole = light.sun_colour * max(light.sun[2], 0.1) + light.sky_colour
    balance = (whole.mean() / whole) ** 0.65
    canvas.image *= (balance / balance.mean()).astype(np.float32)
    return canvas.develop(place.exposure * _exposure(canvas), rng, warmth=place.warmth)


def _exposure(canvas: Canvas) -> float:
    """Exposed for the ground and for the sky, between the two."""
    step = max(1, canvas.height // 256)
    small = canvas.image[::step, ::step].mean(-1) + 1e-4
    weight = np.cos(canvas.theta[::step])[:, None] * np.ones_like(small)
    half = len(small) // 2
    sky = np.exp(np.average(np.log(small[:half]), weights=weight[:half]))
    ground = np.exp(np.average(np.log(small[half:]), weights=weight[half:]))
    return float(0.40 / sky**0.62 / np.clip(ground / 0.5, 0.3 * sky, 1.1 * sky) ** 0.38)
