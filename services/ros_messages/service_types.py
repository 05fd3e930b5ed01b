# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Service and action types of ROS: their definitions, hashes, and encoding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from services.ros_messages.message_types import RosTypes
from services.ros_messages.type_hashes import message_hash, service_hash

_SEPARATOR = "---\n"


def definition_parts(definition: str) -> list[str]:
    """Return the parts of a ``.srv`` or ``.action`` file, which lines of three hyphens separate."""
    return f"{definition}\n".split(_SEPARATOR)


@dataclass(frozen=True, slots=True)
class ServiceType:
    """A service type of one version of ROS.

    Attributes
    ----------
    name : str
        Such as ``nav_msgs/srv/GetMap``.
    request, response : str
        Names of the types of the request and the response in the type store.
    type_hash : str
        Hash of ROS 2.
    """

    name: str
    request: str
    response: str
    type_hash: str

    @classmethod
    def register(cls, types: RosTypes, name: str, definition: str) -> ServiceType:
        """Add a service type to a type store.

        Parameters
        ----------
        types : RosTypes
        name : str
        definition : str
            Text of the ``.srv`` file.
        """
        package, _, last = name.split("/")
        names = [f"{package}/msg/{last}_{end}" for end in ("Request", "Response")]
        for part, text in zip(names, definition_parts(definition), strict=True):
            if part not in types.store.types:
                types.store.register(get_types_from_msg(text, part))
        is_ros_2 = types.version == 2
        type_hash = service_hash(types.store.fielddefs, name, definition) if is_ros_2 else ""
        return cls(name, names[0], names[1], type_hash)


@dataclass(frozen=True, slots=True)
class ActionType:
    """An action type of ROS 2: three services and two topics (design.ros2.org/articles/actions.html).

    Attributes
    ----------
    name : str
        Such as ``cdff_msgs/action/Request``.
    send_goal, get_result : ServiceType
    feedback : str
        Name of the type of the feedback message in the type store.
    feedback_hash : str
    """

    name: str
    send_goal: ServiceType
    get_result: ServiceType
    feedback: str
    feedback_hash: str

    @property
    def feedback_type(self) -> str:
        """Name of the type of the feedback message in keys."""
        return f"{self.name}_FeedbackMessage"

    @classmethod
    def register(cls, types: RosTypes, name: str, definition: str) -> ActionType:
        """Add an action type to a type store.

        Parameters
        ----------
        types : RosTypes
            Of ROS 2.
        name : str
        definition : str
            Text of the ``.action`` file: goal, result and feedback.
        """
        package, _, last = name.split("/")
        goal, result, feedback = definition_parts(definition)
        prefix = f"{package}/msg/{last}"
        texts = {"Goal": goal, "Result": result, "Feedback": feedback}
        texts["FeedbackMessage"] = f"unique_identifier_msgs/UUID goal_id\n{last}_Feedback feedback\n"
        for end, text in texts.items():
            if f"{prefix}_{end}" not in types.store.types:
                types.store.register(get_types_from_msg(text, f"{prefix}_{end}"))
        send_goal = f"unique_identifier_msgs/UUID goal_id\n{last}_Goal goal\n{_SEPARATOR}"
        send_goal += "bool accepted\nbuiltin_interfaces/Time stamp\n"
        get_result = f"unique_identifier_msgs/UUID goal_id\n{_SEPARATOR}int8 status\n{last}_Result result\n"
        definitions = _as_action_types(types.store.fielddefs, prefix, name)
        services = []
        for end, text in (("SendGoal", send_goal), ("GetResult", get_result)):
            service = ServiceType.register(types, f"{package}/msg/{last}_{end}", text)
            own = _as_action_types(types.store.fielddefs, prefix, name)
            type_hash = service_hash(
                own, f"{name}_{end}", "", parts=(f"{name}_{end}_Request", f"{name}_{end}_Response")
            )
            services.append(ServiceType(f"{name}_{end}", service.request, service.response, type_hash))
        feedback_hash = message_hash(definitions, f"{name}_FeedbackMessage")
        return cls(name, services[0], services[1], f"{prefix}_FeedbackMessage", feedback_hash)


def _as_action_types(definitions: Mapping[str, Any], prefix: str, name: str) -> dict[str, Any]:
    """Return definitions in which the types of an action, which the store has as messages, have its names."""

    def renamed(text: str) -> str:
        return name + text.removeprefix(prefix) if text.startswith(f"{prefix}_") else text

    def member(kind: Any) -> Any:
        node, content = kind
        if node == Nodetype.NAME:
            return node, renamed(content)
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            return node, (member(content[0]), content[1])
        return kind

    return {
        renamed(key): (constants, [(field, member(kind)) for field, kind in members])
        for key, (constants, members) in definitions.items()
    }
