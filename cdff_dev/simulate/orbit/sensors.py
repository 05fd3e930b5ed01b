# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensors of the servicer in a scenario in orbit: cameras, lidars, star tracker, IMU and GNSS receiver."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from cdff_common.camera.model import PINHOLE_COEFFICIENTS, CameraModel
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel
from cdff_dev.simulate.fields import Mount, NotNegative, Positive
from cdff_dev.simulate.scenario import BODY_OPTICAL

Fraction = Annotated[float, Field(ge=0, le=1)]


class Exposure(StrictModel):
    """Exposure time, fixed or controlled from the brightness of the client."""

    time_s: Annotated[
        float | None, Field(gt=0, le=60, description="fixed exposure time; without it, it is controlled")
    ] = None
    min_s: Annotated[float, Field(gt=0, description="shortest controlled exposure")] = 1e-4
    max_s: Annotated[float, Field(gt=0, le=60, description="longest controlled exposure")] = 0.5
    target: Annotated[
        float, Field(gt=0, le=4, description="signal of the bright part of the client, of the full well")
    ] = 0.7

    @model_validator(mode="after")
    def _check_limits(self) -> Exposure:
        if self.min_s > self.max_s:
            raise ValueError(f"min_s {self.min_s} is above max_s {self.max_s}")
        return self


class Camera(StrictModel):
    """A grey camera: lens, detector and their errors.

    An unrotated camera looks along x of the base, with z of the base up. The signal of all light follows from
    ``zero_point_e_s``: sunlight is that of a star of magnitude -26.74 at 1 au.
    """

    mount: Mount = Mount(xyz_m=(0.0, 0.0, 0.0))
    rows: Annotated[int, Field(ge=16, le=4096)]
    columns: Annotated[int, Field(ge=16, le=4096)]
    focal_px: Positive
    principal_point_px: tuple[float, float] | None = Field(None, description="default: centre of the image")
    distortion: tuple[float, ...] = Field((), description="k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]")
    rate_hz: Positive
    start_s: Annotated[float, Field(ge=0, description="time of the first image")] = 0.0
    near_m: Annotated[float, Field(gt=0, description="shortest distance to the surface of a client")] = 0.1
    zero_point_e_s: Annotated[float, Field(gt=0, description="signal of magnitude 0, electrons per second")]
    exposure: Exposure = Exposure()
    psf_sigma_px: Annotated[float, Field(gt=0, le=20)] = 0.6
    halo: Annotated[float, Field(ge=0, lt=0.5, description="fraction of the light scattered in the lens")] = (
        0.002
    )
    halo_sigma_px: Positive = 25.0
    stray: Annotated[
        float, Field(ge=0, description="sunlight scattered into the image at 30° from the Sun, 1/sr")
    ] = 0.0
    hood_deg: Annotated[float, Field(gt=0, le=180, description="angle to the Sun without stray light")] = 60.0
    full_well_e: Positive = 20_000.0
    blooming: Annotated[bool, Field(description="charge above the full well fills the column")] = False
    bits: Annotated[int, Field(ge=8, le=16)] = 12
    gain_e_dn: Annotated[
        float | None, Field(gt=0, description="default: the full well is the largest number")
    ] = None
    offset_dn: NotNegative = 0.0
    read_noise_e: NotNegative = 8.0
    dark_e_s: NotNegative = 5.0
    prnu: Annotated[float, Field(ge=0, le=0.1, description="relative variation of the pixels' response")] = (
        0.005
    )
    hot_pixels: Annotated[int, Field(ge=0, description="number of pixels with a large dark current")] = 0
    hot_e_s: Annotated[float, Field(gt=0, description="median of their dark current")] = 2000.0
    cosmic_rays_hz: Annotated[float, Field(ge=0, description="particles that hit the detector")] = 0.0
    readout_s: Annotated[float, Field(ge=0, le=0.5, description="rolling shutter, first to last row")] = 0.0
    stars: Annotated[bool, Field(description="render stars")] = True

    @model_validator(mode="after")
    def _check_lens(self) -> Camera:
        if len(self.distortion) not in PINHOLE_COEFFICIENTS:
            counts = ", ".join(map(str, PINHOLE_COEFFICIENTS))
            raise ValueError(f"distortion has {len(self.distortion)} coefficients, expected {counts}")
        if not np.isfinite(self.model.rays([[0.0, 0.0], [self.columns - 1.0, self.rows - 1.0]])).all():
            raise ValueError(f"distortion {list(self.distortion)} folds the image: the corners have no rays")
        return self

    @property
    def model(self) -> CameraModel:
        """Intrinsic parameters."""
        cx, cy = self.principal_point_px or ((self.columns - 1) / 2, (self.rows - 1) / 2)
        return CameraModel(self.rows, self.columns, self.focal_px, self.focal_px, cx, cy, self.distortion)

    @property
    def T_base_camera(self) -> FloatArray:
        """Pose of the camera in the base, shape (4, 4)."""
        return self.mount.matrix() @ se3.transform(BODY_OPTICAL, [0, 0, 0])

    @property
    def largest_dn(self) -> int:
        """Largest number of the converter."""
        return int(2**self.bits - 1)

    @property
    def electrons_per_dn(self) -> float:
        """Gain, electrons per number."""
        return self.gain_e_dn or self.full_well_e / (self.largest_dn - self.offset_dn)


