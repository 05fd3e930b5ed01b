# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CrossInformation: tells structure from noise, names free directions, gives a covariance that holds."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.geometry import covariance, se3
from cdff_core.dfns.normals_estimation._interface import NormalsEstimationInputs
from cdff_core.dfns.normals_estimation.principal_axis import PrincipalAxis
from cdff_core.dfns.registration_3d._interface import Registration3DInputs
from cdff_core.dfns.registration_3d.point_to_plane_icp import PointToPlaneIcp
from cdff_core.dfns.registration_assessment._interface import (
    RegistrationAssessmentInputs,
    RegistrationAssessmentOutputs,
)
from cdff_core.dfns.registration_assessment.cross_information import CrossInformation
from tests import surfaces


def assessed(source: surfaces.Points, target: surfaces.Points, T: np.ndarray) -> RegistrationAssessmentOutputs:
    normals, node = PrincipalAxis(), CrossInformation()
    normals.configure()
    node.configure()
    ns, nt = (normals.process(NormalsEstimationInputs(cloud)).normals for cloud in (source, target))
    return node.process(RegistrationAssessmentInputs(source, ns, target, nt, T))


def test_terrain_is_tied_down_in_all_six_directions(rng: np.random.Generator) -> None:
    out = assessed(surfaces.terrain(rng), surfaces.terrain(rng), np.eye(4))
    assert np.all(out.agreement > 0.8)
    assert float(out.overlap_source) > 0.95
    assert float(out.overlap_target) > 0.95
    np.testing.assert_allclose(out.covariance, out.covariance.T)
    assert np.linalg.eigvalsh(out.covariance)[0] > 0.0


def test_a_noisy_plane_is_free_to_slide_and_turn_however_its_normals_jitter(rng: np.random.Generator) -> None:
    out = assessed(surfaces.plane(rng, noise_m=0.05), surfaces.plane(rng, noise_m=0.05), np.eye(4))
    assert np.all(out.agreement[:3] < 0.1)
    assert np.all(out.agreement[3:] > 0.9)
    free = np.abs(out.directions[:3])
    assert np.all(free[:, [0, 1, 5]].max(axis=1) > 0.6)  # x, y and the turn about z


def test_a_corridor_is_free_along_itself(rng: np.random.Generator) -> None:
    out = assessed(surfaces.corridor(rng), surfaces.corridor(rng), np.eye(4))
    assert out.agreement[0] < 0.3
    assert abs(out.directions[0, 0]) > 0.95
    assert np.all(out.agreement[1:] > 0.5)


def test_an_alignment_that_slid_is_told_from_the_right_one(rng: np.random.Generator) -> None:
    slid = se3.transform(np.eye(3), [3.0, 2.0, 0.0])
    out = assessed(surfaces.terrain(rng), surfaces.terrain(rng), slid)
    assert out.agreement.min() < 0.3


def test_clouds_that_do_not_meet_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(RefusedError, match="overlap"):
        assessed(surfaces.terrain(rng), surfaces.terrain(rng), se3.transform(np.eye(3), [500.0, 0, 0]))


@pytest.mark.slow
def test_errors_of_many_registrations_lie_within_the_covariance_they_state() -> None:
    icp = PointToPlaneIcp()
    icp.configure()
    normalised = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        source, target = surfaces.terrain(rng, 4000), surfaces.terrain(rng, 4000)
        T = icp.process(Registration3DInputs(source, target)).transform
        stated = assessed(source, target, T).covariance
        error = covariance.pose_error(np.eye(4), T)
        normalised.append(float(error @ np.linalg.solve(stated, error)))
    assert np.mean(normalised) < 12.6  # 95 % of chi-square with 6 degrees of freedom: not too confident
    assert np.mean(normalised) > 0.1  # nor meaninglessly wide
