# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Whether an alignment can be stood for: gates on what the assessment found, and names of weak directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.interfaces.product import CovarianceKind, Quality, Status

if TYPE_CHECKING:
    from cdff_core.dfns.registration_assessment._interface import RegistrationAssessmentOutputs
    from cdff_core.dfpcs.icp_localisation.compound import IcpLocalisationConfig

_AXES = "xyz"
_MOSTLY = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """A candidate pose with the judgement on it.

    Attributes
    ----------
    T_scene_model : ndarray, shape (4, 4)
    assessment : RegistrationAssessmentOutputs
        On the finest level reached.
    residual_scale_m : float
        Robust standard deviation of the residuals there.
    iterations : int
        Over all levels.
    converged : bool
        On the finest level reached.
    jump : float
        Largest displacement between two levels, in gates of the coarser one.
    """

    T_scene_model: NDArray[np.float64]
    assessment: RegistrationAssessmentOutputs
    residual_scale_m: float
    iterations: int
    converged: bool
    jump: float


def judged(found: Alignment, cfg: IcpLocalisationConfig, kind: CovarianceKind) -> Quality:
    """Return FAILED, DEGRADED or OK with the reasons, the measurements they rest on, and the covariance's kind."""
    a = found.assessment
    overlap = max(float(a.overlap_source), float(a.overlap_target))
    failed, degraded = [], []
    if overlap < cfg.min_overlap:
        failed.append(f"low_overlap:{overlap:.2f}<{cfg.min_overlap:g}")
    elif overlap < cfg.good_overlap:
        degraded.append(f"low_overlap:{overlap:.2f}<{cfg.good_overlap:g}")
    if float(a.inlier_ratio) < cfg.min_inlier_ratio:
        failed.append(f"few_inliers:{float(a.inlier_ratio):.2f}<{cfg.min_inlier_ratio:g}")
    rms_gates = float(a.rms_m) / float(a.gate_m)
    if rms_gates > cfg.max_rms_gates:
        failed.append(f"large_residuals:{float(a.rms_m):.3g}m")
    if found.jump > cfg.max_jump_gates:
        failed.append(f"levels_disagree:{found.jump:.1f}>{cfg.max_jump_gates:g}")
    is_free = a.agreement < cfg.min_agreement
    is_weak = (a.agreement < cfg.good_agreement) & ~is_free
    failed += [f"degenerate:{name}" for name in direction_names(a.directions[is_free])]
    degraded += [f"weak:{name}" for name in direction_names(a.directions[is_weak])]
    if not found.converged:
        degraded.append("not_converged")
    status = Status.FAILED if failed else Status.DEGRADED if degraded else Status.OK
    return Quality(status, tuple(failed + degraded), CovarianceKind.NONE if failed else kind, _metrics(found))


def _metrics(found: Alignment) -> dict[str, float]:
    a = found.assessment
    return {
        "overlap_model": float(a.overlap_source),
        "overlap_scene": float(a.overlap_target),
        "inlier_ratio": float(a.inlier_ratio),
        "rms_m": float(a.rms_m),
        "gate_m": float(a.gate_m),
        "iterations": float(found.iterations),
        "condition_number": float(a.information[-1] / a.information[0]),
        "least_information": float(a.information[0]),
        "least_agreement": float(a.agreement.min()),
        "level_jump_gates": found.jump,
        "overlap_radius_m": float(a.radius_m),
    } | {f"overlap_{axis}_m": float(value) for axis, value in zip(_AXES, a.centre_m, strict=True)}


def direction_names(directions: NDArray[np.float64]) -> list[str]:
    """Names of directions that span the same space as the rows ``(k, 6)``, along the scene's axes where it has them.

    Eigenvectors of nearly equal eigenvalues are any basis of their space: flat ground is free in x, y and the turn
    about z, and is said to be, whatever mixture of the three the solver returned.
    """
    projector = directions.T @ directions
    names = []
    for kind, block in (("translation", projector[:3, :3]), ("rotation", projector[3:, 3:])):
        share, vectors = np.linalg.eigh(block)
        axes = [axis for axis in range(3) if block[axis, axis] >= _MOSTLY**2]
        if len(axes) == np.count_nonzero(share > 0.5):
            names += [f"{kind}_{_AXES[axis]}" for axis in axes]
        else:
            names += [f"{kind}{_components(vector)}" for vector in vectors.T[share > 0.5]]
    return names or [direction_name(direction) for direction in directions]


def direction_name(direction: NDArray[np.float64]) -> str:
    """``translation_x``, ``rotation_z``, or with its components where it lies along no axis of the scene's frame."""
    shift, turn = direction[:3], direction[3:]
    kind, part = ("translation", shift) if np.linalg.norm(shift) >= np.linalg.norm(turn) else ("rotation", turn)
    unit = part / max(float(np.linalg.norm(part)), 1e-12)
    axis = int(np.argmax(np.abs(unit)))
    if abs(unit[axis]) >= _MOSTLY:
        return f"{kind}_{_AXES[axis]}"
    return f"{kind}{_components(unit)}"


def _components(unit: NDArray[np.float64]) -> str:
    x, y, z = unit * np.sign(unit[np.argmax(np.abs(unit))])
    return f"({x:.2f},{y:.2f},{z:.2f})"


def displacement_m(
    T_first: NDArray[np.float64], T_second: NDArray[np.float64], centre_m: NDArray[np.float64], radius_m: float
) -> float:
    """How far points within ``radius_m`` of ``centre_m``, where the first puts them, lie from where the second does."""
    change = T_second @ se3.inverse(T_first)
    shift = change[:3, :3] @ centre_m + change[:3, 3] - centre_m
    return float(np.linalg.norm(shift) + radius_m * se3.rotation_angle(change[:3, :3]))


def displaced(
    T: NDArray[np.float64],
    direction: NDArray[np.float64],
    distance_m: float,
    centre_m: NDArray[np.float64],
    radius_m: float,
) -> NDArray[np.float64]:
    """Move a transform along a direction of the pose about a centre; rotations are in units of the radius."""
    x = direction * distance_m
    R = se3.exp_so3(x[3:] / radius_m)
    return se3.transform(R, x[:3] + centre_m - R @ centre_m) @ T
