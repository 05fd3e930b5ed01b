# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StarFieldBackground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StarFieldBackgroundInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of float32, shape (r,c)
        Grey image, proportional to the light, DN.
    saturation : float
        Grey level from which a pixel is saturated, DN; infinity if unknown.
    """

    ARRAYS = ArrayPorts({"image": "float32[r,c]"})

    image: NDArray[np.float32]
    saturation: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StarFieldBackgroundOutputs:
    """Outputs of one call.

    Attributes
    ----------
    residual : ndarray of float32, shape (r,c)
        Image without its background, DN.
    noise : ndarray of float32, shape (r,c)
        Standard deviation of the noise of each pixel without sources, DN.
    mask : ndarray of uint8, shape (r,c)
        0 usable, 1 saturated, 2 trail.
    saturated : float
        Fraction of the pixels that are saturated.
    """

    residual: NDArray[np.float32]
    noise: NDArray[np.float32]
    mask: NDArray[np.uint8]
    saturated: float


class StarFieldBackgroundInterface(Dfn[ConfigT, StarFieldBackgroundInputs, StarFieldBackgroundOutputs]):
    """Remove the background of an image of point sources and measure its noise. Mark pixels that
    cannot be used: saturated pixels, and trails of satellites and cosmic rays.
    """


#: Short names for the implementations.
Inputs = StarFieldBackgroundInputs
Outputs = StarFieldBackgroundOutputs
Interface = StarFieldBackgroundInterface
