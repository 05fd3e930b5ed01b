# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Adaptation of the noise of a source to the statistics of its innovations.

The squared Mahalanobis norm of an innovation has the number of its components as expected value. While the
mean ratio of both exceeds 1, the factor on the variances of the source grows; otherwise it returns towards 1,
because a mean below 1 may be caused by the covariance of the state, and stated variances are not reduced.
"""

from __future__ import annotations

#: Fraction of an innovation in the statistics: about the last fifty increments count.
_GAIN = 0.02
#: Ratio that a refused increment counts as: about that at the limit of the gate.
REFUSED_RATIO = 5.0
#: Upper bound of the factor: ten times the stated standard deviation.
_MAX_FACTOR = 100.0


def adapted_factor(factor: float, ratio: float) -> float:
    """Return the factor on variances after an innovation with a ratio of squared norm to expected value."""
    return min(max(factor * (1.0 + _GAIN * (min(ratio, REFUSED_RATIO) - 1.0)), 1.0), _MAX_FACTOR)
