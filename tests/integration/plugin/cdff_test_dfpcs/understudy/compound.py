# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The controller of the understudy."""

from __future__ import annotations

from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import TransformWithCovariance


class Understudy(Dfpc):
    """Publishes each received pose with the child frame ``mana/base``."""

    name = "understudy"

    def setup(self) -> None:
        """Do nothing."""

    def step(self, sample: Sample) -> Iterable[Output]:
        """Echo a pose."""
        value = TransformWithCovariance.from_transform(
            sample.value.transform, parent=sample.frame, child="mana/base", stamp_ns=sample.stamp_ns
        )
        stamp_ns = sample.stamp_ns
        return [Output("echo", value, stamp_ns, stamp_ns, sample.frame, "mana/base", inputs=(sample.id,))]
