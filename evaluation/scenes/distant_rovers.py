# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated images of distant rovers with truth: places, visible fractions, sizes and ranges."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.interfaces.dfn import validated
from cdff_dev.simulate.camera import StereoCamera
from cdff_dev.simulate.rovers_in_view import RoverView, Silhouette
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.scenario_files import read_scenario
from cdff_dev.simulate.surface import sun_direction
from cdff_dev.simulate.world import World, cast_scene, make_world

OBSERVER = "mana"
#: Place of the observer, metres, its heading is 0; half the angle of view that the rovers use.
_PLACE, _HALF_VIEW = np.array([-32.0, 0.0]), math.radians(16.0)


@dataclass(frozen=True, slots=True, eq=False)
class TrueObject:
    """Truth of one rover in one image.

    Attributes
    ----------
    place_px : ndarray (2,)
        Centre of the visible area, with enclosed gaps filled; NaN if it is not visible.
    visible : float
        Visible fraction of the area.
    size_px : ndarray (2,)
        Width and height of the visible part; 0 if it is not visible.
    range_m : float
        From the camera to the middle of the base.
    is_moving : bool
    """

    place_px: FloatArray
    visible: float
    size_px: FloatArray
    range_m: float
    is_moving: bool


@dataclass(frozen=True, slots=True, eq=False)
class TrueImage:
    """One pair with truth."""

    time_s: float
    left: np.ndarray
    right: np.ndarray
    T_site_camera: FloatArray
    objects: dict[str, TrueObject]


def scene(kind: str, seed: int) -> Scenario:
    """Return a scenario whose distances, speeds, terrain, boulder and rocks depend on the seed.

    Kinds: ``crossing`` (two rovers that cross; a boulder hides one for about 20 s), ``driving`` (the
    same, without a boulder, while the observer drives), ``small`` (rovers of 6 to 19 pixels).
    """
    rng = np.random.default_rng([seed, sum(map(ord, kind))])
    data: dict[str, Any] = read_scenario("distant_rovers")
    data["seed"], data["duration_s"] = 1_000_000 + seed, 60.0
    data["terrain"]["surface"]["sun_azimuth_deg"] = float(rng.uniform(60.0, 300.0))
    data["terrain"]["surface"]["sun_elevation_deg"] = float(rng.uniform(30.0, 60.0))
    near = float(rng.uniform(28.0, 42.0)) if kind != "small" else float(rng.uniform(75.0, 110.0))
    far = near * float(rng.uniform(1.15, 1.4))
    side = float(rng.choice([-1.0, 1.0]))
    robots = data["robots"]
    data["terrain"]["boulders"] = None
    for name, distance, sign in (("minnie", near, side), ("percy", far, -side)):
        angle = sign * _HALF_VIEW * float(rng.uniform(0.85, 1.0))
        start = _PLACE + distance * np.array([1.0, math.tan(angle)])
        robots[name] = {
            "start_xy_m": start.tolist(),
            "heading_deg": math.degrees(-sign * 0.5 * math.pi) + float(rng.uniform(-12.0, 12.0)),
            "curvature_1pm": [[0.0, 0.0], [20.0, float(rng.uniform(-0.015, 0.015))]],
            "speed_m_s": 1.75 * distance * math.tan(_HALF_VIEW) / 52.0,
            "rest_before_s": float(rng.uniform(3.0, 5.0)),
            "rest_after_s": 1.0,
            "ramp_s": 1.5,
        }
    speed = robots["minnie"]["speed_m_s"]
    if kind == "crossing":
        # It hides 20 s of the path of the near rover.
        nearness = 0.45
        diameter = float(np.clip(nearness * (20.0 * speed - 1.1) / 0.85, 2.6, 5.5))
        offset = float(rng.uniform(-1.0, 1.0))
        centre = _PLACE + nearness * near * np.array([1.0, 0.0]) + np.array([0.0, offset])
        data["terrain"]["boulders"] = [{"centre_xy_m": centre.tolist(), "diameter_m": diameter}]
    robots[OBSERVER] |= {"start_xy_m": _PLACE.tolist(), "heading_deg": 0.0}
    robots[OBSERVER] |= {
        "curvature_1pm": [[0.0, 0.0], [10.0, 0.0]],
        "rest_before_s": 1.0 if kind == "driving" else 59.5,
    }
    robots[OBSERVER] |= {"rest_after_s": 0.0, "ramp_s": 0.4, "speed_m_s": 0.05}
    return validated(Scenario, data, f"distant_rovers {kind} {seed}")


