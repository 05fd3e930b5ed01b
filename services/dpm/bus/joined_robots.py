# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Robots that join the DPM while it runs: their frames in the store, scopes, streams and recordings."""

from __future__ import annotations

import logging
from collections.abc import Callable

from cdff_common.bus import Bus, keys
from cdff_common.errors import StorageError
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.robot_profile import RobotProfile
from services.alarms import Severity
from services.dpm.bus.recorder import Recorder
from services.dpm.bus.service_monitor import ServiceMonitor
from services.dpm.operations.dpm import Dpm
from services.dpm.operations.profile_entry import enter

logger = logging.getLogger(__name__)

#: Kind of the events in the history: ``{change: joined | changed | left, revision}``.
EVENT = "robot"


class JoinedRobots:
    """Service of the robots that join, change and leave: a ``RosterListener``.

    Parameters
    ----------
    bus : Bus
    dpm : Dpm
    ground : Profile
        Profile of the shared services; its history policies hold for joined robots, too.
    monitor : ServiceMonitor
    recorder : Recorder
    serve_scope : callable
        Declares the calls of one more scope.
    """

    def __init__(
        self,
        bus: Bus,
        dpm: Dpm,
        ground: Profile,
        monitor: ServiceMonitor,
        recorder: Recorder,
        serve_scope: Callable[[str], None],
    ) -> None:
        self._bus, self._dpm, self._ground = bus, dpm, ground
        self._monitor, self._recorder, self._serve_scope = monitor, recorder, serve_scope

    def set_robot(self, joined: RobotProfile) -> None:
        """Enter a robot in the store, with new revisions of changed mounts, and serve and record it."""
        robot, profile = joined.robot, joined.profile
        is_known = bool(self._monitor.revision(robot.id))
        enter_profile(self._dpm, profile)
        self._monitor.set_robot(robot, joined.revision)
        history = (*profile.history, *self._ground.history)
        self._recorder.set_robot(profile.model_copy(update={"history": history}))
        self._serve_scope(robot.id)
        self._record(robot.id, "changed" if is_known else "joined", joined.revision)

    def remove_robot(self, robot: str) -> None:
        """Stop to follow and record a robot that has left; its products, frames and scope stay."""
        revision = self._monitor.revision(robot)
        self._recorder.remove_robot(robot)
        self._monitor.remove_robot(robot)
        self._bus.withdraw_token(keys.alive(robot, "dpm"))
        self._record(robot, "left", revision)

    def refuse(self, robot: str, reason: str) -> None:
        """Begin the alarm of a robot that cannot join; without a reason end it."""
        if reason:
            remedy = "correct its profile and start it again"
            self._dpm.alarms.set("robot_refused", robot, Severity.WARNING, reason, remedy)
        else:
            self._dpm.alarms.clear("robot_refused", robot)

    def _record(self, robot: str, change: str, revision: str) -> None:
        try:
            self._dpm.writer.record(robot, EVENT, {"change": change, "revision": revision})
        except StorageError as error:  # a full disk; an alarm reports it
            logger.warning("the history lacks that robot %s has %s: %s", robot, change, error)


def enter_profile(dpm: Dpm, profile: Profile) -> None:
    """Add a profile as ``enter`` does, with an alarm for each frame that differs; on a full disk the store is
    served as it is.
    """
    try:
        for difference in enter(dpm.store, profile):
            dpm.alarms.set(
                "frame_differs", difference.frame, Severity.WARNING, difference.text, difference.remedy
            )
    except StorageError as error:
        logger.error("the profile is not entered in the store: %s", error)
