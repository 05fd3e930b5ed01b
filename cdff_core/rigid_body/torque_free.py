# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude of a rigid body without torque, in closed form at any time.

The angular rate about the principal axes follows Jacobi's elliptic functions. The angular momentum is
constant in inertial axes; the angle of precession about it is the integral of a periodic rate, which is
summed as a Fourier series. Energy and momentum are therefore constant to rounding errors over any time.

Source: L. D. Landau, E. M. Lifshitz, Mechanics, 3rd edition, 1976, §36 and §37.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ellipj, ellipk, ellipkinc

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

#: Largest relative asymmetry of an inertia tensor, and violation of the triangle inequality of its moments.
_TOLERANCE = 1e-9
#: Largest relative size of ``rate × momentum`` of a body that rotates at a constant rate.
_CONSTANT = 1e-12
#: Relative size of neglected terms of the Fourier series, and largest number of its samples.
_RESIDUAL, _MAX_SAMPLES = 1e-14, 1 << 16


class TorqueFreeBody:
    """Rotation of a rigid body without torque.

    Parameters
    ----------
    inertia_kg_m2 : array_like (3, 3) or (3,)
        Inertia tensor about the centre of mass in body axes, or its diagonal.
    rate_rad_s : array_like (3,)
        Angular rate relative to inertial axes at time 0, body axes, rad/s.
    R_inertial_body : array_like (3, 3), optional
        Orientation at time 0; identity by default.

    Raises
    ------
    InputError
        If the inertia is not one of a body: symmetric, positive, and no principal moment above the sum of the
        other two; or if a value is not finite.
    """

    def __init__(
        self,
        inertia_kg_m2: ArrayLike,
        rate_rad_s: ArrayLike,
        R_inertial_body: ArrayLike | None = None,
    ) -> None:
        moments, axes = principal_axes(inertia_kg_m2)
        rate = np.asarray(rate_rad_s, dtype=float)
        if rate.shape != (3,) or not np.isfinite(rate).all():
            raise InputError(f"rate_rad_s={rate_rad_s!r}: expected three finite values")
        orientation = np.eye(3) if R_inertial_body is None else np.asarray(R_inertial_body, dtype=float)
        if orientation.shape != (3, 3) or not np.allclose(orientation.T @ orientation, np.eye(3), atol=1e-9):
            raise InputError(f"R_inertial_body={orientation.tolist()}: expected a rotation matrix (3, 3)")
        momentum = moments * (axes.T @ rate)
        # The rate about the axis ``c`` never vanishes: that of the largest or of the smallest moment.
        has_largest = momentum @ momentum >= (momentum**2 / moments).sum() * moments[1]
        order = [0, 1, 2] if has_largest else [2, 1, 0]
        self._moments, self._axes = moments[order], axes[:, order]
        self._axes[:, 2] *= np.linalg.det(self._axes)  # right-handed
        self._rate = self._axes.T @ rate
        self._momentum = float(np.linalg.norm(momentum))
        self._set_rate_functions()
        self._set_precession()
        start = self._from_momentum_axes(np.zeros(1))[0] if self._momentum else self._axes.T
        self._R_inertial_momentum = orientation @ start.T

    @property
    def momentum_axis(self) -> FloatArray:
        """Unit vector (3,) of the angular momentum in inertial axes; zero for a body at rest."""
        if not self._momentum:
            return np.zeros(3)
        if not self._speed:
            momentum = self._axes @ (self._moments * self._rate)
            return np.asarray(self._R_inertial_momentum @ momentum / self._momentum)
        return np.asarray(self._R_inertial_momentum[:, 2])

    @property
    def precession_rad_s(self) -> float:
        """Mean rate about the angular momentum; the total rate of a rotation about a principal axis."""
        return self._precession_rad_s if self._speed else float(np.linalg.norm(self._rate))

    def rates(self, t_s: ArrayLike) -> FloatArray:
        """Return the angular rates (n, 3) at times (n,), body axes, rad/s."""
        return np.asarray(self._principal_rates(np.atleast_1d(np.asarray(t_s, dtype=float))) @ self._axes.T)

    def orientations(self, t_s: ArrayLike) -> FloatArray:
        """Return the orientations ``R_inertial_body`` (n, 3, 3) at times (n,)."""
        times_s = np.atleast_1d(np.asarray(t_s, dtype=float))
        if not self._momentum:
            return np.repeat((self._R_inertial_momentum @ self._axes.T)[None], len(times_s), axis=0)
        return np.asarray(self._R_inertial_momentum @ self._from_momentum_axes(times_s))

    def _set_rate_functions(self) -> None:
        """Set amplitudes, modulus, speed and phase of the elliptic functions of the rates."""
        a, b, c = self._moments
        energy2, momentum2 = float(self._moments @ self._rate**2), self._momentum**2
        self._speed, self._parameter, self._phase = 0.0, 0.0, 0.0
        self._amplitudes = self._rate.copy()
        torque = np.linalg.norm(np.cross(self._rate, self._moments * self._rate))
        if torque <= _CONSTANT * self._momentum * np.linalg.norm(self._rate):
            return
        order = np.sign(c - a)
        across, along = order * (c * energy2 - momentum2), order * (momentum2 - a * energy2)
        sign = np.sign(self._rate[2])
        self._amplitudes = np.array(
            [
                np.sqrt(across / (a * abs(c - a))),
                order * sign * np.sqrt(across / (b * abs(c - b))),
                sign * np.sqrt(along / (c * abs(c - a))),
            ]
        )
        self._speed = float(np.sqrt(abs(c - b) * along / (a * b * c)))
        self._parameter = float(min(abs(b - a) * across / (abs(c - b) * along), 1.0))
        cosine, sine = self._rate[:2] / self._amplitudes[:2]
        self._phase = float(ellipkinc(np.arctan2(sine, cosine), self._parameter))

    def _principal_rates(self, t_s: FloatArray) -> FloatArray:
        if not self._speed:
            return np.repeat(self._amplitudes[None], len(t_s), axis=0)
        sn, cn, dn, _ = ellipj(self._speed * t_s + self._phase, self._parameter)
        return np.asarray(np.column_stack([cn, sn, dn]) * self._amplitudes)

    def _set_precession(self) -> None:
        """Set mean and Fourier coefficients of the rate of precession about the angular momentum."""
        self._precession_rad_s, self._period_s = 0.0, 1.0
        self._coefficients = np.zeros(0, dtype=complex)
        if not self._speed:
            return
        self._period_s = 2.0 * float(ellipk(self._parameter)) / self._speed
        samples = 64
        while True:
            t_s = np.arange(samples) * self._period_s / samples
            spectrum = np.fft.rfft(self._precession_rates(t_s)) / samples
            if np.abs(spectrum[-samples // 8 :]).max() <= _RESIDUAL * abs(spectrum[0]):
                break
            samples *= 2
            if samples > _MAX_SAMPLES:
                raise InputError(
                    f"rate {self._rate.tolist()} rad/s is too near the axis of the middle moment "
                    f"{self._moments[1]:g} kg m²: change it by a thousandth"
                )
        self._precession_rad_s = float(spectrum[0].real)
        numbers = np.arange(1, len(spectrum))
        is_needed = np.abs(spectrum[1:]) > _RESIDUAL * abs(spectrum[0])
        last = int(numbers[is_needed].max(initial=0))
        angular = 2j * np.pi * numbers[:last] / self._period_s
        self._coefficients = 2.0 * spectrum[1 : last + 1] / angular

    def _precession_rates(self, t_s: FloatArray) -> FloatArray:
        squared = self._principal_rates(t_s)[:, :2] ** 2
        a, b, _ = self._moments
        return np.asarray(self._momentum * (squared @ [a, b]) / (squared @ [a**2, b**2]))

    def _precession(self, t_s: FloatArray) -> FloatArray:
        """Return the angles (n,) of precession since time 0, rad."""
        numbers = np.arange(1, len(self._coefficients) + 1)
        turns = np.exp(2j * np.pi * np.outer(np.mod(t_s / self._period_s, 1.0), numbers)) - 1.0
        return np.asarray(self._precession_rad_s * t_s + (turns @ self._coefficients).real)

    def _from_momentum_axes(self, t_s: FloatArray) -> FloatArray:
        """Return the rotations (n, 3, 3) from body axes to axes with z along the angular momentum."""
        if not self._speed:
            turns = se3.exp_so3(np.outer(t_s, self._axes @ self._rate))
            return np.asarray(turns)
        direction = self._principal_rates(t_s) * self._moments / self._momentum
        # Rows x and y of the axes of the momentum: the line of nodes of the axis c, turned by the precession.
        nodes = np.column_stack([direction[:, 1], -direction[:, 0], np.zeros(len(t_s))])
        nodes /= np.linalg.norm(nodes, axis=1, keepdims=True)
        across = np.cross(direction, nodes)
        angle = self._precession(t_s)[:, None]
        x = np.cos(angle) * nodes - np.sin(angle) * across
        y = np.sin(angle) * nodes + np.cos(angle) * across
        return np.asarray(np.stack([x, y, direction], axis=1) @ self._axes.T)


def principal_axes(inertia_kg_m2: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the principal moments (3,), ascending, and their axes as columns of a rotation (3, 3).

    Raises InputError if the tensor is not the inertia of a body.
    """
    inertia = np.asarray(inertia_kg_m2, dtype=float)
    inertia = np.diag(inertia) if inertia.shape == (3,) else inertia
    if inertia.shape != (3, 3) or not np.isfinite(inertia).all():
        raise InputError(f"inertia_kg_m2={inertia_kg_m2!r}: expected (3,) or (3, 3) finite values")
    if np.abs(inertia - inertia.T).max() > _TOLERANCE * np.abs(inertia).max():
        raise InputError(f"inertia_kg_m2={inertia.tolist()}: expected a symmetric tensor")
    moments, axes = np.linalg.eigh(inertia)
    if moments[0] <= 0.0:
        raise InputError(f"inertia_kg_m2: principal moments {moments.tolist()}, expected above 0")
    if moments[2] > (1.0 + _TOLERANCE) * (moments[0] + moments[1]):
        raise InputError(
            f"inertia_kg_m2: principal moments {moments.tolist()}, expected each at most the sum of the "
            "others"
        )
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return moments, axes
