# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RegistrationAssessment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RegistrationAssessmentInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,3)
        Source points, metres.
    source_normals : ndarray of float64, shape (n,3)
        Unit normals of the source.
    target : ndarray of float64, shape (m,3)
        Target points, metres.
    target_normals : ndarray of float64, shape (m,3)
        Unit normals of the target.
    transform : ndarray of float64, shape (4,4)
        T_target_source to assess.
    coarser_transform : ndarray of float64, shape (4,4), optional
        T_target_source from the same registration with about a third of the points; the difference from
        transform is added to the covariance as resolution error.
    """

    ARRAYS = ArrayPorts(
        {
            "source": "float64[n,3]",
            "source_normals": "float64[n,3]",
            "target": "float64[m,3]",
            "target_normals": "float64[m,3]",
            "transform": "float64[4,4]",
            "coarser_transform": "float64[4,4]",
        },
        optional=["coarser_transform"],
    )

    source: NDArray[np.float64]
    source_normals: NDArray[np.float64]
    target: NDArray[np.float64]
    target_normals: NDArray[np.float64]
    transform: NDArray[np.float64]
    coarser_transform: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RegistrationAssessmentOutputs:
    """Outputs of one call.

    Attributes
    ----------
    covariance : ndarray of float64, shape (6,6)
        Covariance of the transform, [x y z rx ry rz], perturbation in the target's frame: noise of the
        residuals times configured factors, plus the resolution error if coarserTransform is given.
    overlap_source : float
        Fraction of source points with a target point within the gate.
    overlap_target : float
        Fraction of target points with a source point within the gate.
    inlier_ratio : float
        Fraction of the pairs within the gate with a nonzero weight of the robust kernel.
    rms_m : float
        Weighted root mean square distance to the target's surface, metres.
    gate_m : float
        Distance below which two points count as overlapping, metres.
    centre_m : ndarray of float64, shape (3)
        Centre of the overlap in the target's frame, metres; rotations in directions are about this point.
    radius_m : float
        Root mean square distance of the overlap from its centre: the unit of the rotations, metres.
    information : ndarray of float64, shape (6)
        Eigenvalues of the normalised information, ascending; each lies in 0 to 1.
    agreement : ndarray of float64, shape (6)
        Fraction of the information along each eigenvector on which the normals of both clouds agree: 1 for
        structure, 0 for noise.
    directions : ndarray of float64, shape (6,6)
        Eigenvectors as rows, x y z rx ry rz, rotations in units of the radius.
    """

    covariance: NDArray[np.float64]
    overlap_source: float
    overlap_target: float
    inlier_ratio: float
    rms_m: float
    gate_m: float
    centre_m: NDArray[np.float64]
    radius_m: float
    information: NDArray[np.float64]
    agreement: NDArray[np.float64]
    directions: NDArray[np.float64]


class RegistrationAssessmentInterface(
    Dfn[ConfigT, RegistrationAssessmentInputs, RegistrationAssessmentOutputs]
):
    """Assess an alignment of two clouds by their overlap, the residuals, and how well structure common
    to both clouds constrains each direction of the pose; compute the covariance.
    """


#: Short names for the implementations.
Inputs = RegistrationAssessmentInputs
Outputs = RegistrationAssessmentOutputs
Interface = RegistrationAssessmentInterface
