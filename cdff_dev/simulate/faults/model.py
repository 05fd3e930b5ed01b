# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Section ``faults`` of a scenario."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel
from cdff_dev.simulate.faults.camera import CameraFaults
from cdff_dev.simulate.faults.imu import ImuFaults
from cdff_dev.simulate.faults.lidar import LidarFaults
from cdff_dev.simulate.faults.solids import BodyPart, MovingObject
from cdff_dev.simulate.faults.timing import Timing
from cdff_dev.simulate.faults.wheels import WheelFaults


class Faults(StrictModel):
    """Faults of the sensors of a scenario; each is off unless its section is present.

    Frames, calibration and stamps in the log remain the stated ones: true values differ from them.
    """

    camera: CameraFaults | None = None
    lidar: LidarFaults | None = None
    wheels: WheelFaults | None = None
    imu: ImuFaults | None = None
    timing: Timing | None = None
    body: Annotated[
        tuple[BodyPart, ...] | None,
        Field(description="parts of the rover in view of camera and lidar, with their shadows"),
    ] = None
    objects: Annotated[
        tuple[MovingObject, ...] | None, Field(description="objects that move, with their shadows")
    ] = None
