# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC PointCloudMatching."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class PointCloudMatchingInterface(Dfpc):
    """Find how two clouds that overlap in part lie to one another, from no guess, by matching descriptors of their
    surfaces; say that there is no overlap rather than answer wrongly.
    """

    name = "point_cloud_matching"
    INPUT_PORTS = ("source", "target")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "source":
                return self.on_source(sample)
            case "target":
                return self.on_target(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_source(self, sample: Sample) -> Iterable[Output]:
        """Take a Pointcloud: The cloud to be moved; each leads to one transform."""

    @abstractmethod
    def on_target(self, sample: Sample) -> Iterable[Output]:
        """Take a Pointcloud: The cloud to be met; kept until the next one."""

    @abstractmethod
    def forget(self) -> None:
        """Forget target and waiting source."""
