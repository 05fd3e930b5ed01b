# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Robots that join a running ground, leave it, and return with another revision of their profile.

The supervisor of a robot's own machine has a liveliness token and serves the profile of the robot
(``supervisor/@rpc/profile``). Each shared service follows these tokens with a roster of its own. A robot of
the ground's own profile stays in it while its machine is out of contact; any other one has left.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Protocol

from cdff_common.bus import Bus, keys
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.robot_profile import RobotProfile
from cdff_common.loops import Loops

logger = logging.getLogger(__name__)

#: Time without a token after which a robot has left, seconds; a router that reloads its access list closes
#: its links for about one.
LEAVE_S = 2.0
#: Pause before the next attempt to read a profile, seconds.
_RETRY_S = 0.3
#: Timeout of a call, and time after which the thread counts as hung.
_CALL_S, _BUSY_LIMIT_S = 3.0, 120.0
_SERVICE = "supervisor"


class RosterListener(Protocol):
    """Service that follows the robots of a roster; the roster calls its methods in its own thread."""

    def set_robot(self, joined: RobotProfile) -> None:
        """Serve a robot that joined, or one whose profile has changed; raises CdffError to refuse it."""

    def remove_robot(self, robot: str) -> None:
        """Stop planning with a robot that left."""


class RobotRoster:
    """Follows the robots that join, change and leave.

    Parameters
    ----------
    bus : Bus
    ground : Profile
        Profile of the shared services.
    listener : RosterListener
    loops : Loops
        Watches the thread.
    on_refusal : callable, optional
        Called with robot and reason; an empty reason ends the refusal.
    now_s : callable, optional
        Monotonic seconds.
    """

    def __init__(
        self,
        bus: Bus,
        ground: Profile,
        listener: RosterListener,
        loops: Loops,
        on_refusal: Callable[[str, str], None] = lambda robot, reason: None,
        now_s: Callable[[], float] = monotonic_s,
    ) -> None:
        self._bus, self._ground, self._listener = bus, ground, listener
        self._on_refusal, self._now_s = on_refusal, now_s
        self._loop = loops.add("roster", _BUSY_LIMIT_S)
        self._changed = threading.Condition()
        self._due_s: dict[str, float] = {}
        self._alive: set[str] = set()
        #: Revisions of the robots that are served; robots of the ground's own profile never leave it.
        self._revisions = {r: RobotProfile.of(ground, r).revision for r in ground.robot_ids}
        self._refused: set[str] = set()
        self._closed = False

    def start(self) -> None:
        """Follow the tokens; present robots join at once."""
        threading.Thread(target=self._run, name="roster", daemon=True).start()
        self._bus.watch_alive(keys.alive("*", _SERVICE), self._on_alive)

    def close(self) -> None:
        """Stop following."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _run(self) -> None:
        self._loop.run(self._next, self.update)

    def _on_alive(self, key: str, is_alive: bool) -> None:
        scope = key.split("/")[2]
        if scope == keys.GROUND:
            return
        with self._changed:
            (self._alive.add if is_alive else self._alive.discard)(scope)
            self._due_s[scope] = self._now_s() + (0.0 if is_alive else LEAVE_S)
            self._changed.notify_all()

    def _next(self) -> str | None:
        """Wait for the next robot to process and return its id; return None after the roster is closed."""
        with self._changed:
            while not self._closed:
                robot = min(self._due_s, key=lambda name: self._due_s[name], default=None)
                wait_s = None if robot is None else self._due_s[robot] - self._now_s()
                if robot is not None and wait_s is not None and wait_s <= 0.0:
                    del self._due_s[robot]
                    return robot
                self._changed.wait(wait_s)
            return None

    def update(self, robot: str) -> None:
        """Compare a robot with its token and its profile, and report the difference to the listener."""
        with self._changed:
            is_alive = robot in self._alive
        if not is_alive:
            self._refuse(robot, "")
            if robot not in self._ground.robot_ids and self._revisions.pop(robot, None) is not None:
                logger.info("robot %s has left", robot)
                self._listener.remove_robot(robot)
            return
        try:
            call = self._bus.call(keys.supervisor_rpc(robot, "profile"), timeout_s=_CALL_S)
        except (
            UnavailableError
        ) as error:  # the token appears before the profile can be read, and links can close for a moment
            logger.info("the profile of %s: %s", robot, error)
            with self._changed:
                self._due_s.setdefault(robot, self._now_s() + _RETRY_S)
            return
        except CdffError as error:
            self._refuse(robot, str(error))
            return
        try:
            self._admit(RobotProfile.from_dict(call.body(), robot))
        except CdffError as error:
            self._refuse(robot, str(error))

    def _admit(self, joined: RobotProfile) -> None:
        robot, revision = joined.robot.id, joined.revision
        joined.check_joins(self._ground)
        previous = self._revisions.get(robot)
        if previous != revision:
            self._listener.set_robot(joined)
            self._revisions[robot] = revision
            change = "has joined with" if previous is None else f"has changed from revision {previous} to"
            logger.info("robot %s %s revision %s of its profile", robot, change, revision)
        self._refuse(robot, "")

    def _refuse(self, robot: str, reason: str) -> None:
        if reason:
            logger.error("robot %s is refused: %s", robot, reason)
            self._refused.add(robot)
        elif robot not in self._refused:
            return
        else:
            self._refused.discard(robot)
        self._on_refusal(robot, reason)
