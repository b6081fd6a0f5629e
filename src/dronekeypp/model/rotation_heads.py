"""Turn the numbers at the end of an MLP into a rotation.

A head of your own is a class here, with an entry in ROTATION_HEADS below.
"""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from dronekeypp import rotations
from dronekeypp.settings import Settings


class RotationHead(nn.Module):
    """This is the base of every rotation head.

    It takes the decoder's settings, and reads `size` numbers as a rotation.
    """

    size: ClassVar[int]  # how many numbers it reads
    start: ClassVar[tuple[float, ...]] = ()  # their values before training; (): as the layer comes

    def __init__(self, config: Settings) -> None:
        super().__init__()
        self.config = config

    def forward(self, numbers: Tensor, rays: Tensor) -> tuple[Tensor, Tensor | None]:
        """Return the rotation that the numbers stand for.

        Where there are angles, the loss of the rotation is that of the angles (Eq. 10); elsewhere it is that
        of R.

        Args:
            numbers: (B, size) the end of the MLP.
            rays: (B, 4, 3) the rays of the keypoints.

        Returns:
            R (B, 3, 3) camera←body, and angles (B, 3) in turns or None.
        """
        raise NotImplementedError


class EulerHead(RotationHead):
    """This is the paper's head: three sigmoids give three angles.

    A sigmoid cannot cross 0 = 1, though the loss is circular, and the paper does not say which angle 0 is. If
    it were 0°, a drone in level flight would always sit on that seam, in pitch and in roll: half of all small
    tilts would need 0.01, the other half 0.99. With angle_zero="middle", 0.5 is 0°, so the seam is at ±180°.
    """

    size = 3

    def forward(self, numbers: Tensor, rays: Tensor) -> tuple[Tensor, Tensor | None]:
        angles = torch.sigmoid(numbers)
        if self.config.angle_zero == "middle":
            angles = (angles + 0.5) % 1.0
        return rotations.angles_to_matrix(angles), angles


class SixDHead(RotationHead):
    """This head reads six numbers as the first two columns of R (Zhou et al., CVPR 2019).

    It makes them orthonormal.
    """

    size = 6
    start = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # near the identity: Gram-Schmidt needs independent columns

    def forward(self, numbers: Tensor, rays: Tensor) -> tuple[Tensor, Tensor | None]:
        return rotations.matrix_from_6d(numbers), None


class AllocentricHead(SixDHead):
    """This head reads the same six numbers as the rotation seen along the ray to the drone."""

    def forward(self, numbers: Tensor, rays: Tensor) -> tuple[Tensor, Tensor | None]:
        seen, _ = super().forward(numbers, rays)
        return rotations.towards(rays.mean(dim=1)) @ seen, None


ROTATION_HEADS: dict[str, type[RotationHead]] = {
    "euler": EulerHead,
    "sixd": SixDHead,
    "allocentric": AllocentricHead,
}
