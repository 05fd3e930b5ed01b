# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulation of the orbital elevation model of a mission: the true terrain, blurred and with noise.

The producer of the product is named ``simulated_survey``, since the model is derived from the true terrain.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from cdff_common.bus import Bus, keys
from cdff_common.codecs import encode, encoding_string
from cdff_common.codecs.wire_types import wire_type
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.missions.script import OrbitalModel
from cdff_dev.simulate.traverse import levelled
from cdff_dev.simulate.world import World

PRODUCER = "simulated_survey"
#: Number of averaged sample points along each edge of a cell; standard deviation of the blur, cells.
_POINTS, _BLUR_CELLS = 4, 0.5
#: Stream of random numbers, different from those of the sensors (``simulate.world.STREAMS``).
_STREAM = 11
_TIMEOUT_S = 60.0


def simulate_orbital_model(
    world: World, robot: str, T_site_odom: FloatArray, model: OrbitalModel
) -> ElevationMap:
    """Return the elevation around the origin of the world, in the site frame of the profile, without rocks.

    Parameters
    ----------
    T_site_odom : Float, shape (4, 4)
        Pose of the odometry frame of ``robot`` in the profile; odom is the level base frame at the start.
    """
    T_world_odom = levelled(world.motions[robot].poses(np.zeros(1))[0])
    T_site_world = T_site_odom @ se3.inverse(T_world_odom)
    x, y = T_site_world[:2, 3]
    half, cell = model.half_width_m, model.resolution_m
    geometry = GridGeometry.aligned("site", cell, (x - half, y - half, x + half, y + half))
    rows, cols = geometry.shape
    fine = GridGeometry.from_cells(
        "site",
        cell / _POINTS,
        left=geometry.left * _POINTS,
        top=geometry.top * _POINTS,
        rows=rows * _POINTS,
        cols=cols * _POINTS,
    )
    gx, gy = fine.centres_m()
    points = np.column_stack([gx.ravel(), gy.ravel(), np.zeros(gx.size)])
    points_world = se3.transform_points(se3.inverse(T_site_world), points)
    z = (
        world.relief.height(points_world[:, :2]).reshape(rows, _POINTS, cols, _POINTS).mean(axis=(1, 3))
        + T_site_world[2, 3]
    )
    noise = gaussian_filter(
        np.random.default_rng([world.scenario.seed, _STREAM]).normal(size=z.shape),
        0.5 * model.correlation_length_m / cell,
    )
    z = gaussian_filter(z, _BLUR_CELLS, mode="nearest") + noise * (model.noise_m / noise.std())
    heights = z.astype(np.float32)
    layers = {"mean": heights, "min": heights, "max": heights, "count": np.ones_like(heights)}
    layers |= {"variance": np.full_like(heights, model.noise_m**2), "age_s": np.zeros_like(heights)}
    return ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)


def store_orbital_model(bus: Bus, model: ElevationMap, robot: str) -> None:
    """Insert the model into the DPM as product ``dem`` of ``robot``."""
    header = Header(
        id=product_id(robot, PRODUCER, "dem", 0, 0, ""),
        seq=0,
        t0_ns=0,
        t1_ns=0,
        frame=model.frame,
        producer=PRODUCER,
        box_m=model.extent_m(),
    )
    bus.call(
        keys.dpm_rpc(keys.GROUND, "put"),
        {"robot": robot, "dfpc": PRODUCER, "port": "dem", "product": "dem"},
        payload=encode(model, "uper"),
        encoding=encoding_string(wire_type(model), "uper"),
        attachment=header.to_attachment(),
        timeout_s=_TIMEOUT_S,
    )
