# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The controller of the troublemaker."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from pydantic import Field

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.dfpc import Dfpc, DfpcConfig, Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import TransformWithCovariance


class TroublemakerConfig(DfpcConfig):
    """Parameters that requests adjust, or that differ between the implementations."""

    period_s: float = Field(1.0, gt=0.0, description="Period that standing requests adjust, seconds")
    covariance_factor: float = Field(1.0, gt=0.0, description="Factor on the covariance of a pose")


class Troublemaker(Dfpc):
    """Echoes poses; the child frame ``trouble/refuse|raise|hang|fail|slow`` makes it misbehave."""

    name = "troublemaker"
    Config = TroublemakerConfig

    def setup(self) -> None:
        """Store the last pose as an item."""
        self._last: Any = None
        self._count = 0
        self.store.offer("last", lambda: self._last)

    def step(self, sample: Sample) -> Iterable[Output]:
        """Echo a pose."""
        trouble = sample.child.removeprefix("trouble/")
        if trouble == "refuse":
            raise RefusedError("refusal on command")
        if trouble == "raise":
            raise ZeroDivisionError("error on command")
        if trouble == "hang":
            time.sleep(3600)
        if trouble == "slow":
            time.sleep(0.05)
        value, quality = sample.value, Quality()
        if self.config.covariance_factor != 1.0:
            T = value.transform
            T = UncertainTransform(T.matrix, T.covariance * self.config.covariance_factor)
            frames = {"parent": value.parent_frame, "child": value.child_frame}
            value = TransformWithCovariance.from_transform(T, stamp_ns=value.stamp_ns, **frames)
        if trouble == "fail":
            value, quality = None, Quality(Status.FAILED, ("told_to_fail",))
        self._last = sample.value
        self._count += 1
        return [
            Output(
                "echo",
                value,
                sample.stamp_ns,
                sample.stamp_ns,
                sample.frame,
                sample.child,
                quality,
                (sample.id,),
            )
        ]

    def count(self, factor: int) -> int:
        """Return the number of echoed poses, times ``factor``."""
        return self._count * factor
