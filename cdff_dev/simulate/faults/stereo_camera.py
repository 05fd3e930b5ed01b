# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The stereo camera with the faults of a scenario: renders pairs of a rover that moves meanwhile."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.camera import StereoCamera, View, pixel_rays
from cdff_dev.simulate.faults.camera import CalibrationError, CameraFaults, blurred, dust_map, veil
from cdff_dev.simulate.faults.solids import Solid, SolidHits, body_solids, cast, object_solids
from cdff_dev.simulate.rover_motion import Motion
from cdff_dev.simulate.scenario import Navcam
from cdff_dev.simulate.surface import Float32Array, sun_direction
from cdff_dev.simulate.world import World, generator

#: Depth of the sky for the computation of image motion, metres.
_SKY_M = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """One camera of the pair, as it truly is.

    Attributes
    ----------
    K : NDArray[np.float64], shape (3, 3)
        True intrinsics, pixels.
    rays : NDArray[np.float64], shape (n, 3)
        True directions of the pixels in the camera frame, depth 1.
    T_base_camera : NDArray[np.float64], shape (4, 4)
    dust : NDArray[np.float32], shape (rows, columns)
        Fraction of the light that dust on the lens removes.
    """

    K: FloatArray
    rays: FloatArray
    T_base_camera: FloatArray
    dust: Float32Array


def draw_eyes(model: Navcam, faults: CameraFaults, rng: np.random.Generator) -> tuple[Eye, Eye]:
    """Return left and right camera, with calibration errors and dust."""
    error = faults.calibration or CalibrationError()
    focal, baseline = 1.0 + rng.standard_normal(2) * [error.focal_sigma, error.baseline_sigma]
    points_px = error.principal_point_sigma_px * rng.standard_normal((2, 2))
    k1 = error.distortion_sigma * rng.standard_normal(2)
    R_mount = se3.exp_so3(math.radians(error.mount_sigma_deg) * rng.standard_normal(3))
    R_right = se3.exp_so3(math.radians(error.rotation_sigma_deg) * rng.standard_normal(3))
    T_base_left = model.T_base_left @ se3.transform(R_mount, np.zeros(3))
    T_left_right = se3.transform(R_right, [baseline * model.baseline_m, 0.0, 0.0])
    eyes = []
    for k, T in enumerate((T_base_left, T_base_left @ T_left_right)):
        K = model.camera_matrix
        K[[0, 1], [0, 1]] *= focal
        K[:2, 2] += points_px[k]
        lost = np.zeros((model.rows, model.columns), dtype=np.float32)
        if faults.dust is not None:
            lost = dust_map(faults.dust, model.rows, model.columns, rng)
        eyes.append(Eye(K, pixel_rays(model, K, float(k1[k])), T, lost))
    return eyes[0], eyes[1]


