# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CrossInformation separates structure from noise, reports degenerate directions and the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.geometry import covariance, se3
from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
from cdff_core.dfns.normals_estimation.principal_axis import PrincipalAxis
from cdff_core.dfns.registration_3d.interface import Registration3DInputs
from cdff_core.dfns.registration_3d.point_to_plane_icp import PointToPlaneIcp
from cdff_core.dfns.registration_assessment.cross_information import CrossInformation
from cdff_core.dfns.registration_assessment.interface import (
    RegistrationAssessmentInputs,
    RegistrationAssessmentOutputs,
)
from tests.support import surfaces


def assess(
    source: surfaces.Points, target: surfaces.Points, T: np.ndarray, coarser: np.ndarray | None = None
) -> RegistrationAssessmentOutputs:
    normals, node = PrincipalAxis(), CrossInformation()
    normals.configure()
    node.configure()
    source_normals, target_normals = (
        normals.process(NormalsEstimationInputs(points=cloud)).normals for cloud in (source, target)
    )
    return node.process(
        RegistrationAssessmentInputs(
            source=source,
            source_normals=source_normals,
            target=target,
            target_normals=target_normals,
            transform=T,
            coarser_transform=coarser,
        )
    )


def test_terrain_constrains_all_six_directions(rng: np.random.Generator) -> None:
    outputs = assess(surfaces.terrain(rng), surfaces.terrain(rng), np.eye(4))
    assert np.all(outputs.agreement > 0.8)
    assert outputs.overlap_source > 0.95
    assert outputs.overlap_target > 0.95
    np.testing.assert_allclose(outputs.covariance, outputs.covariance.T)
    assert np.linalg.eigvalsh(outputs.covariance)[0] > 0.0


def test_a_noisy_plane_constrains_neither_translation_along_it_nor_rotation_about_its_normal(
    rng: np.random.Generator,
) -> None:
    outputs = assess(surfaces.plane(rng, noise_m=0.05), surfaces.plane(rng, noise_m=0.05), np.eye(4))
    assert np.all(outputs.agreement[:3] < 0.1)
    assert np.all(outputs.agreement[3:] > 0.9)
    unconstrained = np.abs(outputs.directions[:3])
    assert np.all(unconstrained[:, [0, 1, 5]].max(axis=1) > 0.6)  # x, y and rotation about z


def test_a_corridor_is_degenerate_along_its_axis(rng: np.random.Generator) -> None:
    outputs = assess(surfaces.corridor(rng), surfaces.corridor(rng), np.eye(4))
    assert outputs.agreement[0] < 0.3
    assert abs(outputs.directions[0, 0]) > 0.95
    assert np.all(outputs.agreement[1:] > 0.5)


def test_a_wrong_alignment_has_little_agreement(rng: np.random.Generator) -> None:
    T_wrong = se3.transform(np.eye(3), [3.0, 2.0, 0.0])
    outputs = assess(surfaces.terrain(rng), surfaces.terrain(rng), T_wrong)
    assert outputs.agreement.min() < 0.3


def test_clouds_without_overlap_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(RefusedError, match="overlap"):
        assess(surfaces.terrain(rng), surfaces.terrain(rng), se3.transform(np.eye(3), [500.0, 0, 0]))


@pytest.mark.slow
def test_errors_of_many_registrations_are_consistent_with_their_covariance() -> None:
    icp = PointToPlaneIcp()
    icp.configure()
    nees = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        source, target = surfaces.terrain(rng, 4000), surfaces.terrain(rng, 4000)
        T = icp.process(Registration3DInputs(source=source, target=target)).transform
        P = assess(source, target, T).covariance
        error = covariance.pose_error(np.eye(4), T)
        nees.append(float(error @ np.linalg.solve(P, error)))
    assert (
        np.mean(nees) < 12.6
    )  # 95 % quantile of χ² with 6 degrees of freedom: the covariance is not too small
    assert np.mean(nees) > 0.1  # nor far too large


def test_the_difference_to_a_coarser_result_is_added_as_a_typical_error(rng: np.random.Generator) -> None:
    source, target = surfaces.terrain(rng), surfaces.terrain(rng)
    change = se3.exp_se3([0.02, -0.01, 0.03, 0.002, -0.001, 0.003])
    without, same, changed = (
        assess(source, target, np.eye(4), coarser) for coarser in (None, np.eye(4), change)
    )
    np.testing.assert_allclose(same.covariance, without.covariance)
    added = changed.covariance - without.covariance
    assert np.linalg.eigvalsh(added)[0] > 0.0
    difference = covariance.pose_error(change, np.eye(4))
    assert difference @ np.linalg.solve(added, difference) == pytest.approx(6.0, rel=0.15)
