# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of a camera of the servicer: light of bodies, Earth, stars and Sun, lens, exposure and detector."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from cdff_common.clock import NS_PER_S
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.stars import add_sources, earth_velocity_m_s, electron_rates, load_catalogue, visible_stars
from cdff_dev.simulate.faults.camera import blurred
from cdff_dev.simulate.orbit.camera_view import CameraRays, View
from cdff_dev.simulate.orbit.detector import Detector
from cdff_dev.simulate.orbit.environment import SUN_MAGNITUDE
from cdff_dev.simulate.orbit.materials import Float32Array
from cdff_dev.simulate.orbit.motion import Light
from cdff_dev.simulate.orbit.random_streams import generator, number_of
from cdff_dev.simulate.orbit.sensors import Camera, off_axis_rad
from cdff_dev.simulate.orbit.world import OrbitWorld

#: Percentile of the brightness of the client's pixels by which the exposure is controlled.
_BRIGHT = 99.0
#: Motion during the exposure below which the image is not blurred, pixels.
_STILL_PX = 0.25
#: Factor by which the image is reduced before the halo is computed, and angular radius of the Sun at 1 au,
#: rad.
_HALO_STEP, _SUN_RAD = 8, 0.00465


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """An image with its truth.

    Attributes
    ----------
    image : ndarray uint8 or uint16 (rows, columns)
    exposure_s : float
    mask : ndarray uint8 (rows, columns)
        Body in each pixel: 1 client, then companions, then parts of the servicer; 0 none.
    centroids_px : ndarray (4,)
        Column and row of the middle of the client's visible surface, and of its light; NaN if it is not seen.
    box_px : ndarray (4,)
        Column and row of the first pixel, width and height of the client; 0 if it is not seen.
    sun : ndarray (4,)
        Unit vector to the Sun, camera axes, and the visible fraction of its disc.
    points_m : ndarray float32 (k, 3)
        Visible points of the client, camera axes.
    T_camera_body : dict of str to ndarray (4, 4)
    lit : float
        Fraction of the client's visible surface in sunlight.
    """

    image: NDArray[np.uint8] | NDArray[np.uint16]
    exposure_s: float
    mask: NDArray[np.uint8]
    centroids_px: FloatArray
    box_px: FloatArray
    sun: FloatArray
    points_m: Float32Array
    T_camera_body: dict[str, FloatArray]
    lit: float


