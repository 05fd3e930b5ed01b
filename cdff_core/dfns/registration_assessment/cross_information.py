# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assessment of an alignment by the structure that both clouds have in common."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.kdtree import kd_tree, nearest, spacing
from cdff_common.geometry.points import checked_points, checked_transform
from cdff_common.geometry.robust import median_sigma
from cdff_common.geometry.voxels import voxel_rows
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.registration_assessment.interface import Inputs, Interface, Outputs

#: Least number of points of each cloud.
_MIN_PAIRS = 20
#: Least number of points from which the median spacing is computed.
_SPACING_SAMPLE = 2000
#: Lower bound of the agreement in the information of the common structure (resolution error).
_MIN_AGREEMENT = 0.05


class CrossInformationConfig(DfnConfig):
    """Parameters of CrossInformation."""

    gate_m: float | None = Field(
        None, gt=0, description="Distance below which points overlap; absent: from gate_spacings"
    )
    gate_spacings: float = Field(2.5, ge=1, le=50, description="Gate in point spacings of the sparser cloud")
    tukey: float = Field(
        3.0, ge=1, le=10, description="Width of the Tukey kernel in robust standard deviations"
    )
    cell_gates: float = Field(
        4.0, ge=1, le=100, description="Edge of a cell whose residuals count as one measurement, in gates"
    )
    covariance_inflation: float = Field(
        4.0, ge=0.01, le=1e4, description="Factor on the variance of translations"
    )
    rotation_inflation: float = Field(4.0, ge=0.01, le=1e4, description="Factor on the variance of rotations")
    floor_spacings: float = Field(
        0.02, ge=0, le=1, description="Lower bound of the standard deviations, in point spacings"
    )


class CrossInformation(Interface[CrossInformationConfig]):
    """Compute the overlap in both directions, a clustered covariance, and the agreement of the two clouds
    along each direction of the pose.

    Notes
    -----
    The information of point-to-plane pairs is ``H = E[J J^T]``, ``J = [n, (p-c)/r x n]``. On flat terrain
    the noise of the normals appears as information along the unconstrained directions. The noise of the two
    clouds is independent, so it does not contribute to the cross-information ``X = E[J_target J_source^T]``,
    in which each Jacobian has the normals of its cloud. Along an eigenvector v of H the ratio ``v^T X v / v^T
    H v`` is near 1 for structure in both clouds, near 0 for an unconstrained direction or a wrong alignment.
    The covariance is the sandwich ``H^-1 B H^-1`` with B summed over cells, since neighbouring residuals are
    not independent (Liang and Zeger 1986, doi:10.1093/biomet/73.1.13). It is inflated by one factor for
    translations of the centre and one for rotations about it.

    The sandwich does not contain errors that are common to all cells, those of planes and distributions
    fitted to few points. If the result with fewer points is given, its difference d estimates them: with n
    times fewer points a sampling error is ``1 / sqrt(n - 1)`` times the difference (variances of nested
    estimates: Hausman 1978, doi:10.2307/1913827), an error proportional to the spacing ``1 / (sqrt(n) - 1)``
    times. For n = 3 these are 0.7 and 1.4; the factor is 1. The variance ``d^T M d / 6`` of one component in
    the metric M of the common structure is distributed over all directions as ``M^-1``, because one
    difference is no estimate of the direction of the error.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the assessment; raises InputError, or RefusedError (``no_overlap``) if too few points
        overlap.
        """
        cfg = self.config
        target = checked_points(inputs.target, "target", _MIN_PAIRS)
        target_normals = checked_points(inputs.target_normals, "target_normals", len(target))
        T = checked_transform(inputs.transform)
        source = se3.transform_points(T, checked_points(inputs.source, "source", _MIN_PAIRS))
        source_normals = checked_points(inputs.source_normals, "source_normals", len(source)) @ T[:3, :3].T
        target_tree, source_tree = kd_tree(target), kd_tree(source)
        spacing_m = max(spacing(tree, _SPACING_SAMPLE) for tree in (target_tree, source_tree))
        gate_m = cfg.gate_m or cfg.gate_spacings * spacing_m
        distance_m, match = nearest(target_tree, source, gate_m)
        target_distance_m, _ = nearest(source_tree, target, gate_m)
        paired = np.isfinite(distance_m)
        if np.count_nonzero(paired) < _MIN_PAIRS:
            raise RefusedError(
                f"{np.count_nonzero(paired)} of {len(source)} points overlap within {gate_m:.3g} m",
                ["no_overlap"],
            )
        p, match = source[paired], match[paired]
        n_target, n_source = target_normals[match], source_normals[paired]
        n_source = n_source * np.where(np.einsum("ij,ij->i", n_source, n_target) < 0.0, -1.0, 1.0)[:, None]
        residual_m = np.einsum("ij,ij->i", p - target[match], n_target)
        weight = _tukey_weights(residual_m, cfg.tukey)
        centre = np.average(p, axis=0, weights=weight)
        offset = p - centre
        radius_m = max(float(np.sqrt(np.average(np.sum(offset**2, axis=1), weights=weight))), 1e-9)
        J_target, J_source = _jacobian(offset / radius_m, n_target), _jacobian(offset / radius_m, n_source)
        information, directions, agreement = _agreement(J_target, J_source, weight)
        covariance = _clustered_covariance(J_target, residual_m, weight, p, cfg.cell_gates * gate_m)
        floor_m2 = (cfg.floor_spacings * spacing_m) ** 2
        inflation = np.sqrt([cfg.covariance_inflation] * 3 + [cfg.rotation_inflation] * 3)
        covariance = covariance * np.outer(inflation, inflation) + floor_m2 * np.eye(6)
        if inputs.coarser_transform is not None:
            change = _change(checked_transform(inputs.coarser_transform), T, centre, radius_m)
            constraint = information * np.clip(agreement, _MIN_AGREEMENT, 1.0)
            covariance += _resolution_covariance(change, constraint, directions)
        return Outputs(
            covariance=_about_origin(covariance, centre, radius_m, T),
            overlap_source=float(np.mean(paired)),
            overlap_target=float(np.mean(np.isfinite(target_distance_m))),
            inlier_ratio=float(np.mean(weight > 0.0)),
            rms_m=float(np.sqrt(np.average(residual_m**2, weights=weight))),
            gate_m=gate_m,
            centre_m=centre,
            radius_m=radius_m,
            information=information,
            agreement=agreement,
            directions=directions,
        )


