"""Decode the pose beyond the paper (`pose="geometric"`): learn shapes, and let projection do the rest.

The paper's decoder is an MLP that has to rediscover projection. But the class is known, and the training
annotations show where each class has its hubs. So this decoder has four parts:
    (a) `SharpHead` finds the keypoints on a fine map and says how sure it is of each.
    (b) `ClassShapes` holds the hubs of every class.
    (c) `refine` moves a pose until the hubs fall onto the keypoints, each as far as it can be trusted, with
        gradients through its last step.
    (d) A direct branch, an MLP on well-conditioned rays, guesses the pose first.

The guess starts the search and stays in it as a prior. Where keypoints say little, the guess carries the
pose. A flat object has two poses that look alike (see `pnp`), and the guess decides between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from dronekeypp import camera, rotations
from dronekeypp.model.backbone import half_precision
from dronekeypp.model.contract import Decoder, PictureShape
from dronekeypp.model.decoder import EMBEDDING, RAY_MODES, RayFeatures, from_site, mlp, true_rays
from dronekeypp.model.encoder import cell_centres
from dronekeypp.model.geometric_losses import geometric_loss_terms
from dronekeypp.model.solver import NEAREST, Problem, refine, unrefined
from dronekeypp.settings import Settings

WIDTH = 64  # channels of the sharp head
# The smallest and the largest standard deviation that the network may claim.
KEYPOINT_SIGMA = (0.002, 0.5)  # crop units, of one keypoint
ANGLE_SIGMA = (0.01, 3.0)  # radians, of the direct branch's rotation
DISTANCE_SIGMA = (0.005, 1.0)  # share of the depth, of the direct branch's translation


class SharpHead(nn.Module):
    """This head finds keypoints on a fine map, and says how sure it is of each.

    The coarse map knows which propeller is which, the fine one where exactly it is. Each is brought to WIDTH
    channels and added to the enlarged coarser one (feature pyramid, Lin et al., CVPR 2017). Then every cell
    of the fine map says how much it looks like each keypoint, and a keypoint is the mean place (soft-argmax).
    Its deviation is read from the features there and from how wide its map is.

    It turns feature maps at three strides into keypoints (B, 4, 2) and their standard deviation
    keypoint_sigma (B, 4), both in crop units.

    With `bfloat16` set to True its convolutions compute in it while they train; see
    `backbone.half_precision`.
    """

    bfloat16 = False

    def __init__(self, channels: tuple[int, int, int], side: int) -> None:
        super().__init__()
        self.lateral = nn.ModuleList(nn.Conv2d(c, WIDTH, 1) for c in channels)
        self.smooth = nn.ModuleList(
            nn.Sequential(nn.Conv2d(WIDTH, WIDTH, 3, padding=1, bias=False), nn.BatchNorm2d(WIDTH), nn.ReLU())
            for _ in range(2)
        )
        self.to_heatmap = nn.Conv2d(WIDTH, 4, 1, bias=False)
        self.to_sigma = nn.Sequential(nn.Linear(WIDTH + 1, 32), nn.ReLU(), nn.Linear(32, 1))
        nn.init.constant_(self.to_sigma[-1].bias, math.log(0.03))
        self.register_buffer("centres", cell_centres(side), persistent=False)  # (M, 2)
        self.to(memory_format=torch.channels_last)

    def forward(self, levels: list[Tensor]) -> dict[str, Tensor]:
        with half_precision(self, levels[0].device):
            fine = self.lateral[0](levels[0])  # (B, W, s/4, s/4)
            middle = self.lateral[1](levels[1])  # (B, W, s/8, s/8)
            x = self.lateral[2](levels[2])
            x = self.smooth[0](middle + interpolate(x, size=middle.shape[-2:], mode="bilinear"))
            x = self.smooth[1](fine + interpolate(x, size=fine.shape[-2:], mode="bilinear"))
        x = x.float()  # (B, W, s/4, s/4)
        heat = torch.softmax(self.to_heatmap(x).flatten(2), dim=2)  # (B, 4, M), each sums to 1
        keypoints = heat @ self.centres  # (B, 4, 2)
        apart = (self.centres - keypoints[:, :, None]).square().sum(dim=-1)  # (B, 4, M)
        spread = (heat * apart).sum(dim=-1, keepdim=True) + 1e-6  # (B, 4, 1)
        features = heat @ x.flatten(2).transpose(1, 2)  # (B, 4, W), at the keypoints
        log_sigma = self.to_sigma(torch.cat([features, 0.5 * spread.log()], dim=2)).squeeze(2)
        return {"keypoints": keypoints, "keypoint_sigma": bounded(log_sigma, KEYPOINT_SIGMA)}


def bounded(log_value: Tensor, limits: tuple[float, float]) -> Tensor:
    """Return exp(log_value), kept within `limits`."""
    return log_value.clamp(math.log(limits[0]), math.log(limits[1])).exp()


class ClassShapes(nn.Module):
    """This module holds where each class has its hubs: (classes, 4, 3) metres in body axes.

    The shapes are learned, and never read off a specification sheet.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.hubs = nn.Parameter(0.1 * torch.randn(classes, 4, 3))

    @torch.no_grad()
    def fit(self, label: Tensor, R: Tensor, keypoints_3d: Tensor) -> None:
        """Start from training annotations.

        The shape of a class is the mean of R^T X over its frames. A class without frames gets the mean of all
        frames.

        Args:
            label: (F,) class indices.
            R: (F, 3, 3) camera←body.
            keypoints_3d: (F, 4, 3) hubs X relative to the drone's centre, camera axes, metres.
        """
        body = keypoints_3d @ R  # (F, 4, 3): rows are points, so this is R^T X
        for k in range(len(self.hubs)):
            of_class = body[label == k]
            self.hubs[k] = (of_class if len(of_class) else body).mean(dim=0)

    def forward(self, probs: Tensor) -> Tensor:
        """Blend the shapes by class probabilities (B, classes) into (B, 4, 3)."""
        return (probs @ self.hubs.flatten(1)).unflatten(1, (4, 3))

    def size_deviation(self, probs: Tensor) -> Tensor:
        """Return how uncertain the class makes the size: the standard deviation (B,) of its logarithm.

        The distance is known no better than the size.
        """
        centred = self.hubs - self.hubs.mean(dim=1, keepdim=True)  # (classes, 4, 3)
        log_size = centred.square().sum(dim=2).mean(dim=1).log() / 2  # (classes,)
        mean = probs @ log_size
        return (probs @ log_size.square() - mean.square()).clamp(min=0).sqrt()


