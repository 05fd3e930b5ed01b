# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of DFPCs as parameters of the node of the gateway, by the services of ``rcl_interfaces``.

The parameter ``lidar_slam.voxel_m`` is ``voxel_m`` of ``lidar_slam``. A parameter is set by ``configure`` of
its DFPC, which an active DFPC refuses.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cdff_common.bus import Bus
from cdff_common.errors import CdffError, InputError
from services.gateway_ros2.robot_node import RobotNode
from services.gateways.counters import TopicCounters
from services.gateways.dfpc_parameters import DfpcParameters
from services.ros_messages.service_types import ServiceType

logger = logging.getLogger(__name__)

_DEFINITIONS = {
    "describe_parameters": ("DescribeParameters", "string[] names\n---\nParameterDescriptor[] descriptors\n"),
    "get_parameters": ("GetParameters", "string[] names\n---\nParameterValue[] values\n"),
    "get_parameter_types": ("GetParameterTypes", "string[] names\n---\nuint8[] types\n"),
    "list_parameters": (
        "ListParameters",
        "uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth\n---\nListParametersResult result\n",
    ),
    "set_parameters": ("SetParameters", "Parameter[] parameters\n---\nSetParametersResult[] results\n"),
    "set_parameters_atomically": (
        "SetParametersAtomically",
        "Parameter[] parameters\n---\nSetParametersResult result\n",
    ),
}
#: Members of ``ParameterValue`` by their type, as in ``rcl_interfaces/msg/ParameterType``.
_MEMBERS = (
    "",
    "bool_value",
    "integer_value",
    "double_value",
    "string_value",
    "byte_array_value",
    "bool_array_value",
    "integer_array_value",
    "double_array_value",
    "string_array_value",
)
_ARRAY_OFFSET = 5
#: Parameters of a request.
_MAX_NAMES = 256


class ParameterServer:
    """Services for the parameters of a node.

    Parameters
    ----------
    node : RobotNode
    robot : str
    allowed : mapping of DFPC to names
        Parameters that exist for the robot; a name of a DFN's parameter has that of its slot and a dot.
    bus : Bus
        Bus of the DFPCs.
    """

    def __init__(self, node: RobotNode, robot: str, allowed: Mapping[str, tuple[str, ...]], bus: Bus) -> None:
        self._types, self._parameters = node.types, DfpcParameters(robot, allowed, bus)
        self.counters = TopicCounters()
        self._kinds: dict[str, ServiceType] = {}
        handlers: dict[str, Callable[[Any], dict[str, Any]]] = {
            "describe_parameters": self._describe,
            "get_parameters": lambda request: {"values": list(map(self._value, request.names))},
            "get_parameter_types": lambda request: {
                "types": np.array([self._value(name).type for name in request.names], np.uint8)
            },
            "list_parameters": self._list,
            "set_parameters": lambda request: {"results": [self._set([p]) for p in request.parameters]},
            "set_parameters_atomically": lambda request: {"result": self._set(request.parameters)},
        }
        if not allowed:
            return
        for name, (last, definition) in _DEFINITIONS.items():
            service = ServiceType.register(node.types, f"rcl_interfaces/srv/{last}", definition)
            node.serve(
                f"/{node.node.name}/{name}", service, self._handler(service, handlers[name]), workers=1
            )

    def to_map(self) -> dict[str, Any]:
        """Return the names of the parameters, and how many were set and refused."""
        return {"names": self._parameters.names, **self.counters.to_map()}

    def _handler(
        self, service: ServiceType, answer: Callable[[Any], dict[str, Any]]
    ) -> Callable[[Any, Callable[[Any], None]], None]:
        kind = self._types.store.types[service.response]

        def handle(request: Any, respond: Callable[[Any], None]) -> None:
            _check_size(request)
            respond(kind(**answer(request)))

        return handle

    def _describe(self, request: Any) -> dict[str, Any]:
        make = self._types.make
        return {
            "descriptors": [
                make(
                    "rcl_interfaces/ParameterDescriptor",
                    name=name,
                    type=self._value(name).type,
                    description="",
                    additional_constraints="",
                    read_only=False,
                    dynamic_typing=False,
                    floating_point_range=[],
                    integer_range=[],
                )
                for name in request.names
            ]
        }

    def _list(self, request: Any) -> dict[str, Any]:
        prefixes, depth = list(request.prefixes), int(request.depth)
        names = [
            name
            for name in self._parameters.names
            if (not prefixes or any(name == p or name.startswith(f"{p}.") for p in prefixes))
            and (depth == 0 or name.count(".") < depth)
        ]
        found = sorted({name.rpartition(".")[0] for name in names})
        make = self._types.make
        return {"result": make("rcl_interfaces/ListParametersResult", names=names, prefixes=found)}

    def _value(self, name: str) -> Any:
        """Return the value of a parameter as a message; not set if it is not known."""
        number, value = 0, None
        try:
            number, value = _typed(self._parameters.value(name))
        except (CdffError, LookupError) as error:
            logger.warning("parameter %s: %r", name, error)
        empty: dict[str, Any] = {
            "bool_value": False,
            "integer_value": 0,
            "double_value": 0.0,
            "string_value": "",
            "byte_array_value": np.zeros(0, np.uint8),
            "bool_array_value": np.zeros(0, bool),
            "integer_array_value": np.zeros(0, np.int64),
            "double_array_value": np.zeros(0),
            "string_array_value": [],
        }
        if number:
            empty[_MEMBERS[number]] = value
        return self._types.make("rcl_interfaces/ParameterValue", type=number, **empty)

    def _set(self, parameters: list[Any]) -> Any:
        """Set parameters of one DFPC, all or none; return the result."""
        is_set, reason = False, ""
        self.counters.receive(0)
        try:
            self._parameters.set({p.name: _plain(p.value, p.name) for p in parameters})
            is_set = True
            self.counters.forward(0.0)
        except (CdffError, LookupError) as error:
            reason = str(error)
            self.counters.drop("refused", reason)
        make = self._types.make
        return make("rcl_interfaces/SetParametersResult", successful=is_set, reason=reason[:1000])


def _check_size(request: Any) -> None:
    """Raise InputError if a request names too many parameters."""
    for field in ("names", "parameters", "prefixes"):
        count = len(getattr(request, field, ()))
        if count > _MAX_NAMES:
            raise InputError(f"{count} {field}: expected at most {_MAX_NAMES} in a request")


def _typed(value: Any) -> tuple[int, Any]:
    """Return the type of a value in ``ParameterType``, and the value as its member."""
    scalars = {bool: 1, int: 2, float: 3, str: 4}
    if type(value) in scalars:
        return scalars[type(value)], value
    if isinstance(value, list) and value:
        kinds = {type(v) for v in value}
        if kinds <= {int, float}:
            kind = float if float in kinds else int
            return scalars[kind] + _ARRAY_OFFSET, np.array(value, kind)
        if kinds == {bool}:
            return scalars[bool] + _ARRAY_OFFSET, np.array(value, bool)
        if kinds == {str}:
            return scalars[str] + _ARRAY_OFFSET, list(value)
    return 0, None


def _plain(value: Any, name: str) -> Any:
    """Return a ``ParameterValue`` as plain data."""
    number = int(value.type)
    if not 0 < number < len(_MEMBERS):
        raise InputError(f"{name}: type {number}, expected a value")
    content = getattr(value, _MEMBERS[number])
    if isinstance(content, np.ndarray):
        return content.tolist()
    return list(content) if isinstance(content, list) else content
