"""How a place is described: its sky, its relief, what the ground is made of, what grows and stands there.

These classes hold numbers only. The modules that draw read them. Angles are in degrees, lengths in metres,
azimuths counter-clockwise from +x, the middle column of the picture. Colours are linear RGB albedos.
"""

from __future__ import annotations

from dataclasses import dataclass, field

Colour = tuple[float, float, float]
Range = tuple[float, float]  # the smallest and the largest value

SNOW: Colour = (0.78, 0.8, 0.84)  # snow that lies on a plant, a roof or a hill

# Colours of leaves. Each plant takes one of its list.
GREENS: tuple[Colour, ...] = (
    (0.062, 0.098, 0.022),
    (0.045, 0.080, 0.020),
    (0.080, 0.115, 0.028),
    (0.050, 0.072, 0.024),
)
DARK: tuple[Colour, ...] = ((0.026, 0.046, 0.018), (0.034, 0.055, 0.020), (0.030, 0.045, 0.022))
AUTUMN: tuple[Colour, ...] = (
    (0.30, 0.155, 0.030),
    (0.26, 0.085, 0.022),
    (0.20, 0.145, 0.030),
    (0.105, 0.105, 0.025),
    (0.075, 0.09, 0.022),
    (0.33, 0.20, 0.04),
)
DRY: tuple[Colour, ...] = ((0.17, 0.15, 0.06), (0.13, 0.125, 0.05), (0.20, 0.165, 0.075))
OLIVE: tuple[Colour, ...] = ((0.085, 0.095, 0.045), (0.10, 0.105, 0.055), (0.07, 0.085, 0.035))


@dataclass(frozen=True)
class Clouds:
    """The clouds of a sky.

    Attributes:
        cumulus: share of the sky under heaps, 0 to 1.
        cirrus: strength of the thin high veil.
        cover: share of a closed grey ceiling, 0 to 1.
        base, thickness: height of the heaps' feet and their thickness, metres.
        scale: metres after which the pattern of the heaps repeats.
    """

    cumulus: float = 0.0
    cirrus: float = 0.0
    cover: float = 0.0
    base: float = 1300.0
    thickness: float = 700.0
    scale: float = 11e3


@dataclass(frozen=True)
class Relief:
    """Hills and mountains around the flat ground at the camera.

    Attributes:
        hills: metres that the hills rise.
        width: metres across a hill.
        flat: metres from the camera to where the hills start.
        mountains: metres that the mountains rise; 0 for none.
        beyond: metres from the camera to the mountains.
        facing, sector: the mountains fill `sector` degrees of azimuth around `facing`.
        woods: share of the hills under trees.
        woods_colour: albedo of the trees.
        snow_line: metres above which the ground is white. Under 0 the surface itself is snow.
        rock_colour: albedo of bare slopes.
    """

    hills: float = 6.0
    width: float = 900.0
    flat: float = 90.0
    mountains: float = 0.0
    beyond: float = 5000.0
    facing: float = 0.0
    sector: float = 360.0
    woods: float = 0.35
    woods_colour: Colour = (0.030, 0.050, 0.016)
    snow_line: float = 1e9
    rock_colour: Colour = (0.16, 0.145, 0.13)


TOWN = Relief(hills=12, width=900, flat=260, woods=0.3)


@dataclass(frozen=True)
class Strip:
    """A road, a path or water that lies across the base surface.

    Attributes:
        surface: a name in `surfaces.SURFACES`, or "water".
        heading: degrees along which the strip runs.
        offset: metres from the camera to the strip's middle line, to the left of `heading`.
        width: metres.
        wobble: metres that its edge wanders.
        marks: "road" for lines in the middle and at the edges, "bays" for parking, "" for none.
        kerb: width in metres of a light border; 0 for none.
        length: metres along `heading`. The middle lies at the camera.
    """

    surface: str
    heading: float = 0.0
    offset: float = 0.0
    width: float = 6.0
    wobble: float = 0.0
    marks: str = ""
    kerb: float = 0.0
    length: float = 60e3


@dataclass(frozen=True)
class Planting:
    """Plants of one kind, strewn or in a row.

    Attributes:
        kind: a name in `kinds.KINDS`.
        count: how many plants are tried. Those on a road, in a house or out of reach are left out.
        near, far: metres between which they stand.
        height: metres.
        colours: albedos of the leaves; each plant takes one.
        facing, sector: strewn plants stand within `sector` degrees of azimuth around `facing`.
        line: (heading in degrees, offset to its left in metres, spacing in metres) of a row; None for strewn.
        clump: 0 for even spacing, 1 for groves.
        snow: share of white on the upper sides, 0 to 1.
    """

    kind: str
    count: int
    near: float
    far: float
    height: Range
    colours: tuple[Colour, ...] = GREENS
    facing: float = 0.0
    sector: float = 360.0
    line: tuple[float, float, float] | None = None
    clump: float = 0.0
    snow: float = 0.0


@dataclass(frozen=True)
class Housing:
    """Buildings of one sort, strewn or in a row.

    Attributes:
        facades: names in `facades.FACADES`; each building takes one.
        height: metres to the eaves.
        size: (smallest length, largest length, smallest depth, largest depth) in metres.
        rise: metres from the eaves to the ridge; 0 for a flat roof.
        line: (heading in degrees, offset to its left, start, stop) of a row, the last three in metres; None
            for strewn buildings. The offset is that of the walls that face the camera.
        gap: metres between neighbours of a row.
        count: how many strewn buildings are tried.
        near, far, facing, sector: where strewn buildings stand, as in `Planting`.
        heading: degrees along which strewn buildings stand; None for any direction.
        snow: share of white on the roofs, 0 to 1.
    """

    facades: tuple[str, ...]
    height: Range
    size: tuple[float, float, float, float] = (12, 20, 10, 14)
    rise: Range = (0.0, 0.0)
    line: tuple[float, float, float, float] | None = None
    gap: Range = (0.0, 0.0)
    count: int = 0
    near: float = 40.0
    far: float = 200.0
    facing: float = 0.0
    sector: float = 360.0
    heading: float | None = None
    snow: float = 0.0


@dataclass(frozen=True)
class Environment:
    """A place at an hour.

    Attributes:
        name: the name that `render_environment` takes.
        sun_azimuth, sun_elevation: where the sun stands, degrees.
        haze: 1 for clean air, 8 for murky air.
        clouds, relief, strips, plants, housing: see their classes.
        surface: a name in `surfaces.SURFACES`.
        props: one tuple per prop: its name in `placing.PROPS`, then the arguments of the function there.
        eye: height of the camera, metres.
        exposure: factor on the exposure that the camera chooses.
        visibility: metres at which two thirds of the contrast are lost.
        waves: slope of the ripples on water, about 0.01 (calm) to 0.15.
        deep: colour that water has of its own.
        mirror_beyond: water mirrors only what stands further away than this, metres.
        glow: radiance of lit windows and lamps.
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
    visibility: float = 22e3
    waves: float = 0.03
    deep: Colour = (0.016, 0.03, 0.032)
    mirror_beyond: float = 60.0
    glow: float = 0.0
