# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC TargetTracking."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class TargetTrackingInterface(Dfpc):
    """Track a freely moving body from pose measurements of any detector: position, velocity, attitude
    and angular rate with covariance. Outliers, gaps and changes of the detector do not interrupt
    the track.
    """

    name = "target_tracking"
    INPUT_PORTS = ("measurement",)

    @abstractmethod
    def on_measurement(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_sensor_body with covariance;
        measurements of several detectors may share the port.
        """

    @abstractmethod
    def restart(self) -> None:
        """Clear the track; the next measurement starts a new one."""
