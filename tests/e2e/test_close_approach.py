# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A close approach in orbit with processes: the plan changes from the far camera to a lidar."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from cdff_common.bus import Bus
from cdff_common.client import Client
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import deploy_folder
from cdff_dev.missions.demonstration import script_of
from cdff_dev.missions.models import upload_model
from cdff_dev.missions.requests import Outcome, run_requests, wait_for_clock
from cdff_dev.missions.stage import Stage
from cdff_dev.ports import free_port
from cdff_dev.simulate.scenario_files import load_any_scenario
from cdff_dev.simulate.store import simulated_log

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(900)]

NAME = "close_approach"


@pytest.fixture(scope="module")
def approach() -> Iterator[tuple[str, list[Outcome]]]:
    """Run the approach; return the endpoint of the router and the outcomes of OG2's requests."""
    script, path = script_of(NAME), deploy_folder() / "profiles" / f"{NAME}.yaml"
    connect, http = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    log = simulated_log(load_any_scenario(str(script.scenario)))
    with (
        Stage(load_profile(path), path, connect, http) as stage,
        Bus.open(connect, name="test", wait_s=20) as bus,
    ):
        stage.wait_ready(bus)
        for name, mesh in script.models.items():
            assert upload_model(http, name, mesh)["result"] == "inserted"
            assert upload_model(http, name, mesh)["result"] == "already"
        stage.play(str(log), script.rate)
        clock, start_ns = wait_for_clock(bus, stage.check_running)
        outcomes = run_requests(script.requests, clock, start_ns, connect, http, lambda _outcome: None)
        yield connect, outcomes


def test_requests_with_bounds_on_the_accuracy_change_the_provider(
    approach: tuple[str, list[Outcome]],
) -> None:
    _, outcomes = approach
    assert [outcome.faults for outcome in outcomes] == [()] * len(outcomes)
    plan = "\n".join(outcomes[2].explanation)
    for dfpc in ("far_range_object_tracking", "target_detection", "lidar_target_tracking"):
        assert f"plan: servicer/{dfpc}" in plan
    assert "detections from product/target_detection/detections" in plan


def test_a_point_of_the_client_is_known_in_the_frame_of_the_arm(approach: tuple[str, list[Outcome]]) -> None:
    connect, _ = approach
    with Client(connect) as client:
        newest = client.search("pose", robot="servicer", dfpc="lidar_target_tracking", limit=1)[0]
        T_arm_client = client.pose(
            "servicer", parent="servicer/arm", child="client/body", t_ns=newest.header.t1_ns
        )
    distance_m = float(T_arm_client.matrix[0, 3])
    assert 5.0 < distance_m < 120.0
