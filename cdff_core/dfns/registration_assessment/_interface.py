# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RegistrationAssessment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationAssessmentInputs:
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,3)
        Points that were moved, metres.
    source_normals : ndarray of float64, shape (n,3)
        Unit normals of the source.
    target : ndarray of float64, shape (m,3)
        Points that were to be met, metres.
    target_normals : ndarray of float64, shape (m,3)
        Unit normals of the target.
    transform : ndarray of float64, shape (4,4)
        T_target_source to be judged.
    """

    source: NDArray[np.float64]
    source_normals: NDArray[np.float64]
    target: NDArray[np.float64]
    target_normals: NDArray[np.float64]
    transform: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationAssessmentOutputs:
    """Outputs of one call.

    Attributes
    ----------
    covariance : ndarray of float64, shape (6,6)
        Of the transform, x y z rx ry rz, perturbation in the target's frame; formal, inflated.
    overlap_source : ndarray of float64, shape ()
        Share of source points with a target point within the gate.
    overlap_target : ndarray of float64, shape ()
        Share of target points with a source point within the gate.
    inlier_ratio : ndarray of float64, shape ()
        Share of the pairs within the gate that the robust kernel keeps.
    rms_m : ndarray of float64, shape ()
        Weighted root mean square distance to the target's surface, metres.
    gate_m : ndarray of float64, shape ()
        Distance within which points count as overlapping, metres.
    centre_m : ndarray of float64, shape (3)
        Centre of the overlap in the target's frame, about which rotations of the directions are meant, metres.
    radius_m : ndarray of float64, shape ()
        Root mean square distance of the overlap from its centre: the unit of the rotations, metres.
    information : ndarray of float64, shape (6)
        Eigenvalues of the normalised information, ascending; each lies in 0 to 1.
    agreement : ndarray of float64, shape (6)
        Per eigenvector, the share of its information that both clouds' normals agree on: 1 structure, 0 noise.
    directions : ndarray of float64, shape (6,6)
        Eigenvectors as rows, x y z rx ry rz, rotations in units of the radius.
    """

    covariance: NDArray[np.float64]
    overlap_source: NDArray[np.float64]
    overlap_target: NDArray[np.float64]
    inlier_ratio: NDArray[np.float64]
    rms_m: NDArray[np.float64]
    gate_m: NDArray[np.float64]
    centre_m: NDArray[np.float64]
    radius_m: NDArray[np.float64]
    information: NDArray[np.float64]
    agreement: NDArray[np.float64]
    directions: NDArray[np.float64]


class RegistrationAssessmentInterface(Dfn[Any, RegistrationAssessmentInputs, RegistrationAssessmentOutputs]):
    """Judge an alignment of two clouds: overlap seen from both, residuals, how well each direction of the pose is
    tied down by structure that both clouds agree on, and the covariance.
    """
