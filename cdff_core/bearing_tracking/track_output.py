# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of tracked objects: direction, range where observable, and pixel, with standard deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.types import ObjectTrack, ObjectTrackStatusT
from cdff_core.bearing_tracking.local_orbital import LocalOrbitalAxes

#: Frame of directions whose attitude is known.
INERTIAL = "inertial"
#: End of the name of a frame with LVLH axes.
LVLH = "/lvlh"
#: Axes of a frame: z up (north in the inertial frame), z down (LVLH), or x right, y down, z forward.
Axes = Literal["z_up", "z_down", "camera"]


@dataclass(frozen=True, slots=True, eq=False)
class TrackState:
    """State of an object at an image.

    Attributes
    ----------
    number : int
    direction, rate : ndarray (3,)
        Unit vector and angular velocity, rad/s, in the frame of the track.
    covariance : ndarray (6, 6)
        Covariance of rotation vector and angular velocity.
    pixel, pixel_sigma : ndarray (2,)
        Column and row; NaN outside the image.
    status : ObjectTrackStatusT
    score : float
        0 to 1.
    range_m, range_sigma_m : float
        NaN while not observable.
    size_m : ndarray (3,)
        Size of the body; 0 if unknown.
    label : str
        Name of the body; that of its number if empty.
    origin_m : ndarray (3,)
        Position of the camera in the frame of the track.
    origin_covariance : ndarray (3, 3)
    is_located : bool
        False if the position of the camera in the frame is not known: the range is, the position is not.
    """

    number: int
    direction: FloatArray
    rate: FloatArray
    covariance: FloatArray
    pixel: FloatArray
    pixel_sigma: FloatArray
    status: ObjectTrackStatusT
    score: float
    range_m: float = float("nan")
    range_sigma_m: float = float("nan")
    size_m: FloatArray | None = None
    label: str = ""
    origin_m: FloatArray | None = None
    origin_covariance: FloatArray | None = None
    is_located: bool = True

    def in_axes(self, axes: LocalOrbitalAxes) -> TrackState:
        """Return the inertial state in LVLH axes."""
        rotated = axes.state(self.direction, self.rate, self.covariance)
        return replace(
            self, direction=rotated.directions[0], rate=rotated.rates[0], covariance=rotated.covariances[0]
        )


def axes_of(frame: str) -> Axes:
    """Return the axes of the frames in orbit; other names are those of cameras."""
    return "z_up" if frame == INERTIAL else "z_down" if frame.endswith(LVLH) else "camera"


def object_track(
    state: TrackState, stamp_ns: int, frame: str, producer: str, axes: Axes | None = None
) -> ObjectTrack:
    """Return the message of a state; without ``axes``, the name of the frame determines them."""
    azimuth, elevation, tangents = angles(state.direction, axes or axes_of(frame))
    turn = np.cross(state.direction, tangents)
    across = turn @ state.covariance[:3, :3] @ turn.T
    u = state.direction
    position_covariance = (
        state.range_m** 2 * tangents.T @ across @ tangents + state.range_sigma_m** 2 * np.outer(u, u)
    )
    sigmas = np.sqrt(np.maximum(np.diag(across), 0.0))
    position_m = state.range_m * u
    if state.origin_m is not None:
        position_m = position_m + state.origin_m
    if state.origin_covariance is not None:
        position_covariance = position_covariance + state.origin_covariance
    if not state.is_located:
        position_m, position_covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    return ObjectTrack.from_bearing(
        state.number,
        stamp_ns,
        frame=frame,
        bearing=[azimuth, elevation, sigmas[0], sigmas[1], state.range_m, state.range_sigma_m],
        position_m=position_m,
        position_covariance=position_covariance,
        velocity=state.rate,
        pixel=state.pixel,
        pixel_sigma=state.pixel_sigma,
        label=state.label or f"object {state.number}",
        status=state.status,
        score=state.score,
        size_m=np.zeros(3) if state.size_m is None else state.size_m,
        producer=producer,
    )


def angles(direction: FloatArray, axes: Axes) -> tuple[float, float, FloatArray]:
    """Return azimuth, elevation and the unit vectors (2, 3) in which they grow.

    With z up the azimuth grows from x to y: in the inertial frame these are right ascension and declination.
    In a camera frame the azimuth grows to the right from the optical axis, the elevation upwards; in LVLH
    axes the azimuth is that from the direction of motion.
    """
    x, y, z = direction
    if axes == "z_up":
        azimuth, elevation = np.arctan2(y, x) % (2.0 * np.pi), np.arctan2(z, np.hypot(x, y))
        east = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        north = np.cross(direction, east)
    elif axes == "z_down":
        azimuth, elevation = np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))
        east = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        north = np.cross(east, direction)
    else:
        azimuth, elevation = np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))
        east = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
        north = np.cross(east, direction)
    return float(azimuth), float(elevation), np.stack([east, north])
