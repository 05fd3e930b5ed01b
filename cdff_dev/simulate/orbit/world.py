# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The bodies of a scenario in orbit, ready for ray casting, and their state at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.errors import ConfigurationError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit.body_scene import BodyLight, BodyScene
from cdff_dev.simulate.orbit.earth import earth_appearance
from cdff_dev.simulate.orbit.environment import earth_rotation
from cdff_dev.simulate.orbit.meshes import BodyMesh, load_body
from cdff_dev.simulate.orbit.motion import Light, OrbitMotion
from cdff_dev.simulate.orbit.scenario import Appendage, Body, OrbitScenario

#: Number of times at which the distance to the bodies is checked.
_CHECKS = 4000


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBody:
    """A body at one time or at several.

    Attributes
    ----------
    number : int
        Value of its pixels in masks: 1 for the client, then the companions, then the parts of the servicer.
    T_base_body : ndarray (n, 4, 4)
    light : BodyLight
        At the middle of the times.
    """

    number: int
    name: str
    scene: BodyScene
    T_base_body: FloatArray
    light: BodyLight


class OrbitWorld:
    """Motion and meshes of a scenario.

    Raises
    ------
    ConfigurationError
        If a mesh is missing or its size is not plausible, or a body is closer than a sensor can see.
    """

    def __init__(self, scenario: OrbitScenario) -> None:
        self.scenario, self.motion = scenario, OrbitMotion(scenario)
        small_body = scenario.small_body is not None
        self.meshes: dict[str, BodyMesh] = {}
        for field, body in bodies_with_fields(scenario):
            size_m = body.size_m if not (small_body and field == "client") else (1.0, 1e6)
            self.meshes[body.name] = load_body(
                body.mesh, unit=body.unit, material=body.material, size_m=size_m, field=field
            )
        self.scenes = {name: BodyScene(mesh) for name, mesh in self.meshes.items()}
        t_s = np.linspace(0.0, scenario.duration_s, _CHECKS)
        check_distances(scenario, self.motion, self.scenes, t_s)

    def placed(self, t_s: FloatArray) -> list[PlacedBody]:
        """Return all bodies at times (n,), with the light at their middle."""
        scenario, motion = self.scenario, self.motion
        middle_s = float(0.5 * (t_s[0] + t_s[-1]))
        light = motion.light(middle_s)
        R_base_inertial = motion.base_attitudes(np.array([middle_s]))[0].T
        result = []
        for i, body in enumerate((*scenario.bodies, *scenario.servicer.body)):
            T = self._poses(body, t_s)
            T_middle = self._poses(body, np.array([middle_s]))[0]
            R_inertial_body = R_base_inertial.T @ T_middle[:3, :3]
            result.append(
                PlacedBody(i + 1, body.name, self.scenes[body.name], T, self._light(light, R_inertial_body))
            )
        return result

    def earth_radiance(self, directions: np.ndarray, t_s: float, light: Light) -> np.ndarray:
        """Return the radiance (n,), 1/sr, of the Earth in directions (n, 3), inertial axes."""
        if light.earth_m is None:
            return np.zeros(len(directions), dtype=np.float32)
        stamp_ns = self.scenario.epoch_ns + round(t_s * NS_PER_S)
        rotation = earth_rotation(stamp_ns)
        earth = earth_appearance(self.scenario.lighting.clouds_seed)
        relative_radiance = earth.radiance(directions, light.earth_m, light.to_sun, rotation)
        return np.asarray(np.float32(light.irradiance) * relative_radiance)

    def _poses(self, body: Body, t_s: FloatArray) -> FloatArray:
        if not isinstance(body, Appendage):
            return self.motion.poses_in_base(body.name, t_s)
        turns = np.tile(np.eye(4), (len(t_s), 1, 1))
        turns[:, :3, :3] = se3.exp_so3(np.outer(np.radians(body.rate_deg_s) * t_s, [0.0, 0.0, 1.0]))
        return np.asarray(body.mount.matrix() @ turns)

    def _light(self, light: Light, R_inertial_body: FloatArray) -> BodyLight:
        lighting = self.scenario.lighting
        earth = None
        if light.earth_m is not None and lighting.earthshine:
            earth = (R_inertial_body, light.earth_m, light.to_sun, light.irradiance, lighting.earth_albedo)
        to_sun = (R_inertial_body.T @ light.to_sun).astype(np.float32)
        return BodyLight(to_sun, light.irradiance * light.sunlit, earth)


def bodies_with_fields(scenario: OrbitScenario) -> list[tuple[str, Body]]:
    """Return all bodies with their paths in the scenario file."""
    companions = [(f"companions.{i}", body) for i, body in enumerate(scenario.companions)]
    parts = [(f"servicer.body.{i}", body) for i, body in enumerate(scenario.servicer.body)]
    return [("client", scenario.client), *companions, *parts]


def check_distances(
    scenario: OrbitScenario, motion: OrbitMotion, scenes: dict[str, BodyScene], t_s: FloatArray
) -> None:
    """Refuse a path on which a body comes closer to a sensor than its ``near_m`` at one of the times (n,).

    The distance is that to the bounding sphere of the body; only if it is too small, that to its surface.

    Raises
    ------
    ConfigurationError
        With the field, the body, the time and the distance.
    """
    sensors = [
        (f"servicer.cameras.{n}.near_m", c.near_m, c.mount) for n, c in scenario.servicer.cameras.items()
    ]
    sensors += [
        (f"servicer.lidars.{n}.near_m", s.near_m, s.mount) for n, s in scenario.servicer.lidars.items()
    ]
    for body in scenario.bodies:
        T_base_body = motion.poses_in_base(body.name, t_s)
        scene = scenes[body.name]
        for field, near_m, mount in sensors:
            positions = (se3.inverse(T_base_body) @ np.append(mount.xyz_m, 1.0))[:, :3]
            distances = np.linalg.norm(positions - scene.centre_m, axis=1) - scene.radius_m
            close = np.flatnonzero(distances < near_m)
            distances[close] = scene.clearances_m(positions[close])
            nearest = int(distances.argmin())
            if distances[nearest] < near_m:
                raise ConfigurationError(
                    f"{field}={near_m:g}: {body.name} is {distances[nearest]:.3g} m from the sensor at "
                    f"{t_s[nearest]:g} s, inside its near plane; change servicer.path or the field"
                )
