# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Field types that several models of a scenario share: bounded numbers, vectors and mounts."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cdff_common.geometry import se3
from cdff_common.geometry.rotation_forms import matrix_from_rpy_deg
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Vector3 = tuple[float, float, float]


class Mount(StrictModel):
    """Pose ``T_base_sensor`` of a sensor.

    An unrotated sensor frame has the axes of the base (x forward, z up).
    """

    xyz_m: Vector3
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)

    def matrix(self) -> FloatArray:
        """Return ``T_base_sensor``, shape (4, 4); roll, pitch and yaw are about the fixed axes x, y and z."""
        return se3.transform(matrix_from_rpy_deg(self.rpy_deg), self.xyz_m)
