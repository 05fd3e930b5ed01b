# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rigid transformation of points."""

from __future__ import annotations

from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_transformation.interface import Inputs, Interface, Outputs


class CartesianSystemTransform(Interface[DfnConfig]):
    """Transform each point by ``p_a = T_a_b p_b``."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the points in frame a; raises InputError if the points or the transform are malformed."""
        T_a_b = checked_transform(inputs.transform)
        return Outputs(
            transformed_points=se3.transform_points(T_a_b, checked_points(inputs.points, finite=False))
        )
