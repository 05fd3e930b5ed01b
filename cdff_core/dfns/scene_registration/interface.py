# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN SceneRegistration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SceneRegistrationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    previous : ndarray of uint8, shape (r,c)
        Previous grey image.
    current : ndarray of uint8, shape (r,c)
        Grey image of the same camera.
    guess : ndarray of float64, shape (3,3), optional
        Expected homography from pixels of the previous image to pixels of the current image; default: the
        identity (camera at rest).
    """

    ARRAYS = ArrayPorts(
        {"previous": "uint8[r,c]", "current": "uint8[r,c]", "guess": "float64[3,3]"}, optional=["guess"]
    )

    previous: NDArray[np.uint8]
    current: NDArray[np.uint8]
    guess: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SceneRegistrationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    homography : ndarray of float64, shape (3,3)
        Homography from pixels of the previous image to pixels of the current image.
    places : ndarray of float32, shape (r,c,2)
        Column and row, in the previous image, of each pixel of the current image.
    sigma : ndarray of float32, shape (r,c)
        Standard deviation of these positions along an axis, pixels.
    is_at_rest : bool
        True if no pixel has moved.
    parallax : float
        Largest displacement relative to the homography, pixels.
    matches : int
        Number of points from which the result is computed.
    """

    homography: NDArray[np.float64]
    places: NDArray[np.float32]
    sigma: NDArray[np.float32]
    is_at_rest: bool
    parallax: float
    matches: int


class SceneRegistrationInterface(Dfn[ConfigT, SceneRegistrationInputs, SceneRegistrationOutputs]):
    """Find the position of each pixel of an image in the previous image, for a scene at rest and a
    moving camera: a homography and the remaining parallax, with its uncertainty.
    """


#: Short names for the implementations.
Inputs = SceneRegistrationInputs
Outputs = SceneRegistrationOutputs
Interface = SceneRegistrationInterface
