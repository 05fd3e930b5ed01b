# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot's own router and the one on the ground are one system whenever they are in contact."""

from __future__ import annotations

import pytest

from cdff_common.bus import Bus, Reply
from cdff_common.errors import CdffError
from tests.integration.conftest import free_port, wait_until
from tests.integration.relay import Relay

pytestmark = pytest.mark.integration

KEY = "cdff/@v1/mana/dpm/@rpc/stat"


def answers(bus: Bus) -> bool:
    try:
        return bool(bus.call(KEY, timeout_s=1.0).body() == 1)
    except CdffError:
        return False


@pytest.mark.req("CDFF-SUP-194")
def test_a_router_finds_the_other_one_whichever_starts_first_and_again_after_silence() -> None:
    ground, aboard = free_port(), f"tcp/127.0.0.1:{free_port()}"
    with (
        Relay(("127.0.0.1", ground)) as link,
        Bus.open_router(aboard, uplink=f"tcp/127.0.0.1:{link.port}"),
        Bus.open(aboard, name="rover") as rover,
    ):
        assert not answers(rover)  # it works on its own meanwhile
        with Bus.open_router(f"tcp/127.0.0.1:{ground}"), Bus.open(f"tcp/127.0.0.1:{ground}", name="dpm") as dpm:
            dpm.serve(KEY, lambda _request: Reply.of(1))
            wait_until(lambda: answers(rover), 20.0, "an answer from the ground")
            link.cut()
            assert not answers(rover)
            link.restore()
            wait_until(lambda: answers(rover), 20.0, "an answer from the ground again")
