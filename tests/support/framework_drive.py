# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated drive of a rover with a lidar for programs of robot frameworks, and checks of their results.

The ground is level at the start, so that the site is the initial pose of the base also without an IMU.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from cdff_common.geometry import se3
from tests.support.hills import HEIGHT_M, Float, Ground, circle, hills

#: Duration of a sweep, and time from one sweep to the next, seconds.
SWEEP_S, PERIOD_S = 0.1, 0.5
#: Angles of the rows below the horizon, and of the columns, to the left.
ELEVATIONS_RAD = -np.arctan(HEIGHT_M / np.geomspace(1.5, 20.0, 32))
AZIMUTHS_RAD = np.linspace(-np.pi, np.pi, 360, endpoint=False)
_RADIUS_M, _NOISE_M = 8.0, 0.003
#: Distances at which the sweeps end, metres.
_DISTANCES_M = np.concatenate([np.zeros(4), [0.05, 0.2], np.arange(0.5, 8.1, 0.4)])
_FLAT_M, _HILLY_M = 1.5, 6.0
#: Steps of the search for the ground along a ray, and largest range, metres.
_STEPS, _MAX_RANGE_M = 120, 30.0
#: Half width and spacing of the grid of heights, metres.
_HALF_M, _SPACING_M = 48.0, 0.1


