"""The 3D pose decoder (Sec. III-B, Eq. 6-8): rays and class in, 3D keypoints and pose out. No drone's size is given."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor, nn

from dronekeypp import camera, rotations
from dronekeypp.model.config import ModelConfig

EMBEDDING = 64  # width of e_ray and e_cls, from the paper
SMALLEST_SPREAD = (
    1e-3  # ray units, 1.5 px at f = 1500: keeps log and division finite while all keypoints coincide
)


def mlp(inp: int, out: int, config: ModelConfig) -> nn.Sequential:
    """Linear-ReLU `config.decoder_layers` times, then Linear to `out`. (Fig. 2b of the paper holds the real widths.)"""
    widths = [inp] + [config.decoder_width] * config.decoder_layers
    layers: list[nn.Module] = []
    for a, b in zip(widths[:-1], widths[1:], strict=True):
        layers += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(widths[-1], out))


class RayFeatures(nn.Module):
    """Rays (B, 4, 3) -> what the ray embedding is fed (B, F).

    "raw": the 12 numbers of Eq. 6 (F = 12). They differ by a few hundredths within a drone: badly conditioned input.
    "standardised": the same 12, minus their training mean, over their training deviation.
    "split": the centre of the four rays (2), the log of their spread (1), and their shape (8) = (rays - centre) / spread,
    each standardised (F = 11). The centre says where the drone is, the spread how far, the shape how it is turned.

    The two statistics are buffers, saved with the weights. `fit` sets them; before that they are rough constants.
    """

    def __init__(self, mode: str):
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
        """The features before they are standardised: (B, F)."""
        if self.mode != "split":
            return rays.flatten(1)  # (B, 12)
        centre, spread = centre_and_spread(rays)
        shape = (rays[..., :2] - centre[:, None]) / spread[..., None]  # (B, 4, 2)
        return torch.cat([centre, spread.log(), shape.flatten(1)], dim=1)  # (B, 11)

    def fit(self, rays: Tensor) -> None:
        """Set the statistics from the rays of the training set (F, 4, 3). "raw" has none."""
        if self.mode == "raw":
            return
        features = self.unscaled(rays.double())
        deviation = features.std(dim=0, unbiased=False)
        self.mean.copy_(features.mean(dim=0))
        self.std.copy_(torch.where(deviation > 1e-6, deviation, torch.ones_like(deviation)))  # z is always 1

    def forward(self, rays: Tensor) -> Tensor:
        return (self.unscaled(rays) - self.mean) / self.std


def centre_and_spread(rays: Tensor) -> tuple[Tensor, Tensor]:
    """Mean x, y (B, 2) of four rays (B, 4, 3) with z = 1, and their root mean square distance from it (B, 1), never 0."""
    centre = rays[..., :2].mean(dim=1)  # (B, 2)
    apart = rays[..., :2] - centre[:, None]  # (B, 4, 2)
    return centre, (apart.square().sum(-1).mean(-1, keepdim=True) + SMALLEST_SPREAD**2).sqrt()


def from_site(s: Tensor, rays: Tensor) -> Tensor:
    """Scale-invariant translation (B, 3) to metres (B, 3): SITE of CDPN (Li et al., ICCV 2019), on rays (B, 4, 3).

    s[:, :2] is how far the drone's centre lies from the centre of the rays, in their spreads; exp(s[:, 2]) is the drone's size, the
    depth times the spread, in metres. CDPN measures against the detector's box; the keypoints' own centre and spread are the same
    in every crop, and rays are already divided by the focal length.
    """
    centre, spread = centre_and_spread(rays)
    direction = torch.cat([centre + s[:, :2] * spread, torch.ones_like(spread)], dim=1)  # (B, 3), z = 1
    return direction * s[:, 2:].exp() / spread


class PoseDecoder(nn.Module):
    """Keypoints (B, 4, 2) in crop units, class probabilities (B, classes), K (B, 3, 3), square (B, 3) -> pose.

    Returns keypoints_px (B, 4, 2), rays (B, 4, 3), e_ray and e_cls (B, 64) or None, keypoints_3d (B, 4, 3) or None
    (metres, camera axes, relative to the drone's centre), angles (B, 3) or None, R (B, 3, 3), t (B, 3) metres.
    """

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        if config.use_rays:
            self.ray_features = RayFeatures(config.rays)
            self.embed_rays = nn.Linear(self.ray_features.size, EMBEDDING)
        if config.use_class:
            self.embed_class = nn.Linear(config.classes, EMBEDDING)
        fused = (EMBEDDING if config.use_rays else 8) + (EMBEDDING if config.use_class else 0)
        if config.use_3d:
            self.mlp_3d = mlp(fused, 4 * 3, config)
        self.rotation_size = 3 if config.rotation == "euler" else 6
        self.mlp_pose = mlp(fused + (12 if config.use_3d else 0), self.rotation_size + 3, config)
        with torch.no_grad():
            if config.rotation != "euler":  # start near the identity: Gram-Schmidt needs independent columns
                self.mlp_pose[-1].bias[:6] = torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
            if config.translation == "site":  # start with a drone whose hubs lie 0.2 m from its centre
                self.mlp_pose[-1].bias[-1:] = math.log(0.2)

    def fit_rays(self, batches: Iterable[dict[str, Tensor]]) -> None:
        """Set the ray statistics from batches with true keypoints, square and K. A no-op where none are used."""
        if not self.config.use_rays or self.config.rays == "raw":
            return
        found = [camera.rays(camera.from_crop(b["keypoints"], b["square"]), b["K"]).cpu() for b in batches]
        self.ray_features.fit(torch.cat(found))

    def forward(
        self, keypoints: Tensor, probs: Tensor, K: Tensor, square: Tensor
    ) -> dict[str, Tensor | None]:
        # Back to full-frame pixels, with the full-frame matrix: so cutting and resizing a crop never changes a ray.
        pixels = camera.from_crop(keypoints, square)  # (B, 4, 2)
        rays = camera.rays(pixels, K)  # (B, 4, 3), Eq. 6
        e_ray = self.embed_rays(self.ray_features(rays)) if self.config.use_rays else None  # (B, 64)
        e_cls = self.embed_class(probs) if self.config.use_class else None  # (B, 64)
        fused = (
            keypoints.flatten(1) if e_ray is None else e_ray
        )  # Table 5, row 1: crop coordinates straight in
        if e_cls is not None:
            fused = torch.cat([fused, e_cls], dim=1)  # (B, 128) = f
        keypoints_3d = None
        if self.config.use_3d:
            flat = self.mlp_3d(fused)  # (B, 12), Eq. 7
            keypoints_3d = flat.unflatten(1, (4, 3))
            fused = torch.cat([fused, flat], dim=1)
        pose = self.mlp_pose(fused)  # (B, 3+3) or (B, 6+3), Eq. 8
        turn, t = pose[:, : self.rotation_size], pose[:, self.rotation_size :]
        if self.config.rotation == "euler":
            # The paper's head. A sigmoid cannot cross 0 = 1, though the loss is circular, and the paper does not say which
            # angle 0 is. Were it 0°, a drone in level flight would always sit on that seam, in pitch and in roll, and half
            # of all small tilts would need 0.01, the other half 0.99. Ours: 0.5 is 0°, so the seam is at ±180°.
            angles = torch.sigmoid(turn)
            if self.config.angle_zero == "middle":
                angles = (angles + 0.5) % 1.0
            R = rotations.angles_to_matrix(angles)
        else:
            angles, R = None, rotations.matrix_from_6d(turn)
        if (
            self.config.rotation == "allocentric"
        ):  # as seen along the ray to the drone, not along the camera's axis
            R = rotations.towards(rays.mean(dim=1)) @ R
        if (
            self.config.translation == "site"
        ):  # not metres, but how far off the centre, and how large for its spread
            t = from_site(t, rays)
        return {
            "keypoints_px": pixels, "rays": rays, "e_ray": e_ray, "e_cls": e_cls, "keypoints_3d": keypoints_3d,
            "angles": angles, "R": R, "t": t,
        }  # fmt: skip
