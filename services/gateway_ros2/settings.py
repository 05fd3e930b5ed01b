# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway to ROS 2."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from services.gateways.settings import GatewaySettings


class Ros2Settings(GatewaySettings):
    """Settings of the gateway to a robot with ROS 2.

    Attributes
    ----------
    domain : int
        ``ROS_DOMAIN_ID`` of the robot.
    """

    domain: Annotated[int, Field(ge=0, le=232)] = 0
