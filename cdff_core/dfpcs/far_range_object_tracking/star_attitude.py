# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude of the camera: of the stars of an image, of a given attitude, or of both."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.camera import CameraModel
from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Sample
from cdff_common.stars import load_catalogue, visible_stars
from cdff_core.bearing_tracking.lens import corrected, distorted
from cdff_core.dfns.attitude_from_directions.interface import AttitudeFromDirectionsInputs
from cdff_core.dfns.star_identification.interface import StarIdentificationInputs
from cdff_core.dfpcs.far_range_object_tracking.configuration import FarRangeObjectTrackingConfig

#: Interval between searches without an attitude, in images, after the first and after many failures.
_FIRST_PAUSE, _LAST_PAUSE = 2, 64
#: Growth of the uncertainty of the last attitude, rad/s, if none is given: the camera may turn.
_TURN_RAD_S = 0.002
#: Catalogue stars in view to this magnitude, and bright sources, from which missing matches are a
#: contradiction.
_BRIGHT_MAGNITUDE, _EXPECTED_STARS, _BRIGHT_SOURCES, _BRIGHT_SNR = 6.0, 4, 8, 10.0
#: Signal-to-noise ratio from which a source may be a star: few false sources exceed it.
_STAR_SNR = 5.5


@dataclass(frozen=True, slots=True, eq=False)
class CameraAttitude:
    """Attitude of the camera at an image.

    Attributes
    ----------
    rotation : ndarray (3, 3) or None
        R_inertial_camera; None if it is unknown.
    covariance : ndarray (3, 3)
        Covariance of its rotation vector in the inertial frame, square radians.
    stars : ndarray of bool (n,)
        Sources that are stars of the catalogue.
    is_from_stars : bool
    scale, radial : float
        Errors of the lens, see StarIdentification.
    residual_rad : float
        Root mean square of the angles between sources and stars; NaN without stars.
    reasons : tuple of str
        Restrictions of the attitude.
    inputs : tuple of str
        Ids of the samples.
    bias_rad : float
        Standard deviation of a constant error about each axis, which the differences of images do not show.
    """

    rotation: FloatArray | None
    covariance: FloatArray
    stars: BoolArray
    is_from_stars: bool = False
    scale: float = 1.0
    radial: float = 0.0
    residual_rad: float = float("nan")
    reasons: tuple[str, ...] = ()
    inputs: tuple[str, ...] = field(default=())
    bias_rad: float = 0.0

    def directions(self, camera: CameraModel, pixels: FloatArray) -> FloatArray:
        """Return the unit vectors (n, 3) of pixels (n, 2), inertial, or in the camera frame without an
        attitude.
        """
        rays = corrected(camera.rays(pixels), self.scale, self.radial)
        return rays if self.rotation is None else rays @ self.rotation.T

    def pixels(self, camera: CameraModel, directions: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of directions (n, 3), the inverse of ``directions``; NaN behind the
        camera.
        """
        rays = directions if self.rotation is None else directions @ self.rotation
        return camera.project(distorted(rays, self.scale, self.radial))


class AttitudeEstimator:
    """Attitude of the camera at each image.

    Parameters
    ----------
    identify, solve : Dfn
        StarIdentification and AttitudeFromDirections.
    """

    def __init__(
        self, identify: Dfn[Any, Any, Any], solve: Dfn[Any, Any, Any], config: FarRangeObjectTrackingConfig
    ) -> None:
        self._identify, self._solve, self._config = identify, solve, config
        self._given: Sample | None = None
        self._before: Sample | None = None  # the given attitude before the last one
        self._last: tuple[int, FloatArray] | None = None
        self._pause, self._wait = _FIRST_PAUSE, 0

    def give(self, sample: Sample) -> None:
        """Store a given attitude."""
        self._before, self._given = self._given, sample

    @property
    def has_given(self) -> bool:
        """True if an attitude was given."""
        return self._given is not None

    def estimate(
        self, stamp_ns: int, camera: CameraModel, pixels: FloatArray, sigmas_px: FloatArray, snr: FloatArray
    ) -> CameraAttitude:
        """Return the attitude at an image with sources at ``pixels`` (n, 2), brightest first."""
        given, sigma_rad, inputs = self._given_at(stamp_ns)
        none = np.zeros(len(pixels), bool)
        reasons: list[str] = []
        if self._config.use_stars:
            guess, guess_sigma = given, sigma_rad
            if guess is None and self._last is not None:
                age_s = (stamp_ns - self._last[0]) * 1e-9
                guess, guess_sigma = self._last[1], 1e-3 + _TURN_RAD_S * age_s
                guess = guess if guess_sigma < 0.05 else None
            try:
                return self._from_stars(
                    stamp_ns, camera, pixels, sigmas_px, snr, guess, guess_sigma, given, inputs
                )
            except (RefusedError, DegenerateGeometryError) as error:
                reasons += list(getattr(error, "reasons", ())) or ["stars_degenerate"]
        if given is not None:
            if self._config.use_stars and self._is_contradicted(camera, given, snr):
                reasons.append("attitude_or_camera_wrong")
                return CameraAttitude(None, np.zeros((3, 3)), none, reasons=tuple(reasons), inputs=inputs)
            reasons = [reason for reason in reasons if not reason.startswith("few_stars")]
            covariance = np.eye(3) * self._config.attitude_noise_rad**2
            return CameraAttitude(
                given, covariance, none, reasons=tuple(reasons), inputs=inputs, bias_rad=sigma_rad
            )
        reasons.append("attitude_missing")
        return CameraAttitude(None, np.zeros((3, 3)), none, reasons=tuple(reasons))

    def _given_at(self, stamp_ns: int) -> tuple[FloatArray | None, float, tuple[str, ...]]:
        """Return the given attitude at a time, its standard deviation and its id, or None."""
        given = self._given
        if given is None or abs(stamp_ns - given.stamp_ns) > self._config.attitude_age_s * 1e9:
            return None, 0.0, ()
        transform = given.value.transform
        sigma = np.radians(self._config.attitude_sigma_deg)
        covariance = transform.covariance
        if covariance is not None and np.isfinite(covariance[3:, 3:]).all() and covariance[3:, 3:].any():
            sigma = max(float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1])), 1e-7)
        R = transform.matrix[:3, :3]
        if given.stamp_ns != stamp_ns and self._before is not None:
            # The rate of the camera is that between the last two attitudes.
            previous = self._before.value.transform.matrix[:3, :3]
            fraction = (stamp_ns - given.stamp_ns) / (given.stamp_ns - self._before.stamp_ns)
            turn = se3.log_so3(R @ previous.T) * fraction
            R = se3.exp_so3(turn) @ R
            sigma = float(np.hypot(sigma, 0.1 * np.linalg.norm(turn)))
        return R, float(sigma), (given.id,)

    def _from_stars(
        self,
        stamp_ns: int,
        camera: CameraModel,
        pixels: FloatArray,
        sigmas_px: FloatArray,
        snr: FloatArray,
        guess: FloatArray | None,
        guess_sigma: float,
        given: FloatArray | None,
        inputs: tuple[str, ...],
    ) -> CameraAttitude:
        count = self._config.identify_sources
        rays = camera.rays(pixels[:count])
        usable = np.flatnonzero(np.isfinite(rays).all(axis=1) & (snr[:count] > _STAR_SNR))
        sigmas = np.hypot(sigmas_px[usable] / camera.fx, self._config.catalogue_sigma_rad)
        if guess is None and self._wait > 0:
            self._wait -= 1
            raise RefusedError(
                "no attitude is known; the next search follows later", reasons=["not_identified"]
            )
        try:
            found = self._identify.process(
                StarIdentificationInputs(
                    directions=rays[usable],
                    sigmas=sigmas,
                    stamp=stamp_ns,
                    attitude=guess,
                    attitude_sigma=guess_sigma,
                )
            )
        except RefusedError:
            self._last, self._wait = None, self._pause
            self._pause = min(2 * self._pause, _LAST_PAUSE)
            raise
        matched = found.stars >= 0
        solution = self._solve.process(
            AttitudeFromDirectionsInputs(
                directions=found.corrected[matched],
                references=found.star_directions[matched],
                sigmas=sigmas[matched],
            )
        )
        self._last, self._pause, self._wait = (stamp_ns, solution.rotation), _FIRST_PAUSE, 0
        stars = np.zeros(len(pixels), bool)
        stars[usable[matched]] = True
        reasons = []
        if found.is_ambiguous:
            reasons.append("few_stars")
        if given is not None:
            difference = float(se3.rotation_angle(solution.rotation @ given.T))
            if difference > 5.0 * guess_sigma + 1e-3:
                reasons.append(f"attitude_differs_from_stars:{np.degrees(difference):.2f}deg")
        if abs(found.scale - 1.0) > 0.005:
            reasons.append(f"focal_length_wrong:{100.0 * (found.scale - 1.0):+.2f}%")
        return CameraAttitude(
            solution.rotation,
            solution.covariance,
            stars,
            is_from_stars=True,
            scale=found.scale,
            radial=found.radial,
            residual_rad=solution.residual,
            reasons=tuple(reasons),
            inputs=inputs,
        )

    def _is_contradicted(self, camera: CameraModel, given: FloatArray, snr: FloatArray) -> bool:
        """Return whether the given attitude predicts bright stars, and bright sources are elsewhere."""
        stars, _ = visible_stars(load_catalogue().brighter_than(_BRIGHT_MAGNITUDE), camera, given)
        return len(stars) >= _EXPECTED_STARS and int((snr > _BRIGHT_SNR).sum()) >= _BRIGHT_SOURCES
