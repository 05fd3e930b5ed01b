# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Findings about the sensors of a robot, and the reasons of products that follow from them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.geometry.se3 import FloatArray

#: Kinds of findings about a sensor (mount, clock, samples, frame); the reason of a finding starts with its
#: kind.
ROTATION, CLOCK, SAMPLES, FRAME = "sensor_rotation", "sensor_clock", "sensor_samples", "sensor_frame"
KINDS = (ROTATION, CLOCK, SAMPLES, FRAME)


@dataclass(frozen=True, slots=True)
class Finding:
    """Disagreement of a sensor with the others or with the profile.

    Attributes
    ----------
    kind : str
        One of ``KINDS``.
    sensors : tuple of str
        The sensor, or those among which the data do not decide.
    value : str
        Size of the disagreement with its unit, for the reason: ``180_deg``.
    what : str
        Description with the expected and the observed value.
    remedy : str
        What the integrator checks first.
    """

    kind: str
    sensors: tuple[str, ...]
    value: str
    what: str
    remedy: str

    @property
    def name(self) -> str:
        """The sensors in words."""
        return " or ".join(self.sensors)

    @property
    def reason(self) -> str:
        """Reason of a product: ``sensor_rotation:lidar_180_deg``."""
        return f"{self.kind}:{'_or_'.join(self.sensors)}_{self.value}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "kind": self.kind,
            "sensors": list(self.sensors),
            "reason": self.reason,
            "what": self.what,
            "remedy": self.remedy,
        }


def is_sensor_reason(reason: str) -> bool:
    """Return whether a reason of a product is that of a finding."""
    return reason.partition(":")[0] in KINDS


def sensor_reasons(reasons: Iterable[str]) -> tuple[str, ...]:
    """Return the reasons that are those of findings."""
    return tuple(reason for reason in reasons if is_sensor_reason(reason))


def roll_pitch_yaw_deg(R: FloatArray) -> str:
    """Return ``[roll, pitch, yaw]`` of a rotation (3, 3) as in ``rpy_deg`` of a profile, degrees."""
    pitch = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
    roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    angles = np.degrees([roll, pitch, yaw]) + 0.0
    return "[" + ", ".join(f"{angle:.1f}" for angle in angles) + "]"
