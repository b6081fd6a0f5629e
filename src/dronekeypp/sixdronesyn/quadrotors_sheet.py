"""This module draws the first random quadrotors on one page.

The command is `python -m dronekeypp.sixdronesyn.quadrotors_sheet [OUT.png]`, and OUT.png is
figures/quadrotors.png by default. The camera is orthographic; each cell has its own scale.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dronekeypp.sixdronesyn.contact_sheet import BACKGROUND, render
from dronekeypp.sixdronesyn.quadrotors import RINGED, quadrotor

COLUMNS, ROWS = 8, 6
VIEWS = ((38, 22), (218, 26))  # azimuth and elevation in degrees: front left, rear right


def quadrotors_sheet(path: str | Path, first: int = 0, cell: tuple[int, int] = (216, 166)) -> None:
    """Draw 48 quadrotors from number `first` on and save them as PNG.

    Every fourth is seen from the rear right, the others from the front left. `cell` is (width, height) of a
    view in pixels.
    """
    cell_width, cell_height = cell
    foot = 24
    width, height = cell_width * COLUMNS, cell_height * ROWS + foot
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor=BACKGROUND)
    axes = figure.add_axes((0, 0, 1, 1))
    for place in range(COLUMNS * ROWS):
        drone = quadrotor(first + place)
        left, top = cell_width * (place % COLUMNS), cell_height * (place // COLUMNS)
        azimuth, elevation = VIEWS[1 if place % 4 == 3 else 0]
        # the outer half of a blurred propeller may leave the cell, but not a duct
        share = 1.2 if drone.family in RINGED else 0.6
        outer = np.abs(drone.hubs[:, :2]).max() + share * drone.propeller_radius
        half_height = 1.15 * outer * cell_height / cell_width
        picture = render(drone, azimuth, elevation, cell, half_height)
        extent = (left, left + cell_width, top + cell_height, top)
        axes.imshow(picture, extent=extent, interpolation="none")
        axes.text(left + 6, top + 10, str(drone.number), fontsize=8, weight="bold", va="center")
        numbers = f"{1000 * drone.wheelbase:.0f} mm {drone.family}"
        axes.text(left + cell_width - 6, top + 10, numbers, fontsize=7, va="center", ha="right")
    caption = (
        "Random quadrotors: number, wheelbase and family. Orthographic, each at its own scale; "
        "every fourth is seen from the rear right, the others from the front left."
    )
    axes.text(6, height - foot / 2, caption, fontsize=8, va="center")
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.axis("off")
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True}, metadata={"Software": None})


if __name__ == "__main__":
    quadrotors_sheet(sys.argv[1] if len(sys.argv) > 1 else Path("figures") / "quadrotors.png")
