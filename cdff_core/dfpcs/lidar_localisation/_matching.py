# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A sweep against a local map: registration, assessment, judgement, covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_core.cloud_matching.acceptance import judged
from cdff_core.cloud_matching.matcher import Found, displacement_m
from cdff_core.dfns.normals_estimation._interface import NormalsEstimationInputs
from cdff_core.dfns.point_cloud_downsampling._interface import PointCloudDownsamplingInputs
from cdff_core.dfns.registration_3d._interface import Registration3DInputs
from cdff_core.dfns.registration_assessment._interface import RegistrationAssessmentInputs

if TYPE_CHECKING:
    from cdff_common.interfaces.dfpc import Dfpc
    from cdff_core.dfpcs.lidar_localisation._configuration import LidarLocalisationConfig
    from cdff_core.dfpcs.lidar_localisation._scan_map import LocalMap


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A sweep in the base's frame at its end.

    Attributes
    ----------
    whole_m : ndarray, shape (m, 3)
        As it came, within range.
    points_m, normals : ndarray, shape (n, 3)
        Thinned.
    coarse_m : ndarray, shape (k, 3)
        Thinned to be matched from afar.
    """

    whole_m: se3.FloatArray
    points_m: se3.FloatArray
    normals: se3.FloatArray
    coarse_m: se3.FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """A place on the map with the judgement on it; ``found`` is None where there was none to judge."""

    found: Found | None
    quality: Quality

    @property
    def is_good(self) -> bool:
        """Whether it can be stood for."""
        return self.found is not None and self.quality.status is not Status.FAILED


class SweepMatcher:
    """Runs the slots thin_scan, thin_coarse, normals, register_coarse, refine and assess.

    Parameters
    ----------
    dfpc : Dfpc
        Whose slots these are.
    config : LidarLocalisationConfig
    """

    def __init__(self, dfpc: Dfpc, config: LidarLocalisationConfig) -> None:
        self._config = config
        self._thin, self._thin_coarse = dfpc.dfn("thin_scan"), dfpc.dfn("thin_coarse")
        self._normals, self._coarse = dfpc.dfn("normals"), dfpc.dfn("register_coarse")
        self._refine, self._assess = dfpc.dfn("refine"), dfpc.dfn("assess")

    def normals(self, points_m: se3.FloatArray) -> se3.FloatArray:
        """Normals ``(n, 3)`` of points."""
        return self._normals.process(NormalsEstimationInputs(points_m)).normals

    def coarse(self, points_m: se3.FloatArray) -> se3.FloatArray:
        """Points thinned to be matched from afar."""
        return self._thin_coarse.process(PointCloudDownsamplingInputs(points_m)).points

    def sweep(self, points_m: se3.FloatArray) -> Sweep:
        """Thin a sweep to both levels."""
        points = self._thin.process(PointCloudDownsamplingInputs(points_m)).points
        return Sweep(points_m, points, self.normals(points), self.coarse(points))

    def near(self, sweep: Sweep, local: LocalMap, T: se3.FloatArray, *, may_be_free: bool) -> Match:
        """PointcloudMatcher.doICP from a pose that is nearly right; ``may_be_free`` where a prediction fills in."""
        try:
            step = self._refine.process(Registration3DInputs(sweep.points_m, local.points_m, local.normals, T))
            a = self._assess.process(
                RegistrationAssessmentInputs(
                    sweep.points_m, sweep.normals, local.points_m, local.normals, step.transform
                )
            )
        except (RefusedError, DegenerateGeometryError) as error:
            return Match(None, Quality(Status.FAILED, tuple(error.reasons)))
        moved_m = displacement_m(T, step.transform, a.centre_m, float(a.radius_m))
        metrics = {"residual_scale_m": float(step.residual_scale_m), "iterations": float(step.iterations)}
        found = Found(step.transform, a, bool(step.converged), moved_m, metrics)
        return Match(found, self._judged(found, may_be_free=may_be_free))

    def approached(self, sweep: Sweep, local: LocalMap, T: se3.FloatArray) -> se3.FloatArray:
        """Pose ``(4, 4)`` from metres and tens of degrees away, good to centimetres.

        Raises
        ------
        RefusedError
            If sweep and map do not fit where that ends.
        """
        step = self._coarse.process(Registration3DInputs(sweep.coarse_m, local.coarse_m, local.coarse_normals, T))
        residual_m, most_m = float(step.residual_scale_m), self._config.max_coarse_residual_m
        if residual_m > most_m:
            reason = f"large_residuals:{residual_m:.3g}m>{most_m:g}m"
            raise RefusedError(f"from afar sweep and map lie {residual_m:.3g} m apart", [reason])
        return step.transform

    def far(self, sweep: Sweep, local: LocalMap, T: se3.FloatArray, *, may_be_free: bool) -> Match:
        """``near`` after an approach from afar."""
        try:
            first = self.approached(sweep, local, T)
        except (RefusedError, DegenerateGeometryError) as error:
            return Match(None, Quality(Status.FAILED, tuple(error.reasons)))
        return self.near(sweep, local, first, may_be_free=may_be_free)

    def pose(self, found: Found) -> UncertainTransform:
        """``T_map_base`` with calibrated covariance, large along directions that the match leaves free."""
        cfg, a, T = self._config, found.assessment, found.T_target_source
        tilt, yaw = np.radians([cfg.map_sigma_tilt_deg, cfg.map_sigma_yaw_deg])
        of_map = np.array([cfg.map_sigma_xy_m, cfg.map_sigma_xy_m, cfg.map_sigma_z_m, tilt, tilt, yaw])
        C = cfg.covariance_scale * a.covariance + np.diag(of_map**2)
        for direction in a.directions[a.agreement < cfg.min_agreement]:
            # A shift and a turn about the middle of the overlap, as a change of translation and rotation.
            turn = direction[3:] / float(a.radius_m)
            v = np.concatenate([direction[:3] + np.cross(turn, T[:3, 3] - a.centre_m), turn])
            C = C + cfg.free_sigma_m**2 * np.outer(v, v)
        return UncertainTransform(T, C)

    def _judged(self, found: Found, *, may_be_free: bool) -> Quality:
        cfg = self._config
        quality = judged(found, float(found.assessment.overlap_source), cfg)
        failed = [r for r in quality.reasons if quality.status is Status.FAILED and not r.startswith(_MILD)]
        if may_be_free:
            failed = [r for r in failed if not r.startswith("degenerate:")]
        residual_m = float(found.assessment.rms_m)
        if residual_m > cfg.max_residual_m:
            failed.append(f"large_residuals:{residual_m:.3g}m>{cfg.max_residual_m:g}m")
        others = tuple(r for r in quality.reasons if r not in failed)
        status = Status.FAILED if failed else Status.DEGRADED if others else Status.OK
        kind = CovarianceKind.NONE if failed else CovarianceKind.CALIBRATED
        return Quality(status, (*failed, *others), kind, quality.metrics)


#: Reasons that make an answer DEGRADED at most.
_MILD = ("weak:", "not_converged")