class Renderer:
    """Images of the observer of a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.world: World = make_world(scenario)
        navcam, surface = scenario.navcam, scenario.terrain.surface
        assert navcam is not None
        assert surface is not None
        assert scenario.rovers_in_view is not None
        assert self.world.appearance is not None
        self.navcam = navcam
        cast = cast_scene(self.world.relief, self.world.rocks)
        vertices, triangles = self.world.relief.mesh()
        meshes = (triangles, self.world.rocks.triangles) if len(self.world.rocks.triangles) else (triangles,)
        self._camera = StereoCamera(navcam, cast, self.world.appearance, len(vertices), meshes)
        self._view = RoverView(
            scenario.rovers_in_view,
            self._camera,
            cast,
            self.world.motions,
            sun_direction(surface),
            surface.ambient,
            surface.haze_distance_m,
        )

    def images(self) -> Iterator[TrueImage]:
        """Yield the pairs in the order of time."""
        model = self.navcam
        for k in range(int(self.scenario.duration_s * model.rate_hz)):
            t = k / model.rate_hz
            T = self.world.motions[OBSERVER].poses(np.array([t]))[0]
            rng = np.random.default_rng([self.scenario.seed, k])
            exposures = self._camera.exposures(rng)
            light, silhouettes = self._view.radiance(T @ model.T_base_left, OBSERVER, t)
            other, _ = self._view.radiance(T @ model.T_base_right, OBSERVER, t)
            left = self._camera.expose(light, float(exposures[0]), rng)
            right = self._camera.expose(other, float(exposures[1]), rng)
            T_camera = T @ model.T_base_left
            objects = {
                n: self._truth(n, t, T_camera, silhouettes.get(n))
                for n in self.world.motions
                if n != OBSERVER
            }
            yield TrueImage(t, left, right, T_camera, objects)

    def _truth(
        self, name: str, t: float, T_site_camera: FloatArray, silhouette: Silhouette | None
    ) -> TrueObject:
        motion = self.world.motions[name]
        T = motion.poses(np.array([t]))[0]
        range_m = float(np.linalg.norm(T[:3, 3] - T_site_camera[:3, 3]))
        moving = bool(motion.distance(t) - motion.distance(max(t - 0.5, 0.0)) > 0.02)
        place, size, visible = np.full(2, np.nan), np.zeros(2), 0.0
        if silhouette is not None and silhouette.coverage.max() > 0.5:
            mask = _filled(silhouette.coverage > 0.5)
            rows, cols = np.nonzero(mask)
            place = np.array([cols.mean(), rows.mean()])
            size = np.array([np.ptp(cols) + 1.0, np.ptp(rows) + 1.0])
            visible = float(silhouette.coverage.sum()) / max(silhouette.whole, 1.0)
        return TrueObject(place, visible, size, range_m, moving)


def _filled(mask: BoolArray) -> BoolArray:
    """Return a mask with the pixels that have pixels of it on all four sides."""
    left, right = np.maximum.accumulate(mask, axis=1), np.maximum.accumulate(mask[:, ::-1], axis=1)[:, ::-1]
    above, below = np.maximum.accumulate(mask, axis=0), np.maximum.accumulate(mask[::-1], axis=0)[::-1]
    return np.asarray(mask | (left & right & above & below))
