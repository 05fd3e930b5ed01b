# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run of a mission in orbit on a running system: guided servicer, requests, comparison, report."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psutil  # type: ignore[import-untyped]

from cdff_common.bus import Bus
from cdff_common.client import Client
from cdff_common.clock import NS_PER_S
from cdff_common.errors import UnavailableError
from cdff_common.json_form import jsonable
from cdff_common.types import Frame, Mesh
from cdff_dev.missions.models import upload_model
from cdff_dev.missions.orbit.autonomy import OrbitAutonomy, describe_error
from cdff_dev.missions.orbit.comparison import (
    BearingErrors,
    ModelErrors,
    PoseErrors,
    bearing_errors,
    model_errors,
    pose_errors,
    true_distances,
)
from cdff_dev.missions.orbit.link import InterruptibleLink
from cdff_dev.missions.orbit.script import OrbitLimits, OrbitMission
from cdff_dev.missions.report import Process, resource_usage
from cdff_dev.missions.requests import wait_for_clock
from cdff_dev.missions.stage import Stage
from cdff_dev.simulate.orbit.meshes import load_body
from cdff_dev.simulate.orbit.scenario import OrbitScenario

logger = logging.getLogger(__name__)

#: Longest wait for the mission clock, which starts when the bodies are loaded, seconds.
_WORLD_TIMEOUT_S = 120.0
#: Largest number of images in the report.
_IMAGES = 4


