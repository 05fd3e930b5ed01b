# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Features of images, and pairs of points between two images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Sample
from cdff_core.dfns.features_description_2d.interface import FeaturesDescription2DInputs
from cdff_core.dfns.features_extraction_2d.interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_matching_2d.interface import FeaturesMatching2DInputs
from cdff_core.dfns.features_tracking_2d.interface import FeaturesTracking2DInputs
from cdff_core.imaging.frames import check_undistorted
from cdff_core.imaging.grey import grey_image

FloatArray = NDArray[np.float64]
#: Points of each image that the first search compares; the search along epipolar lines uses all of them.
SEARCHED_POINTS = 2000


@dataclass(frozen=True, slots=True, eq=False)
class FeatureView:
    """Image with its points ``(n, 2)`` and their descriptors ``(n, d)``; d is 0 if points are tracked.

    Blobs come before corners, each sorted by decreasing score.
    """

    sample: Sample
    image: NDArray[np.uint8]
    points: FloatArray
    descriptors: NDArray[np.uint8]

    @property
    def camera(self) -> FloatArray | None:
        """Camera matrix; None if it is unknown."""
        K = np.asarray(self.sample.value.camera_matrix, np.float64)
        return K if K[0, 0] > 0.0 and K[1, 1] > 0.0 else None


@dataclass(frozen=True, slots=True, eq=False)
class PointPairs:
    """Corresponding points ``(n, 2)`` of the left and the right image, pixels."""

    left: FloatArray
    right: FloatArray

    def __getitem__(self, mask: NDArray[np.bool_]) -> PointPairs:
        return PointPairs(self.left[mask], self.right[mask])

    def __len__(self) -> int:
        return len(self.left)


class FeatureMatcher:
    """Extracts, describes and matches points with the DFNs of the slots that the implementation has."""

    def __init__(self, slots: dict[str, Any]) -> None:
        self._slots = slots

    def view(self, sample: Sample) -> FeatureView:
        """Detect and describe the points of an image.

        Raises InputError on distortion, another pixel type, or a camera matrix that is not finite.
        """
        check_undistorted(sample.value)
        if not np.isfinite(sample.value.camera_matrix).all():
            raise InputError(
                f"camera matrix {sample.value.camera_matrix.tolist()}: expected finite numbers, or zeros if "
                "the camera is unknown"
            )
        image = grey_image(sample.value)
        rows = np.concatenate(
            [self._detect(slot, image) for slot in ("blobs", "corners") if slot in self._slots]
        )
        points = np.ascontiguousarray(rows[:, :2])
        if "describe" not in self._slots:
            return FeatureView(sample, image, points, np.zeros((len(points), 0), np.uint8))
        described = self._slots["describe"].process(
            FeaturesDescription2DInputs(
                image=image,
                features=points,
                sizes=np.ascontiguousarray(rows[:, 2]),
                angles=np.ascontiguousarray(rows[:, 3]),
            )
        )
        return FeatureView(sample, image, points[described.valid], described.descriptors[described.valid])

    def _detect(self, slot: str, image: NDArray[np.uint8]) -> FloatArray:
        """Return column, row, size and angle ``(n, 4)`` of the points, by decreasing score.

        Size and angle are NaN if the detector has none.
        """
        detected = self._slots[slot].process(FeaturesExtraction2DInputs(image=image))
        unknown = np.full(len(detected.features), np.nan)
        sizes = unknown if detected.sizes is None else detected.sizes
        angles = unknown if detected.angles is None else detected.angles
        order = np.argsort(-detected.scores, kind="stable")
        return np.column_stack([detected.features, sizes, angles])[order]

    def match(self, left: FeatureView, right: FeatureView, limit: int | None = SEARCHED_POINTS) -> PointPairs:
        """Return the pairs of similar descriptors among the first ``limit`` points of each image (None: all),
        or the tracked points.
        """
        if "track" in self._slots:
            tracking = self._slots["track"].process(
                FeaturesTracking2DInputs(reference=left.image, image=right.image, features=left.points)
            )
            return PointPairs(left.points, tracking.matches)[tracking.valid]
        matching = self._slots["match"].process(
            FeaturesMatching2DInputs(source=left.descriptors[:limit], sink=right.descriptors[:limit])
        )
        return PointPairs(left.points[matching.matches[:, 0]], right.points[matching.matches[:, 1]])

    def match_along_lines(self, left: FeatureView, right: FeatureView, F: FloatArray) -> PointPairs | None:
        """Return the pairs with similar descriptors near epipolar lines; None without the slot guide."""
        if "guide" not in self._slots:
            return None
        inputs = FeaturesMatching2DInputs(
            source=left.descriptors,
            sink=right.descriptors,
            source_features=left.points,
            sink_features=right.points,
            fundamental_matrix=F,
        )
        matching = self._slots["guide"].process(inputs)
        return PointPairs(left.points[matching.matches[:, 0]], right.points[matching.matches[:, 1]])
