"""Change training pictures: another camera's colours, a small compressed video, and the mirror."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from torch import Tensor

from dronekeypp.camera import MIRRORED_KEYPOINTS, mirror_image, mirror_keypoints, mirror_square
from dronekeypp.rotations import mirror_points, mirror_rotation

SMALLEST_SIDE = 20  # pixels: `degrade` makes no crop smaller


def recolour(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a picture (H, W, 3) uint8 as another camera would show the same scene.

    Exposure, gamma, white balance and saturation are drawn from `rng`. There are only 14 training
    environments; without this a network learns their light along with the drones.
    """
    level = np.arange(256) / 255
    gains = np.exp(rng.uniform(-0.3, 0.3) + rng.uniform(-0.1, 0.1, 3))[:, None]  # (3, 1)
    curves = gains * level ** np.exp(rng.uniform(-0.35, 0.35))  # (3, 256)
    curves = (curves * 255).clip(0, 255).astype(np.uint8)
    image = cv2.LUT(image, np.ascontiguousarray(curves.T[None]))
    saturation = rng.uniform(0.5, 1.2)
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    return cv2.addWeighted(image, saturation, grey, 1 - saturation, 0)


def degrade(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a crop (S, S, 3) uint8 as a small, compressed video shows it.

    Rendered crops are sharp and free of noise. A real drone is often 20 to 80 pixels wide, and its camera
    sharpens the picture, adds noise and compresses it. All of that happens here at the small size, before the
    crop is enlarged again. Every strength is drawn from `rng`.
    """
    S = image.shape[0]
    side = int(round(np.exp(rng.uniform(np.log(min(SMALLEST_SIDE, S)), np.log(S)))))
    small = cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA).astype(np.float32)
    small += rng.uniform(0, 1) * (small - cv2.GaussianBlur(small, (0, 0), 1))
    small += rng.normal(0, rng.uniform(0, 8), small.shape)
    quality = int(rng.integers(30, 91))
    pixels = small.clip(0, 255).round().astype(np.uint8)
    data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return cv2.resize(cv2.imdecode(data, cv2.IMREAD_COLOR), (S, S), interpolation=cv2.INTER_LINEAR)


def mirrored(items: dict[str, Tensor], chosen: Tensor) -> dict[str, Tensor]:
    """Return a batch in which the chosen frames are seen in a mirror.

    The mirror is held at x = 0 of the camera. A drone's left is its right in a mirror, so the picture shows
    the same drone in another pose. Left and right hubs exchange their names, and the crop's square is
    mirrored about the principal point; K stays. There are few flights and each has few headings; the mirror
    doubles them. It is right for drones whose hubs are left–right symmetric.

    Args:
        items: the batch, with image, K and the keys of `data.MIRRORED`.
        chosen: (B,) bool, the frames to mirror.
    """
    changed = {
        "image": mirror_image(items["image"]),
        "square": mirror_square(items["square"], items["K"]),
        "keypoints": mirror_keypoints(items["keypoints"]),
        "keypoints_3d": mirror_points(items["keypoints_3d"][:, MIRRORED_KEYPOINTS]),
        "R": mirror_rotation(items["R"]),
        "t": mirror_points(items["t"]),
        "visible": items["visible"][:, MIRRORED_KEYPOINTS],
    }
    result = {}
    for name, value in items.items():
        choice = chosen.view(-1, *[1] * (value.dim() - 1))
        result[name] = torch.where(choice, changed.get(name, value), value)
    return result