class CameraSimulator:
    """Makes the images of one camera."""

    def __init__(self, world: OrbitWorld, name: str) -> None:
        self.world, self.name = world, name
        self.model: Camera = world.scenario.servicer.cameras[name]
        self.rays = CameraRays(self.model)
        self._detector = Detector(self.model, generator(world.scenario, "detector", number_of(name)))
        self._sun_e_s = self.model.zero_point_e_s * 10.0 ** (-0.4 * SUN_MAGNITUDE)

    def image(self, t_s: float, index: int) -> CameraImage:
        """Return the image at the middle of the exposure ``t_s``; ``index`` selects the random numbers."""
        world, _model = self.world, self.model
        row_s = t_s + self._row_delays_s()
        view = self.rays.render(world.placed(row_s))
        light = world.motion.light(t_s)
        if light.earth_m is not None:
            self._add_earth(view, t_s, light)
        exposure_s = self._exposure_s(view)
        electrons = self._electrons(view, t_s, light, exposure_s)
        rng = generator(world.scenario, "image", number_of(self.name), index)
        image = self._detector.read(electrons, exposure_s, rng)
        return self._with_truth(view, image, exposure_s, t_s, light)

    def _row_delays_s(self) -> FloatArray:
        """Return the delay of the exposure of each row, (rows,); (1,) for a global shutter."""
        if self.model.readout_s == 0.0:
            return np.zeros(1)
        return np.linspace(0.0, self.model.readout_s, self.model.rows)

    def _attitude(self, t_s: float) -> FloatArray:
        """Return ``R_inertial_camera`` (3, 3)."""
        R = self.world.motion.base_attitudes(np.array([t_s]))[0] @ self.model.T_base_camera[:3, :3]
        return np.asarray(R)

    # -- light

    def _add_earth(self, view: View, t_s: float, light: Light) -> None:
        """Add the light of the Earth to the view, if it is in the field."""
        assert light.earth_m is not None  # the scenario has an Earth
        R = self._attitude(t_s)
        down = -light.earth_m / np.linalg.norm(light.earth_m)
        radius = math.asin(min(6_500_000.0 / float(np.linalg.norm(light.earth_m)), 1.0))
        corners = self.rays.directions.reshape(self.model.rows, self.model.columns, 3)[
            [0, 0, -1, -1], [0, -1, 0, -1]
        ]
        half_field = max(off_axis_rad(np.array([0.0, 0.0, 1.0]), c.astype(float)) for c in corners)
        if off_axis_rad(R[:, 2], down) > radius + half_field:
            return
        empty_pixels = np.flatnonzero(view.number.ravel() == 0)
        directions = self.rays.directions[empty_pixels] @ R.T.astype(np.float32)
        view.radiance.ravel()[empty_pixels] = self.world.earth_radiance(directions, t_s, light)

    def _exposure_s(self, view: View) -> float:
        """Return the exposure time that brings the bright part of the client to its target signal."""
        exposure = self.model.exposure
        if exposure.time_s is not None:
            return exposure.time_s
        rates = np.zeros(1)
        of_client = (view.number == 1) & (view.radiance > 0.0)
        if of_client.any():
            rates = (view.radiance[of_client] * self.rays.solid_angle[of_client]).astype(float)
        for source in view.sources:
            if source.number == 1:
                spread = 2.0 * math.pi * self.model.psf_sigma_px**2 + float(
                    np.prod(np.ptp(source.pixels, axis=0) + 0.1)
                )
                rates = np.array([source.radiance_sr.sum() / spread])
        bright = float(np.percentile(rates, _BRIGHT)) * self._sun_e_s
        target_electrons = exposure.target * self.model.full_well_e
        if bright * exposure.max_s <= target_electrons:
            return exposure.max_s
        return float(max(target_electrons / bright, exposure.min_s))

    def _electrons(self, view: View, t_s: float, light: Light, exposure_s: float) -> Float32Array:
        """Return the expected photoelectrons (rows, columns) of all light."""
        model = self.model
        R, trail = self._attitude(t_s), None
        if float(view.radiance.max(initial=0.0)) > 0.0:
            electrons = view.radiance * self.rays.solid_angle * np.float32(self._sun_e_s * exposure_s)
            trail = self._displacements_px(view, t_s, exposure_s)
            if trail is not None:
                electrons = blurred(electrons, trail)
            electrons = _spread(electrons, model.psf_sigma_px)
        else:
            electrons = np.zeros((model.rows, model.columns), np.float32)
        for source in view.sources:
            ends = self._source_ends(source.name, t_s, exposure_s)
            signal = source.radiance_sr * (self._sun_e_s * exposure_s)
            lit = signal > 0.0
            add_sources(electrons, source.pixels[lit], signal[lit], model.psf_sigma_px, ends)
        if model.stars:
            self._add_stars(electrons, view, t_s, exposure_s)
        self._add_sun(electrons, view, R, light, exposure_s)
        if model.halo > 0.0:
            electrons = _add_halo(electrons, model.halo, model.halo_sigma_px)
        return electrons

    def _displacements_px(self, view: View, t_s: float, exposure_s: float) -> FloatArray | None:
        """Return the motion of each pixel's point (rows, columns, 2) in the exposure, None if small.

        Points of bodies move with them; the Earth moves with the rotation of the camera.
        """
        model, motion = self.model, self.world.motion
        ends_s = np.array([t_s - 0.5 * exposure_s, t_s + 0.5 * exposure_s])
        rotations = [self._attitude(float(end)) for end in ends_s]
        relative_rotations = [rotations[i].T @ self._attitude(t_s) for i in (0, 1)]
        corners = self.rays.directions.reshape(model.rows, model.columns, 3)[[0, 0, -1, -1], [0, -1, 0, -1]]
        K = model.focal_px
        shift = _project_directions(corners @ relative_rotations[1].T) - _project_directions(
            corners @ relative_rotations[0].T
        )
        moving = float(np.abs(shift).max()) * K > _STILL_PX
        displacement = None
        if moving:
            ends = [_project_directions(self.rays.directions.astype(float) @ R.T) for R in relative_rotations]
            displacement = ((ends[1] - ends[0]) * K).reshape(model.rows, model.columns, 2)
        T_camera_base = se3.inverse(model.T_base_camera)
        scenario = self.world.scenario
        for number, body in enumerate((*scenario.bodies, *scenario.servicer.body), start=1):
            at = np.flatnonzero(view.number.ravel() == number)
            if not len(at):
                continue
            if number > len(scenario.bodies):
                if displacement is not None:
                    displacement.reshape(-1, 2)[at] = 0.0
                continue
            T = T_camera_base @ motion.poses_in_base(body.name, np.append(ends_s, t_s))
            points = view.points_m.reshape(-1, 3)[at].astype(float)
            points_at_ends = [
                points @ (T[i] @ se3.inverse(T[2]))[:3, :3].T + (T[i] @ se3.inverse(T[2]))[:3, 3]
                for i in (0, 1)
            ]
            step = (_project_directions(points_at_ends[1]) - _project_directions(points_at_ends[0])) * K
            if float(np.abs(step).max()) > _STILL_PX or displacement is not None:
                if displacement is None:
                    displacement = np.zeros((model.rows, model.columns, 2))
                displacement.reshape(-1, 2)[at] = step
        if displacement is not None:
            # The light of a body moves over its silhouette: dark pixels take the motion of the nearest point.
            dark = (view.number == 0) & (view.radiance == 0.0)
            nearest = distance_transform_edt(dark, return_distances=False, return_indices=True)
            displacement = displacement[nearest[0], nearest[1]]
        return displacement

    def _source_ends(self, name: str, t_s: float, exposure_s: float) -> FloatArray:
        """Return the displacement (2,) of a distant body during the exposure."""
        ends_s = np.array([t_s - 0.5 * exposure_s, t_s + 0.5 * exposure_s])
        T = se3.inverse(self.model.T_base_camera) @ self.world.motion.poses_in_base(name, ends_s)
        pixels = self.model.model.project(T[:, :3, 3])
        step = pixels[1] - pixels[0]
        return step if np.isfinite(step).all() else np.zeros(2)

    def _add_stars(self, electrons: Float32Array, view: View, t_s: float, exposure_s: float) -> None:
        """Add the stars that no body or Earth hides, with proper motion and aberration."""
        scenario, model = self.world.scenario, self.model
        stamp_ns = scenario.epoch_ns + round(t_s * NS_PER_S)
        velocity = np.zeros(3)
        if scenario.orbit is not None:
            velocity = earth_velocity_m_s(stamp_ns) + self.world.motion.servicer_states(np.array([t_s]))[1][0]
        catalogue = load_catalogue().apparent(stamp_ns, velocity)
        camera = model.model
        index, pixels = visible_stars(catalogue, camera, self._attitude(t_s), margin_px=20.0)
        if not len(index):
            return
        directions = catalogue.directions[index]
        rate = self._star_rates_px_s(directions, t_s)
        if model.readout_s > 0.0:
            pixels = pixels + rate * (model.readout_s * pixels[:, 1:] / max(model.rows - 1, 1))
        column = np.clip(np.rint(pixels[:, 0]), 0, model.columns - 1).astype(np.intp)
        row = np.clip(np.rint(pixels[:, 1]), 0, model.rows - 1).astype(np.intp)
        visible = (view.number[row, column] == 0) & ~self._behind_earth(directions, t_s)
        signals = electron_rates(catalogue.magnitudes[index[visible]], model.zero_point_e_s) * exposure_s
        add_sources(electrons, pixels[visible], signals, model.psf_sigma_px, rate[visible] * exposure_s)

    def _star_rates_px_s(self, directions: FloatArray, t_s: float) -> FloatArray:
        """Return the image motion (n, 2) of stars by the rotation of the camera, pixels per second."""
        half_step_s = 5e-3
        ends = [self.model.model.project(directions @ self._attitude(t_s + s * half_step_s)) for s in (-1, 1)]
        rate = (ends[1] - ends[0]) / (2.0 * half_step_s)
        return np.where(np.isfinite(rate), rate, 0.0)

    def _behind_earth(self, directions: FloatArray, t_s: float) -> NDArray[np.bool_]:
        earth_m = self.world.motion.light(t_s).earth_m
        if earth_m is None:
            return np.zeros(len(directions), dtype=bool)
        distance = float(np.linalg.norm(earth_m))
        return np.asarray(
            directions @ (-earth_m / distance) > math.cos(math.asin(min(6_390_000.0 / distance, 1.0)))
        )

    def _add_sun(
        self,
        electrons: Float32Array,
        view: View,
        R_inertial_camera: FloatArray,
        light: Light,
        exposure_s: float,
    ) -> None:
        """Add the disc of the Sun, and its light scattered in the lens."""
        model = self.model
        if light.sunlit == 0.0:
            return
        sun = R_inertial_camera.T @ light.to_sun
        angle = off_axis_rad(np.array([0.0, 0.0, 1.0]), sun)
        signal = self._sun_e_s * light.irradiance * light.sunlit * exposure_s
        if model.stray > 0.0 and angle < math.radians(model.hood_deg):
            # The scattered light decreases with the square of the angle; the hood's edge is 10° wide.
            entering = min((math.radians(model.hood_deg) - angle) / math.radians(10.0), 1.0)
            cosine = np.clip(self.rays.directions @ sun.astype(np.float32), -1.0, 1.0)
            off = np.maximum(np.arccos(cosine), np.float32(math.radians(1.0))).reshape(electrons.shape)
            veil = model.stray * entering * signal * (math.radians(30.0) / off) ** 2
            electrons += (veil * self.rays.solid_angle).astype(np.float32)
        if angle > math.radians(80.0):
            return
        pixel = model.model.project(sun[None])[0]
        if (
            not np.isfinite(pixel).all()
            or (pixel < -50.0).any()
            or (pixel > [model.columns + 50, model.rows + 50]).any()
        ):
            return
        column, row = (
            int(np.clip(round(v), 0, n - 1)) for v, n in zip(pixel, (model.columns, model.rows), strict=True)
        )
        if view.number[row, column] == 0:
            radius_px = max(_SUN_RAD * model.focal_px, model.psf_sigma_px)
            add_sources(electrons, pixel[None], [signal], radius_px)

    # -- truth

    def _with_truth(
        self,
        view: View,
        image: NDArray[np.uint8] | NDArray[np.uint16],
        exposure_s: float,
        t_s: float,
        light: Light,
    ) -> CameraImage:
        """Return the image with the true poses and the client's visible fraction."""
        T_camera_base = se3.inverse(self.model.T_base_camera)
        scenario, times = self.world.scenario, np.array([t_s])
        poses = {
            body.name: (T_camera_base @ self.world.motion.poses_in_base(body.name, times))[0]
            for body in scenario.bodies
        }
        u, v, weight = _client_samples(view, self.rays.solid_angle)
        inside = (u > -0.5) & (u < self.model.columns - 0.5) & (v > -0.5) & (v < self.model.rows - 0.5)
        u, v, weight = u[inside], v[inside], weight[inside]
        centroids, box, lit = np.full(4, np.nan), np.zeros(4), 0.0
        if len(u):
            centroids[:2] = u.mean(), v.mean()
            if weight.sum() > 0.0:
                centroids[2:] = (u * weight).sum() / weight.sum(), (v * weight).sum() / weight.sum()
            first = np.floor([u.min() + 0.5, v.min() + 0.5])
            box = np.concatenate([first, np.floor([u.max() + 0.5, v.max() + 0.5]) - first + 1.0])
            lit = float(np.mean(weight > 0.05 * weight.max(initial=0.0))) if weight.max() > 0.0 else 0.0
        sun = self._attitude(t_s).T @ light.to_sun
        return CameraImage(
            image,
            exposure_s,
            view.number,
            centroids,
            box,
            np.append(sun, light.sunlit),
            _client_points(view, scenario.truth_points),
            poses,
            lit,
        )