def _ground() -> Ground:
    """Return hills that are level at the start, interpolated between heights on a grid."""
    axis = np.arange(-_HALF_M, _HALF_M, _SPACING_M)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    s = np.clip((np.hypot(x, y) - _FLAT_M) / (_HILLY_M - _FLAT_M), 0.0, 1.0)
    heights = hills(1)(x, y)
    heights = s * s * (3.0 - 2.0 * s) * (heights - heights[len(axis) // 2, len(axis) // 2])

    def interpolated(x: Float, y: Float) -> Float:
        cells = (np.array([np.ravel(x), np.ravel(y)]) + _HALF_M) / _SPACING_M
        return np.asarray(map_coordinates(heights, cells, order=1, mode="nearest")).reshape(np.shape(x))

    return interpolated


@dataclass(frozen=True)
class Drive:
    """A drive with its true poses.

    Attributes
    ----------
    ranges_m : array (n, rows, columns)
        Ranges of each sweep, NaN without an echo.
    T_site_base : array (n, 4, 4)
        True poses at the end of each sweep.
    ground : callable
        Heights of the ground in the site, metres.
    """

    ranges_m: NDArray[np.float32]
    T_site_base: Float
    ground: Ground

    def points_m(self) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
        """Return the points (n, m, 3) in the lidar, and the times (m,) after the start of a sweep in ns.

        A ray without an echo is NaN.
        """
        rays = _rays()
        points = self.ranges_m.reshape(len(self.ranges_m), -1, 1) * rays[None]
        offsets_ns = np.round(1e9 * SWEEP_S * _fractions()).astype(np.uint32)
        return points.astype(np.float32), np.broadcast_to(offsets_ns, self.ranges_m.shape[1:]).ravel()


def _rays() -> Float:
    """Return the directions (rows x columns, 3) of the rays."""
    e, a = np.meshgrid(ELEVATIONS_RAD, AZIMUTHS_RAD, indexing="ij")
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)


def _fractions() -> Float:
    """Return the part of the sweep before each column."""
    return np.arange(1, len(AZIMUTHS_RAD) + 1) / len(AZIMUTHS_RAD)


def make_drive(seed: int = 0) -> Drive:
    """Return a drive of 8 m along an arc."""
    ground, rng = _ground(), np.random.default_rng(seed)
    ends = circle(ground, _RADIUS_M, _DISTANCES_M)
    ranges = []
    for previous, end in zip([ends[0], *ends[:-1]], ends, strict=True):
        start = previous @ se3.exp_se3((1.0 - SWEEP_S / PERIOD_S) * se3.log_se3(se3.inverse(previous) @ end))
        ranges.append(_sweep(ground, start, end, rng))
    T_lidar_base = se3.transform(np.eye(3), [0.0, 0.0, -HEIGHT_M])
    return Drive(np.array(ranges, np.float32), np.array(ends) @ T_lidar_base, ground)


def _sweep(ground: Ground, T_start: Float, T_end: Float, rng: np.random.Generator) -> Float:
    """Return the ranges (rows, columns) at which the rays of a moving lidar meet the ground."""
    step = se3.log_se3(se3.inverse(T_start) @ T_end)
    T = np.array([T_start @ se3.exp_se3(fraction * step) for fraction in _fractions()])
    shape = len(ELEVATIONS_RAD), len(AZIMUTHS_RAD)
    rays = np.einsum("cij,rcj->rci", T[:, :3, :3], _rays().reshape(*shape, 3))
    origins = T[:, :3, 3]
    near, far = np.zeros(shape), np.full(shape, np.nan)
    for range_m in np.geomspace(0.8, _MAX_RANGE_M, _STEPS):
        open_rays = np.isnan(far)
        if not open_rays.any():
            break
        below = _height_above(ground, origins, rays, np.full(shape, range_m)) < 0.0
        far[open_rays & below] = range_m
        near[open_rays & ~below] = range_m
    for _ in range(20):
        middle = 0.5 * (near + far)
        below = _height_above(ground, origins, rays, np.nan_to_num(middle)) < 0.0
        far, near = np.where(below, middle, far), np.where(below, near, middle)
    return np.asarray(far + rng.normal(0.0, _NOISE_M, shape))


def _height_above(ground: Ground, origins: Float, rays: Float, range_m: Float) -> Float:
    points = origins + range_m[..., None] * rays
    return np.asarray(points[..., 2] - ground(points[..., 0], points[..., 1]))


def check_poses(
    drive: Drive, starts_ns: list[int], poses: list[list[float]], tolerance_m: float = 0.15
) -> float:
    """Compare poses ``[stamp_ns, x, y, z, qx, qy, qz, qw]`` of the base in the site with the true ones.

    Return the largest error in metres.

    Parameters
    ----------
    starts_ns : list of int
        Time at which each sweep began; a repeated last sweep belongs to the last pose.
    """
    ends_ns = np.array(starts_ns) + round(1e9 * SWEEP_S)
    errors = []
    for stamp_ns, *numbers in poses:
        gaps_ns = np.abs(ends_ns - stamp_ns)
        index = int(np.argmin(gaps_ns))
        if gaps_ns[index] > 2e6:
            continue
        T = se3.transform(se3.matrix_from_quaternion_xyzw(np.array(numbers[3:7])), np.array(numbers[:3]))
        error = se3.inverse(drive.T_site_base[min(index, len(drive.T_site_base) - 1)]) @ T
        errors.append(np.linalg.norm(error[:3, 3]))
    expected = len(drive.T_site_base) // 2
    assert len(errors) >= expected, f"{len(errors)} of {len(poses)} poses at the end of a sweep"
    assert max(errors) < tolerance_m, f"errors of the poses in metres: {np.round(errors, 3)}"
    return float(max(errors))


def grid_map_cells(dem: dict[str, Any]) -> Float:
    """Return the points (n, 3) of a grid map ``{position, lengths, resolution, values}``, NaN where unknown.

    ``values`` are columns of ``grid_map_msgs``: rows along -x, columns along -y from the corner of the
    largest x and y.
    """
    resolution, (lx, ly), (px, py) = dem["resolution"], dem["lengths"], dem["position"]
    x = px + 0.5 * lx - (np.arange(round(lx / resolution)) + 0.5) * resolution
    y = py + 0.5 * ly - (np.arange(round(ly / resolution)) + 0.5) * resolution
    heights = np.array([np.nan if v is None else v for v in dem["values"]])
    x, y = np.meshgrid(x, y)
    return np.column_stack([x.ravel(), y.ravel(), heights])


def check_heights(drive: Drive, points_m: Float, sigma_m: float = 0.03) -> float:
    """Compare points (n, 3) in the site, NaN where unknown, with the ground.

    Return the root mean square of the errors in metres.
    """
    heights = points_m[:, 2]
    known = np.isfinite(heights)
    assert known.mean() > 0.5, f"{known.mean():.0%} of the cells are known"
    errors = (heights - drive.ground(points_m[:, 0], points_m[:, 1]))[known]
    rms = float(np.sqrt(np.mean(errors**2)))
    assert rms < sigma_m, f"root mean square of the errors of the heights: {rms:.3f} m"
    assert np.ptp(heights[known]) > 3.0 * rms, "the heights differ by more than their errors"
    return rms
