# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Initial values of models of rotation, from measured orientations."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.rigid_body.motion_models import SteadyRotation, Tumble, with_inertia

#: Largest rotation over which the rate is taken as constant, rad, and least number of orientations from
#: which it is computed.
_WINDOW_RAD, _MIN_WINDOW = 0.7, 3
#: Moments of inertia of initial values that do not follow from the orientations.
_MOMENTS = ((1.0, 1.0, 1.0), (1.0, 1.0, 0.6), (0.6, 1.0, 1.0))


def steady_start(t_s: FloatArray, orientations: FloatArray) -> SteadyRotation:
    """Return the rotation with the first orientation and the median rate of the first eight intervals."""
    return SteadyRotation(orientations[0], np.median(_rates(t_s[:9], orientations[:9]), axis=0))


def tumble_starts(t_s: FloatArray, orientations: FloatArray) -> list[Tumble]:
    """Return tumbles with the first orientation and rate, and different tensors of inertia.

    The first tensor is the one with the most constant angular momentum ``R J R' rate`` in the reference
    frame, from rates of short windows (n >= 6 orientations).
    """
    increments = np.linalg.norm(_rates(t_s, orientations), axis=1) * np.diff(t_s)
    size = int(np.clip(_WINDOW_RAD / max(float(np.median(increments)), 1e-9), _MIN_WINDOW, len(t_s) // 3))
    size += 1 - size % 2
    starts = range(0, len(t_s) - size + 1, max(1, size // 2))
    middles = np.array([start + size // 2 for start in starts])
    rates = np.array([_slope(t_s[s : s + size], orientations[s : s + size]) for s in starts])
    steady = SteadyRotation(orientations[0], rates[0])
    inertia = _constant_momentum(orientations[middles], rates)
    _, axes = np.linalg.eigh(inertia)
    tensors = [inertia, *((axes * np.array(moments)) @ axes.T for moments in _MOMENTS)]
    return [with_inertia(steady, tensor) for tensor in tensors]


def _rates(t_s: FloatArray, orientations: FloatArray) -> FloatArray:
    """Return the rates (n - 1, 3) between consecutive orientations, in the reference frame."""
    turns = se3.log_so3(orientations[1:] @ np.swapaxes(orientations[:-1], 1, 2))
    return np.asarray(turns / np.diff(t_s)[:, None])


def _slope(t_s: FloatArray, orientations: FloatArray) -> FloatArray:
    """Return the mean rate (3,) of a short window, in the reference frame, by linear regression."""
    middle = orientations[len(orientations) // 2]
    turns = se3.log_so3(orientations @ middle.T)
    times_s = t_s - t_s.mean()
    return np.asarray(times_s @ turns / (times_s @ times_s))


def _constant_momentum(orientations: FloatArray, rates: FloatArray) -> FloatArray:
    """Return the tensor (3, 3), body axes, whose momentum changes least; of positive trace."""
    body_rates = np.einsum("nji,nj->ni", orientations, rates)
    x, y, z = body_rates.T
    zero = np.zeros_like(x)
    # J rate as a linear function of Jxx, Jyy, Jzz, Jxy, Jxz, Jyz.
    momentum = np.stack(
        [
            np.stack([x, zero, zero, y, z, zero], axis=1),
            np.stack([zero, y, zero, x, zero, z], axis=1),
            np.stack([zero, zero, z, zero, x, y], axis=1),
        ],
        axis=1,
    )
    rotated = orientations @ momentum
    _, _, rows = np.linalg.svd((rotated - rotated.mean(axis=0)).reshape(-1, 6), full_matrices=False)
    a, b, c, d, e, f = rows[-1] * np.sign(rows[-1][:3].sum() or 1.0)
    return np.array([[a, d, e], [d, b, f], [e, f, c]])
