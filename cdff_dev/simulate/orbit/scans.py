# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scans of a lidar of the servicer: beams at their own times, mixed echoes, noise and lost echoes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.lidar import Scan
from cdff_dev.simulate.orbit.body_scene import Hits
from cdff_dev.simulate.orbit.materials import Float32Array, reflected, tilted
from cdff_dev.simulate.orbit.random_streams import generator, number_of
from cdff_dev.simulate.orbit.sensors import OrbitLidar
from cdff_dev.simulate.orbit.world import OrbitWorld, PlacedBody

#: Longest time between two poses of a scan, seconds: beams between them share a pose.
_POSE_STEP_S = 2e-3
#: Difference of neighbouring ranges at which a beam is divided into parts, metres, and the offsets of the
#: parts relative to the divergence.
_EDGE_M = 0.05
_PARTS = 0.35 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
#: Limits of the range noise, relative to ``range_sigma_m``, and relative variation of the intensity.
_SIGMA_LIMITS, _SPECKLE = (0.3, 6.0), 0.08


class LidarSimulator:
    """Makes the scans of one lidar."""

    def __init__(self, world: OrbitWorld, name: str) -> None:
        self.world, self.name = world, name
        self.model: OrbitLidar = world.scenario.servicer.lidars[name]
        unit = generator(world.scenario, "lidar_unit", number_of(name))
        self._bias_m = self.model.range_bias_sigma_m * unit.standard_normal()
        self._azimuth, self._elevation = _angles(self.model)
        self.directions: Float32Array = _unit_vectors(self._azimuth, self._elevation)
        self._T_base_lidar = self.model.mount.matrix()

    def scan(self, t0_s: float, index: int) -> Scan:
        """Return the scan that starts at ``t0_s``; ``index`` selects the random numbers."""
        offsets_s = self.beam_times_s()
        step = self._beams_per_pose()
        pose_s = t0_s + offsets_s[step // 2 :: step]
        bodies = self.world.placed(pose_s)
        beams = np.arange(len(offsets_s))
        range_m, signal = self._echoes(bodies, self.directions, beams // step)
        self._divide_beams(bodies, range_m, signal, step)
        rng = generator(self.world.scenario, "scan", number_of(self.name), index)
        return self._measure_echoes(range_m, signal, offsets_s, rng)

    def beam_times_s(self) -> FloatArray:
        """Return the time (n,) of each beam since the start of the scan, row by row."""
        n = self.model.rows * self.model.columns
        return np.asarray(np.arange(n) * (self.model.sweep_s / n), dtype=np.float64)

    def _beams_per_pose(self) -> int:
        """Return the number of consecutive beams with one pose, a divisor of the number of beams."""
        model = self.model
        n = model.rows * model.columns
        if model.sweep_s == 0.0:
            return n
        most = max(int(_POSE_STEP_S / model.sweep_s * n), 1)
        return next(k for k in range(min(most, n), 0, -1) if n % k == 0)

    def _echoes(
        self, bodies: list[PlacedBody], directions: Float32Array, pose: NDArray[np.intp]
    ) -> tuple[Float32Array, Float32Array]:
        """Return range (n,), infinite without echo, and signal (n,) of beams (n, 3) with poses (n,).

        The signal is that of the echo relative to a white surface at ``reference_m`` at right angles.
        """
        range_m = np.full(len(directions), np.inf, dtype=np.float32)
        signal = np.zeros(len(directions), dtype=np.float32)
        for body in bodies:
            T = se3.inverse(body.T_base_body) @ self._T_base_lidar  # T_body_lidar
            candidates = _candidates(body, T, directions)
            if not len(candidates):
                continue
            hits = body.scene.cast(directions, T, candidates, pose)
            at = candidates[hits.ray]
            nearer = hits.distance_m < range_m[at]
            range_m[at[nearer]] = hits.distance_m[nearer]
            signal[at[nearer]] = self._signals(body, hits)[nearer]
        return range_m, signal

    def _signals(self, body: PlacedBody, hits: Hits) -> Float32Array:
        """Return the signals (k,) of hits: light that returns to the lidar."""
        table = body.scene.table
        normals = tilted(table, hits.material, hits.points_m, hits.normals)
        back = reflected(table, hits.material, hits.points_m, normals, hits.to_eye, hits.to_eye)
        return np.asarray(np.pi * back * (self.model.reference_m / hits.distance_m) ** 2, dtype=np.float32)

    def _divide_beams(
        self, bodies: list[PlacedBody], range_m: Float32Array, signal: Float32Array, step: int
    ) -> None:
        """Replace the echoes of beams at edges by the mean of the echoes of their parts, in place."""
        model = self.model
        if model.divergence_deg == 0.0:
            return
        grid = np.where(np.isfinite(range_m), range_m, -1e3).reshape(model.rows, model.columns)
        edge = np.zeros(grid.shape, dtype=bool)
        for axis in (0, 1):
            jump = np.abs(np.diff(grid, axis=axis)) > _EDGE_M
            first = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
            second = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
            edge[first] |= jump
            edge[second] |= jump
        edge_beams = np.flatnonzero(edge)
        if not len(edge_beams):
            return
        weight, weighted_range = signal[edge_beams].astype(float), np.zeros(len(edge_beams))
        hits_centre = np.isfinite(range_m[edge_beams])
        weighted_range[hits_centre] = weight[hits_centre] * range_m[edge_beams[hits_centre]]
        half = math.radians(model.divergence_deg)
        for part in _PARTS:
            rays = _unit_vectors(
                self._azimuth[edge_beams] + part[0] * half, self._elevation[edge_beams] + part[1] * half
            )
            part_range_m, part_signal = self._echoes(bodies, rays, edge_beams // step)
            hits_body = np.isfinite(part_range_m)
            weight[hits_body] += part_signal[hits_body]
            weighted_range[hits_body] += part_signal[hits_body] * part_range_m[hits_body].astype(float)
        has_echo = weight > 0.0
        mixed = np.where(has_echo, weighted_range / np.where(has_echo, weight, 1.0), np.inf)
        range_m[edge_beams] = mixed
        signal[edge_beams] = weight / (1.0 + len(_PARTS))

    def _measure_echoes(
        self, range_m: Float32Array, signal: Float32Array, offsets_s: FloatArray, rng: np.random.Generator
    ) -> Scan:
        """Return the scan of detected echoes, with noise."""
        model = self.model
        echo = np.flatnonzero(signal > 0.0)
        low, high = _SIGMA_LIMITS
        sigma = model.range_sigma_m * np.clip(1.0 / np.sqrt(signal[echo]), low, high)
        measured = range_m[echo] + self._bias_m + sigma * rng.standard_normal(len(echo))
        speckle = 1.0 + _SPECKLE * rng.standard_normal(len(echo))
        detected = (signal[echo] * speckle > model.detection_threshold) & (measured > model.near_m)
        detected &= measured < model.far_m
        beam, distance = echo[detected], measured[detected]
        strength = (signal[echo] * speckle)[detected] * (distance / model.reference_m) ** 2
        if model.false_alarms > 0.0:
            false = np.flatnonzero(rng.random(len(range_m)) < model.false_alarms)
            is_true_echo = ~np.isin(beam, false)
            beam = np.concatenate([beam[is_true_echo], false])
            distance = np.concatenate(
                [distance[is_true_echo], rng.uniform(model.near_m, model.far_m, len(false))]
            )
            strength = np.concatenate([strength[is_true_echo], rng.uniform(0.0, 0.1, len(false))])
            order = np.argsort(beam, kind="stable")
            beam, distance, strength = beam[order], distance[order], strength[order]
        points = (self.directions[beam] * distance[:, None]).astype(np.float32)
        return Scan(
            points,
            np.round(offsets_s[beam] * 1e6).astype(np.uint32),
            np.clip(1000.0 * strength, 0, 65535).astype(np.uint16),
            (beam // model.columns).astype(np.uint16),
        )


def _angles(model: OrbitLidar) -> tuple[FloatArray, FloatArray]:
    """Return azimuth and elevation (n,) of the beams, rad, row by row from the top, each from the left."""
    width, height = np.radians(model.field_deg)
    azimuth = np.linspace(0.5 * width, -0.5 * width, model.columns)
    elevation = np.linspace(0.5 * height, -0.5 * height, model.rows)
    e, a = np.meshgrid(elevation, azimuth, indexing="ij")
    return a.ravel(), e.ravel()


def _unit_vectors(azimuth: FloatArray, elevation: FloatArray) -> Float32Array:
    cosine = np.cos(elevation)
    vectors = np.stack([cosine * np.cos(azimuth), cosine * np.sin(azimuth), np.sin(elevation)], axis=1)
    return np.asarray(vectors, dtype=np.float32)


def _candidates(body: PlacedBody, T_body_lidar: FloatArray, directions: Float32Array) -> NDArray[np.intp]:
    """Return the beams that pass the bounding sphere of a body at one of its poses."""
    T_lidar_body = se3.inverse(T_body_lidar)
    centres = T_lidar_body[:, :3, :3] @ body.scene.centre_m + T_lidar_body[:, :3, 3]
    distances = np.linalg.norm(centres, axis=1)
    if distances.min() <= body.scene.radius_m:
        return np.arange(len(directions))
    axis = centres[len(centres) // 2] / distances[len(centres) // 2]
    spread = np.arccos(np.clip(centres @ axis / distances, -1.0, 1.0)).max()
    half = min(np.arcsin(body.scene.radius_m / distances.min()) + spread, np.pi)
    cosine = directions @ axis.astype(np.float32)
    return np.flatnonzero(cosine >= np.float32(np.cos(half) - 1e-6))
