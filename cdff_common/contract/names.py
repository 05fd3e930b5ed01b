# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scopes, and the patterns of ids and names, unanchored."""

from __future__ import annotations

from typing import Literal

#: Scope of the services that serve every robot.
GROUND = "ground"
#: Value of ``robot=`` for every robot.
ANY_ROBOT = "any"
#: Scopes that cannot be a robot id.
RESERVED_SCOPES = frozenset({GROUND, ANY_ROBOT})

#: Services that connect the robots of other frameworks.
GatewayName = Literal[
    "gateway_ccsds", "gateway_dds", "gateway_ros1", "gateway_ros2", "gateway_rock", "gateway_yarp"
]

#: Names in a profile: robots, sensors, streams, modes, bodies.
NAME = r"[a-z][a-z0-9_]{0,63}"
ROBOT_ID = NAME
#: Names in a key and of a stored product: DFPCs, ports, product types.
KEY_NAME = r"[a-z0-9_]{1,64}"
FRAME_ID = r"[a-z0-9_]+(/[a-z0-9_]+)*"
MAX_FRAME_LENGTH = 128
#: Name that a requester gives its request.
REQUEST_ID = r"[A-Za-z0-9_.-]{1,64}"
PRODUCT_ID = r"[0-9a-f-]{36}"
