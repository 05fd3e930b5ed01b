# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway to ROS 1."""

from __future__ import annotations

from pydantic import model_validator

from services.gateways.request_types import ACTIONS
from services.gateways.settings import GatewaySettings
from services.ros_messages.mapping import mapping_table


class Ros1Settings(GatewaySettings):
    """Settings of the gateway to a robot with ROS 1."""

    @model_validator(mode="after")
    def _has_no_actions(self) -> Ros1Settings:
        actions = [entry.type for entry in self.requests if entry.type in ACTIONS]
        if actions:
            raise ValueError(f"{actions[0]}: the gateway to ROS 1 has services only")
        return self

    @model_validator(mode="after")
    def _has_messages_of_ros_1(self) -> Ros1Settings:
        types = {entry.type for entry in self.inputs} | {entry.type for entry in self.outputs}
        missing = sorted(types & mapping_table().only_in(2))
        if missing:
            raise ValueError(f"{missing[0]}: exists in ROS 2 only; expected another type")
        return self
