# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of VisualTargetTracking: the sequence is that of ``ImageTracking``, from a guess."""

from __future__ import annotations

from cdff_core.dfpcs.visual_target_tracking.configuration import VisualTargetTrackingConfig
from cdff_core.dfpcs.visual_target_tracking.interface import VisualTargetTrackingInterface
from cdff_core.object_models.image_tracking import ImageTracking


class VisualTargetTracking(ImageTracking, VisualTargetTrackingInterface):
    """Comparison of each image, and its depth image if there is one, with the mesh at the predicted state."""

    Config = VisualTargetTrackingConfig
    config: VisualTargetTrackingConfig

    def setup(self) -> None:
        """Create the DFNs, clear the state, offer the store item."""
        self.setup_images()
