# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The router of a robot and the router on the ground form one network while they are in contact."""

from __future__ import annotations

import pytest

from cdff_common.bus import Bus, Reply
from cdff_common.errors import CdffError
from tests.integration.conftest import free_port, wait_until
from tests.support.relay import Relay

pytestmark = pytest.mark.integration

KEY = "cdff/@v1/mana/dpm/@rpc/stat"


def ground_answers(bus: Bus) -> bool:
    try:
        return bool(bus.call(KEY, timeout_s=1.0).body() == 1)
    except CdffError:
        return False


@pytest.mark.req("CDFF-SUP-194")
@pytest.mark.slow
def test_routers_connect_in_any_order_of_start_and_reconnect_after_silence() -> None:
    ground_port, rover_endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
    with (
        Relay(("127.0.0.1", ground_port)) as link,
        Bus.open_router(rover_endpoint, uplink=f"tcp/127.0.0.1:{link.port}"),
        Bus.open(rover_endpoint, name="rover") as rover,
    ):
        assert not ground_answers(rover)  # without the ground, nothing answers
        with (
            Bus.open_router(f"tcp/127.0.0.1:{ground_port}"),
            Bus.open(f"tcp/127.0.0.1:{ground_port}", name="dpm") as dpm,
        ):
            dpm.serve(KEY, lambda _request: Reply.of(1))
            wait_until(lambda: ground_answers(rover), 20.0, "an answer from the ground")
            link.cut()
            assert not ground_answers(rover)
            link.restore()
            wait_until(lambda: ground_answers(rover), 20.0, "an answer from the ground again")
