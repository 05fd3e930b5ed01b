# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mounts of the sensors of a robot, and scales of its wheels, from a log of one drive."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.errors import CdffError, DegenerateGeometryError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.rotation_forms import rpy_deg_from_matrix
from cdff_core.calibration import (
    DIRECTIONS,
    Mount,
    WheelScales,
    hand_eye,
    inertial_mount,
    motion_pairs,
    wheel_scales,
)
from cdff_core.calibration.estimate import advice
from cdff_dev.calibrate.drive import (
    Trajectory,
    estimated_trajectory,
    frame_of,
    inertial,
    recorded_poses,
    sensor_streams,
    wheel_stream,
)
from cdff_dev.logs.source import LogSource


@dataclass(frozen=True, slots=True, eq=False)
class SensorResult:
    """Result for a sensor.

    Attributes
    ----------
    stream, frame : str
    mount : Mount or None
        None if the calibration is refused.
    refusal : str
        Why there is no mount.
    offset_s : float or None
        Time to add to the stamps of an IMU; None for other sensors.
    profile_mount : UncertainTransform or None
        Mount that the profile stated before the calibration.
    """

    stream: str
    frame: str
    mount: Mount | None
    refusal: str = ""
    offset_s: float | None = None
    profile_mount: UncertainTransform | None = None

    @property
    def completed_mount(self) -> UncertainTransform | None:
        """Mount to write to the profile; directions that the calibration did not determine are taken from the mount
        in the profile, by default the identity.
        """
        if self.mount is None:
            return None
        return self.mount.completed(
            UncertainTransform.identity() if self.profile_mount is None else self.profile_mount
        )

    def to_json(self) -> dict[str, Any]:
        """Return plain data: the transform, its covariance, and the undetermined directions."""
        if self.mount is None or self.completed_mount is None:
            return {"stream": self.stream, "frame": self.frame, "refused": self.refusal}
        covariance = self.completed_mount.covariance
        return {
            "stream": self.stream,
            "frame": self.frame,
            "T": self.completed_mount.matrix.tolist(),
            "covariance": None if covariance is None else covariance.tolist(),
            "undetermined": list(self.mount.undetermined),
            "offset_s": self.offset_s,
            "motions": self.mount.pairs,
            "rms_m": self.mount.rms_m,
            "rms_rad": self.mount.rms_rad,
        }

    def lines(self) -> Iterator[str]:
        """Yield the result in words."""
        yield f"{self.frame} ({self.stream})"
        if self.mount is None or self.completed_mount is None:
            yield f"  refused: {self.refusal}"
            return
        sigma = self.mount.sigma
        rpy = rpy_deg_from_matrix(self.completed_mount.matrix[:3, :3])
        values = [*self.completed_mount.matrix[:3, 3], *rpy]
        sigmas = [*sigma[:3], *np.rad2deg(sigma[3:])]
        for name, value, s in zip(DIRECTIONS, values, sigmas, strict=True):
            unit = "m" if name in "xyz" else "°"
            digits = 3 if unit == "m" else 2
            if name in self.mount.undetermined:
                kept_value = "0" if self.profile_mount is None else "that of the profile"
                yield f"  {name:5} not determined; kept: {kept_value} ({value:.{digits}f} {unit})"
            else:
                yield f"  {name:5} {value:9.{digits}f} ± {s:.{digits}f} {unit}"
        if self.mount.undetermined:
            yield f"  to determine {', '.join(self.mount.undetermined)}: {self._advice()}"
        if self.profile_mount is not None:
            delta = self.completed_mount.matrix[:3, :3] @ self.profile_mount.matrix[:3, :3].T
            shift_m = float(
                np.linalg.norm(self.completed_mount.matrix[:3, 3] - self.profile_mount.matrix[:3, 3])
            )
            angle_deg = float(np.rad2deg(se3.rotation_angle(delta)))
            yield f"  differs from the profile by {shift_m:.3f} m and {angle_deg:.2f}°"
        if self.offset_s is not None:
            yield f"  clock: add {self.offset_s:+.2f} s to its stamps (resolution 0.02 s)"

    def _advice(self) -> str:
        """Return which motions determine the missing directions.

        Wheels do not determine the position of an IMU.
        """
        assert self.mount is not None
        if self.offset_s is None:
            return advice(self.mount.undetermined)
        angles = tuple(d for d in self.mount.undetermined if d in DIRECTIONS[3:])
        parts = [advice(angles)] if angles else []
        if len(angles) < len(self.mount.undetermined):
            parts.append("measure the position of the unit, since the slip of wheels acts like a lever arm")
        return "; ".join(parts)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Results of a drive: sensors, and scales of the wheels or why there are none."""

    robot: str
    wheels: str
    sensors: tuple[SensorResult, ...]
    scales: WheelScales | None
    scales_by: str
    scales_refusal: str

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        s = self.scales
        scales = (
            {"refused": self.scales_refusal}
            if s is None
            else {
                "by": self.scales_by,
                "radius": s.radius,
                "radius_sigma": s.radius_sigma,
                "track": s.track,
                "track_sigma": s.track_sigma,
            }
        )
        return {
            "robot": self.robot,
            "wheels": self.wheels,
            "sensors": [sensor.to_json() for sensor in self.sensors],
            "wheel_scales": scales,
        }

    def lines(self) -> Iterator[str]:
        """Yield the report in words."""
        yield f"mounts in {self.robot}/base, compared with {self.wheels}:"
        for sensor in self.sensors:
            yield from sensor.lines()
        s = self.scales
        if s is None:
            yield f"wheels: refused: {self.scales_refusal}"
            return
        curves = f"{np.rad2deg(s.yaw_rad):.0f}° of curves"
        yield f"wheels by {self.scales_by}, over {s.distance_m:.1f} m and {curves}:"
        yield f"  radius      {s.radius:.4f} ± {s.radius_sigma:.4f} times the radius that the driver uses"
        yield f"  track width {s.track:.4f} ± {s.track_sigma:.4f} times the track width that the driver uses"


def calibrate(
    log: LogSource,
    robot: str,
    known: Mapping[str, UncertainTransform],
    *,
    wheels: str | None = None,
    streams: Sequence[str] = (),
) -> Calibration:
    """Return mounts and scales from a drive.

    Parameters
    ----------
    known : mapping of frame to UncertainTransform
        Mounts of the profile.
    wheels : str, optional
        Stream of wheel odometry.
    streams : sequence of str
        Streams to calibrate; default: all IMUs, lidars and stereo cameras of the robot.

    Raises
    ------
    InputError
        If the log has no wheel odometry, or several.
    """
    base_stream = wheel_stream(log, robot, wheels)
    base = recorded_poses(log, base_stream)
    results: list[SensorResult] = []
    scales, scales_by, refusal = None, "", "the log has no lidar and no stereo camera with a determined mount"
    for stream in streams or sensor_streams(log, robot):
        frame = frame_of(log, stream)
        mount_known = known.get(frame)
        try:
            if log.streams[stream].type_name == "IMUSensors":
                results.append(_inertial_result(log, stream, base, mount_known))
                continue
            sensor = estimated_trajectory(log, stream)
            pairs = motion_pairs(base.stamps_ns, base.poses, sensor.stamps_ns, sensor.poses)
            result = SensorResult(stream, frame, hand_eye(pairs), profile_mount=mount_known)
            results.append(result)
            if scales is None and result.mount is not None and result.completed_mount is not None:
                result.mount.require(("yaw",))
                scales, scales_by = wheel_scales(pairs, result.completed_mount.matrix), stream
        except DegenerateGeometryError as error:
            if not results or results[-1].stream != stream:
                results.append(SensorResult(stream, frame, None, str(error), profile_mount=mount_known))
            refusal = str(error)
        except CdffError as error:
            results.append(SensorResult(stream, frame, None, str(error), profile_mount=mount_known))
    return Calibration(robot, base_stream, tuple(results), scales, scales_by, refusal)


def _inertial_result(
    log: LogSource, stream: str, base: Trajectory, known: UncertainTransform | None
) -> SensorResult:
    unit = inertial(log, stream)
    mount, offset_s = inertial_mount(
        unit.stamps_ns, unit.force_m_s2, unit.rate_rad_s, base.stamps_ns, base.poses
    )
    return SensorResult(stream, unit.frame, mount, offset_s=offset_s, profile_mount=known)