class OrbitLidar(StrictModel):
    """A lidar with a field of view about x of its mount: scanning row by row, or flash.

    The beams are equidistant in azimuth and elevation. The range noise is ``range_sigma_m`` for a white
    diffuse surface at ``reference_m`` seen at right angles, and grows with the inverse root of the signal.
    """

    mount: Mount = Mount(xyz_m=(0.0, 0.0, 0.0))
    kind: Literal["scanning", "flash"] = "scanning"
    rows: Annotated[int, Field(ge=2, le=2048)]
    columns: Annotated[int, Field(ge=2, le=2048)]
    field_deg: tuple[Positive, Positive] = Field(description="full angles in azimuth and elevation")
    rate_hz: Positive
    start_s: NotNegative = 0.0
    scan_s: Annotated[float | None, Field(gt=0, description="duration of a scan; default 1 / rate_hz")] = None
    near_m: Annotated[float, Field(gt=0, description="shortest range")] = 0.3
    far_m: Annotated[float, Field(gt=0, description="longest range")] = 500.0
    range_sigma_m: NotNegative = 0.02
    range_bias_sigma_m: Annotated[float, Field(ge=0, description="constant error, drawn once")] = 0.0
    reference_m: Positive = 20.0
    divergence_deg: Annotated[float, Field(ge=0, le=2, description="full angle of a beam")] = 0.05
    detection_threshold: Annotated[
        float, Field(ge=0, description="smallest detected signal, of a white surface at reference_m")
    ] = 0.01
    false_alarms: Annotated[
        float, Field(ge=0, le=0.1, description="fraction of beams with a random range")
    ] = 0.0

    @model_validator(mode="after")
    def _check_ranges(self) -> OrbitLidar:
        """Refuse ranges, fields and periods that contradict each other."""
        if self.near_m >= self.far_m:
            raise ValueError(f"near_m {self.near_m} is not below far_m {self.far_m}")
        if max(self.field_deg) >= 180.0:
            raise ValueError(f"field_deg {list(self.field_deg)}: expected below 180°")
        if self.kind == "scanning" and self.sweep_s > 1.0 / self.rate_hz + 1e-9:
            raise ValueError(
                f"scan_s {self.scan_s} is longer than the interval of scans, {1 / self.rate_hz:g} s"
            )
        return self

    @property
    def sweep_s(self) -> float:
        """Duration of a scan, seconds; 0 of a flash."""
        return 0.0 if self.kind == "flash" else self.scan_s or 1.0 / self.rate_hz


class StarTracker(StrictModel):
    """Attitude of the base from stars: noise across and about the boresight (x of the mount), and a bias."""

    mount: Mount = Mount(xyz_m=(0.0, 0.0, 0.0), rpy_deg=(0.0, -60.0, 0.0))
    rate_hz: Positive = 1.0
    cross_sigma_arcsec: NotNegative = 5.0
    roll_sigma_arcsec: NotNegative = 30.0
    bias_sigma_arcsec: NotNegative = 5.0
    sun_exclusion_deg: Annotated[float, Field(ge=0, le=180)] = 40.0
    earth_exclusion_deg: Annotated[float, Field(ge=0, le=90, description="angle to the Earth's limb")] = 20.0


class Gnss(StrictModel):
    """Position and velocity of the base: white noise, and an error that varies slowly."""

    rate_hz: Positive = 1.0
    position_sigma_m: NotNegative = 1.5
    velocity_sigma_m_s: NotNegative = 0.02
    slow_sigma_m: NotNegative = 2.0
    slow_s: Annotated[float, Field(gt=0, description="correlation time of the slow error")] = 600.0


def off_axis_rad(axis: FloatArray, direction: FloatArray) -> float:
    """Return the angle between two unit vectors (3,)."""
    return math.atan2(float(np.linalg.norm(np.cross(axis, direction))), float(axis @ direction))
