# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Models of the rotation of a body without torque, as functions of a few parameters.

Each model has the orientation and the angular rate at one time as parameters. The inertia tensor of a
tumbling body is known up to its scale: ``J = tr(P) I - P`` with the tensor ``P = exp(S)`` of the second
moments of mass and a symmetric ``S`` without trace, so that every value of the five parameters of ``S`` is
the inertia of a body.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, Self, TypeVar

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.rigid_body.torque_free import TorqueFreeBody

#: Half of the interval of central differences: radians, fraction of the angular rate, logarithms of moments.
_STEP = 1e-5
#: Smallest angular rate with which an interval is computed as a fraction of the period, rad/s.
_MIN_RATE_RAD_S = 1e-7
#: Orthonormal basis of the symmetric matrices (3, 3) without trace.
_BASIS = np.array(
    [
        np.diag([1.0, -1.0, 0.0]) / np.sqrt(2.0),
        np.diag([1.0, 1.0, -2.0]) / np.sqrt(6.0),
        np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 0]]) / np.sqrt(2.0),
        np.array([[0.0, 0, 1], [0, 0, 0], [1, 0, 0]]) / np.sqrt(2.0),
        np.array([[0.0, 0, 0], [0, 0, 1], [0, 1, 0]]) / np.sqrt(2.0),
    ]
)


class RotationModel(Protocol):
    """Rotation of a body as a function of time."""

    @property
    def size(self) -> int:
        """Number of parameters: orientation (3), rate (3), further ones."""

    @property
    def scale(self) -> FloatArray:
        """Units (size,) in which steps of the parameters are of similar effect."""

    @property
    def momentum_axis(self) -> FloatArray:
        """Unit vector (3,) along the angular momentum in axes of the reference frame."""

    @property
    def mean_rate_rad_s(self) -> float:
        """Mean angular rate about the momentum, rad/s."""

    def moved(self, step: FloatArray) -> Self:
        """Return the model with changed parameters; the first three of ``step`` (size,) rotate it, rad."""

    def orientations(self, t_s: FloatArray) -> FloatArray:
        """Return ``R_reference_body`` (n, 3, 3) at times (n,) since the epoch."""

    def rates(self, t_s: FloatArray) -> FloatArray:
        """Return the angular rates (n, 3) in axes of the reference frame, rad/s."""


M = TypeVar("M", bound=RotationModel)


@dataclass(frozen=True, slots=True)
class SteadyRotation:
    """Rotation about an axis that is constant in the reference frame and in the body.

    Attributes
    ----------
    R_reference_body : ndarray (3, 3)
        Orientation at the epoch.
    rate_rad_s : ndarray (3,)
        Angular rate in axes of the reference frame.
    """

    R_reference_body: FloatArray
    rate_rad_s: FloatArray

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 6

    @property
    def scale(self) -> FloatArray:
        """Units of the parameters, see `RotationModel`."""
        return np.repeat([1.0, max(float(np.linalg.norm(self.rate_rad_s)), _MIN_RATE_RAD_S)], 3)

    @property
    def momentum_axis(self) -> FloatArray:
        """Unit vector (3,) along the rate; zero without rotation."""
        rate_rad_s = self.mean_rate_rad_s
        return np.asarray(self.rate_rad_s / rate_rad_s) if rate_rad_s else np.zeros(3)

    @property
    def mean_rate_rad_s(self) -> float:
        """Angular rate, rad/s."""
        return float(np.linalg.norm(self.rate_rad_s))

    def moved(self, step: FloatArray) -> SteadyRotation:
        """Return the rotation with orientation ``Exp(step[:3]) R`` and rate increased by ``step[3:]``."""
        return SteadyRotation(
            se3.exp_so3(step[:3]) @ self.R_reference_body, np.asarray(self.rate_rad_s + step[3:6])
        )

    def orientations(self, t_s: FloatArray) -> FloatArray:
        """Return the orientations (n, 3, 3)."""
        return np.asarray(se3.exp_so3(np.outer(t_s, self.rate_rad_s)) @ self.R_reference_body)

    def rates(self, t_s: FloatArray) -> FloatArray:
        """Return the constant rate (n, 3)."""
        return np.repeat(self.rate_rad_s[None], len(t_s), axis=0)


