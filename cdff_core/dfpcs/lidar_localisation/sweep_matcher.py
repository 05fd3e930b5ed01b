# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of a sweep with the local map, its quality and covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Quality, Status
from cdff_core.cloud_matching.acceptance import registration_quality
from cdff_core.cloud_matching.matcher import Registration, refine_and_assess
from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
from cdff_core.dfns.point_cloud_downsampling.interface import PointCloudDownsamplingInputs
from cdff_core.dfns.registration_3d.interface import Registration3DInputs
from cdff_core.dfpcs.lidar_localisation.surface import Surface, joint_roughness_m

if TYPE_CHECKING:
    from cdff_common.interfaces.dfpc import Dfpc
    from cdff_core.dfpcs.lidar_localisation.configuration import LidarLocalisationConfig
    from cdff_core.dfpcs.lidar_localisation.tiled_map import LocalMap


#: Largest RMS residual of an accepted registration, and largest residual scale of a coarse registration,
#: relative to the joint roughness of sweep and map. At the correct pose, the points of the sweep are nearer
#: to the planes of the map than neighbouring points of the map are to each other's planes.
_MAX_ROUGHNESSES, _MAX_COARSE_ROUGHNESSES = 1.0, 0.5
#: Standard deviation along degenerate directions, metres.
_DEGENERATE_SIGMA_M = 10.0
#: Prefixes of reasons that make a match DEGRADED at most.
_DEGRADED = ("weak:", "not_converged")


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Points of a sweep in the base's frame at the end of the sweep."""

    all_points_m: se3.FloatArray  # (m, 3), all points within range
    fine: Surface  # thinned for the fine registration
    coarse: Surface  # thinned for the coarse registration


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """A registration with its quality; ``registration`` is None if the registration failed."""

    registration: Registration | None
    quality: Quality

    @property
    def accepted(self) -> Registration | None:
        """The registration; None if the quality is FAILED."""
        return None if self.quality.status is Status.FAILED else self.registration


