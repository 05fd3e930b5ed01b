# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude of the camera: of the stars of an image, of a given attitude, or of both."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel
from cdff_common.errors import DegenerateGeometryError, FrameNotFoundError, InputError, RefusedError
from cdff_common.geometry import FrameGraph, se3
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Sample
from cdff_common.stars import earth_velocity_m_s, load_catalogue, visible_stars
from cdff_core.bearing_tracking.camera_attitude import CameraAttitude
from cdff_core.bearing_tracking.local_orbital import LocalOrbitalAxes
from cdff_core.dfns.attitude_from_directions.interface import AttitudeFromDirectionsInputs
from cdff_core.dfns.star_identification.interface import StarIdentificationInputs
from cdff_core.dfpcs.far_range_object_tracking.configuration import FarRangeObjectTrackingConfig

#: Interval between searches without an attitude, in images, after the first and after many failures.
_FIRST_PAUSE, _LAST_PAUSE = 2, 64
#: Growth of the uncertainty of the last attitude, rad/s, if none is given: the camera may turn.
_TURN_RAD_S = 0.002
#: A given attitude without matches is contradicted if it predicts at least this number of catalogue stars
#: brighter than this magnitude, and at least this number of sources has this signal-to-noise ratio.
_BRIGHT_MAGNITUDE, _EXPECTED_STARS, _BRIGHT_SOURCES, _BRIGHT_SNR = 6.0, 4, 8, 10.0
#: Signal-to-noise ratio from which a source may be a star: few false sources exceed it.
_STAR_SNR = 5.5
#: Age up to which a velocity in orbit is used: its change until then moves the stars by less than an
#: arcsecond.
_NAVIGATION_NS = 120_000_000_000
#: Gain of one image in the running mean of the errors of the lens, and least error, rad.
_LENS_GAIN, _LENS_LEAST = 0.1, 1e-6
#: Number of parameters that are adjusted to the stars.
_ADJUSTED = 5


