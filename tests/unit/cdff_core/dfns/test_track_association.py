# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np

from cdff_core.dfns.track_association.interface import TrackAssociationInputs, TrackAssociationOutputs
from cdff_core.dfns.track_association.joint_assignment import JointAssignment


def associated(
    places: list[list[float]],
    regions: list[list[float]],
    region_sizes: list[list[float]] | None = None,
    similarities: list[list[float]] | None = None,
) -> TrackAssociationOutputs:
    node = JointAssignment()
    node.configure()
    m, n = len(places), len(regions)
    return node.process(
        TrackAssociationInputs(
            places=np.array(places, float).reshape(m, 2),
            covariances=np.repeat(np.eye(2)[None], m, axis=0),
            sizes=np.full((m, 2), 20.0),
            size_sigmas=np.full(m, 0.2),
            regions=np.array(regions, float).reshape(n, 2),
            region_covariances=np.repeat(0.1 * np.eye(2)[None], n, axis=0),
            region_sizes=np.full((n, 2), 20.0) if region_sizes is None else np.array(region_sizes),
            similarities=None if similarities is None else np.array(similarities),
        )
    )


def test_the_sum_of_all_pairs_decides_not_the_nearest_region() -> None:
    association = associated([[10.0, 10.0], [12.0, 10.0]], [[12.5, 10.0], [15.0, 10.0]])
    assert association.chosen.tolist() == [0, 1]


def test_a_region_outside_the_gate_or_of_another_size_is_not_chosen() -> None:
    assert associated([[10.0, 10.0]], [[30.0, 10.0]]).chosen.tolist() == [-1]
    assert associated([[10.0, 10.0]], [[10.0, 10.0]], [[80.0, 80.0]]).chosen.tolist() == [-1]
    association = associated([[10.0, 10.0]], [])
    assert association.chosen.tolist() == [-1]
    assert np.isnan(association.costs).all()


def test_appearance_separates_objects_at_one_place_and_without_it_they_are_ambiguous() -> None:
    places, regions = [[10.0, 10.0], [10.5, 10.0]], [[10.2, 10.0], [10.4, 10.0]]
    assert associated(places, regions).is_ambiguous.all()
    association = associated(places, regions, similarities=[[0.1, 0.95], [0.95, 0.1]])
    assert association.chosen.tolist() == [1, 0]
    assert not association.is_ambiguous.any()
