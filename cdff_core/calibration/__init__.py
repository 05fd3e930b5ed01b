# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mounts of sensors and scales of wheels from the motions of one drive."""

from cdff_core.calibration.estimate import DIRECTIONS, Mount
from cdff_core.calibration.hand_eye import hand_eye
from cdff_core.calibration.inertial_mount import inertial_mount
from cdff_core.calibration.motions import MotionPairs, motion_pairs
from cdff_core.calibration.wheel_scales import WheelScales, wheel_scales

__all__ = [
    "DIRECTIONS",
    "MotionPairs",
    "Mount",
    "WheelScales",
    "hand_eye",
    "inertial_mount",
    "motion_pairs",
    "wheel_scales",
]
