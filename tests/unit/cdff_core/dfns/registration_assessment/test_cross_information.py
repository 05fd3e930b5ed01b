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


def assess(source: surfaces.Points, target: surfaces.Points, T: np.ndarray) -> RegistrationAssessmentOutputs:
    normals, node = PrincipalAxis(), CrossInformation()
    normals.configure()
    node.configure()
    ns, nt = (normals.process(NormalsEstimationInputs(points=cloud)).normals for cloud in (source, target))
    return node.process(
        RegistrationAssessmentInputs(
            source=source, source_normals=ns, target=target, target_normals=nt, transform=T
        )
    )


def test_terrain_constrains_all_six_directions(rng: np.random.Generator) -> None:
    out = assess(surfaces.terrain(rng), surfaces.terrain(rng), np.eye(4))
    assert np.all(out.agreement > 0.8)
    assert out.overlap_source > 0.95
    assert out.overlap_target > 0.95
    np.testing.assert_allclose(out.covariance, out.covariance.T)
    assert np.linalg.eigvalsh(out.covariance)[0] > 0.0


def test_a_noisy_plane_constrains_neither_sliding_nor_rotation(rng: np.random.Generator) -> None:
    out = assess(surfaces.plane(rng, noise_m=0.05), surfaces.plane(rng, noise_m=0.05), np.eye(4))
    assert np.all(out.agreement[:3] < 0.1)
    assert np.all(out.agreement[3:] > 0.9)
    unconstrained = np.abs(out.directions[:3])
    assert np.all(unconstrained[:, [0, 1, 5]].max(axis=1) > 0.6)  # x, y and rotation about z


def test_a_corridor_is_degenerate_along_its_axis(rng: np.random.Generator) -> None:
    out = assess(surfaces.corridor(rng), surfaces.corridor(rng), np.eye(4))
    assert out.agreement[0] < 0.3
    assert abs(out.directions[0, 0]) > 0.95
    assert np.all(out.agreement[1:] > 0.5)


def test_a_shifted_registration_is_distinguished_from_the_correct_one(rng: np.random.Generator) -> None:
    T_slid = se3.transform(np.eye(3), [3.0, 2.0, 0.0])
    out = assess(surfaces.terrain(rng), surfaces.terrain(rng), T_slid)
    assert out.agreement.min() < 0.3


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
    assert np.mean(nees) < 12.6  # 95 % quantile of χ² with 6 degrees of freedom: not too small
    assert np.mean(nees) > 0.1  # and not far too large
