"""Say what a lens does: the camera matrix, the distortion, and how a picture is straightened."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from dronekeypp.errors import InputError
from dronekeypp.footage.cameras.plausible import check_plausible

HALF_PIXEL = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
ACCURACY = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
AGREES = 0.5  # pixels: what may be lost on the way from the distorted picture to the straight one and back


@dataclass(frozen=True)
class Calibration:
    """Describe what a lens does.

    Attributes:
        K: (3, 3) the camera matrix of the whole frame, pixels, with pixel centres at +0.5.
        distortion: OpenCV's distortion coefficients, or None for a pinhole camera.
        size: (width, height) of the calibrated frame, where the file gives it.
        fisheye: whether the coefficients are the four of cv2.fisheye.
        of_the_frames: whether the file lies beside these very frames, as that of a BOP scene does. Frames
            may be crops then, and the principal point lie anywhere.
        source: the file, for messages.
        description: what was read, from which entries: one line for people.
    """

    K: np.ndarray
    distortion: np.ndarray | None = None
    size: tuple[int, int] | None = None
    fisheye: bool = False
    of_the_frames: bool = False
    source: str = "the camera"
    description: str = ""
    # The maps of the last size that was straightened: they take as long to compute as to use.
    _maps: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def for_frames(self, width: int, height: int) -> Calibration:
        """Return the calibration of frames of another size.

        They must be the calibrated frames made smaller or larger.

        Raises:
            InputError: The frames have another shape. Then they were cut, and the matrix cannot be known. Or
                no lens has such a matrix, or it must be that of another resolution (`check_plausible`).
        """
        if self.size is not None and abs(width * self.size[1] / self.size[0] - height) > 1:  # pixels
            raise InputError(
                f"{self.source}: the camera was calibrated at {self.size[0]}×{self.size[1]}, "
                f"the frames are {width}×{height}: not the same shape"
            )
        fitting = self
        if self.size not in (None, (width, height)):
            scale = np.diag([width / self.size[0], height / self.size[1], 1.0])
            note = f"{self.description}; scaled to frames of {width}x{height}"
            fitting = replace(self, K=scale @ self.K, size=(width, height), description=note, _maps={})
        remarks = check_plausible(
            fitting.K,
            fitting.distortion,
            fitting.fisheye,
            (width, height),
            fitting.source,
            centred=not self.of_the_frames,
            size_is_known=self.size is not None,
        )
        if remarks:
            fitting = replace(fitting, description="; ".join([fitting.description, *remarks]), _maps={})
        return fitting

    @property
    def opencv_K(self) -> np.ndarray:
        """Return K (3, 3) as OpenCV counts: its pixel centres start from 0, where ours lie at +0.5."""
        return self.K - HALF_PIXEL

    def undistort(self, image: np.ndarray) -> np.ndarray:
        """Return the picture (H, W, 3) that a pinhole camera with the same K would have taken.

        Where the lens did not see, it is black.
        """
        if self.distortion is None:
            return image
        size = image.shape[1], image.shape[0]
        if size not in self._maps:
            self._maps.clear()
            self._maps[size] = self._undistortion_maps(size)
        return cv2.remap(image, *self._maps[size], cv2.INTER_LINEAR)

    def _undistortion_maps(self, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return where the pixels of the straight picture lie in the distorted one, for cv2.remap."""
        K = self.opencv_K
        init = cv2.fisheye.initUndistortRectifyMap if self.fisheye else cv2.initUndistortRectifyMap
        x, y = init(self._without_skew(), self.distortion, np.eye(3), K, size, cv2.CV_32FC1)
        if K[0, 1]:
            x += (K[0, 1] / K[1, 1] * (y - K[1, 2])).astype(np.float32)
        return cv2.convertMaps(x, y, cv2.CV_16SC2)

    def _without_skew(self) -> np.ndarray:
        """Return `opencv_K` without its skew, which OpenCV's lens models pass over."""
        K = self.opencv_K
        K[0, 1] = 0
        return K

    def undistort_points(self, pixels: np.ndarray) -> np.ndarray:
        """Return where points (P, 2) of the distorted picture lie in the straight one.

        A point is NaN where the coefficients cannot be inverted: polynomials fold beyond the picture's part
        that was calibrated.
        """
        if self.distortion is None:
            return pixels
        K, plain_K = self.opencv_K, self._without_skew()
        seen = np.asarray(pixels, dtype=np.float64) - 0.5  # as OpenCV counts
        seen = seen - np.outer((seen[:, 1] - K[1, 2]) * K[0, 1] / K[1, 1], [1, 0])
        points = seen[:, None]  # (P, 1, 2)
        if self.fisheye:
            rays = cv2.fisheye.undistortPoints(points, plain_K, self.distortion, criteria=ACCURACY)
            again = cv2.fisheye.distortPoints(rays, plain_K, self.distortion)
        else:
            rays = cv2.undistortPoints(points, plain_K, self.distortion, criteria=ACCURACY)
            ahead = cv2.convertPointsToHomogeneous(rays)
            again, _ = cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), plain_K, self.distortion)
        homogeneous = np.concatenate([rays[:, 0], np.ones((len(rays), 1))], axis=1)
        straight = homogeneous @ K[:2].T + 0.5
        lost = np.linalg.norm(again[:, 0] - seen, axis=1)
        straight[~(lost < AGREES)] = np.nan
        return straight

    def undistort_box(self, box: np.ndarray) -> np.ndarray:
        """Return the box (x, y, w, h) in the undistorted picture that surrounds a box of the distorted one.

        Points along the four edges are undistorted, because a straight edge becomes a curve. The box is NaN
        where the coefficients cannot be inverted.
        """
        if self.distortion is None:
            return box
        x, y, w, h = box
        along = np.linspace(0, 1, 9)
        edges = []
        for side in (y, y + h):
            edges.append(np.stack([x + along * w, np.full(9, side)], axis=1))
        for side in (x, x + w):
            edges.append(np.stack([np.full(9, side), y + along * h], axis=1))
        points = self.undistort_points(np.concatenate(edges))  # (36, 2)
        low, high = points.min(axis=0), points.max(axis=0)
        return np.array([*low, *(high - low)])
