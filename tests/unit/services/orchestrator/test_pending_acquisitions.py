# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Single acquisitions wait for all DFPCs of their plan, one after the other at each sensor."""

from __future__ import annotations

import pytest

from cdff_core.orchestration.acquisition import Acquisition, AcquisitionParameters
from cdff_core.orchestration.journal import recover
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.pending_acquisitions import PendingAcquisitions

MATCHER, MAPPER = ProviderId("mana", "matcher"), ProviderId("mana", "mapper")
OTHER, CAMERA = ProviderId("minnie", "matcher"), SensorId("mana", "camera")
ONE = Acquisition("single", AcquisitionParameters.parse("now"))


class Demands:
    """Acquisitions with the leases and observations on which they depend."""

    def __init__(self) -> None:
        self.leases, self.observed = Leases(), ObservedState()
        self.acquisitions = PendingAcquisitions()

    def demand(self, holder: str, *providers: ProviderId, priority: int = 5) -> None:
        self.leases.acquire(holder, providers, {}, priority=priority)
        self.acquisitions.set(holder, {CAMERA: ONE})

    def due(self, now_s: float = 0.0) -> list[str]:
        """Return the holders of the due acquisitions."""
        return [a.holder for a in self.acquisitions.due(self.leases, self.observed, now_s)]


@pytest.fixture
def demands() -> Demands:
    return Demands()


def test_an_acquisition_waits_for_the_whole_chain_of_its_robot(demands: Demands) -> None:
    demands.demand("job", MATCHER, MAPPER, OTHER)
    assert demands.due() == []
    demands.observed.active |= {MATCHER}  # it uses the camera; the map needs the mapper, too
    assert demands.due() == []
    demands.observed.active |= {MAPPER}
    demands.observed.warm_at_s[MAPPER] = 3.0
    assert demands.due() == []
    assert demands.due(3.0) == ["job"]


def test_an_acquisition_waits_while_one_of_its_dfpcs_is_taken_by_another_request(demands: Demands) -> None:
    demands.demand("job", MATCHER)
    demands.observed.active |= {MATCHER}
    demands.leases.take([MATCHER], 9)
    demands.leases.acquire("urgent", [MATCHER], {}, priority=9)
    assert demands.due() == []


def test_acquisitions_of_one_sensor_are_made_one_after_the_other(demands: Demands) -> None:
    demands.observed.active |= {MATCHER}
    for holder in ("first", "second"):
        demands.demand(holder, MATCHER)
    assert demands.due() == ["first"]
    demands.acquisitions.end("first", CAMERA, 40)
    assert demands.due() == ["second"]
    assert [demands.acquisitions.begun_ns(holder) for holder in ("first", "second")] == [40, 0]
    assert demands.acquisitions.is_pending("second", CAMERA)
    demands.acquisitions.end("unknown", CAMERA, 50)
    demands.acquisitions.remove("second")
    assert demands.due() == []


def test_an_acquisition_that_failed_waits_for_its_back_off(demands: Demands) -> None:
    demands.demand("job", MATCHER)
    demands.observed.active |= {MATCHER}
    demands.observed.add_failure(CAMERA, "no image", 10.0)
    assert demands.due(10.0) == []
    assert demands.due(11.0) == ["job"]


def test_an_acquisition_is_no_change_of_the_mode_to_undo_after_a_restart() -> None:
    records = [
        {"kind": "mode", "sensor": "mana/camera", "mode": "single", "ok": True, "acquired": "now"},
        {"kind": "mode", "sensor": "mana/lidar", "mode": "scan", "ok": True},
    ]
    assert recover(records).modes == {SensorId("mana", "lidar")}
