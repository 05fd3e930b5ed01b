# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is kept of an image, and pairs of points between two of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfpc import Sample
from cdff_core.dfns.features_description_2d._interface import FeaturesDescription2DInputs
from cdff_core.dfns.features_extraction_2d._interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_matching_2d._interface import FeaturesMatching2DInputs
from cdff_core.dfns.features_tracking_2d._interface import FeaturesTracking2DInputs
from cdff_core.imaging.frames import check_straight
from cdff_core.imaging.grey import grey_image

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """An image with its points; without descriptors where they are tracked."""

    sample: Sample
    image: NDArray[np.uint8]
    points: FloatArray
    descriptors: NDArray[np.uint8]

    @property
    def camera(self) -> FloatArray | None:
        """Camera matrix, None where the frame has none."""
        K = np.asarray(self.sample.value.camera_matrix, np.float64)
        return K if K[0, 0] > 0.0 and K[1, 1] > 0.0 else None


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Points of the left image and their partners in the right one ``(n, 2)``, pixels."""

    left: FloatArray
    right: FloatArray

    def __getitem__(self, chosen: NDArray[np.bool_]) -> Pairs:
        return Pairs(self.left[chosen], self.right[chosen])

    def __len__(self) -> int:
        return len(self.left)


class Matcher:
    """The front half of the compound: points, descriptions, pairs."""

    def __init__(self, slots: dict[str, Any]) -> None:
        self._slots = slots

    def view(self, sample: Sample) -> View:
        """Points and descriptors of every detector of the variant; raises InputError on an image it cannot take."""
        check_straight(sample.value)
        image = grey_image(sample.value)
        points, descriptors = [], []
        for slot in ("blobs", "corners"):
            if slot not in self._slots:
                continue
            found = self._slots[slot].process(FeaturesExtraction2DInputs(image))
            if "describe" not in self._slots:
                return View(sample, image, found.features, np.zeros((len(found.features), 0), np.uint8))
            described = self._slots["describe"].process(
                FeaturesDescription2DInputs(image, found.features, found.sizes, found.angles)
            )
            points.append(found.features[described.valid])
            descriptors.append(described.descriptors[described.valid])
        return View(sample, image, np.concatenate(points), np.concatenate(descriptors))

    def pairs(self, left: View, right: View) -> Pairs:
        """What looks alike in both images."""
        if "track" in self._slots:
            tracked = self._slots["track"].process(FeaturesTracking2DInputs(left.image, right.image, left.points))
            return Pairs(left.points, tracked.matches)[tracked.valid]
        found = self._slots["match"].process(FeaturesMatching2DInputs(left.descriptors, right.descriptors))
        return Pairs(left.points[found.matches[:, 0]], right.points[found.matches[:, 1]])

    def guided(self, left: View, right: View, F: FloatArray) -> Pairs | None:
        """What looks alike along epipolar lines; None where the variant does not search there."""
        if "guide" not in self._slots:
            return None
        inputs = FeaturesMatching2DInputs(left.descriptors, right.descriptors, left.points, right.points, F)
        found = self._slots["guide"].process(inputs)
        return Pairs(left.points[found.matches[:, 0]], right.points[found.matches[:, 1]])
