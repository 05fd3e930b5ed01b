# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Action server of ROS 2: three services and two topics.

Source: https://design.ros2.org/articles/actions.html.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np

from cdff_common.clock import monotonic_s, wall_ns
from services.gateway_ros2.robot_node import RobotNode
from services.ros_messages.encoding import Outgoing
from services.ros_messages.service_types import ActionType, ServiceType

logger = logging.getLogger(__name__)

CANCEL_GOAL = "action_msgs/srv/CancelGoal"
STATUS = "action_msgs/msg/GoalStatusArray"
_CANCEL_GOAL_DEFINITION = "GoalInfo goal_info\n---\nint8 return_code\nGoalInfo[] goals_canceling\n"
#: Codes of ``CancelGoal``.
_NONE, _REJECTED, _UNKNOWN_GOAL, _TERMINATED = 0, 1, 2, 3
#: Goals that run or wait, and time for which results are kept, seconds.
_MAX_GOALS, _RESULT_S = 8, 900.0
_ID_BYTES = 16
_NS_PER_S = 1_000_000_000


class GoalState(IntEnum):
    """Status of a goal, as in ``action_msgs/msg/GoalStatus``."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def is_final(self) -> bool:
        """True if the goal has ended."""
        return self >= GoalState.SUCCEEDED


@dataclass(eq=False)
class Goal:
    """A goal of an action.

    Attributes
    ----------
    goal_id : bytes
    stamp_ns : int
        Time of its acceptance.
    request : Any
        The goal message.
    cancelled : threading.Event
        Set when its cancellation is requested.
    cancel : callable or None
        Called once when that happens; set by ``execute``.
    """

    goal_id: bytes
    stamp_ns: int
    request: Any
    state: GoalState = GoalState.ACCEPTED
    result: Any = None
    ended_s: float = 0.0
    cancelled: threading.Event = field(default_factory=threading.Event)
    cancel: Callable[[], None] | None = None
    waiting: list[Callable[[Any], None]] = field(default_factory=list)


#: Runs a goal: from the goal and a function that publishes feedback to the result, and whether it succeeded.
Execute = Callable[[Goal, Callable[[Any], None]], tuple[Any, bool]]


class ActionServer:
    """Action server of a node.

    Parameters
    ----------
    node : RobotNode
    name : str
        Such as ``/cdff/request``.
    action : ActionType
    execute : callable
        Runs in a thread of its own.
    no_result : callable
        Returns the result of a goal that is not known.
    """

    def __init__(
        self, node: RobotNode, name: str, action: ActionType, execute: Execute, no_result: Callable[[], Any]
    ) -> None:
        self._node, self._name, self._action = node, f"{name}/_action", action
        self._execute, self._no_result = execute, no_result
        self._lock = threading.RLock()
        self._goals: dict[bytes, Goal] = {}
        self._pool = ThreadPoolExecutor(_MAX_GOALS, thread_name_prefix=f"goals of {name}")
        cancel_goal = ServiceType.register(node.types, CANCEL_GOAL, _CANCEL_GOAL_DEFINITION)
        self._cancel_response = node.types.store.types[cancel_goal.response]
        self._feedback_topic, self._status_topic = f"{self._name}/feedback", f"{self._name}/status"
        node.declare_publisher(
            self._feedback_topic, action.feedback_type, latched=False, type_hash=action.feedback_hash
        )
        node.declare_publisher(self._status_topic, STATUS, latched=True)
        node.serve(f"{self._name}/send_goal", action.send_goal, self._on_goal)
        node.serve(f"{self._name}/cancel_goal", cancel_goal, self._on_cancel)
        node.serve(f"{self._name}/get_result", action.get_result, self._on_result)
        self._publish_status()

    def close(self) -> None:
        """Cancel the goals and end their threads."""
        with self._lock:
            goals = [goal for goal in self._goals.values() if not goal.state.is_final]
        for goal in goals:
            self._cancel(goal)
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _on_goal(self, request: Any, respond: Callable[[Any], None]) -> None:
        goal_id, stamp_ns = bytes(np.asarray(request.goal_id.uuid, np.uint8)), wall_ns()
        with self._lock:
            self._discard_old()
            active = sum(not goal.state.is_final for goal in self._goals.values())
            is_accepted = goal_id not in self._goals and active < _MAX_GOALS and any(goal_id)
            if is_accepted:
                goal = self._goals[goal_id] = Goal(goal_id, stamp_ns, request.goal)
        types = self._node.types
        kind = types.store.types[self._action.send_goal.response]
        try:
            respond(kind(accepted=is_accepted, stamp=_time(types, stamp_ns)))
        finally:  # an accepted goal runs to its end even if the client is lost
            if is_accepted:
                self._pool.submit(self._run, goal)
        if is_accepted:
            self._publish_status()
        else:
            logger.warning("%s: goal %s is rejected, %d run", self._name, goal_id.hex(), active)

    def _run(self, goal: Goal) -> None:
        """Execute a goal, and answer the clients that wait for its result; an error aborts it."""
        try:
            result, succeeded = self._executed(goal)
            has_failed = False
        except Exception:
            logger.exception("%s: goal %s failed", self._name, goal.goal_id.hex())
            result, succeeded, has_failed = self._no_result(), False, True
        with self._lock:
            if succeeded:
                goal.state = GoalState.SUCCEEDED
            else:  # an error aborts a goal, also a cancelled one
                is_cancelled = goal.cancelled.is_set() and not has_failed
                goal.state = GoalState.CANCELED if is_cancelled else GoalState.ABORTED
            goal.result, goal.ended_s = result, monotonic_s()
            waiting, goal.waiting = goal.waiting, []
        for respond in waiting:
            try:
                self._respond_result(goal, respond)
            except Exception:  # the other clients receive the result
                logger.exception("%s: a result of goal %s is not sent", self._name, goal.goal_id.hex())
        self._publish_status()

    def _executed(self, goal: Goal) -> tuple[Any, bool]:
        """Return the result of a goal, and whether it has succeeded."""
        with self._lock:
            if goal.cancelled.is_set():
                return self._no_result(), False
            goal.state = GoalState.EXECUTING
        self._publish_status()
        return self._execute(goal, lambda message: self._publish_feedback(goal, message))

    def _on_result(self, request: Any, respond: Callable[[Any], None]) -> None:
        goal_id = bytes(np.asarray(request.goal_id.uuid, np.uint8))
        with self._lock:
            goal = self._goals.get(goal_id)
            if goal is not None and not goal.state.is_final:
                goal.waiting.append(respond)
                return
        self._respond_result(goal, respond)

    def _respond_result(self, goal: Goal | None, respond: Callable[[Any], None]) -> None:
        kind = self._node.types.store.types[self._action.get_result.response]
        state, result = (GoalState.UNKNOWN, self._no_result()) if goal is None else (goal.state, goal.result)
        respond(kind(status=int(state), result=result))

    def _on_cancel(self, request: Any, respond: Callable[[Any], None]) -> None:
        """Cancel a goal by its id, all goals accepted until a time, or all goals if both are zero."""
        info = request.goal_info
        goal_id = bytes(np.asarray(info.goal_id.uuid, np.uint8))
        until_ns = info.stamp.sec * _NS_PER_S + info.stamp.nanosec
        has_id = any(goal_id)
        with self._lock:
            named = self._goals.get(goal_id)
            chosen = [
                goal
                for goal in self._goals.values()
                if goal is named or (until_ns and goal.stamp_ns <= until_ns) or not (has_id or until_ns)
            ]
            running = [goal for goal in chosen if not goal.state.is_final]
        code = _NONE if running else _REJECTED
        if has_id and not running:
            code = _UNKNOWN_GOAL if named is None else _TERMINATED
        infos = [self._info(goal) for goal in running]
        respond(self._cancel_response(return_code=code, goals_canceling=infos))
        for goal in running:
            self._cancel(goal)
        self._publish_status()

    def _cancel(self, goal: Goal) -> None:
        with self._lock:
            if goal.cancelled.is_set() or goal.state.is_final:
                return
            goal.cancelled.set()
            goal.state = GoalState.CANCELING
        if goal.cancel is not None:
            goal.cancel()

    def _publish_feedback(self, goal: Goal, feedback: Any) -> None:
        types = self._node.types
        message = types.store.types[self._action.feedback](goal_id=self._uuid(goal), feedback=feedback)
        data = bytes(types.serialize(message, self._action.feedback))
        self._node.publish_bytes(self._feedback_topic, self._action.feedback_type, data)

    def _publish_status(self) -> None:
        make = self._node.types.make
        with self._lock:
            statuses = [
                make("action_msgs/GoalStatus", goal_info=self._info(goal), status=int(goal.state))
                for goal in self._goals.values()
            ]
        message = make("action_msgs/GoalStatusArray", status_list=statuses)
        self._node.publish(Outgoing(self._status_topic, STATUS, message), latched=True)

    def _discard_old(self) -> None:
        """Discard the results that ended longest ago."""
        now_s = monotonic_s()
        self._goals = {
            key: goal
            for key, goal in self._goals.items()
            if not goal.state.is_final or now_s - goal.ended_s < _RESULT_S
        }
        ended = [goal for goal in self._goals.values() if goal.state.is_final]
        ended.sort(key=lambda goal: goal.ended_s)
        for goal in ended[: max(len(ended) - _MAX_GOALS, 0)]:
            del self._goals[goal.goal_id]

    def _info(self, goal: Goal) -> Any:
        stamp = _time(self._node.types, goal.stamp_ns)
        return self._node.types.make("action_msgs/GoalInfo", goal_id=self._uuid(goal), stamp=stamp)

    def _uuid(self, goal: Goal) -> Any:
        return self._node.types.make(
            "unique_identifier_msgs/UUID", uuid=np.frombuffer(goal.goal_id, np.uint8, _ID_BYTES)
        )


def _time(types: Any, stamp_ns: int) -> Any:
    return types.make("builtin_interfaces/Time", sec=stamp_ns // _NS_PER_S, nanosec=stamp_ns % _NS_PER_S)
