# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The status of a hosted DFPC while other threads connect and disconnect its ports."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from services.dfpc_host.hosted_dfpc import HostedDfpc


def test_a_port_that_is_disconnected_meanwhile_does_not_end_the_status() -> None:
    wired = {"scan": "sensor/lidar/scan", "poses": "dfpc/position_manager/pose"}

    class Counters:
        def to_dict(self, _now_s: float) -> dict[str, int]:
            wired.clear()  # as a deactivation in another thread
            return {"count": 1}

    hosted: Any = SimpleNamespace(wired=wired, _streams={"scan": Counters(), "poses": Counters()})
    assert HostedDfpc._stream_status(hosted) == {
        "sensor/lidar/scan": {"count": 1},
        "dfpc/position_manager/pose": {"count": 1},
    }
