# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ApparentSizeRanging."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ApparentSizeRangingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of float32, shape (r,c)
        Image window with the light of the body, background removed; the optical axis passes through the
        centre of the window.
    noise : float
        Standard deviation of the noise of a pixel.
    focal : float
        Focal length of the window, pixels.
    point_spread : float
        Standard deviation of the point spread function, pixels.
    sizes : ndarray of float64, shape (2)
        Smallest and largest apparent size of the body from all directions, metres.
    vertices : ndarray of float64, shape (v,3), optional
        Vertices of the model in the frame of the body, metres.
    triangles : ndarray of int64, shape (t,3), optional
        Triangles of the model.
    attitude : ndarray of float64, shape (3,3), optional
        R_window_body; window: x right, y down, z forward.
    sun : ndarray of float64, shape (3), optional
        Unit vector towards the Sun in the frame of the window.
    """

    ARRAYS = ArrayPorts(
        {
            "image": "float32[r,c]",
            "sizes": "float64[2]",
            "vertices": "float64[v,3]",
            "triangles": "int64[t,3]",
            "attitude": "float64[3,3]",
            "sun": "float64[3]",
        },
        finite=["image"],
        positive=["noise", "focal", "point_spread", "sizes"],
        optional=["vertices", "triangles", "attitude", "sun"],
    )

    image: NDArray[np.float32]
    noise: float
    focal: float
    point_spread: float
    sizes: NDArray[np.float64]
    vertices: NDArray[np.float64] | None = None
    triangles: NDArray[np.int64] | None = None
    attitude: NDArray[np.float64] | None = None
    sun: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ApparentSizeRangingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    range : float
        Distance of the body's origin along the line of sight, metres; the middle of the interval if the
        attitude is unknown.
    range_sigma : float
        Standard deviation of the range, metres.
    interval : ndarray of float64, shape (2)
        Smallest and largest range that the apparent size permits, metres.
    origin : ndarray of float64, shape (2)
        Column and row of the body's origin in the window; NaN if the attitude is unknown.
    agreement : float
        Correlation of image and rendered model; NaN without a comparison.
    extent : float
        Largest extent of the body in the image, pixels.
    """

    range: float
    range_sigma: float
    interval: NDArray[np.float64]
    origin: NDArray[np.float64]
    agreement: float
    extent: float


class ApparentSizeRangingInterface(Dfn[ConfigT, ApparentSizeRangingInputs, ApparentSizeRangingOutputs]):
    """Measure the range of a resolved body from its apparent size: by comparison with its rendered
    model if attitude and Sun direction are known, otherwise as an interval from its smallest and
    largest apparent size.
    """


#: Short names for the implementations.
Inputs = ApparentSizeRangingInputs
Outputs = ApparentSizeRangingOutputs
Interface = ApparentSizeRangingInterface
