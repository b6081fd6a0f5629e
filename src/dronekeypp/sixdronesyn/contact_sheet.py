"""This module draws all seven drones on one page.

The command is `python -m dronekeypp.sixdronesyn.contact_sheet [OUT.png] [--edition N]`. It also prints the
drones' numbers and where each is from. Every view of a row has the same scale, which a bar gives. The camera
is orthographic.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyvista as pv
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from dronekeypp.sixdronesyn.drones import EDITION, EDITIONS, SEVEN, Drone
from dronekeypp.sixdronesyn.meshes import drone_mesh
from dronekeypp.sixdronesyn.shape_table import shape_table

# azimuth and elevation of the camera in degrees; azimuth 0 is in front of the drone, looking at its nose
VIEWS = {
    "front left": (38, 20),
    "rear right": (218, 24),
    "left side": (90, 4),
    "from above": (180, 89.9),
    "front": (0, 3),
}
BACKGROUND = (0.955, 0.96, 0.965)
FIGURES = {1: "drones.png", 2: "drones_second_edition.png"}


def render(
    drone: str | Drone,
    azimuth: float,
    elevation: float,
    pixels: tuple[int, int],
    half_height: float,
    blur: float = 2.2,
    samples: int = 2,
) -> np.ndarray:
    """Return one orthographic view, (height, width, 3) uint8.

    Args:
        drone: the drone, or its name.
        azimuth, elevation: where the camera stands, degrees in the body frame.
        pixels: (width, height) of the picture.
        half_height: metres from the middle of the picture to its upper edge.
        blur: the angle that each propeller turns through during the exposure, radians.
        samples: the picture is drawn this many times finer in each direction, and averaged.
    """
    mesh = drone_mesh(drone)
    width, height = pixels
    size = [width * samples, height * samples]
    plotter = pv.Plotter(off_screen=True, window_size=size, lighting="none")
    plotter.set_background(BACKGROUND)
    a, e = np.radians([azimuth, elevation])
    camera_direction = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    toward = np.array([np.cos(a), np.sin(a), 0.0])
    sun = (0.5 * toward - 0.55 * right + (0, 0, 1), 0.86)
    fill = (0.8 * toward + 0.9 * right + (0, 0, 0.1), 0.45)
    ground = (0.3 * toward - (0, 0, 1), 0.25)
    for position, strength in (sun, fill, ground):
        light = pv.Light(
            position=tuple(position), focal_point=(0, 0, 0), intensity=strength, light_type="scene light"
        )
        plotter.add_light(light)
    body = plotter.add_mesh(
        mesh.body, scalars="rgb", rgb=True, ambient=0.16, diffuse=1.0, specular=0.20, specular_power=24
    )
    body.prop.interpolation = "phong"
    discs = mesh.propellers(np.array([0.5, 1.1, 1.9, 2.6]), blur)
    plotter.add_mesh(discs, scalars="rgba", rgb=True, lighting=False)
    camera = plotter.camera
    camera.focal_point, camera.position = (0, 0, 0), tuple(camera_direction)
    # from above, the side away from the camera points up in the picture
    camera.up = (np.cos(a + np.pi), np.sin(a + np.pi), 0) if elevation > 80 else (0, 0, 1)
    camera.parallel_projection, camera.parallel_scale = True, half_height
    camera.clipping_range = (0.01, 2.0)
    picture = plotter.screenshot(return_img=True).astype(float)[..., :3]
    plotter.close()
    picture = picture.reshape(height, samples, width, samples, 3).mean(axis=(1, 3))
    return np.rint(picture).astype(np.uint8)


def contact_sheet(path: str | Path, drones: Sequence[Drone], cell: tuple[int, int] = (360, 262)) -> None:
    """Draw a row of five views for each drone and save them as PNG.

    `cell` is (width, height) of a view in pixels.
    """
    cell_width, cell_height = cell
    head, foot = 34, 30
    width, height = cell_width * len(VIEWS), head + cell_height * len(drones) + foot
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor=BACKGROUND)
    axes = figure.add_axes((0, 0, 1, 1))
    for column, title in enumerate(VIEWS):
        axes.text(cell_width * (column + 0.5), head / 2, title, ha="center", va="center", fontsize=11)
    for row, drone in enumerate(drones):
        top = head + cell_height * row
        bottom = top + cell_height
        # the outer half of a blurred propeller may leave the cell: the bodies are then a quarter larger
        outer = np.abs(drone.hubs[:, :2]).max(axis=0) + 0.55 * drone.propeller_radius
        half_height = max(outer[0], outer[1] * cell_height / cell_width)
        for column, (azimuth, elevation) in enumerate(VIEWS.values()):
            left = cell_width * column
            picture = render(drone, azimuth, elevation, cell, half_height)
            axes.imshow(picture, extent=(left, left + cell_width, bottom, top), interpolation="none")
        axes.text(10, top + 18, drone.label, fontsize=12, weight="bold", va="center")
        numbers = f"wheelbase {drone.wheelbase * 1000:.0f} mm, {drone.mass * 1000:.0f} g"
        axes.text(10, bottom - 34, numbers, fontsize=9, va="center")
        bar = 0.1 * cell_height / (2 * half_height)
        axes.add_patch(Rectangle((10, bottom - 20), bar, 4, color="black", linewidth=0))
        axes.text(16 + bar, bottom - 18, "100 mm", fontsize=9, va="center")
        axes.axhline(top, color="0.8", linewidth=0.8)
    caption = (
        "Orthographic, one scale per row given by its bar. "
        "Propellers turn through 126° while the shutter is open."
    )
    axes.text(10, height - foot / 2, caption, fontsize=9, va="center")
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.axis("off")
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True}, metadata={"Software": None})


def main(arguments: list[str] | None = None) -> None:
    """Run the command line. arguments: None for those of the process."""
    parser = argparse.ArgumentParser(
        prog="python -m dronekeypp.sixdronesyn.contact_sheet",
        description="Draw the seven drones, and print their numbers and where each is from.",
    )
    parser.add_argument("out", nargs="?", type=Path, help="the PNG file; by default one in figures/")
    parser.add_argument("--edition", type=int, choices=sorted(EDITIONS), default=EDITION)
    values = parser.parse_args(arguments)
    drones = [EDITIONS[values.edition][name] for name in SEVEN]
    contact_sheet(values.out or Path("figures") / FIGURES[values.edition], drones)
    print(shape_table(drones))


if __name__ == "__main__":
    main()
