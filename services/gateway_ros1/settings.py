# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway to ROS 1."""

from __future__ import annotations

from pydantic import model_validator

from services.gateways.request_types import ACTIONS
from services.gateways.settings import GatewaySettings


class Ros1Settings(GatewaySettings):
    """Settings of the gateway to a robot with ROS 1.

    Attributes
    ----------
    clock : bool
        Publish the mission clock as ``/clock``, for nodes with ``use_sim_time``.
    """

    clock: bool = False

    @model_validator(mode="after")
    def _has_no_actions(self) -> Ros1Settings:
        actions = [entry.type for entry in self.requests if entry.type in ACTIONS]
        if actions:
            raise ValueError(f"{actions[0]}: the gateway to ROS 1 has services only")
        return self
