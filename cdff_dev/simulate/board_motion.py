# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a camera in front of a board, with the readings of an inertial measurement unit at the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.calibration.boards import Board

#: Number of sines of each coordinate, and step of the numerical derivatives, seconds.
_SINES, _STEP_S = 3, 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class BoardMotion:
    """Smooth motion: each coordinate is a sum of sines.

    Attributes
    ----------
    amplitudes, frequencies_hz, phases : ndarray, shape (6, s)
        Of the position (m) and the rotation vector (rad) of the board in the frame of the camera.
    centre : ndarray, shape (6,)
        Mean position and rotation vector.
    board_centre_m : ndarray, shape (3,)
        Point of the board to which the position refers.
    """

    amplitudes: FloatArray
    frequencies_hz: FloatArray
    phases: FloatArray
    centre: FloatArray
    board_centre_m: FloatArray

    @classmethod
    def random(
        cls,
        board: Board,
        rng: np.random.Generator,
        *,
        distance_m: float,
        rotation_deg: tuple[float, float, float] = (20.0, 20.0, 25.0),
        shift: float = 0.12,
    ) -> BoardMotion:
        """Return a motion in front of a board, which stays in view.

        Parameters
        ----------
        board : Board
        rng : numpy.random.Generator
        distance_m : float
            Mean distance of the board from the camera.
        rotation_deg : tuple of float
            Largest rotation about each axis of the camera.
        shift : float
            Largest displacement along each axis of the camera, relative to the distance.
        """
        largest = np.array([shift * distance_m] * 3 + list(np.deg2rad(rotation_deg)))
        parts = rng.uniform(0.5, 1.0, (6, _SINES))
        amplitudes = largest[:, None] * parts / parts.sum(axis=1, keepdims=True)
        frequencies = rng.uniform(0.3, 1.0, (6, _SINES))
        corners = board.corners_m
        middle = np.append(np.mean([corners.min(axis=0), corners.max(axis=0)], axis=0)[:2], 0.0)
        centre = np.array([0.0, 0.0, distance_m, 0.0, 0.0, 0.0])
        return cls(amplitudes, frequencies, rng.uniform(0.0, 2 * np.pi, (6, _SINES)), centre, middle)

    def T_camera_board(self, t_s: FloatArray) -> FloatArray:
        """Return the poses ``(n, 4, 4)`` of the board at times ``(n,)``."""
        t = np.asarray(t_s, np.float64)[:, None, None]
        waves = np.sin(2 * np.pi * self.frequencies_hz * t + self.phases)
        values = self.centre + (self.amplitudes * waves).sum(axis=-1)
        R = se3.exp_so3(values[:, 3:])
        return se3.transform(R, values[:, :3] - R @ self.board_centre_m)

    def readings(
        self, t_s: FloatArray, T_camera_imu: FloatArray, gravity_m_s2: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return specific force ``(n, 3)``, m/s², and angular rate ``(n, 3)``, rad/s, without errors.

        Parameters
        ----------
        t_s : ndarray, shape (n,)
        T_camera_imu : ndarray, shape (4, 4)
        gravity_m_s2 : ndarray, shape (3,)
            In the frame of the board.
        """
        before, now, after = (
            se3.inverse(self.T_camera_board(t_s + shift)) @ T_camera_imu for shift in (-_STEP_S, 0.0, _STEP_S)
        )
        acceleration = (before[:, :3, 3] - 2 * now[:, :3, 3] + after[:, :3, 3]) / _STEP_S**2
        inverse = np.swapaxes(now[:, :3, :3], 1, 2)
        force = (inverse @ (acceleration - gravity_m_s2)[..., None])[..., 0]
        rate = se3.log_so3(np.swapaxes(before[:, :3, :3], 1, 2) @ after[:, :3, :3]) / (2 * _STEP_S)
        return force, rate


def noisy_readings(
    force: FloatArray,
    rate: FloatArray,
    rng: np.random.Generator,
    *,
    rate_hz: float,
    biases: FloatArray,
    gyro_noise: float = 1e-3,
    force_noise: float = 1e-2,
) -> tuple[FloatArray, FloatArray]:
    """Return specific force and angular rate with white noise and biases.

    Parameters
    ----------
    force, rate : ndarray, shape (n, 3)
        Specific force (m/s²) and angular rate (rad/s) without errors.
    rng : numpy.random.Generator
    rate_hz : float
        Readings per second.
    biases : ndarray, shape (6,)
        Of angular rate (rad/s) and specific force (m/s²).
    gyro_noise, force_noise : float
        Noise densities, rad/s/√Hz and m/s²/√Hz.
    """
    scale = np.sqrt(rate_hz)
    own_force = force + biases[3:] + rng.normal(0.0, force_noise * scale, force.shape)
    return own_force, rate + biases[:3] + rng.normal(0.0, gyro_noise * scale, rate.shape)


def stamps_at(rate_hz: float, duration_s: float, start_ns: int) -> NDArray[np.int64]:
    """Return stamps at a rate, rounded to microseconds."""
    t_us = np.rint(np.arange(0.0, duration_s, 1.0 / rate_hz) * 1e6).astype(np.int64)
    return np.asarray(start_ns + 1000 * t_us, np.int64)