class FaultyStereoCamera:
    """Renders the stereo pairs of one rover, with the faults of the scenario."""

    def __init__(self, world: World, robot: str, camera: StereoCamera) -> None:
        scenario = world.scenario
        assert scenario.navcam is not None  # the caller has made its camera
        assert scenario.faults is not None  # the caller has checked it
        assert scenario.terrain.surface is not None  # required by the scenario for cameras
        self._model, self._camera, self._world = scenario.navcam, camera, world
        self._motion: Motion = world.motions[robot]
        self._all_faults = scenario.faults
        self._faults = scenario.faults.camera or CameraFaults()
        self._surface = scenario.terrain.surface
        self._sun = sun_direction(scenario.terrain.surface)
        index = sorted(scenario.robots).index(robot)
        self._eyes = draw_eyes(self._model, self._faults, generator(scenario, "fault_camera_rig", index))

    def pair(
        self, t_s: float, rng: np.random.Generator, fault_rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return left and right image ``(rows, columns)`` stamped ``t_s``, seconds since the epoch."""
        exposures = self._camera.exposures(rng)
        exposure = self._faults.exposure
        if exposure is not None:
            exposures = exposures * 2.0 ** (
                exposure.stops + exposure.stops_sigma * fault_rng.standard_normal()
            )
        left, right = (
            self._camera.expose(self.radiance(eye, t_s), float(e), rng)
            for eye, e in zip(self._eyes, exposures, strict=True)
        )
        return left, right

    def radiance(self, eye: Eye, t_s: float) -> Float32Array:
        """Return the relative radiance ``(rows, columns)`` behind the lens of one camera."""
        model = self._model
        row_t_s = t_s + self._row_delays_s()
        T_site_base = self._motion.poses(row_t_s)
        T_site_camera = T_site_base @ eye.T_base_camera
        view = self._camera.view(T_site_camera, eye.rays)
        solids = self._solids(T_site_base, row_t_s)
        hits = self._solid_hits(view, solids)
        image, depth_m = self._with_solids(view, hits, solids)
        if self._faults.exposure is not None and self._faults.exposure.time_s > 0.0:
            displacement = self._displacement_px(eye, view, hits, depth_m, row_t_s)
            image = blurred(image, displacement)
        if self._faults.glare is not None and self._sees_sun(T_site_camera[0, :3, 3]):
            unit = view.directions / np.linalg.norm(view.directions, axis=1, keepdims=True)
            glow = veil(self._faults.glare, unit, T_site_camera[0, :3, 2], self._sun)
            image = image + glow.reshape(model.rows, model.columns).astype(np.float32)
        if self._faults.dust is not None:
            sky = np.float32(self._faults.dust.scatter * self._camera.sky)
            image = image * (1 - eye.dust) + sky * eye.dust
        return image

    def _sees_sun(self, point_m: FloatArray) -> bool:
        return bool(self._camera.sunlit(point_m.astype(np.float32)[None], self._sun)[0])

    def _row_delays_s(self) -> FloatArray:
        shutter = self._faults.rolling_shutter
        readout_s = 0.0 if shutter is None else shutter.readout_s
        return np.linspace(0.0, readout_s, self._model.rows)

    def _solid_hits(self, view: View, solids: list[Solid]) -> SolidHits:
        shape = (self._model.rows, self._model.columns, 3)
        origins = np.asarray(view.origin_m, dtype=np.float64).reshape(shape)[:, :1]
        return cast(solids, origins, view.directions.astype(np.float64).reshape(shape))

    def _solids(self, T_site_base: FloatArray, t_s: FloatArray) -> list[Solid]:
        faults = self._all_faults
        return [
            *body_solids(faults.body or (), T_site_base, t_s),
            *object_solids(faults.objects or (), self._world.relief, t_s),
        ]

    def _with_solids(
        self, view: View, hits: SolidHits, solids: list[Solid]
    ) -> tuple[Float32Array, Float32Array]:
        """Return radiance and depth ``(rows, columns)`` with the solids and their shadows."""
        rows, columns = hits.t.shape
        image = view.radiance.reshape(rows, columns).copy()
        depth = view.depth_m.reshape(rows, columns)
        if not solids:
            return image, depth
        ambient = self._surface.ambient
        points = (
            np.asarray(view.origin_m, dtype=np.float64)
            + view.directions * np.where(np.isfinite(view.depth_m), view.depth_m, 0.0)[:, None]
        )
        to_sun = np.broadcast_to(self._sun, (rows, columns, 3))
        shaded = np.isfinite(cast(solids, points.reshape(rows, columns, 3), to_sun).t) & np.isfinite(depth)
        pixels = np.flatnonzero(shaded)
        lit = self._camera.sunlit(points[pixels].astype(np.float32), self._sun)
        direct = (1.0 - ambient) * np.clip(view.normals[pixels] @ self._sun, 0.0, None) * lit
        image.ravel()[pixels] *= (ambient / (ambient + direct)).astype(np.float32)
        nearer = hits.t < depth
        cosine = np.clip(hits.normals[nearer] @ self._sun, 0.0, None)
        image[nearer] = hits.albedo[nearer] * (ambient + (1.0 - ambient) * cosine)
        return image, np.where(nearer, hits.t, depth).astype(np.float32)

    def _displacement_px(
        self, eye: Eye, view: View, hits: SolidHits, depth_m: Float32Array, t_s: FloatArray
    ) -> FloatArray:
        """Return the image motion ``(rows, columns, 2)`` of each pixel during the exposure."""
        assert self._faults.exposure is not None  # checked by the caller
        half_s = 0.5 * self._faults.exposure.time_s
        rows, columns = depth_m.shape
        depth = np.where(np.isfinite(depth_m), depth_m, _SKY_M)
        origin = np.asarray(view.origin_m, dtype=np.float64).reshape(rows, columns, 3)
        points = origin + view.directions.reshape(rows, columns, 3) * depth[..., None]
        on_solid = hits.t <= depth
        velocity = np.where(on_solid[..., None], hits.velocity_m_s, 0.0)
        ends = []
        for dt in (-half_s, half_s):
            T_camera_site = se3.inverse(self._motion.poses(t_s + dt) @ eye.T_base_camera)
            at = np.einsum("rij,rcj->rci", T_camera_site[:, :3, :3], points + dt * velocity)
            at += T_camera_site[:, None, :3, 3]
            ends.append(at[..., :2] / np.maximum(at[..., 2:], 1e-3))
        displacement = (ends[1] - ends[0]) * np.array([eye.K[0, 0], eye.K[1, 1]])
        displacement[on_solid & hits.on_rover] = 0.0
        return np.asarray(displacement)
