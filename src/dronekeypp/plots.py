"""Draw figures that more than one notebook shows.

Every function but `style` draws into an axis and returns it.
"""

import sys
from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from torch import Tensor

from dronekeypp.camera import project, to_crop
from dronekeypp.colours import AXIS_COLOURS, KEYPOINT_COLOURS

KEYPOINT_LABELS = ("front-left", "front-right", "rear-right", "rear-left")


def style() -> None:
    """Set small, quiet defaults for every figure of the course.

    Call it once at the top of a notebook. Where the environment asks for a backend that draws to files only
    (MPLBACKEND=Agg, as in many containers), a notebook gets the one that shows its figures.
    """
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if hasattr(shell, "kernel") and matplotlib.get_backend().lower() == "agg":
        shell.run_line_magic("matplotlib", "inline")
    matplotlib.rcParams.update(
        {
            "figure.dpi": 100,
            "figure.constrained_layout.use": True,
            "font.size": 9,
            "axes.titlesize": 10,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.prop_cycle": matplotlib.cycler(
                color=["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"]
            ),
            "image.interpolation": "nearest",
            "legend.frameon": False,
        }
    )


def show_image(ax: Axes, image: np.ndarray | Tensor, title: str | None = None) -> Axes:
    """Show an image without ticks: (H, W, 3) uint8 or float, or a tensor (3, H, W) in [0, 1]."""
    image = np.asarray(image)
    if image.ndim == 3 and image.shape[0] == 3:
        image = image.transpose(1, 2, 0)
    # Pixel centres are at +0.5: the image covers [0, W] × [0, H], so annotations need no shift.
    ax.imshow(image, extent=(0, image.shape[1], image.shape[0], 0))
    ax.set(xticks=[], yticks=[], title=title)
    for spine in ax.spines.values():
        spine.set_visible(False)
    return ax


def draw_keypoints(
    ax: Axes,
    points: np.ndarray | Tensor,
    visible: np.ndarray | Tensor | None = None,
    marker: str = "o",
    size: float = 18,
    labels: bool = False,
) -> Axes:
    """Draw four keypoints (4, 2) in the pixels of the axis.

    A keypoint is drawn hollow where `visible` (4,) is false. With `labels` the keypoints have legend entries.
    """
    for i, (x, y) in enumerate(np.asarray(points)):
        colour = KEYPOINT_COLOURS[i]
        if marker in ("x", "+"):  # these markers have no face
            colours = {"c": colour}
        else:
            is_visible = visible is None or bool(visible[i])
            colours = {"facecolors": colour if is_visible else "none", "edgecolors": colour}
        label = KEYPOINT_LABELS[i] if labels else None
        ax.scatter(x, y, s=size, marker=marker, linewidths=1.2, label=label, zorder=3, **colours)
    return ax


def draw_box(ax: Axes, box: Sequence[float] | np.ndarray, colour: str = "white") -> Axes:
    """Draw a box (x, y, width, height) in the pixels of the axis."""
    x, y, width, height = box
    ax.add_patch(Rectangle((x, y), width, height, fill=False, edgecolor=colour, linewidth=1))
    return ax


def draw_axes(
    ax: Axes,
    R: np.ndarray | Tensor,
    t: np.ndarray | Tensor,
    K: np.ndarray | Tensor,
    square: np.ndarray | Tensor | None = None,
    size: float | None = None,
    length: float = 0.15,
) -> Axes:
    """Draw the body axes of a pose: x forward (orange), y left (green), z up (blue).

    Args:
        ax: shows the full frame, or the crop if `square` is given.
        R: (3, 3), from body to camera axes.
        t: (3,), metres in camera axes.
        K: (3, 3), the camera matrix of the full frame.
        square: (x, y, side) of the crop in full-frame pixels, or None for the full frame.
        size: the side of the crop in pixels of the axis; needed with `square`.
        length: the length of an axis in metres.
    """
    R = np.asarray(R, dtype=float)
    t = np.asarray(t, dtype=float)
    K = np.asarray(K, dtype=float)
    ends = np.concatenate([np.zeros((1, 3)), length * np.eye(3)])  # (4, 3): the origin and the three tips
    pixels = project(ends @ R.T + t, K)  # (4, 2)
    if square is not None:
        pixels = to_crop(pixels, np.asarray(square, dtype=float)) * size
    arrow = {"arrowstyle": "-|>", "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    for tip, colour in zip(pixels[1:], AXIS_COLOURS, strict=True):
        ax.annotate("", tip, pixels[0], arrowprops=arrow | {"color": colour})
    return ax