class AttitudeEstimator:
    """Attitude of the camera at each image.

    Parameters
    ----------
    identify, solve : Dfn
        StarIdentification and AttitudeFromDirections.
    frames : FrameGraph
        Mounts of the sensors, for an attitude of another frame than that of the camera.
    """

    def __init__(
        self,
        identify: Dfn[Any, Any, Any],
        solve: Dfn[Any, Any, Any],
        config: FarRangeObjectTrackingConfig,
        frames: FrameGraph,
    ) -> None:
        self._identify, self._solve, self._config = identify, solve, config
        self._frames = frames
        self._given: Sample | None = None
        self._before: Sample | None = None  # the given attitude before the last one
        self._last: tuple[int, FloatArray] | None = None
        self._pause, self._wait = _FIRST_PAUSE, 0
        self._navigation: Sample | None = None
        self._lens_rad2 = config.catalogue_sigma_rad**2

    def give_navigation(self, sample: Sample) -> None:
        """Store the state of the carrier of the camera.

        Raises
        ------
        InputError
            If it is not finite, or not in the inertial frame.
        """
        velocity = np.asarray(sample.value.velocity, float)
        if not np.isfinite(velocity).all() or sample.value.target_frame not in ("", "inertial"):
            raise InputError(
                f"navigation: velocity {velocity.tolist()} in frame {sample.value.target_frame!r}, expected a"
                " finite one in 'inertial'"
            )
        self._navigation = sample

    def orbital_axes(self, stamp_ns: int) -> LocalOrbitalAxes | None:
        """Return the LVLH axes of the carrier at a time; None without a state that is new enough."""
        navigation = self._navigation
        if navigation is None or abs(stamp_ns - navigation.stamp_ns) >= _NAVIGATION_NS:
            return None
        state = navigation.value
        variances = [np.trace(c) / 3.0 for c in (state.cov_position, state.cov_velocity)]
        interval_s = (stamp_ns - navigation.stamp_ns) * 1e-9
        try:
            return LocalOrbitalAxes.of_state(state.pos, state.velocity, interval_s, *np.sqrt(variances))
        except DegenerateGeometryError:
            return None  # the state has no position, or does not belong to an orbit

    def _velocity_m_s(self, stamp_ns: int) -> FloatArray | None:
        """Return the velocity of the camera relative to the Sun, or None."""
        if self._config.observer == "sun":
            return None
        velocity = earth_velocity_m_s(stamp_ns)
        if self._navigation is not None and abs(stamp_ns - self._navigation.stamp_ns) < _NAVIGATION_NS:
            velocity = velocity + self._navigation.value.velocity
        return velocity

    def give(self, sample: Sample) -> None:
        """Store a given attitude."""
        self._before, self._given = self._given, sample

    @property
    def has_given(self) -> bool:
        """True if an attitude was given."""
        return self._given is not None

    def estimate(
        self,
        stamp_ns: int,
        camera: CameraModel,
        pixels: FloatArray,
        sigmas_px: FloatArray,
        snr: FloatArray,
        camera_frame: str,
    ) -> CameraAttitude:
        """Return the attitude at an image with sources at ``pixels`` (n, 2), brightest first."""
        none = np.zeros(len(pixels), bool)
        reasons: list[str] = []
        try:
            R_stated, sigma_rad, inputs = self._given_at(stamp_ns, camera_frame)
        except FrameNotFoundError:
            R_stated, sigma_rad, inputs = None, 0.0, ()
            reasons.append("mount_of_attitude_unknown")
        if self._config.use_stars:
            guess, guess_sigma = R_stated, sigma_rad
            if guess is None and self._last is not None:
                last_ns, R_last = self._last
                age_s = (stamp_ns - last_ns) * 1e-9
                guess, guess_sigma = R_last, 1e-3 + _TURN_RAD_S * age_s
                guess = guess if guess_sigma < 0.05 else None
            try:
                return self._from_stars(
                    stamp_ns, camera, pixels, sigmas_px, snr, guess, guess_sigma, R_stated, inputs
                )
            except (RefusedError, DegenerateGeometryError) as error:
                reasons += list(getattr(error, "reasons", ())) or ["stars_degenerate"]
        if R_stated is not None:
            if self._config.use_stars and self._is_contradicted(camera, R_stated, snr):
                reasons.append("attitude_or_camera_wrong")
                return CameraAttitude(None, np.zeros((3, 3)), none, reasons=tuple(reasons), inputs=inputs)
            reasons = [reason for reason in reasons if not reason.startswith("few_stars")]
            covariance = np.eye(3) * self._config.attitude_noise_rad**2
            return CameraAttitude(
                R_stated,
                covariance,
                none,
                reasons=tuple(reasons),
                inputs=inputs,
                bias_rad=sigma_rad,
                lens_rad=float(np.sqrt(self._lens_rad2)),
            )
        reasons.append("attitude_missing")
        return CameraAttitude(None, np.zeros((3, 3)), none, reasons=tuple(reasons))

    def _given_at(self, stamp_ns: int, camera_frame: str) -> tuple[FloatArray | None, float, tuple[str, ...]]:
        """Return the given attitude of the camera at a time, its standard deviation and its id, or None.

        Raises
        ------
        FrameNotFoundError
            If the attitude is that of another frame, whose mount is not known.
        """
        attitude_sample = self._given
        if (
            attitude_sample is None
            or abs(stamp_ns - attitude_sample.stamp_ns) > self._config.attitude_age_s * 1e9
        ):
            return None, 0.0, ()
        transform = attitude_sample.value.transform
        sigma = np.radians(self._config.attitude_sigma_deg)
        covariance = transform.covariance
        if covariance is not None and np.isfinite(covariance[3:, 3:]).all() and covariance[3:, 3:].any():
            sigma = max(float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1])), 1e-7)
        R = transform.matrix[:3, :3]
        if attitude_sample.stamp_ns != stamp_ns and self._before is not None:
            # The rate of the camera is that between the last two attitudes.
            previous = self._before.value.transform.matrix[:3, :3]
            fraction = (stamp_ns - attitude_sample.stamp_ns) / (
                attitude_sample.stamp_ns - self._before.stamp_ns
            )
            turn = se3.log_so3(R @ previous.T) * fraction
            R = se3.exp_so3(turn) @ R
            sigma = float(np.hypot(sigma, 0.1 * np.linalg.norm(turn)))
        child = attitude_sample.value.child_frame
        if child and child != camera_frame:
            R = R @ self._frames.lookup(child, camera_frame, stamp_ns).matrix[:3, :3]
        return R, float(sigma), (attitude_sample.id,)

    def _from_stars(
        self,
        stamp_ns: int,
        camera: CameraModel,
        pixels: FloatArray,
        sigmas_px: FloatArray,
        snr: FloatArray,
        guess: FloatArray | None,
        guess_sigma: float,
        R_stated: FloatArray | None,
        inputs: tuple[str, ...],
    ) -> CameraAttitude:
        """Return the attitude from identified stars; raises RefusedError if they are not identified."""
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
            identification = self._identify.process(
                StarIdentificationInputs(
                    directions=rays[usable],
                    sigmas=sigmas,
                    stamp=stamp_ns,
                    attitude=guess,
                    attitude_sigma=guess_sigma,
                    velocity=self._velocity_m_s(stamp_ns),
                )
            )
        except RefusedError:
            self._last, self._wait = None, self._pause
            self._pause = min(2 * self._pause, _LAST_PAUSE)
            raise
        is_identified = identification.stars >= 0
        solution = self._solve.process(
            AttitudeFromDirectionsInputs(
                directions=identification.corrected[is_identified],
                references=identification.star_directions[is_identified],
                sigmas=sigmas[is_identified],
            )
        )
        self._last, self._pause, self._wait = (stamp_ns, solution.rotation), _FIRST_PAUSE, 0
        self._measure_lens(solution.residual, sigmas_px[usable[is_identified]] / camera.fx)
        stars = np.zeros(len(pixels), bool)
        stars[usable[is_identified]] = True
        reasons = []
        if identification.is_ambiguous:
            reasons.append("few_stars")
        if R_stated is not None:
            difference = float(se3.rotation_angle(solution.rotation @ R_stated.T))
            if difference > 5.0 * guess_sigma + 1e-3:
                reasons.append(f"attitude_differs_from_stars:{np.degrees(difference):.2f}deg")
        if abs(identification.scale - 1.0) > 0.005:
            reasons.append(f"focal_length_wrong:{100.0 * (identification.scale - 1.0):+.2f}%")
        return CameraAttitude(
            solution.rotation,
            solution.covariance,
            stars,
            is_from_stars=True,
            scale=identification.scale,
            radial=identification.radial,
            residual_rad=solution.residual,
            reasons=tuple(reasons),
            inputs=inputs,
            lens_rad=float(np.sqrt(self._lens_rad2)),
        )

    def _measure_lens(self, residual_rad: float, noise_rad: FloatArray) -> None:
        """Add the excess of the residuals of the stars over their noise to the errors of the lens.

        Five parameters are adjusted to the 2 n coordinates: rotation, focal length, distortion.
        """
        n = len(noise_rad)
        if 2 * n <= 2 * _ADJUSTED:
            return
        variance = 0.5 * residual_rad**2 * 2.0 * n / (2.0 * n - _ADJUSTED)
        excess = variance - float(np.mean(noise_rad**2))
        self._lens_rad2 += _LENS_GAIN * (excess - self._lens_rad2)
        self._lens_rad2 = max(self._lens_rad2, _LENS_LEAST**2)

    def _is_contradicted(self, camera: CameraModel, R_stated: FloatArray, snr: FloatArray) -> bool:
        """Return whether the given attitude predicts bright stars, and bright sources are elsewhere."""
        stars, _ = visible_stars(load_catalogue().brighter_than(_BRIGHT_MAGNITUDE), camera, R_stated)
        return len(stars) >= _EXPECTED_STARS and int((snr > _BRIGHT_SNR).sum()) >= _BRIGHT_SOURCES
