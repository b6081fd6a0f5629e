"""Decode the pose as the paper does (Sec. III-B, Eq. 6-8).

Rays and class go in; 3D keypoints and the pose come out. No drone's size is given to the decoder.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from dronekeypp import camera
from dronekeypp.model.contract import Decoder, PictureShape
from dronekeypp.model.rotation_heads import ROTATION_HEADS
from dronekeypp.settings import Settings

EMBEDDING = 64  # width of e_ray and e_cls, from the paper
# Ray units, 1.5 px at f = 1500. It keeps logarithm and division finite while all keypoints coincide.
SMALLEST_SPREAD = 1e-3
RAY_MODES = ("raw", "standardised", "split")  # what a ray embedding can be fed, see `RayFeatures`


@dataclass(frozen=True)
class DecoderConfig(Settings):
    """These are the settings of the paper's decoder: the parts of its Table 5, its heads, and its size."""

    use_rays: bool = True  # False: the decoder sees the crop coordinates, flattened (Table 5, row 1)
    use_class: bool = True  # False: no class embedding (Table 5, rows 1-3)
    use_3d: bool = True  # False: no MLP_3D (Table 5, rows 1-2)
    rays: str = "raw"  # what the ray embedding is fed: "raw" (paper) | "standardised" | "split"
    rotation: str = "euler"  # "euler" (paper: three sigmoid angles) | "sixd" | "allocentric", see the heads
    translation: str = "metres"  # "metres" (paper) | "site": against centre and spread of the rays
    angle_zero: str = "middle"  # euler: 0° at the "middle" of the sigmoid, seam at 180° | at its "edge"
    decoder_width: int = 256  # hidden width of MLP_3D and MLP_pose
    decoder_layers: int = 3  # their hidden layers

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {
        "rays": RAY_MODES,
        "rotation": tuple(ROTATION_HEADS),
        "translation": ("metres", "site"),
        "angle_zero": ("middle", "edge"),
    }
    LEAST: ClassVar[dict[str, float]] = {"decoder_width": 1, "decoder_layers": 1}
    MOST: ClassVar[dict[str, float]] = {"decoder_width": 65536, "decoder_layers": 64}
    ONLY_WITH: ClassVar[dict[str, tuple[tuple[str, Any], ...]]] = {
        "rays": (("use_rays", True),),
        "angle_zero": (("rotation", "euler"),),
    }


def mlp(inp: int, out: int, config: Settings) -> nn.Sequential:
    """Return an MLP from `inp` to `out` numbers.

    It is a Linear and a ReLU, `config.decoder_layers` times, then a Linear to `out`. The real widths stand in
    Fig. 2b of the paper, which is an image.
    """
    widths = [inp] + [config.decoder_width] * config.decoder_layers
    layers: list[nn.Module] = []
    for a, b in zip(widths[:-1], widths[1:], strict=True):
        layers += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(widths[-1], out))


class RayFeatures(nn.Module):
    """This module turns rays (B, 4, 3) into what the ray embedding is fed (B, F).

    There are three modes:
        "raw": the 12 numbers of Eq. 6 (F = 12). They differ by a few hundredths within a drone, which is
            badly conditioned input.
        "standardised": the same 12, minus their training mean, over their training deviation (F = 12).
        "split": the centre of the four rays (2), the logarithm of their spread (1), and their shape (8) =
            (rays - centre) / spread, each standardised (F = 11). The centre says where the drone is, the
            spread how far away, the shape how it is turned.

    The mean and the deviation are buffers, saved with the weights. `fit` sets them; before that they are
    rough constants.
    """

    def __init__(self, mode: str) -> None:
        super().__init__()
        self.mode = mode
        self.size = 11 if mode == "split" else 12
        mean, std = torch.zeros(self.size), torch.ones(self.size)
        if mode == "standardised":
            mean, std = torch.tensor([0.0, 0.0, 1.0]).repeat(4), torch.tensor([0.3, 0.2, 1.0]).repeat(4)
        elif mode == "split":
            mean[2] = -3.5  # spread of 3 cm at 1 m, or of 15 cm at 5 m
            std = torch.tensor([0.3, 0.2, 0.7] + [0.7] * 8)
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)

    def unscaled(self, rays: Tensor) -> Tensor:
        """Return the features (B, F) of rays (B, 4, 3) before they are standardised."""
        if self.mode != "split":
            return rays.flatten(1)  # (B, 12)
        centre, spread = centre_and_spread(rays)
        shape = (rays[..., :2] - centre[:, None]) / spread[..., None]  # (B, 4, 2)
        return torch.cat([centre, spread.log(), shape.flatten(1)], dim=1)  # (B, 11)

    def fit(self, rays: Tensor) -> None:
        """Set the mean and the deviation from the rays of the training set (F, 4, 3).

        The mode "raw" has none.
        """
        if self.mode == "raw":
            return
        features = self.unscaled(rays.double())
        deviation = features.std(dim=0, unbiased=False)
        self.mean.copy_(features.mean(dim=0))
        self.std.copy_(torch.where(deviation > 1e-6, deviation, torch.ones_like(deviation)))  # z is always 1

    def forward(self, rays: Tensor) -> Tensor:
        return (self.unscaled(rays) - self.mean) / self.std


