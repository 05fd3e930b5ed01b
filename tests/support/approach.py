# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An approach in orbit with processes: the demonstration, its outcomes and the true poses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cdff_common.bus import Bus
from cdff_common.geometry import se3
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import deploy_folder
from cdff_dev.logs import open_log
from cdff_dev.missions.demonstration import script_of
from cdff_dev.missions.models import upload_model
from cdff_dev.missions.requests import Outcome, run_requests, wait_for_clock
from cdff_dev.missions.stage import Stage
from cdff_dev.ports import free_port
from cdff_dev.simulate.scenario_files import load_any_scenario
from cdff_dev.simulate.store import simulated_log


@dataclass(frozen=True, slots=True)
class Approach:
    """A running demonstration after its requests.

    Attributes
    ----------
    connect, http : str
        Endpoint of the router, and ``host:port`` of the DPM.
    log : Path
        The simulated log.
    outcomes : list of Outcome
        Outcomes of OG2's requests.
    """

    connect: str
    http: str
    log: Path
    outcomes: list[Outcome]

    def true_pose(self, sensor: str, t_ns: int) -> NDArray[np.float64]:
        """Return ``T_sensor_client`` (4, 4), metres, at the time of a sample of the servicer's sensor."""
        stream = f"/servicer/truth.{sensor}_target"
        with open_log(self.log) as source:
            target = next(s.value for s in source.samples([stream]) if s.stamp_ns == t_ns)
        data = target.detections[0].pose.data
        return se3.transform_from_quaternion_xyzw(data.translation, data.orientation)


@contextmanager
def run_approach(name: str) -> Iterator[Approach]:
    """Run a demonstration in orbit until all requests have an outcome; the processes end with the context."""
    script, path = script_of(name), deploy_folder() / "profiles" / f"{name}.yaml"
    connect, http = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    log = simulated_log(load_any_scenario(str(script.scenario)))
    with (
        Stage(load_profile(path), path, connect, http) as stage,
        Bus.open(connect, name="test", wait_s=60) as bus,
    ):
        stage.wait_ready(bus)
        for model, mesh in script.models.items():
            assert upload_model(http, model, mesh)["result"] == "inserted"
            assert upload_model(http, model, mesh)["result"] == "already"
        stage.play(str(log), script.rate)
        clock, start_ns = wait_for_clock(bus, stage.check_running)
        outcomes = run_requests(script.requests, clock, start_ns, connect, http, lambda _outcome: None)
        yield Approach(connect, http, log, outcomes)
