# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Features of an image with their directions in the frame of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, ByteArray, FloatArray
from cdff_common.camera import CameraModel
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.features_description_2d.interface import (
    FeaturesDescription2DInputs,
    FeaturesDescription2DOutputs,
)
from cdff_core.dfns.features_extraction_2d.interface import (
    FeaturesExtraction2DInputs,
    FeaturesExtraction2DOutputs,
)

ExtractionDfn = Dfn[Any, FeaturesExtraction2DInputs, FeaturesExtraction2DOutputs]
DescriptionDfn = Dfn[Any, FeaturesDescription2DInputs, FeaturesDescription2DOutputs]


@dataclass(frozen=True, slots=True, eq=False)
class ImageFeatures:
    """Described features of an image.

    Attributes
    ----------
    pixels : ndarray, shape (n, 2)
        Column and row in the image.
    directions : ndarray, shape (n, 2)
        x / z and y / z in the frame of the camera, without lens distortion.
    descriptors : ndarray of uint8, shape (n, d)
    """

    pixels: FloatArray
    directions: FloatArray
    descriptors: ByteArray

    def __len__(self) -> int:
        return len(self.pixels)


class FeatureExtractor:
    """Detects and describes features in raw images; only their positions lose the lens distortion."""

    def __init__(self, detect: ExtractionDfn, describe: DescriptionDfn) -> None:
        self._detect, self._describe = detect, describe

    def extract(self, image: ByteArray, camera: CameraModel, mask: BoolArray | None = None) -> ImageFeatures:
        """Return the features of a grey image with a direction less than 80 degrees off axis.

        ``mask (rows, columns)`` selects the usable pixels.
        """
        detected = self._detect.process(FeaturesExtraction2DInputs(image=image, mask=mask))
        described = self._describe.process(
            FeaturesDescription2DInputs(
                image=image, features=detected.features, sizes=detected.sizes, angles=detected.angles
            )
        )
        rays = camera.rays(detected.features)
        usable = described.valid & (np.nan_to_num(rays[:, 2]) > np.cos(np.radians(80.0)))
        directions = rays[usable, :2] / rays[usable, 2:]
        return ImageFeatures(detected.features[usable], directions, described.descriptors[usable])
