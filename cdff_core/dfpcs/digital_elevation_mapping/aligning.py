# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A capture fitted to the local map, as far as its pose is uncertain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_registration._interface import DemRegistrationInputs
from cdff_core.dfpcs.digital_elevation_mapping.patch import Measurements


class Aligning:
    """Fits captures to the local map, and knows how certain the map as a whole is.

    All that fits the map has the map's error, which is that of the pose it began with: it grows with the distance from
    there by the tilt. To it come the fit's own variance and what fits before have added to the cells below.

    Parameters
    ----------
    registration : Dfn
        A DemRegistration.
    """

    def __init__(self, registration: Dfn[Any, Any, Any]) -> None:
        self._registration = registration
        self._anchor: tuple[str, NDArray[np.float64], NDArray[np.float64]] | None = None

    def aligned(self, measured: Measurements, local_map: ElevationMap | None) -> Measurements:
        """The measurements moved to where they fit the map, with what is left of their pose's uncertainty.

        They stay as they are where there is no map in their frame, their pose has no covariance, or the map says
        nothing; their variance never grows.
        """
        pose = measured.pose
        if pose is None or pose.covariance is None or not len(measured.points_m):
            return measured
        centre = pose.matrix[:3, 3]
        if self._anchor is None or self._anchor[0] != measured.frame:
            self._anchor = (measured.frame, centre, pose.covariance)
        if local_map is None or local_map.frame != measured.frame:
            return measured
        fit = self._registration.process(
            DemRegistrationInputs(
                points=measured.points_m, noise_variance=measured.noise_variance_m2, map=local_map, centre=centre,
                covariance=pose.covariance,
            )
        )  # fmt: skip
        if not int(fit.matched):
            return measured
        moved = se3.transform_points(fit.correction, measured.points_m)
        variance = self._of_anchor(moved) + _height_variance(moved - centre, fit.covariance)
        variance += self._of_map(moved, local_map)
        origin = None if measured.origin_m is None else se3.transform_points(fit.correction, measured.origin_m[None])[0]
        return replace(
            measured,
            points_m=moved,
            pose_variance_m2=np.fmin(measured.pose_variance_m2, variance),
            origin_m=origin,
            correction_m=float(np.linalg.norm(fit.correction[:3, :3] @ centre + fit.correction[:3, 3] - centre)),
        )

    def _of_anchor(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        _, centre, covariance = self._anchor or ("", np.zeros(3), np.zeros((6, 6)))
        return _height_variance(points - centre, covariance)

    def _of_map(self, points: NDArray[np.float64], local_map: ElevationMap) -> float:
        """Mean variance of the map below the points that the anchor does not explain, square metres."""
        row, col, inside = local_map.geometry.cells_of(points[:, 0], points[:, 1])
        below = local_map.layer("pose_variance")[row[inside], col[inside]] - self._of_anchor(points[inside])
        return max(float(np.nanmean(below)), 0.0) if np.isfinite(below).any() else 0.0


def _height_variance(arm: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a pose's covariance puts on the heights of points at a lever arm ``(n, 3)``, square metres."""
    J = np.column_stack([np.ones(len(arm)), arm[:, 1], -arm[:, 0]])
    return np.asarray(np.einsum("ni,ij,nj->n", J, covariance[2:5, 2:5], J))
