# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated world: meshes for ray casting, their appearance, the motions of the rovers, the true map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_dev.simulate.relief import Relief, make_relief
from cdff_dev.simulate.rocks import RockMesh, make_rocks, with_boulders
from cdff_dev.simulate.rover_motion import Motion, make_motion, track
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.surface import Appearance, make_appearance

#: Streams of random numbers: each sensor has its own, so that a change of one sensor does not affect others.
STREAMS = {
    "relief": 0,
    "rocks": 1,
    "appearance": 2,
    "navcam": 3,
    "lidar": 4,
    "imu": 5,
    "wheels": 6,
    "fault_camera_rig": 7,
    "fault_navcam": 8,
    "fault_lidar_rig": 9,
    "fault_lidar": 10,
    "fault_imu": 11,
    "fault_wheels": 12,
    "clock_navcam": 13,
    "clock_lidar": 14,
    "clock_imu": 15,
    "clock_wheels": 16,
    "boulders": 17,
}


def generator(scenario: Scenario, stream: str, *indices: int) -> np.random.Generator:
    """Return the random number generator of one stream and its indices, independent of all others."""
    return np.random.default_rng([scenario.seed, STREAMS[stream], *indices])


@dataclass(slots=True, eq=False)
class World:
    """Terrain, rocks, motions of the rovers, and appearance; the latter is None without cameras."""

    scenario: Scenario
    relief: Relief
    rocks: RockMesh
    motions: dict[str, Motion]
    appearance: Appearance | None


def cast_scene(relief: Relief, rocks: RockMesh) -> Any:
    """Return a scene for ray casting (Open3D): geometry 0 is the ground, geometry 1 the rocks."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    for vertices, triangles in (relief.mesh(), (rocks.vertices, rocks.triangles)):
        if len(triangles):
            scene.add_triangles(o3d.core.Tensor.from_numpy(vertices), o3d.core.Tensor.from_numpy(triangles))
    return scene


def make_world(scenario: Scenario) -> World:
    """Return the world of a scenario; two calls give equal worlds."""
    relief = make_relief(scenario.terrain, generator(scenario, "relief"))
    motions = {
        robot: make_motion(drive, scenario.chassis, relief, scenario.duration_s)
        for robot, drive in scenario.robots.items()
    }
    paths = [
        track(
            drive,
            np.arange(-0.5, float(motions[robot].distance(scenario.duration_s)) + 0.5, 0.05).clip(min=0),
        )[0]
        for robot, drive in scenario.robots.items()
    ]
    plains = scenario.terrain.plains or ()
    rocks = make_rocks(
        scenario.terrain.rocks, relief, np.concatenate(paths), generator(scenario, "rocks"), plains
    )
    if scenario.terrain.boulders:
        rocks = with_boulders(rocks, scenario.terrain.boulders, relief, generator(scenario, "boulders"))
    appearance = None
    if scenario.navcam is not None:
        scene = cast_scene(relief, rocks)
        rng = generator(scenario, "appearance")
        appearance = make_appearance(scenario.terrain, relief, rocks, scene, rng)
    return World(scenario, relief, rocks, motions, appearance)


def true_heights(
    world: World, resolution_m: float, samples_per_edge: int = 3
) -> dict[str, NDArray[np.float32]]:
    """Return the true elevation of the fine part of the terrain with rocks, from vertical rays.

    Returns
    -------
    dict of NDArray[np.float32], shape (n, n)
        ``mean``, ``variance``, ``min`` and ``max`` of the surface in each cell, metres; row 0 at ymax.
    """
    import open3d as o3d

    half = world.scenario.terrain.fine_half_width_m
    n = round(2 * half / resolution_m)
    k = samples_per_edge
    axis = (np.arange(n * k, dtype=np.float64) + 0.5) * (resolution_m / k) - half
    rays = np.zeros((n * k, n * k, 6), dtype=np.float32)
    rays[..., 0], rays[..., 1], rays[..., 2] = axis[None, :], axis[::-1, None], 100.0
    rays[..., 5] = -1.0
    scene = cast_scene(world.relief, world.rocks)
    distance_m = (
        scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)["t_hit"].numpy().astype(np.float64)
    )
    z = (100.0 - distance_m).reshape(n, k, n, k)
    layers = {"mean": z.mean((1, 3)), "variance": z.var((1, 3)), "min": z.min((1, 3)), "max": z.max((1, 3))}
    return {name: layer.astype(np.float32) for name, layer in layers.items()}
