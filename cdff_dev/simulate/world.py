# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated world in memory: meshes to cast rays at, how they look, how the rovers move, the true map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_dev.simulate.relief import Relief, make_relief
from cdff_dev.simulate.rocks import RockMesh, make_rocks
from cdff_dev.simulate.rover_motion import Motion, make_motion, track
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.surface import Look, make_look

#: Streams of random numbers, so that a change in one sensor leaves the others as they were.
STREAMS = {"relief": 0, "rocks": 1, "look": 2, "navcam": 3, "lidar": 4, "imu": 5, "wheels": 6}


def generator(scenario: Scenario, stream: str, *indices: int) -> np.random.Generator:
    """Random numbers of one stream and index, independent of the order in which others are drawn."""
    return np.random.default_rng([scenario.seed, STREAMS[stream], *indices])


@dataclass(slots=True, eq=False)
class World:
    """Ground, rocks, look (for cameras only) and motions of a scenario; made once, handed to the worker
    processes.
    """

    scenario: Scenario
    relief: Relief
    rocks: RockMesh
    motions: dict[str, Motion]
    look: Look | None


def cast_scene(relief: Relief, rocks: RockMesh) -> Any:
    """Return an Open3D ray casting scene: geometry 0 is the ground, 1 the rocks."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    for vertices, triangles in (relief.mesh(), (rocks.vertices, rocks.triangles)):
        if len(triangles):
            scene.add_triangles(o3d.core.Tensor.from_numpy(vertices), o3d.core.Tensor.from_numpy(triangles))
    return scene


def make_world(scenario: Scenario) -> World:
    """Build the world of a scenario; two calls give equal worlds."""
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
    look = None
    if scenario.navcam is not None:
        look = make_look(
            scenario.terrain, relief, rocks, cast_scene(relief, rocks), generator(scenario, "look")
        )
    return World(scenario, relief, rocks, motions, look)


def true_heights(
    world: World, resolution_m: float, samples_per_edge: int = 3
) -> dict[str, NDArray[np.float32]]:
    """The true map of the fine part by rays from above, rocks included.

    Returns
    -------
    dict of NDArray[np.float32], shape (n, n)
        mean, variance, min, max of the surface inside each cell, metres; row 0 at ymax.
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
    hit = scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)["t_hit"].numpy().astype(np.float64)
    z = (100.0 - hit).reshape(n, k, n, k)
    layers = {"mean": z.mean((1, 3)), "variance": z.var((1, 3)), "min": z.min((1, 3)), "max": z.max((1, 3))}
    return {name: layer.astype(np.float32) for name, layer in layers.items()}