@dataclass(frozen=True, slots=True, eq=False)
class OrbitResult:
    """Results of a mission in orbit.

    Attributes
    ----------
    unfinished : list of str
        Errors that ended the tasks.
    distance : tuple of (ndarray (n,), ndarray (n,))
        Times since the start, seconds, and true distances, metres.
    images : list of (float, Frame)
        Images in the DPM with their times since the start, seconds.
    """

    name: str
    mission: OrbitMission
    autonomy: OrbitAutonomy
    poses: PoseErrors
    bearings: BearingErrors | None
    model: ModelErrors | None
    unfinished: list[str]
    distance: tuple[Any, Any]
    images: list[tuple[float, Frame]]
    processes: list[Process]
    mission_s: float
    run_s: float
    limits: OrbitLimits = field(default_factory=OrbitLimits)

    @property
    def faults(self) -> list[str]:
        """Limits that are not met."""
        limits, poses = self.mission.limits, self.poses.summary()
        faults = list(self.unfinished)
        if poses["poses"] < limits.min_poses:
            faults.append(f"{poses['poses']} poses, expected at least {limits.min_poses}")
        if poses["poses"]:
            for name, unit, limit in (
                ("position_m", "m", limits.position_m),
                ("rotation_deg", "°", limits.rotation_deg),
            ):
                if poses[name]["median"] > limit:
                    faults.append(f"median {name} {poses[name]['median']:.3g} {unit}, expected {limit:g}")
            if poses["within_three_sigma"] < limits.within_three_sigma:
                within = f"{poses['within_three_sigma']:.1%} of the poses within three sigmas"
                faults.append(f"{within}, expected at least {limits.within_three_sigma:.0%}")
        if limits.model_rms_m is not None:
            if self.model is None:
                faults.append("no model was delivered")
            elif self.model.rms_m > limits.model_rms_m:
                faults.append(f"model: RMS {self.model.rms_m:.3f} m, expected {limits.model_rms_m:g} m")
        if limits.model_completeness is not None and self.model is not None:
            complete = self.model.completeness
            if complete < limits.model_completeness:
                faults.append(f"model: {complete:.0%} complete, expected {limits.model_completeness:.0%}")
        return faults

    def lines(self) -> list[str]:
        """Return the results as text."""
        parts = [str(part) for part in (self.bearings, self.poses, self.model) if part is not None]
        wrong, flagged = self.poses.flagged_failures(self.mission.limits)
        answered = sum(not outcome.faults for outcome in self.autonomy.outcomes)
        return [
            *parts,
            f"{wrong} poses with errors above five times the limits, {flagged} of them DEGRADED",
            f"{answered} of {len(self.autonomy.outcomes)} requests answered as asked, "
            f"{len(self.autonomy.refusals)} refused with a reason; {self.autonomy.steps} displacements",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the results for JSON."""
        plain: dict[str, Any] = jsonable(
            {
                "poses": self.poses.summary(),
                "bearings": None if self.bearings is None else self.bearings.summary(),
                "model": None if self.model is None else self.model.summary(),
                "requests": {
                    "answered": sum(not outcome.faults for outcome in self.autonomy.outcomes),
                    "failed": sum(bool(outcome.faults) for outcome in self.autonomy.outcomes),
                    "refused_with_reason": len(self.autonomy.refusals),
                },
                "displacements": self.autonomy.steps,
                "events": [[event.at_s, event.text] for event in self.autonomy.events],
                "mission_s": self.mission_s,
                "run_s": self.run_s,
            }
        )
        return plain


def run(
    name: str,
    mission: OrbitMission,
    scenario: OrbitScenario,
    stage: Stage,
    bus: Bus,
    speed: float,
    print_line: Callable[[str], None],
) -> OrbitResult:
    """Run a mission on a system that is ready; raises CdffError if a process of the system ends."""
    for body, mesh in mission.models.items():
        model = upload_model(stage.http, body, mesh)
        print_line(f"mesh of {body}: {model['triangles']} triangles in {model['frame']}")
    truth_log = stage.log_dir.parent / "truth"
    stage.drive(mission.scenario, scenario.seed, speed, truth_log)
    clock, start_ns = wait_for_clock(bus, stage.check_running, _WORLD_TIMEOUT_S)
    start_s, stop = time.monotonic(), threading.Event()
    robot, client_name = scenario.servicer.name, scenario.client.name
    unfinished: list[str] = []
    with InterruptibleLink(stage.connect) as link:
        autonomy = OrbitAutonomy(
            robot=robot,
            client=client_name,
            tasks=mission.tasks,
            profile=stage.profile,
            clock=clock,
            start_ns=start_ns,
            link=link,
            http=stage.http,
            restart=lambda process: kill_process(stage.supervisor_pid, f"{robot}_{process}"),
            stop=stop,
            print_line=print_line,
        )

        def act() -> None:
            try:
                autonomy.run(bus)
            except Exception as error:
                logger.exception("tasks of %s", robot)
                unfinished.append(describe_error(robot, error))
                print_line(unfinished[-1])

        thread = threading.Thread(target=act, name="tasks", daemon=True)
        thread.start()
        try:
            while thread.is_alive():
                stage.check_running()
                time.sleep(0.2)
        finally:
            stop.set()
            thread.join(60.0)
    mission_s, run_s = (clock.now_ns() - start_ns) / NS_PER_S, time.monotonic() - start_s
    print_line(f"{mission_s:.0f} s of mission time in {run_s:.0f} s; comparing with the ground truth")
    processes = resource_usage(stage.supervisor_pid)
    stage.end_drive()
    with Client(stage.connect) as client:
        poses, bearings = _compared_tracks(client, truth_log, mission, scenario)
        images = _stored_images(client, robot, start_ns)
    stamps_ns, distances_m = true_distances(truth_log, robot, client_name)
    return OrbitResult(
        name=name,
        mission=mission,
        autonomy=autonomy,
        poses=poses,
        bearings=bearings,
        model=_compared_model(autonomy, mission, scenario),
        unfinished=unfinished,
        distance=((stamps_ns - start_ns) / NS_PER_S, distances_m),
        images=images,
        processes=processes,
        mission_s=mission_s,
        run_s=run_s,
    )


def kill_process(supervisor_pid: int, process: str) -> None:
    """Kill a DFPC host of the supervisor by the name of its process; the supervisor starts it again."""
    for child in psutil.Process(supervisor_pid).children():
        line = child.cmdline()
        if "--process" in line and line[line.index("--process") + 1] == process:
            child.kill()
            return
    raise UnavailableError(f"no process {process!r} runs below the supervisor")


def _compared_tracks(
    client: Client, truth_log: Path, mission: OrbitMission, scenario: OrbitScenario
) -> tuple[PoseErrors, BearingErrors | None]:
    """Return the errors of the tracker, and those of the bearings if the servicer has a far camera."""
    robot, body = scenario.servicer.name, scenario.client.name
    lidar = next(iter(scenario.servicer.lidars))
    poses = pose_errors(client, truth_log, robot, mission.tracker, lidar, body)
    if not scenario.servicer.cameras:
        return poses, None
    camera = next(iter(scenario.servicer.cameras))
    return poses, bearing_errors(client, truth_log, robot, camera, body)


def _stored_images(client: Client, robot: str, start_ns: int) -> list[tuple[float, Frame]]:
    """Return up to ``_IMAGES`` images of a robot in the DPM, evenly chosen, with times since the start."""
    found = sorted(client.search("image", robot=robot, limit=1000), key=lambda item: item.header.t1_ns)
    rows = np.unique(np.linspace(0, len(found) - 1, min(len(found), _IMAGES)).astype(int))
    chosen = [found[row] for row in rows]
    return [((p.header.t1_ns - start_ns) / NS_PER_S, client.get(p.id).value) for p in chosen]


def _compared_model(
    autonomy: OrbitAutonomy, mission: OrbitMission, scenario: OrbitScenario
) -> ModelErrors | None:
    """Return the errors of the last model that was delivered; None without one."""
    models = [o.answer.value for o in autonomy.outcomes if o.answer and isinstance(o.answer.value, Mesh)]
    if not models:
        return None
    client = scenario.client
    body = load_body(
        client.mesh, unit=client.unit, material=client.material, size_m=(1e-2, 1e6), field="client"
    )
    return model_errors(models[-1], body, mission.limits.model_within_m)
