# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of VisualTargetTracking."""

from __future__ import annotations

from cdff_core.object_models.image_tracking import ImageTrackingConfig


class VisualTargetTrackingConfig(ImageTrackingConfig):
    """Parameters of the tracker, and of the DFN slots."""
