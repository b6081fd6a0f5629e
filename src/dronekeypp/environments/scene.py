"""From the description of a place to its picture: fill it, cast the shadows, paint far to near, develop."""

from __future__ import annotations

import numpy as np

from dronekeypp.environments.canvas import Canvas
from dronekeypp.environments.placing import Site
from dronekeypp.environments.shadows import Shadows
from dronekeypp.environments.sky import Daylight, Sky
from dronekeypp.environments.specs import Environment
from dronekeypp.environments.terrain import Terrain
from dronekeypp.environments.things import Thing
from dronekeypp.environments.water import paint_water

_SHADOWS_WITHIN = 500  # metres; what stands further away casts no shadow


def paint(place: Environment, height: int, seed: int) -> np.ndarray:
    """Draw the panorama of a place, (height, 2 height, 3) uint8 RGB.

    The same (place, height, seed) gives the same pixels.
    """
    rng = np.random.default_rng((_name_code(place.name), seed))
    field_seed = int(rng.integers(1, 10_000))
    canvas = Canvas(height, place.eye)
    canvas.visibility = place.visibility
    azimuth, elevation = np.radians(place.sun_azimuth), np.radians(place.sun_elevation)
    sky = Sky(azimuth, elevation, place.haze, place.clouds, field_seed)
    sky.paint(canvas)
    light = sky.light
    terrain = Terrain(place.relief, place.surface, place.strips, light, field_seed)
    things = Site(place, terrain, rng).fill()
    terrain.paint(canvas, _cast_shadows(things, light))
    _paint_things(canvas, things, place, terrain, light)
    _balance(canvas, light)
    return canvas.develop(place.exposure * _exposure(canvas), rng)


def _name_code(name: str) -> int:
    """Return a number for a name, the same on every machine."""
    code = 0
    for i, letter in enumerate(name):
        code += ord(letter) * 31**i
    return code % 1_000_003


def _cast_shadows(things: list[Thing], light: Daylight) -> Shadows:
    """Draw the shadows of the things that are near enough."""
    shadows = Shadows(light.sun)
    for thing in things:
        if thing.distance < _SHADOWS_WITHIN:
            thing.cast(shadows)
    shadows.soften()
    return shadows


def _paint_things(
    canvas: Canvas, things: list[Thing], place: Environment, terrain: Terrain, light: Daylight
) -> None:
    """Paint all things, far ones first, and the water between those that it mirrors and the others."""
    things = sorted(things, key=lambda thing: -thing.distance)
    mirrored = [thing for thing in things if thing.distance >= place.mirror_beyond]
    near = things[len(mirrored) :]
    for thing in mirrored:
        thing.paint(canvas, light)
    paint_water(canvas, terrain.water, light, place.waves, place.deep, terrain.seed)
    # The water has run over the hulls of the boats: they are painted again.
    afloat = [thing for thing in mirrored if thing.afloat]
    for thing in afloat + near:
        thing.paint(canvas, light)


def _balance(canvas: Canvas, light: Daylight) -> None:
    """Balance white, most of the way: a camera (and an eye) takes the light's colour out."""
    whole = light.sun_colour * max(light.sun[2], 0.1) + light.sky_colour
    balance = (whole.mean() / whole) ** 0.65
    canvas.image *= (balance / balance.mean()).astype(np.float32)


def _exposure(canvas: Canvas) -> float:
    """Return the exposure between that for the ground and that for the sky."""
    step = max(1, canvas.height // 256)
    small = canvas.image[::step, ::step].mean(-1) + 1e-4
    weight = np.cos(canvas.theta[::step])[:, None] * np.ones_like(small)
    half = len(small) // 2
    sky = np.exp(np.average(np.log(small[:half]), weights=weight[:half]))
    ground = np.exp(np.average(np.log(small[half:]), weights=weight[half:]))
    return float(0.40 / sky**0.62 / np.clip(ground / 0.5, 0.3 * sky, 1.1 * sky) ** 0.38)