@dataclass(frozen=True, slots=True)
class Tumble:
    """Rotation of a body with three unequal moments of inertia.

    Attributes
    ----------
    R_reference_body : ndarray (3, 3)
        Orientation at the epoch.
    rate_rad_s : ndarray (3,)
        Angular rate at the epoch in body axes.
    log_moments : ndarray (3, 3)
        The matrix ``S`` of the module, symmetric, without trace.
    """

    R_reference_body: FloatArray
    rate_rad_s: FloatArray
    log_moments: FloatArray

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 11

    @property
    def scale(self) -> FloatArray:
        """Units of the parameters, see `RotationModel`."""
        rate = max(float(np.linalg.norm(self.rate_rad_s)), _MIN_RATE_RAD_S)
        return np.repeat([1.0, rate, 1.0], [3, 3, 5])

    @property
    def inertia(self) -> FloatArray:
        """Inertia tensor (3, 3) in body axes with trace 1."""
        values, axes = np.linalg.eigh(self.log_moments)
        moments = np.exp(values - values.max())
        return np.asarray(0.5 * (np.eye(3) - (axes * (moments / moments.sum())) @ axes.T))

    @property
    def momentum_axis(self) -> FloatArray:
        """Unit vector (3,) along the angular momentum."""
        return self._body().momentum_axis

    @property
    def mean_rate_rad_s(self) -> float:
        """Mean rate of precession, rad/s."""
        return self._body().precession_rad_s

    @property
    def moment_ratios(self) -> FloatArray:
        """Smallest and middle moment of inertia (2,), relative to the largest."""
        moments = np.linalg.eigvalsh(self.inertia)
        return np.asarray(moments[:2] / moments[2])

    def moved(self, step: FloatArray) -> Tumble:
        """Return the tumble with orientation ``Exp(step[:3]) R``, rate and moments increased."""
        return Tumble(
            se3.exp_so3(step[:3]) @ self.R_reference_body,
            np.asarray(self.rate_rad_s + step[3:6]),
            np.asarray(self.log_moments + np.tensordot(step[6:11], _BASIS, axes=1)),
        )

    def orientations(self, t_s: FloatArray) -> FloatArray:
        """Return the orientations (n, 3, 3)."""
        return self._body().orientations(t_s)

    def rates(self, t_s: FloatArray) -> FloatArray:
        """Return the rates (n, 3)."""
        body = self._body()
        return np.asarray((body.orientations(t_s) @ body.rates(t_s)[:, :, None])[:, :, 0])

    def _body(self) -> TorqueFreeBody:
        return TorqueFreeBody(self.inertia, self.rate_rad_s, self.R_reference_body)


def with_inertia(model: SteadyRotation, inertia: FloatArray) -> Tumble:
    """Return the tumble with orientation and rate of a steady rotation, and an inertia tensor (3, 3)."""
    moments = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    values, axes = np.linalg.eigh(moments)
    logs = np.log(np.maximum(values, 1e-3 * values.max()))
    S = (axes * (logs - logs.mean())) @ axes.T
    return Tumble(model.R_reference_body, model.R_reference_body.T @ model.rate_rad_s, np.asarray(S))


def orientation_derivatives(model: RotationModel, t_s: FloatArray) -> FloatArray:
    """Return the derivatives (n, 3, size) of the orientation, as rotation vector in axes of the reference
    frame.

    Central differences; the models are analytic functions of their parameters.
    """
    values = np.empty((len(t_s), 3, model.size))
    for k, (above, below, interval) in enumerate(_neighbours(model)):
        turns = above.orientations(t_s) @ np.swapaxes(below.orientations(t_s), 1, 2)
        values[:, :, k] = se3.log_so3(turns) / interval
    return values


def rate_derivatives(model: RotationModel, t_s: FloatArray) -> FloatArray:
    """Return the derivatives (n, 3, size) of the angular rate in axes of the reference frame."""
    columns = [
        (above.rates(t_s) - below.rates(t_s)) / interval for above, below, interval in _neighbours(model)
    ]
    return np.stack(columns, axis=2)


def value_derivatives(model: M, value: Callable[[M], FloatArray]) -> FloatArray:
    """Return the derivatives (k, size) of a function of the model with values (k,)."""
    columns = [(value(above) - value(below)) / interval for above, below, interval in _neighbours(model)]
    return np.stack(columns, axis=1)


def _neighbours(model: M) -> Iterator[tuple[M, M, float]]:
    """Yield models with a larger and a smaller value of each parameter, and the difference of the values."""
    for k, size in enumerate(_STEP * model.scale):
        step = np.zeros(model.size)
        step[k] = size
        yield model.moved(step), model.moved(-step), 2.0 * size