def _client_samples(view: View, solid_angle: Float32Array) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return columns, rows and light (n,) of the visible surface of the client."""
    for source in view.sources:
        if source.number == 1:
            return source.pixels[:, 0], source.pixels[:, 1], source.radiance_sr
    row, column = np.nonzero(view.number == 1)
    light = view.radiance[row, column] * solid_angle[row, column]
    return column.astype(float), row.astype(float), light.astype(float)


def _client_points(view: View, count: int) -> Float32Array:
    """Return at most ``count`` visible points (k, 3) of the client, evenly chosen over its pixels."""
    points = next((s.points_m.astype(np.float32) for s in view.sources if s.number == 1), None)
    if points is None:
        points = view.points_m[view.number == 1]
    if count == 0 or not len(points):
        return points[:0]
    chosen = np.unique(np.linspace(0, len(points) - 1, min(count, len(points))).astype(np.intp))
    return np.asarray(points[chosen])


def _spread(electrons: Float32Array, sigma_px: float) -> Float32Array:
    """Return the image after the point spread, computed around its light only."""
    rows, columns = np.flatnonzero(electrons.any(axis=1)), np.flatnonzero(electrons.any(axis=0))
    margin = math.ceil(4.0 * sigma_px) + 1
    window = (
        slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
        slice(max(columns[0] - margin, 0), columns[-1] + margin + 1),
    )
    electrons[window] = gaussian_filter(electrons[window], sigma_px, mode="constant", truncate=4.0)
    return electrons


def _add_halo(electrons: Float32Array, fraction: float, sigma_px: float) -> Float32Array:
    """Return the image with a fraction of its light spread over a wide halo."""
    rows, columns = electrons.shape
    small_shape = (max(columns // _HALO_STEP, 1), max(rows // _HALO_STEP, 1))
    small = cv2.resize(electrons, small_shape, interpolation=cv2.INTER_AREA)
    wide = gaussian_filter(small, sigma_px / _HALO_STEP, mode="constant", truncate=3.0)
    halo = cv2.resize(wide, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.float32(1.0 - fraction) * electrons + np.float32(fraction) * halo)


def _project_directions(directions: NDArray[np.floating]) -> FloatArray:
    """Return x/z and y/z (n, 2) of directions (n, 3)."""
    d = np.asarray(directions, dtype=float)
    return np.asarray(d[:, :2] / np.maximum(d[:, 2:], 1e-6))
