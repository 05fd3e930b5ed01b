# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The controller of the path planner."""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class PathPlanning(Dfpc):
    """Publishes the trajectories it receives as planned paths."""

    name = "path_planning"

    def setup(self) -> None:
        """Do nothing."""

    def step(self, sample: Sample) -> Iterable[Output]:
        """Publish a trajectory."""
        stamp_ns = sample.stamp_ns
        return [Output("path", sample.value, stamp_ns, stamp_ns, sample.frame, inputs=(sample.id,))]
