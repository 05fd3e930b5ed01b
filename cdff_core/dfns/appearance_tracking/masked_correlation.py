# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Template matching by weighted normalised correlation with sub-pixel position.

References
----------
.. [1] Lewis, J. P. (1995). Fast normalized cross-correlation. Vision Interface.
.. [2] Haralick, R. M., Shapiro, L. G. (1993). Computer and Robot Vision II, §16.4 (variance of a match).
"""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.appearance_tracking.interface import Inputs, Interface, Outputs

#: Smallest side of a template after scaling, pixels.
_MIN_SIDE_PX = 3
#: Least distance of the second best position from the best one, pixels.
_OTHER_PX = 3


class MaskedCorrelationConfig(DfnConfig):
    """Parameters of MaskedCorrelation."""

    scale_gain: float = Field(
        0.03,
        ge=0.0,
        le=1.0,
        description="Increase of the correlation for which another scale than the first is taken",
    )
    floor_px: float = Field(0.05, ge=0.0, le=2.0, description="Least standard deviation of a position, px")


class MaskedCorrelation(Interface[MaskedCorrelationConfig]):
    """Normalised correlation [1]_ of the weighted template at all
    positions of a window and several scales.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the best position and scale.

        Raises
        ------
        InputError
            If the weights are negative or all 0.
        """
        if not (inputs.weights.max(initial=0.0) > 0.0 and inputs.weights.min(initial=0.0) >= 0.0):
            raise InputError("weights: expected numbers from 0, one of them above 0")
        best = Outputs(
            place=np.full(2, np.nan), covariance=np.full((2, 2), np.nan), scale=1.0, score=-1.0, second=-1.0
        )
        for k, scale in enumerate(inputs.scales):
            match = self._at_scale(inputs, float(scale))
            min_score = best.score + (self.config.scale_gain if k == 1 else 0.0)
            if match is not None and match.score > min_score:
                best = match
        return best

    def _at_scale(self, inputs: Inputs, scale: float) -> Outputs | None:
        """Return the best match of the template at one scale; None if the window is too small for it."""
        rows, cols = inputs.template.shape
        size = (max(round(cols * scale), _MIN_SIDE_PX), max(round(rows * scale), _MIN_SIDE_PX))
        method = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
        template, weights = (
            np.asarray(cv2.resize(x, size, interpolation=method), np.float32)
            for x in (inputs.template, inputs.weights)
        )
        middle = 0.5 * (np.array(size) - 1.0)
        first = np.floor(inputs.place - middle - inputs.reach).astype(int)
        last = np.ceil(inputs.place - middle + inputs.reach).astype(int) + np.array(size)
        first = np.maximum(first, 0)
        last = np.minimum(last, inputs.image.shape[::-1])
        if (last - first < np.array(size)).any():
            return None
        window = inputs.image[first[1] : last[1], first[0] : last[0]].astype(np.float32)
        scores = _correlation(window, template, weights)
        _, score, _, at = cv2.minMaxLoc(scores)
        offset = _vertex(scores, (at[0], at[1]))
        others = scores.copy()
        low = np.maximum(np.array(at) - _OTHER_PX, 0)
        others[low[1] : at[1] + _OTHER_PX + 1, low[0] : at[0] + _OTHER_PX + 1] = -1.0
        return Outputs(
            place=first + np.array(at) + offset + middle,
            covariance=self._covariance(window, template, weights, np.array(at), inputs.noise),
            scale=size[0] / cols,
            score=float(score),
            second=float(others.max()),
        )

    def _covariance(
        self,
        window: Float32Array,
        template: Float32Array,
        weights: Float32Array,
        at: np.ndarray,
        noise: float,
    ) -> FloatArray:
        """Return the covariance of the position from residual and gradients [2]_."""
        h, w = template.shape
        patch = window[at[1] : at[1] + h, at[0] : at[0] + w]
        a, b = np.average(patch, weights=weights), np.average(template, weights=weights)
        gain = float(((template - b) * (patch - a) * weights).sum())
        gain /= max(float(((template - b) ** 2 * weights).sum()), 1e-6)
        residual = patch - a - gain * (template - b)
        variance = max(noise**2, float(np.average(residual**2, weights=weights)))
        gu, gv = (gain * np.gradient(template, axis=k) for k in (1, 0))
        J = np.array(
            [[(gu * gu * weights).sum(), (gu * gv * weights).sum()], [0.0, (gv * gv * weights).sum()]]
        )
        J[1, 0] = J[0, 1]
        floor = self.config.floor_px**2 * np.eye(2)
        return np.asarray(np.linalg.inv(J + 1e-3 * np.eye(2)) * variance + floor)


def _correlation(window: Float32Array, template: Float32Array, weights: Float32Array) -> Float32Array:
    """Return the weighted normalised correlation at each position of the template in the window."""
    total = float(weights.sum())
    centred = template - float((weights * template).sum()) / total
    norm = float((weights * centred**2).sum())
    product = cv2.matchTemplate(window, weights * centred, cv2.TM_CCORR)
    mean = cv2.matchTemplate(window, weights, cv2.TM_CCORR) / total
    power = cv2.matchTemplate(window**2, weights, cv2.TM_CCORR)
    variance = np.maximum(power - total * mean**2, 1e-3 * total)
    return np.asarray(np.clip(product / np.sqrt(variance * max(norm, 1e-6)), -1.0, 1.0), np.float32)


def _vertex(scores: Float32Array, at: tuple[int, int]) -> FloatArray:
    """Return the offset (2,) of the vertex of the parabolas through the largest score and its neighbours."""
    u, v = at
    offset = np.zeros(2)
    for axis, line, k in ((0, scores[v], u), (1, scores[:, u], v)):
        if 0 < k < len(line) - 1:
            before, middle, after = (float(x) for x in line[k - 1 : k + 2])
            bend = before - 2.0 * middle + after
            if bend < 0.0:
                offset[axis] = float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5))
    return offset
