# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC PointCloudMatching."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class PointCloudMatchingInterface(Dfpc):
    """Register two partially overlapping clouds without a guess by matching descriptors of their
    surfaces. Without sufficient overlap the result is refused.
    """

    name = "point_cloud_matching"
    INPUT_PORTS = ("source", "target")

    @abstractmethod
    def on_source(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Cloud to register; each source yields one transform."""

    @abstractmethod
    def on_target(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Cloud to register it with; stored until the next one."""

    @abstractmethod
    def forget(self) -> None:
        """Clear target and waiting source."""
