# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""TruncatedGnc: wrong pairs among the right ones, up to about seven in ten.

References
----------
.. [1] H. Yang, P. Antonante, V. Tzoumas, L. Carlone, Graduated Non-Convexity for Robust Spatial Perception, RA-L 5(2),
   2020, doi:10.1109/LRA.2020.2965893, §III.B
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.geometry import se3
from cdff_core.dfns.transform_estimation_3d._rigid import Float, RigidConfig, RigidEstimation, fitted

#: Factor by which the loss nears the truncated square at each step ([1]_).
_GROWTH = 1.4
_STEPS = 200


class TruncatedGncConfig(RigidConfig):
    """From where on a pair is wrong."""

    threshold: Annotated[float, Field(gt=0, le=1e6)] = 0.1


class TruncatedGnc(RigidEstimation):
    """Truncated least squares, come upon from the convex side ([1]_): no samples, no seed."""

    Config: ClassVar[type[RigidConfig]] = TruncatedGncConfig
    config: TruncatedGncConfig

    def _agreeing(self, source: Float, sink: Float, sigmas: Float) -> NDArray[np.bool_]:
        limit, weights = self.config.threshold**2, np.ones(len(source))
        squares = _squares(source, sink, sigmas, weights)
        if squares.max() <= limit:
            return np.ones(len(source), bool)
        mu = limit / (2.0 * squares.max() - limit)
        for _ in range(_STEPS):
            low, high = mu / (mu + 1.0) * limit, (mu + 1.0) / mu * limit
            between = np.sqrt(limit * mu * (mu + 1.0) / np.maximum(squares, 1e-300)) - mu
            weights = np.where(squares <= low, 1.0, np.where(squares >= high, 0.0, between))
            if (weights > 1e-9).sum() < 3:
                return np.zeros(len(source), bool)
            squares = _squares(source, sink, sigmas, weights)
            if ((weights < 1e-6) | (weights > 1.0 - 1e-6)).all():
                break
            mu *= _GROWTH
        return squares <= limit


def _squares(source: Float, sink: Float, sigmas: Float, weights: Float) -> Float:
    T = fitted(source, sink, weights / sigmas**2)
    return np.asarray(((se3.transform_points(T, source) - sink) ** 2).sum(axis=1) / sigmas**2)