class SweepMatcher:
    """Registers sweeps by the DFNs thin_scan, thin_coarse, normals, register_coarse, refine and assess."""

    def __init__(self, dfpc: Dfpc, config: LidarLocalisationConfig) -> None:
        self._config, self._covariance_kind = config, dfpc.covariance_kind
        self._thin, self._thin_coarse = dfpc.dfn("thin_scan"), dfpc.dfn("thin_coarse")
        self._normals, self._coarse = dfpc.dfn("normals"), dfpc.dfn("register_coarse")
        self._refine, self._assess = dfpc.dfn("refine"), dfpc.dfn("assess")

    def normals(self, points_m: se3.FloatArray) -> se3.FloatArray:
        """Return the normals ``(n, 3)`` of points."""
        normals: se3.FloatArray = self._normals.process(NormalsEstimationInputs(points=points_m)).normals
        return normals

    def thin_coarse(self, points_m: se3.FloatArray) -> se3.FloatArray:
        """Return points thinned for the coarse registration."""
        points: se3.FloatArray = self._thin_coarse.process(
            PointCloudDownsamplingInputs(points=points_m)
        ).points
        return points

    def prepare(self, points_m: se3.FloatArray) -> Sweep:
        """Return a sweep, given as points (n, 3), thinned for the coarse and the fine registration."""
        points = self._thin.process(PointCloudDownsamplingInputs(points=points_m)).points
        return Sweep(points_m, Surface(points, self.normals), Surface(self.thin_coarse(points), self.normals))

    def register(
        self, sweep: Sweep, local: LocalMap, T_map_base: se3.FloatArray, *, allow_degenerate: bool
    ) -> Match:
        """Run PointcloudMatcher.doICP from a nearly correct pose.

        With ``allow_degenerate``, degenerate directions are accepted, since a prediction constrains them.
        """
        try:
            registration = refine_and_assess(
                self._refine,
                self._assess,
                sweep.fine,
                local,
                T_map_base,
                metrics={},  # no features are matched
                coarser=(sweep.fine.coarser, local.coarser),
            )
        except RefusedError as error:
            return Match(None, Quality.from_error(error))
        limit_m = _MAX_ROUGHNESSES * self._roughness_m(sweep.fine, local)
        return Match(registration, self._quality(registration, limit_m, allow_degenerate=allow_degenerate))

    def register_coarse(self, sweep: Sweep, local: LocalMap, T_map_base: se3.FloatArray) -> se3.FloatArray:
        """Return the pose ``(4, 4)`` of the coarse registration from a pose metres and tens of degrees away.

        Raises RefusedError if sweep and map do not match in that pose.
        """
        step = self._coarse.process(
            Registration3DInputs(
                source=sweep.coarse.points_m,
                target=local.coarse.points_m,
                target_normals=local.coarse.normals,
                guess=T_map_base,
            )
        )
        limit_m = _MAX_COARSE_ROUGHNESSES * self._roughness_m(sweep.coarse, local.coarse)
        if step.residual_scale_m > limit_m:
            reason = f"large_residuals:{step.residual_scale_m:.3g}m>{limit_m:.3g}m"
            raise RefusedError(f"coarse registration of sweep and map: {reason}", [reason])
        T_coarse: se3.FloatArray = step.transform
        return T_coarse

    def register_coarse_to_fine(
        self, sweep: Sweep, local: LocalMap, T_map_base: se3.FloatArray, *, allow_degenerate: bool
    ) -> Match:
        """Run PointcloudMatcher.doICP from coarse to fine: ``register_coarse``, then ``register``."""
        try:
            T_coarse = self.register_coarse(sweep, local, T_map_base)
        except RefusedError as error:
            return Match(None, Quality.from_error(error))
        return self.register(sweep, local, T_coarse, allow_degenerate=allow_degenerate)

    def pose(self, registration: Registration) -> UncertainTransform:
        """Return ``T_map_base`` with covariance, large along degenerate directions."""
        cfg, a, T = self._config, registration.assessment, registration.T_target_source
        tilt, yaw = np.radians([cfg.map_sigma_tilt_deg, cfg.map_sigma_yaw_deg])
        map_sigma = np.array([cfg.map_sigma_xy_m, cfg.map_sigma_xy_m, cfg.map_sigma_z_m, tilt, tilt, yaw])
        C = a.covariance + np.diag(map_sigma**2)
        for direction in a.directions[a.agreement < cfg.min_agreement]:
            # Convert translation and rotation about the centre of the overlap to a change of the pose.
            rotation = direction[3:] / a.radius_m
            change = np.concatenate([direction[:3] + np.cross(rotation, T[:3, 3] - a.centre_m), rotation])
            C = C + _DEGENERATE_SIGMA_M**2 * np.outer(change, change)
        return UncertainTransform(T, C)

    def _roughness_m(self, sweep: Surface, local: Surface) -> float:
        return joint_roughness_m(sweep, local, self._config.range_resolution_m)

    def _quality(self, registration: Registration, limit_m: float, *, allow_degenerate: bool) -> Quality:
        """Return the quality from the shared gates and the largest RMS residual ``limit_m``, metres.

        With ``allow_degenerate``, degenerate directions are accepted.
        """
        cfg = self._config
        quality = registration_quality(registration, registration.assessment.overlap_source, cfg)
        allowed = (*_DEGRADED, "degenerate:") if allow_degenerate else _DEGRADED
        is_failed = quality.status is Status.FAILED
        failed = [r for r in quality.reasons if is_failed and not r.startswith(allowed)]
        residual_m = registration.assessment.rms_m
        if residual_m > limit_m:
            failed.append(f"large_residuals:{residual_m:.3g}m>{limit_m:.3g}m")
        others = tuple(r for r in quality.reasons if r not in failed)
        step = registration.step
        metrics = {
            "residual_scale_m": step.residual_scale_m,
            "iterations": step.iterations,
            **quality.metrics,
        }
        return Quality.from_reasons(others, self._covariance_kind, metrics, failed=failed)
