"""The kinds of walls, as numbers: their colour, their windows, their roof."""

from __future__ import annotations

from dataclasses import dataclass

from dronekeypp.environments.specs import Colour


@dataclass(frozen=True)
class Facade:
    """The walls and the roof of a building. Lengths are in metres, colours are albedos.

    Attributes:
        wall: colour of the wall.
        window: (width, height) of a window; (0, 0) for none.
        pitch: (metres from window to window, height of a storey).
        sill: height of a window's foot above its floor.
        glass: strength of the panes' mirror, 0 to 1.
        bands: structure of the wall: "brick", "panel", "ribs", "plaster", "open" (a bare concrete frame), ""
            for none.
        roof: colour of the roof.
        frame: width of a window's frame.
        plinth: height of the darker foot of the wall.
        lit: share of windows that are lit at dusk.
    """

    wall: Colour = (0.4, 0.37, 0.32)
    window: tuple[float, float] = (1.3, 1.5)
    pitch: tuple[float, float] = (3.0, 3.1)
    sill: float = 0.95
    glass: float = 0.35
    bands: str = "plaster"
    roof: Colour = (0.28, 0.12, 0.08)
    frame: float = 0.07
    plinth: float = 0.6
    lit: float = 0.25


FACADES: dict[str, Facade] = {
    "plaster": Facade(wall=(0.38, 0.34, 0.275)),
    "white": Facade(
        wall=(0.47, 0.455, 0.43), window=(1.2, 1.35), pitch=(3.2, 2.9), roof=(0.10, 0.095, 0.095)
    ),
    "ochre": Facade(wall=(0.37, 0.265, 0.145), window=(1.1, 1.7), pitch=(2.7, 3.4), roof=(0.30, 0.14, 0.085)),
    "brick": Facade(
        wall=(0.25, 0.115, 0.075),
        window=(1.15, 1.6),
        pitch=(2.6, 3.2),
        bands="brick",
        roof=(0.14, 0.12, 0.115),
    ),
    "old_brick": Facade(
        wall=(0.20, 0.10, 0.07), window=(1.5, 2.0), pitch=(3.4, 3.9), bands="brick", roof=(0.11, 0.10, 0.10)
    ),
    "stone": Facade(
        wall=(0.33, 0.30, 0.25), window=(1.2, 2.1), pitch=(2.9, 4.0), bands="panel", roof=(0.12, 0.125, 0.13)
    ),
    "glass": Facade(
        wall=(0.16, 0.17, 0.18),
        window=(1.38, 3.2),
        pitch=(1.5, 3.6),
        sill=0.2,
        glass=0.75,
        bands="",
        frame=0.04,
        plinth=0.3,
        lit=0.4,
    ),
    "office": Facade(
        wall=(0.36, 0.36, 0.36),
        window=(2.5, 1.9),
        pitch=(2.9, 3.5),
        sill=0.9,
        glass=0.5,
        bands="panel",
        frame=0.05,
        lit=0.4,
    ),
    "slab": Facade(wall=(0.44, 0.43, 0.41), window=(1.8, 1.45), pitch=(3.1, 2.8), bands="panel"),
    "shed": Facade(
        wall=(0.36, 0.39, 0.41),
        window=(2.2, 0.9),
        pitch=(9.0, 9.0),
        sill=4.2,
        bands="ribs",
        roof=(0.3, 0.31, 0.32),
        plinth=0.9,
    ),
    "red_shed": Facade(
        wall=(0.26, 0.06, 0.045),
        window=(1.0, 1.0),
        pitch=(5.0, 7.0),
        sill=1.2,
        bands="ribs",
        roof=(0.2, 0.19, 0.185),
        plinth=0.3,
    ),
    "timber": Facade(
        wall=(0.16, 0.095, 0.055),
        window=(1.0, 1.1),
        pitch=(2.6, 2.7),
        bands="ribs",
        roof=(0.13, 0.11, 0.10),
        plinth=0.8,
    ),
    "frame": Facade(
        wall=(0.34, 0.335, 0.32),
        window=(4.2, 2.75),
        pitch=(4.7, 3.3),
        sill=0.0,
        glass=0.0,
        bands="open",
        frame=0.0,
        plinth=0.0,
        lit=0.0,
    ),
    "wall": Facade(
        wall=(0.36, 0.345, 0.32),
        window=(0.0, 0.0),
        pitch=(9.0, 9.0),
        bands="panel",
        roof=(0.34, 0.33, 0.31),
        plinth=0.0,
    ),
    "stand": Facade(
        wall=(0.40, 0.40, 0.40),
        window=(5.4, 2.4),
        pitch=(6.0, 4.6),
        sill=1.4,
        glass=0.25,
        bands="open",
        roof=(0.55, 0.56, 0.57),
        plinth=1.5,
    ),
    "container": Facade(
        wall=(0.20, 0.07, 0.04),
        window=(0.0, 0.0),
        pitch=(9.0, 9.0),
        bands="ribs",
        roof=(0.2, 0.08, 0.05),
        plinth=0.0,
    ),
}