def centre_and_spread(rays: Tensor) -> tuple[Tensor, Tensor]:
    """Return the centre and the spread of four rays (B, 4, 3) with z = 1.

    Returns:
        the mean x, y (B, 2), and the root mean square distance from it (B, 1), which is never 0.
    """
    centre = rays[..., :2].mean(dim=1)  # (B, 2)
    apart = rays[..., :2] - centre[:, None]  # (B, 4, 2)
    return centre, (apart.square().sum(-1).mean(-1, keepdim=True) + SMALLEST_SPREAD**2).sqrt()


def from_site(s: Tensor, rays: Tensor) -> Tensor:
    """Convert scale-invariant translations to metres.

    This is SITE of CDPN (Li et al., ICCV 2019), on rays. CDPN measures against the detector's box. The
    keypoints' own centre and spread are the same in every crop, and rays are already divided by the focal
    length.

    Args:
        s: (B, 3). s[:, :2] is how far the drone's centre lies from the centre of the rays, in their spreads.
            exp(s[:, 2]) is the drone's size, which is the depth times the spread, in metres.
        rays: (B, 4, 3) with z = 1.

    Returns:
        (B, 3) the drone's centre in camera axes, metres.
    """
    centre, spread = centre_and_spread(rays)
    direction = torch.cat([centre + s[:, :2] * spread, torch.ones_like(spread)], dim=1)  # (B, 3), z = 1
    return direction * s[:, 2:].exp() / spread


def true_rays(annotations: dict[str, Tensor]) -> Tensor:
    """Return the rays (F, 4, 3) of the true keypoints of training frames.

    `annotations` holds keypoints, square and K, stacked.
    """
    pixels = camera.from_crop(annotations["keypoints"], annotations["square"])
    return camera.rays(pixels, annotations["K"])


class PoseDecoder(Decoder):
    """This is the paper's decoder, which makes a pose from keypoints and a class.

    It takes keypoints (B, 4, 2) in crop units, class probabilities (B, classes), K (B, 3, 3) and square
    (B, 3).

    It returns a dict:
        keypoints_px: (B, 4, 2) full-frame pixels.
        rays: (B, 4, 3) by Eq. 6.
        e_ray, e_cls: (B, 64) the embeddings, or None.
        keypoints_3d: (B, 4, 3) metres, camera axes, relative to the drone's centre; or None.
        angles: (B, 3) turns, or None.
        R: (B, 3, 3) camera←body.
        t: (B, 3) metres.
    """

    Config = DecoderConfig

    def __init__(self, config: DecoderConfig, classes: int = 7, picture: PictureShape | None = None) -> None:
        super().__init__()
        self.config = config
        if config.use_rays:
            self.ray_features = RayFeatures(config.rays)
            self.embed_rays = nn.Linear(self.ray_features.size, EMBEDDING)
        if config.use_class:
            self.embed_class = nn.Linear(classes, EMBEDDING)
        fused = (EMBEDDING if config.use_rays else 8) + (EMBEDDING if config.use_class else 0)
        if config.use_3d:
            self.mlp_3d = mlp(fused, 4 * 3, config)
        self.rotation = ROTATION_HEADS[config.rotation](config)
        self.mlp_pose = mlp(fused + (12 if config.use_3d else 0), self.rotation.size + 3, config)
        with torch.no_grad():
            if self.rotation.start:
                self.mlp_pose[-1].bias[: self.rotation.size] = torch.tensor(self.rotation.start)
            if config.translation == "site":  # start with a drone whose hubs lie 0.2 m from its centre
                self.mlp_pose[-1].bias[-1:] = math.log(0.2)

    @property
    def learns_from(self) -> tuple[str, ...]:
        """Return what its losses read of a frame's truth. Without MLP_3D that is no 3D keypoints."""
        keys = ("R", "t", "keypoints", "label")
        return (*keys, "keypoints_3d") if self.config.use_3d else keys

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """Set the ray statistics from the true keypoints of training frames, if rays are used."""
        if self.config.use_rays:
            self.ray_features.fit(true_rays(annotations))

    def forward(
        self, keypoints: Tensor, probs: Tensor, K: Tensor, square: Tensor
    ) -> dict[str, Tensor | None]:
        # Back to full-frame pixels, used with the full-frame matrix: so cutting a crop never changes a ray.
        pixels = camera.from_crop(keypoints, square)  # (B, 4, 2)
        rays = camera.rays(pixels, K)  # (B, 4, 3), Eq. 6
        e_ray = self.embed_rays(self.ray_features(rays)) if self.config.use_rays else None  # (B, 64)
        e_cls = self.embed_class(probs) if self.config.use_class else None  # (B, 64)
        fused = keypoints.flatten(1) if e_ray is None else e_ray  # Table 5, row 1: crop coordinates
        if e_cls is not None:
            fused = torch.cat([fused, e_cls], dim=1)  # (B, 128) = f
        keypoints_3d = None
        if self.config.use_3d:
            flat = self.mlp_3d(fused)  # (B, 12), Eq. 7
            keypoints_3d = flat.unflatten(1, (4, 3))
            fused = torch.cat([fused, flat], dim=1)
        pose = self.mlp_pose(fused)  # (B, 3+3) or (B, 6+3), Eq. 8
        turn, t = pose[:, : self.rotation.size], pose[:, self.rotation.size :]
        R, angles = self.rotation(turn, rays)
        if self.config.translation == "site":  # not metres, but offsets in spreads of the rays, and a size
            t = from_site(t, rays)
        return {
            "keypoints_px": pixels,
            "rays": rays,
            "e_ray": e_ray,
            "e_cls": e_cls,
            "keypoints_3d": keypoints_3d,
            "angles": angles,
            "R": R,
            "t": t,
        }
