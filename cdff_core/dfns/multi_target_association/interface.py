# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN MultiTargetAssociation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MultiTargetAssociationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    stamp : int
        Time of the image, nanoseconds; must be later than the time of the previous call.
    directions : ndarray of float64, shape (n,3)
        Unit vectors of the sources in a frame that does not rotate.
    covariances : ndarray of float64, shape (n,3,3)
        Covariances of the vectors, perpendicular to them.
    snr : ndarray of float64, shape (n)
        Ratio of signal to noise of each source.
    pixels : ndarray of float64, shape (n,2)
        Column and row of each source.
    can_start : ndarray of bool, shape (n)
        True for a source that can start a new object; other sources can only continue an object.
    defect_evidence : ndarray of float64, shape (n)
        Squared residuals of the fit of a point source minus those of the fit of a single bright pixel;
        positive for a defect.
    stars : ndarray of float64, shape (k,3)
        Unit vectors of the identified stars of the image, which are not contained in directions.
    blend_angle : float
        Angle below which two sources cannot be separated, radians.
    solid_angle : float
        Solid angle of the field of view, steradians.
    is_dark : bool
        True if objects cannot be seen in this image, so that a missing source is no evidence.
    """

    ARRAYS = ArrayPorts(
        {
            "directions": "float64[n,3]",
            "covariances": "float64[n,3,3]",
            "snr": "float64[n]",
            "pixels": "float64[n,2]",
            "can_start": "bool[n]",
            "defect_evidence": "float64[n]",
            "stars": "float64[k,3]",
        },
        finite=["directions", "covariances", "snr", "pixels", "defect_evidence", "stars"],
    )

    stamp: int
    directions: NDArray[np.float64]
    covariances: NDArray[np.float64]
    snr: NDArray[np.float64]
    pixels: NDArray[np.float64]
    can_start: NDArray[np.bool_]
    defect_evidence: NDArray[np.float64]
    stars: NDArray[np.float64]
    blend_angle: float
    solid_angle: float
    is_dark: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MultiTargetAssociationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    ids : ndarray of int64, shape (m)
        Numbers of the objects.
    states : ndarray of int64, shape (m)
        0 tentative, 1 confirmed, 2 coasting, 3 lost in this call.
    classes : ndarray of int64, shape (m)
        0 undecided, 1 moving target, 2 at rest in the sky, 3 at rest in the sensor.
    sources : ndarray of int64, shape (m)
        Index of the source of each object; -1 for none.
    object_directions : ndarray of float64, shape (m,3)
        Unit vectors of the objects.
    rates : ndarray of float64, shape (m,3)
        Angular velocities, radians per second.
    object_covariances : ndarray of float64, shape (m,6,6)
        Covariances of direction and rate.
    scores : ndarray of float64, shape (m)
        Logarithm of the likelihood ratio of the object to false sources.
    hypotheses : ndarray of int64, shape (m)
        Number of hypotheses of each object.
    """

    ids: NDArray[np.int64]
    states: NDArray[np.int64]
    classes: NDArray[np.int64]
    sources: NDArray[np.int64]
    object_directions: NDArray[np.float64]
    rates: NDArray[np.float64]
    object_covariances: NDArray[np.float64]
    scores: NDArray[np.float64]
    hypotheses: NDArray[np.int64]


class MultiTargetAssociationInterface(
    Dfn[ConfigT, MultiTargetAssociationInputs, MultiTargetAssociationOutputs]
):
    """Associate the sources of successive images with objects, with several hypotheses over time, and
    classify each object by its motion: a moving target, a star or other source at rest in the sky,
    or a defect at rest in the sensor.
    """


#: Short names for the implementations.
Inputs = MultiTargetAssociationInputs
Outputs = MultiTargetAssociationOutputs
Interface = MultiTargetAssociationInterface
