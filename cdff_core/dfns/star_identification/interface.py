# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StarIdentification."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StarIdentificationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    directions : ndarray of float64, shape (n,3)
        Unit vectors of the sources in the camera frame, brightest first.
    sigmas : ndarray of float64, shape (n)
        Standard deviation of each direction, perpendicular to it, radians.
    stamp : int
        Time of the image, nanoseconds since the UNIX epoch.
    attitude : ndarray of float64, shape (3,3), optional
        Approximate R_inertial_camera.
    attitude_sigma : float
        Standard deviation of the approximate attitude about each axis, radians; ignored without an
        attitude.
    velocity : ndarray of float64, shape (3), optional
        Velocity of the camera relative to the Sun, m/s, ICRS axes, which shifts the stars by aberration;
        without it they are not shifted.
    """

    ARRAYS = ArrayPorts(
        {
            "directions": "float64[n,3]",
            "sigmas": "float64[n]",
            "attitude": "float64[3,3]",
            "velocity": "float64[3]",
        },
        finite=["directions"],
        positive=["sigmas"],
        optional=["attitude", "velocity"],
    )

    directions: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    stamp: int
    attitude_sigma: float
    attitude: NDArray[np.float64] | None = None
    velocity: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StarIdentificationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    stars : ndarray of int64, shape (n)
        Index of the star of each source in the catalogue; -1 for none.
    star_directions : ndarray of float64, shape (n,3)
        Unit vectors of the stars at the time of the image, ICRS, with aberration if the velocity is given;
        NaN for sources without a star.
    corrected : ndarray of float64, shape (n,3)
        Directions in the camera frame with the measured errors of the lens removed.
    rotation : ndarray of float64, shape (3,3)
        R_inertial_camera.
    scale : float
        Ratio of the measured to the given focal length.
    radial : float
        Coefficient of cubic radial distortion that the given camera model does not contain, per square
        tangent.
    residual : float
        Root mean square of the angles between sources and stars, radians.
    is_ambiguous : bool
        True if the attitude was accepted only because it agrees with the approximate attitude.
    """

    stars: NDArray[np.int64]
    star_directions: NDArray[np.float64]
    corrected: NDArray[np.float64]
    rotation: NDArray[np.float64]
    scale: float
    radial: float
    residual: float
    is_ambiguous: bool


class StarIdentificationInterface(Dfn[ConfigT, StarIdentificationInputs, StarIdentificationOutputs]):
    """Identify the sources of an image that are stars of the catalogue, with or without an approximate
    attitude, and measure errors of focal length and radial distortion. A result that could be due
    to chance is refused.
    """


#: Short names for the implementations.
Inputs = StarIdentificationInputs
Outputs = StarIdentificationOutputs
Interface = StarIdentificationInterface
