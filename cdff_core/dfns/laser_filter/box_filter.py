# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Removal of points inside or outside a box fixed to the body, such as points on the robot itself."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import LaserRangeErrors, RigidBodyState
from cdff_core.dfns.laser_filter._scan import check_beam_geometry, points_laser_m, replace_ranges
from cdff_core.dfns.laser_filter.interface import Inputs, Interface, Outputs

Coordinate = Annotated[float, Field(ge=-1000, le=1000)]
Corner = tuple[Coordinate, Coordinate, Coordinate]

#: Largest deviation of the norm of a quaternion from 1.
_UNIT_TOLERANCE = 1e-3


class BoxFilterConfig(DfnConfig):
    """Parameters of BoxFilter."""

    min_corner_m: Corner = Field((-0.5, -0.5, -0.5), description="Lower corner of the box in the body frame")
    max_corner_m: Corner = Field((0.5, 0.5, 0.5), description="Upper corner of the box in the body frame")
    remove: Literal["inside", "outside"] = Field(
        "inside",
        description=(
            "Points to remove: those inside the box or on its faces (the robot itself), or those outside"
        ),
    )

    @model_validator(mode="after")
    def _corners_in_order(self) -> BoxFilterConfig:
        if not all(low < high for low, high in zip(self.min_corner_m, self.max_corner_m, strict=True)):
            raise ValueError(
                f"box from {self.min_corner_m} to {self.max_corner_m}: expected min < max on every axis"
            )
        return self


class BoxFilter(Interface[BoxFilterConfig]):
    """Remove the points inside or outside a box along the body's axes."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the filtered scan.

        Raises
        ------
        InputError
            If the scan has no beam geometry, or the transform is not finite or its quaternion not of unit
            length.
        """
        scan = inputs.scan_samples
        check_beam_geometry(scan)
        points_m = se3.transform_points(_T_body_laser(inputs.laser_2_body_tf), points_laser_m(scan))
        inside = np.all(
            (points_m >= self.config.min_corner_m) & (points_m <= self.config.max_corner_m), axis=1
        )
        is_selected = inside if self.config.remove == "inside" else ~inside
        removed = is_selected & np.isfinite(points_m).all(axis=1)
        return Outputs(filtered_scans=replace_ranges(scan, removed, LaserRangeErrors.OTHER_RANGE_ERRORS))


def _T_body_laser(state: RigidBodyState) -> FloatArray:
    """Return the pose of the source frame (laser) of a state in its target frame (body), 4x4."""
    norm = float(np.linalg.norm(state.orient))
    if not np.isfinite(state.pos).all() or not abs(norm - 1) < _UNIT_TOLERANCE:
        raise InputError(
            f"laser_2_body_tf: position {state.pos.tolist()}, quaternion_xyzw {state.orient.tolist()}; "
            "expected finite numbers and a unit quaternion"
        )
    return se3.transform(se3.matrix_from_quaternion_xyzw(state.orient / norm), state.pos)