def _tukey_weights(residual_m: FloatArray, constant: float) -> FloatArray:
    """Return Tukey weights for a kernel of ``constant`` robust standard deviations."""
    scale_m = max(median_sigma(residual_m), 1e-9)
    u = residual_m / (constant * scale_m)
    return np.where(np.abs(u) < 1.0, (1.0 - u * u) ** 2, 0.0)


def _jacobian(offset: FloatArray, normals: FloatArray) -> FloatArray:
    """Return rows ``[n, offset x n]`` (n, 6): derivatives with respect to translation and rotation."""
    return np.hstack([normals, np.cross(offset, normals)])


def _agreement(
    J_target: FloatArray, J_source: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the eigenvalues of the information, its eigenvectors as rows, and the agreement of both clouds
    along them.
    """
    w = (weight / weight.sum())[:, None]
    mean = 0.5 * ((J_target * w).T @ J_target + (J_source * w).T @ J_source)
    cross = (J_target * w).T @ J_source
    information, vectors = np.linalg.eigh(mean)
    information = np.maximum(information, 1e-12)
    agreement = np.einsum("ij,ik,kj->j", vectors, cross, vectors) / information
    return information, np.ascontiguousarray(vectors.T), agreement


def _clustered_covariance(
    J: FloatArray, residual_m: FloatArray, weight: FloatArray, points: FloatArray, cell_m: float
) -> FloatArray:
    """Return the sandwich covariance (6, 6) about the centre, rotations in radii, square metres."""
    H = (J * weight[:, None]).T @ J
    cell, _ = voxel_rows(points, cell_m)
    score = J * (weight * residual_m)[:, None]
    by_cell = np.stack([np.bincount(cell, weights=score[:, column]) for column in range(6)], axis=1)
    H_inverse = np.linalg.inv(H + 1e-9 * np.trace(H) * np.eye(6))
    return np.asarray(H_inverse @ (by_cell.T @ by_cell) @ H_inverse)


def _change(
    T_target_source_other: FloatArray, T_target_source: FloatArray, centre: FloatArray, radius_m: float
) -> FloatArray:
    """Return the motion (6,) from a transform to another one, metres: translation of the centre, and rotation
    about it times the radius.
    """
    motion = T_target_source_other @ se3.inverse(T_target_source)
    translation_m = motion[:3, :3] @ centre + motion[:3, 3] - centre
    return np.concatenate([translation_m, radius_m * se3.log_so3(motion[:3, :3])])


def _resolution_covariance(change: FloatArray, constraint: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) for which ``change`` (6,) is a typical error.

    ``constraint`` (6,) is the information of the common structure along the rows of ``directions`` (6, 6).
    """
    variance_m2 = np.sum(constraint * (directions @ change) ** 2) / len(change)
    return np.asarray((directions.T / constraint) @ directions * variance_m2)


def _about_origin(
    covariance: FloatArray, centre: FloatArray, radius_m: float, T_target_source: FloatArray
) -> FloatArray:
    """Return the covariance of the transform, given that of a motion about the centre with rotations in
    radii.

    A translation d and a rotation phi about c change the translation t by ``d + phi x (t - c)``.
    """
    S = np.diag([1.0, 1.0, 1.0, 1.0 / radius_m, 1.0 / radius_m, 1.0 / radius_m])
    A = np.eye(6)
    A[:3, 3:] = -se3.skew(T_target_source[:3, 3] - centre)
    about_origin = A @ S @ covariance @ S @ A.T
    return np.asarray(0.5 * (about_origin + about_origin.T))
