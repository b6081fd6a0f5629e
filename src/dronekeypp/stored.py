"""One picture on disk, and one drone in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.sixdronesyn import bop, folders


@dataclass(frozen=True)
class StoredFrame:
    """This is one drone in one picture, or a picture without a drone, and where it comes from.

    Attributes:
        annotation: what the flight's three files say of the drone; None of a picture without one.
        folder: the flight's folder.
        image: the picture's file, which is called by its number.
        digest: what the picture's bytes must have, or None where nobody says.
        scene, subsequence: the numbers of its scene and of its flight.
        width, height: the size of the whole frame, pixels.
    """

    annotation: bop.Frame | None
    folder: Path
    image: Path
    digest: str | None
    scene: int
    subsequence: int
    width: int
    height: int

    @property
    def number(self) -> int:
        """Return the number of the picture in its flight."""
        return int(self.image.stem)

    @property
    def middle_inside(self) -> bool:
        """Tell whether the middle of the drone's box lies in the whole frame."""
        x, y = self.annotation.box[:2] + self.annotation.box[2:] / 2
        return bool(0 <= x <= self.width and 0 <= y <= self.height)

    def read(self) -> np.ndarray:
        """Read the image on disk as uint8 RGB.

        Returns:
            (size, size, 3) for a stored crop, or (H, W, 3) for a whole frame.

        Raises:
            InputError: the image is missing or cut off, or a whole frame has another size than its data set
                says.
        """
        image = folders.read_image(self.image, self.digest)
        height, width = image.shape[:2]
        whole = self.annotation is None or self.annotation.square is None
        if whole and (width, height) != (self.width, self.height):
            raise InputError(
                f"{self.image}: {width}×{height} pixels, its data set has {self.width}×{self.height}"
            )
        return image
