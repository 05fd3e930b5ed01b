# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration boards: corner positions, and their detection in images [1]_ [2]_.

The frame of a board is x to the right and y down along the printed pattern, z away from the reader.

References
----------
.. [1] Garrido-Jurado, S., et al. (2014). Automatic generation and detection of highly reliable fiducial
   markers under occlusion. Pattern Recognition 47(6). doi:10.1016/j.patcog.2014.01.005
.. [2] Olson, E. (2011). AprilTag: a robust and flexible visual fiducial system. ICRA.
   doi:10.1109/ICRA.2011.5979561
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import cv2
import numpy as np

from cdff_common.arrays import ByteArray, FloatArray, IntArray
from cdff_common.errors import InputError

BoardKind = Literal["chessboard", "charuco", "aprilgrid", "tags"]

#: Least number of corners of a view.
LEAST_CORNERS = 8
#: Largest number of squares or tags along a side.
_MAX_SIDE = 60
#: Half width of the window in which a corner is refined, as a part of the shortest side of a square or tag.
_WINDOW_PART = 0.18
#: Width of the black border of the tags, bits: Kalibr's are wider than those of other programs.
_BORDER_BITS = {"aprilgrid": 2, "tags": 1}


@dataclass(frozen=True)
class Board:
    """Calibration board.

    Attributes
    ----------
    kind : str
        ``chessboard`` (``columns`` x ``rows`` inner corners), ``charuco`` (``columns`` x ``rows`` squares),
        ``aprilgrid`` (``columns`` x ``rows`` tags of the family 36h11, tag 0 at the lower left, as Kalibr) or
        ``tags`` (the same family on white ground, tag 0 at the upper left, as OpenCV's GridBoard).
    columns, rows : int
    size_m : float
        Side of a square, or of a tag without the small squares.
    marker : float
        ``charuco``: side of a marker, metres; boards of tags: distance of two tags as a part of ``size_m``.
    dictionary : str
        Dictionary of the markers of ``charuco``.
    """

    kind: BoardKind
    columns: int
    rows: int
    size_m: float
    marker: float = 0.0
    dictionary: str = "DICT_4X4_250"

    def __post_init__(self) -> None:
        sides = (self.columns, self.rows)
        if min(sides) < 2 or max(sides) > _MAX_SIDE or not 0.0 < self.size_m < 10.0:
            raise InputError(
                f"board of {self.columns} x {self.rows}, {self.size_m} m: expected 2 to {_MAX_SIDE} along "
                "each side, and a size between 0 and 10 m"
            )
        if self.kind == "charuco" and not 0.0 < self.marker < self.size_m:
            raise InputError(
                f"charuco markers of {self.marker} m: expected less than the {self.size_m} m of a square"
            )
        if self.kind in _BORDER_BITS and not 0.0 < self.marker < 2.0:
            raise InputError(f"tag spacing {self.marker}: expected a part of the tag size between 0 and 2")
        if not hasattr(cv2.aruco, self.dictionary):
            raise InputError(
                f"dictionary {self.dictionary}: expected one of OpenCV, for example DICT_4X4_250"
            )

    @cached_property
    def corners_m(self) -> FloatArray:
        """Positions of the corners ``(n, 3)`` in the frame of the board, by their number."""
        if self.kind == "charuco":
            return np.asarray(self._charuco.getChessboardCorners(), np.float64)
        if self.kind == "chessboard":
            y, x = np.mgrid[: self.rows, : self.columns].reshape(2, -1)
            return np.column_stack([x, y, np.zeros(x.size)]) * self.size_m
        pitch_m = self.size_m * (1.0 + self.marker)
        row, column = np.mgrid[: self.rows, : self.columns].reshape(2, -1)
        from_top = self.rows - 1 - row if self.kind == "aprilgrid" else row
        upper_left = np.column_stack([column, from_top]) * pitch_m
        corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * self.size_m
        plane = (upper_left[:, None] + corner).reshape(-1, 2)
        return np.column_stack([plane, np.zeros(len(plane))])

    @cached_property
    def extent_m(self) -> tuple[float, float]:
        """Width and height of the printed pattern, metres."""
        if self.kind == "charuco":
            return self.columns * self.size_m, self.rows * self.size_m
        width, height = np.ptp(self.corners_m[:, :2], axis=0)
        return float(width), float(height)

    def detect(self, image: ByteArray) -> tuple[IntArray, FloatArray]:
        """Return numbers ``(k,)`` and pixels ``(k, 2)`` of the corners in a grey image, or none."""
        if self.kind == "charuco":
            corners, numbers = self._charuco_detector.detectBoard(image)[:2]
        elif self.kind == "chessboard":
            flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
            is_complete, corners = cv2.findChessboardCornersSB(image, (self.columns, self.rows), flags=flags)
            numbers = np.arange(len(self.corners_m)) if is_complete else None
            if is_complete:
                grid = np.asarray(corners, np.float64).reshape(self.rows, self.columns, 2)
                sides_px = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
                corners = _refined(image, grid, min(sides_px))
        else:
            numbers, corners = self._detect_tags(image)
        if numbers is None or corners is None or len(numbers) < LEAST_CORNERS:
            return np.zeros(0, np.int64), np.zeros((0, 2))
        return np.asarray(numbers, np.int64).reshape(-1), np.asarray(corners, np.float64).reshape(-1, 2)

    def _detect_tags(self, image: ByteArray) -> tuple[IntArray, FloatArray]:
        """Return numbers and pixels of the corners of the tags.

        Programs print the tags of the family in different orientations: the one that fits the layout is used.
        """
        none = np.zeros(0, np.int64), np.zeros((0, 2))
        quads, ids, _ = self._tag_detector.detectMarkers(image)
        if ids is None:
            return none
        is_known = ids.ravel() < self.columns * self.rows
        tags, first = np.unique(ids.ravel()[is_known], return_index=True)
        if len(tags) * 4 < LEAST_CORNERS:
            return none
        pixels = np.array(quads, np.float64).reshape(-1, 4, 2)[is_known][first]
        plane = self.corners_m[:, :2].reshape(-1, 4, 2)[tags]
        errors = []
        for turn in range(4):
            turned = np.roll(pixels, turn, axis=1).reshape(-1, 2)
            H, _ = cv2.findHomography(plane.reshape(-1, 2), turned, 0)
            predicted = cv2.perspectiveTransform(plane.reshape(1, -1, 2), H)[0] if H is not None else np.inf
            errors.append(float(np.median(np.abs(predicted - turned))))
        pixels = np.roll(pixels, int(np.argmin(errors)), axis=1)
        sides_px = np.linalg.norm(pixels - np.roll(pixels, 1, axis=1), axis=2)
        numbers = (tags[:, None] * 4 + np.arange(4)).reshape(-1)
        return numbers, _refined(image, pixels, sides_px.min())

    @cached_property
    def _charuco(self) -> Any:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.size_m, self.marker, dictionary)

    @cached_property
    def _charuco_detector(self) -> Any:
        return cv2.aruco.CharucoDetector(self._charuco)

    @cached_property
    def _tag_detector(self) -> Any:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        parameters = cv2.aruco.DetectorParameters()
        parameters.markerBorderBits = _BORDER_BITS[self.kind]
        return cv2.aruco.ArucoDetector(dictionary, parameters)

    def picture(self, pixels_per_m: float) -> ByteArray:
        """Return the printed pattern, grey; the frame's origin is the upper left corner of a charuco board.

        Of the other boards, the outermost edge is one square (chessboard) or one gap (boards of tags) beyond
        the first corner.
        """
        width, height = (round(v * pixels_per_m) for v in self.extent_m)
        if self.kind == "charuco":
            return np.asarray(self._charuco.generateImage((width, height), marginSize=0))
        border_m = self.border_m
        columns, rows = (round((v + 2 * border_m) * pixels_per_m) for v in self.extent_m)
        x = (np.arange(columns) + 0.5) / pixels_per_m - border_m
        y = (np.arange(rows) + 0.5) / pixels_per_m - border_m
        if self.kind == "chessboard":
            is_black = (np.floor(x / self.size_m)[None, :] + np.floor(y / self.size_m)[:, None]) % 2 == 0
            return np.where(is_black, 0, 255).astype(np.uint8)
        image = np.full((rows, columns), 255, np.uint8)
        gap_m, pitch_m = self.size_m * self.marker, self.size_m * (1.0 + self.marker)
        if self.kind == "aprilgrid":
            is_gap = [(v % pitch_m) > self.size_m for v in (x, y)]
            image[is_gap[1][:, None] & is_gap[0][None, :]] = 0
        side = round(self.size_m * pixels_per_m)
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        for tag in range(self.columns * self.rows):
            left, top = np.round((self.corners_m[4 * tag, :2] + gap_m) * pixels_per_m).astype(int)
            image[top : top + side, left : left + side] = cv2.aruco.generateImageMarker(
                dictionary, tag, side, borderBits=_BORDER_BITS[self.kind]
            )
        return image

    @property
    def border_m(self) -> float:
        """Width of the printed pattern beyond the outermost corners, metres; 0 for charuco, by its frame."""
        if self.kind == "charuco":
            return 0.0
        return self.size_m * (1.0 if self.kind == "chessboard" else self.marker)


def _refined(image: ByteArray, pixels: FloatArray, side_px: float) -> FloatArray:
    """Return corners ``(k, 2)`` at which the gradients around them meet.

    The window follows the shortest side of a square or tag, so that it contains one corner only.
    """
    window = int(np.clip(side_px * _WINDOW_PART, 3, 8))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    start = pixels.reshape(-1, 1, 2).astype(np.float32)
    refined = cv2.cornerSubPix(image, start, (window, window), (-1, -1), criteria)
    return np.asarray(refined, np.float64).reshape(-1, 2)
