# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Structure above the ground is found for large cells, independently of their size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.types import ElevationMap, Pointcloud
from cdff_core.dfpcs.digital_elevation_mapping.compound import DigitalElevationMapping
from cdff_core.dfpcs.digital_elevation_mapping.structure_filter import StructureFilter
from evaluation.ground_segmentation import read_classified
from evaluation.overhangs import RULES, errors


def dem(resolution_m: float, **config: float | None) -> DigitalElevationMapping:
    result = DigitalElevationMapping()
    result.configure({"resolution_m": resolution_m, "align": False, **config}, DfpcContext("mana"), "Lidar")
    return result


def village(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return points of a slope of 11 degrees with houses of 3 m, and which of them are on houses."""
    xy = rng.uniform(0.0, 80.0, (6400, 2))
    is_house = np.all((xy % 20.0 > 6.0) & (xy % 20.0 < 15.0), axis=1)
    z = 0.2 * xy[:, 0] + np.where(is_house, 3.0, 0.0) + rng.normal(0.0, 0.03, len(xy))
    return np.c_[xy, z], is_house


def map_of(compound: DigitalElevationMapping, points: np.ndarray) -> ElevationMap:
    compound_outputs = [
        *compound.step(Sample("cloud", 0, 0, Pointcloud.from_points(points, frame="map", stamp_ns=0))),
        *compound.finish(),
    ]
    return next(o.value for o in compound_outputs if o.port == "map" and o.value is not None)


@pytest.mark.parametrize("edge_m", [4.0, 8.0])
def test_houses_are_not_part_of_the_ground_of_large_cells(rng: np.random.Generator, edge_m: float) -> None:
    points, _ = village(rng)
    elevation = map_of(dem(edge_m, far_factor=0), points)
    x, _ = elevation.geometry.centres_m()
    error_m = np.abs(elevation.layer("mean") - 0.2 * x)[elevation.layer("count") > 5]
    has_ground = np.isfinite(elevation.layer("overhang_m"))[elevation.layer("count") > 5]
    assert has_ground.any()
    assert np.quantile(error_m[has_ground], 0.9) < 0.6


def test_in_small_cells_the_rasterisation_decides(rng: np.random.Generator) -> None:
    points, is_house = village(rng)
    compound = dem(1.0, far_factor=4)
    structure = StructureFilter(compound.config, compound.dfn)
    assert structure.find(points, 1.0) is None
    is_structure = structure.find(points, 4.0)
    assert is_structure is not None
    assert np.mean(is_structure == is_house) > 0.98
    without = dem(8.0, overhang_gap_m=None)
    assert StructureFilter(without.config, without.dfn).find(points, 8.0) is None


def test_built_up_areas_are_mapped_better_than_with_vertical_gaps(real_data: Callable[[str], Path]) -> None:
    path = real_data("isprs_terrain") / "samp42-utm.pcd"
    points, is_ground = read_classified(path, path.with_name("samp42-utm-ground.pcd"))
    gaps, ours = (errors(points - points.min(axis=0), is_ground, 8.0, rule) for rule in RULES)
    assert ours["rmse_m"] < 0.5 < gaps["rmse_m"]
    assert ours["ground_lost_percent"] < 0.2
