# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Undistortion by a map from the pixels of the undistorted image to those of the input."""

from __future__ import annotations

from cdff_common.camera import CameraModel
from cdff_core.dfns.image_undistortion.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import with_image
from cdff_core.imaging.rectification import LensMapConfig, undistorted


class LensMap(Interface[LensMapConfig]):
    """Undistortion with a map that is computed once per calibration."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the undistorted image; raises InputError if the image has no camera."""
        ideal = undistorted(CameraModel.of_frame(inputs.image), self.config.keep, self.config.max_angle_deg)
        image = ideal.apply(inputs.image.image, self.config.interpolation)
        return Outputs(image=with_image(inputs.image, image, camera=ideal.camera))
