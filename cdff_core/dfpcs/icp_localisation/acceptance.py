# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quality of an alignment, and names of its degenerate directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_core.cloud_matching.acceptance import gate_reasons

if TYPE_CHECKING:
    from cdff_core.dfns.registration_assessment.interface import RegistrationAssessmentOutputs
    from cdff_core.dfpcs.icp_localisation.configuration import IcpLocalisationConfig

Float = NDArray[np.float64]

_AXES = "xyz"
#: Largest jump between two levels, in overlap gates of the coarser one.
_MAX_JUMP_GATES = 1.0
#: Cosine from which a direction is named after an axis.
_ALONG_AXIS = 0.85


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
    } | {f"overlap_{axis}_m": float(value) for axis, value in zip(_AXES, a.centre_m, strict=True)}


def direction_names(directions: Float) -> list[str]:
    """Return names of directions that span the same space as the rows ``(k, 6)``, along axes where possible.

    Eigenvectors of nearly equal eigenvalues are an arbitrary basis of their space: on flat ground the names
    are x, y and the rotation about z, even if each row is a mixture of the three.
    """
    projector = directions.T @ directions
    names = []
    for kind, block in (("translation", projector[:3, :3]), ("rotation", projector[3:, 3:])):
        ratios, vectors = np.linalg.eigh(block)
        axes = [axis for axis in range(3) if block[axis, axis] >= _ALONG_AXIS**2]
        if len(axes) == np.count_nonzero(ratios > 0.5):
            names += [f"{kind}_{_AXES[axis]}" for axis in axes]
        else:
            names += [f"{kind}{_components(vector)}" for vector in vectors.T[ratios > 0.5]]
    return names or [direction_name(direction) for direction in directions]


def direction_name(direction: Float) -> str:
    """Return ``translation_x``, ``rotation_z``, … or, if the direction is along no axis, its components."""
    translation, rotation = direction[:3], direction[3:]
    is_translation = np.linalg.norm(translation) >= np.linalg.norm(rotation)
    kind, vector = ("translation", translation) if is_translation else ("rotation", rotation)
    unit = vector / max(float(np.linalg.norm(vector)), 1e-12)
    axis = int(np.argmax(np.abs(unit)))
    along_axis = abs(unit[axis]) >= _ALONG_AXIS
    return f"{kind}_{_AXES[axis]}" if along_axis else f"{kind}{_components(unit)}"


def _components(unit: Float) -> str:
    x, y, z = unit * np.sign(unit[np.argmax(np.abs(unit))])
    return f"({x:.2f},{y:.2f},{z:.2f})"


def displace(T: Float, direction: Float, distance_m: float, centre_m: Float, radius_m: float) -> Float:
    """Return a transform displaced along a direction (6,): translation, and rotation about ``centre_m`` (3,).

    Rotations are in units of metres at the distance ``radius_m`` from the centre.
    """
    step_m = direction * distance_m
    R = se3.exp_so3(step_m[3:] / radius_m)
    return se3.transform(R, step_m[:3] + centre_m - R @ centre_m) @ T
