# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Removal of points that are too near, too far, or on the robot itself."""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_filtering.interface import Inputs, Interface, Outputs

#: Points that are farther than this from the median point are no measurements.
_LARGEST_EXTENT_M = 1e6


class RangeFilterConfig(DfnConfig):
    """Parameters of RangeFilter."""

    min_range_m: float = Field(0.0, ge=0, description="Minimum range of the remaining points")
    max_range_m: float | None = Field(
        None, gt=0, description="Maximum range of the remaining points; absent: 1000 km from the median point"
    )
    self_mask_m: tuple[float, float, float, float, float, float] | None = Field(
        None,
        description=(
            "Box (xmin ymin zmin xmax ymax zmax) of the robot in the frame of the points; points inside "
            "are removed"
        ),
    )

    @model_validator(mode="after")
    def _in_order(self) -> RangeFilterConfig:
        if self.max_range_m is not None and self.min_range_m >= self.max_range_m:
            raise ValueError(f"min_range_m {self.min_range_m}: expected below max_range_m {self.max_range_m}")
        box = self.self_mask_m
        if box is not None and any(low >= high for low, high in zip(box[:3], box[3:], strict=True)):
            raise ValueError(f"self_mask_m {box}: expected each minimum below its maximum")
        return self


class RangeFilter(Interface[RangeFilterConfig]):
    """Remove points that are not finite, outside the limits of the range from the origin, or inside the
    robot's box.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the remaining points; raises InputError if none remains."""
        p = checked_points(inputs.points, finite=False)
        with np.errstate(invalid="ignore", over="ignore"):
            range_m = np.sqrt(np.einsum("ij,ij->i", p, p))
            is_valid = (range_m >= self.config.min_range_m) & np.isfinite(range_m)
            is_valid &= self._is_near(p, range_m)
            if self.config.self_mask_m is not None:
                low, high = np.array(self.config.self_mask_m[:3]), np.array(self.config.self_mask_m[3:])
                is_valid &= ~np.all((p >= low) & (p <= high), axis=1)
        kept_rows = np.flatnonzero(is_valid)
        if not len(kept_rows):
            raise InputError(f"points: none of {len(p)} is finite and within the limits {self.config}")
        points = p if len(kept_rows) == len(p) else p[kept_rows]
        return Outputs(filtered_points=points, kept=kept_rows.astype(np.int64, copy=False))

    def _is_near(self, points_m: FloatArray, range_m: FloatArray) -> BoolArray:
        """Return which points are within the largest range, without one within the extent of a real cloud.

        The origin of a cloud may be far away, as in map projections; wrong points are far from the others.
        """
        if self.config.max_range_m is not None:
            return np.asarray(range_m <= self.config.max_range_m)
        if not np.any(range_m > _LARGEST_EXTENT_M):
            return np.ones(len(range_m), np.bool_)
        median_m = np.median(points_m[np.isfinite(range_m)], axis=0)
        return np.asarray(np.linalg.norm(points_m - median_m, axis=1) <= _LARGEST_EXTENT_M)
