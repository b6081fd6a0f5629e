"""Define the contract of a pose decoder.

A decoder turns keypoints and a class into a pose, and owns all that belongs to this: its own settings, its
losses, what it learns from the training set before the first step, and the names of its outputs. The network
(`network.DroneKeyPP`) only calls it. A decoder of your own derives from `Decoder` and is entered in
`network.DECODERS` under the word that `--set pose=WORD` will choose it by.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from torch import Tensor, nn

from dronekeypp.model.losses import loss_terms
from dronekeypp.settings import Settings


class PictureShape(NamedTuple):
    """This is what a decoder that looks at the picture has to know of the network around it."""

    width: int  # d, of the encoder's pooled tokens
    channels: tuple[int, int, int]  # of the backbone's maps at stride 4 and 8 and of the last one
    image_size: int  # side of the crop, pixels


class Decoder(nn.Module):
    """This is the base of every pose decoder.

    Its constructor takes `(config, classes, picture)`: its own settings, the number of classes, and a
    `PictureShape`, or None where there is no picture.

    `forward` takes keypoints (B, 4, 2) in crop units, class probabilities (B, classes), K (B, 3, 3) and
    square (B, 3). It returns a dict with at least R (B, 3, 3) camera←body, t (B, 3) metres and keypoints_px
    (B, 4, 2) full-frame pixels.
    """

    Config: ClassVar[type[Settings]]  # its own settings; no name may be one of the network's
    outputs: ClassVar[tuple[str, ...]] = ()  # what it answers beside the pose, in an exported file too
    needs_image: ClassVar[bool] = False  # whether it looks at the picture, beside keypoints and class
    # What its losses and `prepare` read of a frame's truth.
    learns_from: tuple[str, ...] = ("R", "t", "keypoints", "keypoints_3d", "label")

    def look(self, levels: list[Tensor], encoded: dict) -> dict:
        """Look at the picture, and return what the encoder answered together with what is added.

        The default returns `encoded` as it is.

        Args:
            levels: the backbone's maps at stride 4 and 8, and the last one.
            encoded: the encoder's answers.
        """
        return encoded

    def decode(self, encoded: dict, probs: Tensor, K: Tensor, square: Tensor) -> dict[str, Tensor | None]:
        """Return the pose from all that was read from the picture.

        The default uses the keypoints only.
        """
        return self(encoded["keypoints"], probs, K, square)

    def prepare(self, annotations: dict[str, Tensor]) -> None:
        """Learn what the truth of training frames shows before the first step.

        The default learns nothing. `annotations` holds keypoints, square, K, label, R, t and keypoints_3d,
        stacked, without images.
        """

    def losses(self, output: dict, batch: dict, keypoint_unit: float) -> dict[str, Tensor]:
        """Return the terms of the loss as unweighted scalars, named as in `losses.TERMS`.

        The default is Eq. 9 and 11.
        """
        return loss_terms(output, batch, keypoint_unit)
