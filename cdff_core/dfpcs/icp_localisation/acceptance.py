# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quality of an alignment, and names of its degenerate directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.direction_names import direction_names
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_core.cloud_matching.acceptance import gate_reasons

if TYPE_CHECKING:
    from cdff_core.dfns.registration_assessment.interface import RegistrationAssessmentOutputs
    from cdff_core.dfpcs.icp_localisation.configuration import IcpLocalisationConfig

Float = NDArray[np.float64]

#: Largest jump between two levels, in overlap gates of the coarser one.
_MAX_JUMP_GATES = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """A candidate pose with its assessment on the finest level reached."""

    T_scene_model: Float  # (4, 4)
    assessment: RegistrationAssessmentOutputs
    residual_scale_m: float  # robust standard deviation of the residuals
    iterations: int  # over all levels
    converged: bool
    jump: float  # largest displacement between two levels, in overlap gates of the coarser one

    @property
    def overlap(self) -> float:
        """Larger of the overlaps of model and scene."""
        return max(self.assessment.overlap_source, self.assessment.overlap_target)

    @property
    def merit(self) -> float:
        """Score for the comparison of restarts: overlap times the least agreement."""
        return self.overlap * float(self.assessment.agreement.min())


def alignment_quality(alignment: Alignment, config: IcpLocalisationConfig, kind: CovarianceKind) -> Quality:
    """Return FAILED, DEGRADED or OK; ``kind`` is the covariance kind of an accepted alignment."""
    jump = alignment.jump
    failed, degraded = gate_reasons(
        alignment.assessment,
        alignment.overlap,
        config,
        alignment.converged,
        failed=[f"levels_disagree:{jump:.1f}>{_MAX_JUMP_GATES:g}"] if jump > _MAX_JUMP_GATES else (),
        direction_names=direction_names,
    )
    return Quality.from_reasons(degraded, kind, _metrics(alignment), failed=failed)


def _metrics(alignment: Alignment) -> dict[str, float]:
    """Return the quantities of an alignment as metrics of a product."""
    a = alignment.assessment
    return {
        "overlap_model": a.overlap_source,
        "overlap_scene": a.overlap_target,
        "inlier_ratio": a.inlier_ratio,
        "rms_m": a.rms_m,
        "gate_m": a.gate_m,
        "iterations": alignment.iterations,
        "condition_number": float(a.information[-1] / a.information[0]),
        "least_information": float(a.information[0]),
        "least_agreement": float(a.agreement.min()),
        "level_jump_gates": alignment.jump,
        "overlap_radius_m": a.radius_m,
    } | {f"overlap_{axis}_m": float(value) for axis, value in zip("xyz", a.centre_m, strict=True)}


def displace(T: Float, direction: Float, distance_m: float, centre_m: Float, radius_m: float) -> Float:
    """Return a transform displaced along a direction (6,): translation, and rotation about ``centre_m`` (3,).

    Rotations are in units of metres at the distance ``radius_m`` from the centre.
    """
    step_m = direction * distance_m
    R = se3.exp_so3(step_m[3:] / radius_m)
    return se3.transform(R, step_m[:3] + centre_m - R @ centre_m) @ T
