"""Figures that more than one notebook shows. Every function draws into an axis it is given, and returns it."""

import matplotlib
import numpy as np

from dronekeypp.camera import project, to_crop

# Okabe–Ito colours, safe for colour-blind readers. One a keypoint: front-left, front-right, rear-right, rear-left.
KEYPOINT_COLOURS = ("#D55E00", "#E69F00", "#0072B2", "#56B4E9")
AXIS_COLOURS = ("#D55E00", "#009E73", "#0072B2")  # body x (forward), y (left), z (up)
KEYPOINT_LABELS = ("front-left", "front-right", "rear-right", "rear-left")


def style():
    """Small, quiet defaults for every figure of the course. Call it once at the top of a notebook."""
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


def show_image(ax, image, title=None):
    """Show an image without ticks: (H, W, 3) uint8 or float, or a torch tensor (3, H, W) in [0, 1]."""
    image = np.asarray(image)
    if image.ndim == 3 and image.shape[0] == 3:
        image = image.transpose(1, 2, 0)
    # Pixel centres at +0.5: the picture covers [0, W] × [0, H], so annotations need no shift.
    ax.imshow(image, extent=(0, image.shape[1], image.shape[0], 0))
    ax.set(xticks=[], yticks=[], title=title)
    for spine in ax.spines.values():
        spine.set_visible(False)
    return ax


def draw_keypoints(ax, points, visible=None, marker="o", size=18, labels=False):
    """Draw four keypoints (4, 2) in the axis' pixels; hollow where `visible` (4,) is false."""
    for i, (x, y) in enumerate(np.asarray(points)):
        seen = visible is None or bool(visible[i])
        face = KEYPOINT_COLOURS[i] if seen else "none"
        kind = (
            dict(c=KEYPOINT_COLOURS[i])
            if marker in ("x", "+")
            else dict(facecolors=face, edgecolors=KEYPOINT_COLOURS[i])
        )
        ax.scatter(
            x,
            y,
            s=size,
            marker=marker,
            linewidths=1.2,
            label=KEYPOINT_LABELS[i] if labels else None,
            zorder=3,
            **kind,
        )
    return ax


def draw_box(ax, box, colour="white"):
    """Draw a box (x, y, w, h)."""
    ax.add_patch(
        matplotlib.patches.Rectangle(box[:2], box[2], box[3], fill=False, edgecolor=colour, linewidth=1)
    )
    return ax


def draw_axes(ax, R, t, K, square=None, size=None, length=0.15):
    """Draw the body axes of a pose: x forward (orange), y left (green), z up (blue), each `length` metres.

    Full-frame pixels, or with `square` (x, y, side) and `size` the pixels of that crop.
    """
    R, t, K = (np.asarray(v, dtype=float) for v in (R, t, K))
    tips = project(np.concatenate([np.zeros((1, 3)), length * np.eye(3)]) @ R.T + t, K)
    if square is not None:
        tips = to_crop(tips, np.asarray(square, dtype=float)) * size
    for tip, colour in zip(tips[1:], AXIS_COLOURS, strict=True):
        ax.annotate(
            "",
            tip,
            tips[0],
            arrowprops=dict(arrowstyle="-|>", color=colour, linewidth=1.6, shrinkA=0, shrinkB=0),
        )
    return ax
