# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A request for one acquisition: the unit points and triggers the sensor once, when the DFPC is ready."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.errors import InputError, UnavailableError
from tests.integration.troublemaker_mission import troublemaker_mission
from tests.support.wheel_odometry import Driver

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with troublemaker_mission(tmp_path_factory.mktemp("acquisition")) as endpoint:
        yield endpoint


@pytest.fixture
def driver(endpoint: str) -> Iterator[Driver]:
    with Bus.open(endpoint, name="driver") as bus:
        result = Driver(bus)
        yield result
        result.stop()


@pytest.mark.req("CDFF-SUP-198")
def test_one_sample_is_acquired_with_the_requested_direction_and_the_product_of_it_delivered(
    endpoint: str, driver: Driver
) -> None:
    with Client(endpoint) as client:
        explained = client.explain("pose", robot="mana", acquire="pan_deg:30,tilt_deg:-10")
        acquisition = explained["plan"]["acquisitions"]["mana/wheels"]
        assert acquisition == {
            "mode": "single",
            "parameters": {"pan_deg": 30.0, "tilt_deg": -10.0},
            "duration_s": 0.8,
            "energy_j": 16.0,
        }
        first = client.request("pose", robot="mana", acquire="pan_deg:30,tilt_deg:-10")
        assert driver.acquired == [{"pan_deg": 30.0, "tilt_deg": -10.0}]
        assert driver.modes[:2] == ["single", "off"]
        second = client.request("pose", robot="mana", acquire="now")
        assert second.header.t1_ns > first.header.t1_ns
        assert len(driver.acquired) == 2
        assert driver.acquired[1] == {"pan_deg": 0.0, "tilt_deg": 0.0}
        # Without an acquisition the newest stored pose answers, and nothing is acquired.
        assert client.request("pose", robot="mana").header.id == second.header.id
        assert len(driver.acquired) == 2


@pytest.mark.parametrize(
    ("acquire", "fault"),
    [("pan_deg:120", "has a mode for a single acquisition with pan_deg:120"), ("zoom:2", "with zoom:2")],
)
def test_an_impossible_acquisition_is_unavailable_with_the_reason(
    endpoint: str, driver: Driver, acquire: str, fault: str
) -> None:
    with Client(endpoint) as client, pytest.raises(UnavailableError, match=fault):
        client.request("pose", robot="mana", acquire=acquire, deadline_s=5)
    assert driver.acquired == []


def test_the_unit_refuses_parameters_outside_their_bounds(endpoint: str) -> None:
    parameters = {"sensor": "wheels", "mode": "single", "acquire": "pan_deg:91"}
    with (
        Bus.open(endpoint, name="caller") as bus,
        pytest.raises(InputError, match="pan_deg=91: expected -90"),
    ):
        bus.call(keys.icu_rpc("mana", "set_mode"), parameters)