@dataclass(frozen=True)
class GeometricConfig(Settings):
    """These are the settings of the geometric decoder."""

    rays: str = "raw"  # what the direct branch's ray embedding is fed: "raw" | "standardised" | "split"
    decoder_width: int = 256  # hidden width of the direct branch's MLP
    decoder_layers: int = 3  # its hidden layers
    search: bool = True  # False: the direct branch's guess is the answer

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {"rays": RAY_MODES}
    LEAST: ClassVar[dict[str, float]] = {"decoder_width": 1, "decoder_layers": 1}
    MOST: ClassVar[dict[str, float]] = {"decoder_width": 65536, "decoder_layers": 64}


class GeometricDecoder(Decoder):
    """This decoder looks sharply at the picture, learns each class's shape, and searches for the pose.

    It takes keypoints (B, 4, 2) and their sigma (B, 4) in crop units, class probabilities (B, classes), K
    (B, 3, 3), square (B, 3) and summary (B, d). The summary is what the encoder made of the picture, the last
    layer's pooled tokens. So the direct branch sees the drone as well as its keypoints.

    It returns keypoints_px, rays, keypoints_3d, R and t as `PoseDecoder` does, and also:
        R_direct, t_direct: (B, 3, 3) and (B, 3) metres, the direct branch's guess.
        angle_sigma: (B,) radians, how uncertain the direct branch is of its rotation.
        distance_sigma: (B,) share of the depth, how uncertain it is of its translation.
        cost: (B, 2) of the two poses that the search ends at.
        covariance: (B, 6, 6) of (turn in radians, shift in metres), camera axes.
    """

    Config = GeometricConfig
    outputs = ("covariance",)
    needs_image = True

    def __init__(self, config: GeometricConfig, classes: int, picture: PictureShape) -> None:
        super().__init__()
        self.config = config
        self.head = SharpHead(picture.channels, picture.image_size // 4)
        self.shapes = ClassShapes(classes)
        self.ray_features = RayFeatures(config.rays)
        self.embed_rays = nn.Linear(self.ray_features.size, EMBEDDING)
        self.embed_class = nn.Linear(classes, EMBEDDING)
        self.embed_look = nn.Linear(picture.width, EMBEDDING)
        self.mlp_pose = mlp(3 * EMBEDDING, 6 + 3 + 2, config)
        start = [1.0, 0, 0, 0, 1, 0]  # the identity
        start += [0, 0, math.log(0.2)]  # a drone 0.2 m large
        start += [math.log(0.35), math.log(0.1)]  # uncertain by 20 degrees and a tenth of the distance
        with torch.no_grad():
            self.mlp_pose[-1].bias.copy_(torch.tensor(start))
        # What the deviations of the turn and of the shift are multiplied with in the covariance.
        self.register_buffer("calibration", torch.ones(2))

    def look(self, levels: list[Tensor], encoded: dict) -> dict:
        """Put the sharp keypoints in place of the encoder's own.

        Those are called coarse_keypoints from here on.
        """
        return {**encoded, "coarse_keypoints": encoded["keypoints"], **self.head(levels)}

    def decode(self, encoded: dict, probs: Tensor, K: Tensor, square: Tensor) -> dict[str, Tensor | None]:
        summary = encoded["ir"][:, -1]
        return self(encoded["keypoints"], probs, K, square, encoded["keypoint_sigma"], summary)

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """Set the ray statistics, and start the shapes from where the training frames have the hubs."""
        self.ray_features.fit(true_rays(annotations))
        device = self.shapes.hubs.device
        label, R, points = annotations["label"], annotations["R"], annotations["keypoints_3d"]
        self.shapes.fit(label.to(device), R.to(device), points.to(device))

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Return the terms of the loss; see `geometric_loss_terms`."""
        return geometric_loss_terms(output, batch, keypoint_unit)

    def forward(
        self, keypoints: Tensor, probs: Tensor, K: Tensor, square: Tensor, sigma: Tensor, summary: Tensor
    ) -> dict[str, Tensor | None]:
        pixels = camera.from_crop(keypoints, square)  # (B, 4, 2)
        rays = camera.rays(pixels, K)  # (B, 4, 3), Eq. 6
        # Keypoints learn to be where the hubs are, not where the direct branch would like them.
        fixed = rays.detach()
        embedded = [self.embed_rays(self.ray_features(fixed)), self.embed_class(probs)]
        fused = torch.cat([*embedded, self.embed_look(summary)], dim=1)
        direct = self.mlp_pose(torch.relu(fused))
        R0 = rotations.towards(fixed.mean(dim=1)) @ rotations.matrix_from_6d(direct[:, :6])
        t0 = from_site(direct[:, 6:9], fixed)
        angle_sigma = bounded(direct[:, 9], ANGLE_SIGMA)
        distance_sigma = bounded(direct[:, 10], DISTANCE_SIGMA)
        hubs = self.shapes(probs)
        focal = torch.stack([K[:, 0, 0], K[:, 1, 1]], dim=1)  # (B, 2)
        ray_sigma = sigma[:, :, None] * (square[:, 2:] / focal)[:, None]  # (B, 4, 2)
        t_sigma = distance_sigma * t0[:, 2].detach().clamp(min=NEAREST)
        if self.config.search:
            guess = R0.detach(), t0.detach(), angle_sigma, t_sigma
            fit = refine(Problem(hubs, rays[..., :2], ray_sigma, *guess))
        else:
            fit = unrefined(R0, t0, angle_sigma, t_sigma)
        return {
            "keypoints_px": pixels,
            "rays": rays,
            "e_ray": None,
            "e_cls": None,
            "angles": None,
            "R": fit["R"],
            "t": fit["t"],
            "keypoints_3d": hubs @ fit["R"].transpose(1, 2),
            "R_direct": R0,
            "t_direct": t0,
            "angle_sigma": angle_sigma,
            "distance_sigma": distance_sigma,
            "cost": fit["cost"],
            "covariance": self.total_covariance(fit, probs),
        }

    def total_covariance(self, fit: dict[str, Tensor], probs: Tensor) -> Tensor:
        """Return the covariance (B, 6, 6) of a fit of `refine`, with what one fit cannot know.

        Three things are added. The first is the other pose of the two that a flat object has, with the belief
        it deserves. The second is how uncertain the class makes the size, and with it the distance. The third
        is a bad fit: there are 14 residuals less 6 unknowns, so half the weighted squares should be about 4.
        Where they are more, the drone is not of the shape we think.
        """
        misfit = (fit["cost"].amin(dim=1) / 4).clamp(min=1)[:, None, None]
        along = self.shapes.size_deviation(probs)[:, None] * fit["t"]  # (B, 3)
        size = torch.cat([torch.zeros_like(along), along], dim=1)  # (B, 6)
        share = fit["share"]
        other = (share * (1 - share)).sqrt()[:, None] * fit["apart"]  # (B, 6), of two poses with these shares
        spreads = torch.stack([size, other], dim=2)  # (B, 6, 2)
        scale = self.calibration.repeat_interleave(3)
        return (misfit * fit["covariance"] + spreads @ spreads.transpose(1, 2)) * scale[:, None] * scale
