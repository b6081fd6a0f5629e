"""The drawing of one plant: which leaf, blade or strip of bark shows at every pixel."""

from __future__ import annotations

import cv2
import numpy as np


class Drawing:
    """A plant being drawn, later elements over earlier ones.

    Attributes:
        size: pixels of its height, which stands for the height of the plant.
        width: pixels.
        owner: (size, width) int32 number of the element that shows at a pixel. Element 0 is nothing.
        elements: tables (n, 6) float32 of what the elements are: normal (right, towards viewer, up), openness
            to the sky, leaf 1 or bark 0, tone. Together they are one table, numbered from the first row on.
    """

    def __init__(self, size: int, width: int) -> None:
        self.size = size
        self.width = width
        self.owner = np.zeros((size, width), np.int32)
        self.elements = [np.zeros((1, 6), np.float32)]

    def count(self) -> int:
        """Return how many elements there are, which is the number of the next one."""
        return sum(len(elements) for elements in self.elements)

    def add(self, elements: np.ndarray) -> None:
        """Add a table (n, 6) of elements."""
        self.elements.append(elements.astype(np.float32))

    def table(self) -> np.ndarray:
        """Return all elements, (n, 6) float32."""
        return np.concatenate(self.elements)

    def stroke(self, line: np.ndarray, thick: float, element: int) -> None:
        """Draw a tapering stroke.

        Args:
            line: (n, 2) points as (right of the foot, up) in heights of the plant.
            thick: pixels at its start.
            element: its number.
        """
        points = np.stack(
            [self.width / 2 + line[:, 0] * self.size, self.size - 1 - line[:, 1] * self.size * 0.97], -1
        )
        last = len(points) - 1
        for k in range(last):
            taper = max(1, round(thick * (1 - 0.75 * k / last)))
            start = points[k].astype(int).tolist()
            end = points[k + 1].astype(int).tolist()
            cv2.line(self.owner, start, end, int(element), taper)
