# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of the catalogue's stars with objects among them, for tests."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from cdff_common.camera import CameraModel
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.stars import add_sources, earth_velocity_m_s, load_catalogue, visible_stars
from cdff_common.types import Frame, TransformWithCovariance
from cdff_core.object_models.rendering import Window, camera_normals, render
from tests.support.satellite import satellite

FloatArray = np.ndarray
T0_NS = 1_564_358_400_000_000_000
#: Camera of 512 x 384 pixels with a field of 11.4 degrees.
CAMERA = CameraModel(384, 512, 2560.0, 2560.0, 255.5, 191.5)
SPREAD_PX = 0.7
#: Direction of the Sun in the camera for ``satellite_light``.
SATELLITE_SUN = np.array([0.5, -0.3, -0.81])


def satellite_light(T_camera_body: FloatArray) -> FloatArray:
    """Return the light (r, c), float32, of the satellite at a pose."""
    vertices, triangles = satellite()
    window = Window(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, CAMERA.rows, CAMERA.cols)
    face = render(vertices, triangles, T_camera_body, window).face
    sun = SATELLITE_SUN / np.linalg.norm(SATELLITE_SUN)
    cosine = camera_normals(vertices, triangles, T_camera_body, face) @ sun
    light = np.where(face >= 0, 6000.0 * np.clip(np.nan_to_num(cosine), 0.0, 1.0), 0.0)
    return np.asarray(cv2.GaussianBlur(light.astype(np.float32), (0, 0), SPREAD_PX))


@dataclass
class StarScene:
    """Camera that looks at stars and turns with a constant rate.

    Attributes
    ----------
    attitude : ndarray (3, 3)
        R_inertial_camera at the first image.
    rate : ndarray (3,)
        Angular velocity of the camera, inertial axes, rad/s.
    noise_dn, level_dn : float
        Noise and background.
    """

    camera: CameraModel = CAMERA
    attitude: FloatArray = field(default_factory=lambda: pointing(286.4, 28.9, 30.0))
    rate: FloatArray = field(default_factory=lambda: np.array([1e-4, -2e-4, 0.0]))
    noise_dn: float = 20.0
    level_dn: float = 400.0
    seed: int = 1

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.catalogue = load_catalogue().apparent(T0_NS, earth_velocity_m_s(T0_NS))

    def rotation(self, time_s: float) -> FloatArray:
        """Return R_inertial_camera at a time since the first image."""
        return np.asarray(se3.exp_so3(self.rate * time_s) @ self.attitude)

    def light(self, time_s: float) -> np.ndarray:
        """Return the light of the stars."""
        image = np.zeros((self.camera.rows, self.camera.cols), np.float32)
        indices, pixels = visible_stars(self.catalogue, self.camera, self.rotation(time_s))
        flux = 4e4 * 10.0 ** (-0.4 * (self.catalogue.magnitudes[indices] - 3.0))
        add_sources(image, pixels, flux, SPREAD_PX)
        return image

    def pixel(self, direction: FloatArray, time_s: float) -> FloatArray:
        """Return column and row of an inertial direction."""
        return np.asarray(self.camera.project((self.rotation(time_s).T @ direction)[None])[0])

    def add_point(self, light: np.ndarray, pixel: FloatArray, snr: float) -> None:
        """Add a point source with a signal-to-noise ratio."""
        # The norm of the image of a point of light 1.
        norm = 1.0 / np.sqrt(4.0 * np.pi * (SPREAD_PX**2 + 1.0 / 12.0))
        add_sources(light, pixel[None], [snr * self.noise_dn / norm], SPREAD_PX)

    def sample(
        self, light: np.ndarray, index: int, period_s: float = 1.0, sensor: str = "robot/camera"
    ) -> Sample:
        """Return an image of the light with noise, 16 bit."""
        levels = self.level_dn + light + self.rng.normal(0.0, self.noise_dn, light.shape)
        stamp_ns = T0_NS + int(index * period_s * 1e9)
        frame = Frame.from_image(
            levels.clip(0, 65535).astype(np.uint16),
            stamp_ns=stamp_ns,
            sensor=sensor,
            camera_matrix=self.camera.matrix,
        )
        return Sample("image", stamp_ns, index, frame, id=f"image{index}", frame=sensor)

    def attitude_sample(self, index: int, period_s: float = 1.0, error_rad: float = 0.0) -> Sample:
        """Return the attitude at an image, with an error about the vertical axis of the camera."""
        R = self.rotation(index * period_s) @ se3.exp_so3([0.0, error_rad, 0.0])
        stamp_ns = T0_NS + int(index * period_s * 1e9)
        value = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(R, np.zeros(3)), None),
            parent="inertial",
            child="robot/camera",
            stamp_ns=stamp_ns,
        )
        return Sample("attitude", stamp_ns, index, value, id=f"attitude{index}", frame="inertial")


def pointing(ra_deg: float, dec_deg: float, roll_deg: float) -> FloatArray:
    """Return R_inertial_camera of a camera whose axis points at a right ascension and declination."""
    ra, dec, roll = np.radians([ra_deg, dec_deg, roll_deg])
    forward = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.column_stack([right, np.cross(forward, right), forward])
    return np.asarray(R @ se3.exp_so3([0.0, 0.0, roll]))
