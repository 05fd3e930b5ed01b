# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Clouds of a region: all points within the budget, else an even selection."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from dpm_store import Query, Store
from tests.support.map_products import put_cloud


def rows(points: np.ndarray) -> set[tuple[float, ...]]:
    return {tuple(p) for p in np.round(points, 6)}


def test_points_of_all_clouds_in_the_region_are_returned_in_one_frame(
    store: Store, rng: np.random.Generator
) -> None:
    T = UncertainTransform(se3.transform(se3.exp_so3([0.0, 0.0, 0.5]), [1.0, 2.0, 3.0]))
    store.frames.set("mana/odom", "site", T)
    a, b, c = (rng.uniform(-2.0, 2.0, (500, 3)) for _ in range(3))
    put_cloud(store, a, 1)
    put_cloud(store, b, 2, frame="mana/odom", robot="minnie")
    put_cloud(store, c, 3, frame="elsewhere")
    region = parse_region("box:-1,-1,-1,3,3,4")
    cloud = store.clouds.assemble(Query(region=region))
    both = np.vstack([a, T.apply(b)])
    inside = region.contains(*both.T)
    assert rows(cloud.cloud.points_m) == rows(both[inside])
    assert (cloud.points_seen, cloud.voxel_m) == (int(inside.sum()), 0.0)
    assert cloud.robots == ("mana", "minnie")
    assert cloud.skipped_frames == ("elsewhere",)
    assert cloud.cloud.frame == "site"


@pytest.mark.req("CDFF-SUP-182")
def test_a_budget_is_filled_and_represents_sparse_regions(store: Store, rng: np.random.Generator) -> None:
    dense = rng.uniform(0.0, 1.0, (60_000, 3))
    sparse = rng.uniform(10.0, 20.0, (300, 3))
    put_cloud(store, dense, 1)
    put_cloud(store, sparse, 2)
    everything = np.vstack([dense, sparse])
    cloud = store.clouds.assemble(Query(), 2000)
    points = cloud.cloud.points_m
    assert len(points) == 2000
    assert rows(points) <= rows(everything)
    assert len(rows(points)) == 2000
    assert cloud.points_seen == 60_300
    assert rows(np.floor(everything / cloud.voxel_m)) == rows(np.floor(points / cloud.voxel_m))
    assert (points[:, 0] > 5.0).sum() > 250


def test_the_result_is_independent_of_the_partition_into_clouds(
    store: Store, rng: np.random.Generator
) -> None:
    points = rng.uniform(-5.0, 5.0, (30_000, 3))
    put_cloud(store, points[:10_000], 3, frame="site")
    put_cloud(store, points[10_000:], 2, frame="site")
    for seq, part in enumerate(np.array_split(points, 9)):
        put_cloud(store, part, 100 - seq, robot="minnie")
    one = store.clouds.assemble(Query(robot="mana"), 1000)
    many = store.clouds.assemble(Query(robot="minnie"), 1000)
    assert one.voxel_m == many.voxel_m
    occupied_voxels = [rows(np.floor(result.cloud.points_m / result.voxel_m)) for result in (one, many)]
    assert occupied_voxels[0] == occupied_voxels[1]


def test_the_newest_point_of_a_voxel_is_kept(store: Store) -> None:
    grid = np.stack(np.meshgrid(*[np.arange(10.0)] * 3), axis=-1).reshape(-1, 3)
    put_cloud(store, grid, 2, intensity=np.full(1000, 2))
    put_cloud(store, grid + 1e-4, 1, intensity=np.full(1000, 1))
    cloud = store.clouds.assemble(Query(), 1000)
    assert np.all(np.asarray(cloud.cloud.intensity) == 2)


def test_empty_regions_and_budgets_out_of_range_are_refused(store: Store) -> None:
    put_cloud(store, np.zeros((1, 3)), 1)
    with pytest.raises(ProductNotFoundError, match="no point cloud in circle"):
        store.clouds.assemble(Query(region=parse_region("circle:9,9,1")))
    put_cloud(store, np.array([[-1.0, 0.0, 0.0], [1.0, 1.0, 1.0]]), 2)
    assert len(store.clouds.assemble(Query(), 1).cloud.points_m) == 1
    with pytest.raises(InputError, match="points=0"):
        store.clouds.assemble(Query(), 0)


def test_voxels_of_the_finest_step_are_cubes_of_a_millimetre(store: Store) -> None:
    corners = 0.004 * np.arange(500)[:, None] + np.zeros(3)
    put_cloud(store, np.vstack([corners + 0.0002, corners + 0.0008]), 1)
    cloud = store.clouds.assemble(Query(), 500)
    assert cloud.voxel_m == pytest.approx(0.001)
    assert len(rows(np.floor(cloud.cloud.points_m / 0.001))) == 500
