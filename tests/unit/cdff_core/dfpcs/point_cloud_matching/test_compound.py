# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point cloud matching: registration at any relative heading, and refusal without overlap."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, ProductNotFoundError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from tests.support import surfaces

T_TRUE = se3.exp_se3([30.0, -12.0, 5.0, 0.1, -0.2, 2.5])


def make_configured_dfpc(**config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("point_cloud_matching")
    dfpc.configure(config)
    return dfpc


def cloud(port: str, points: surfaces.Points, stamp_ns: int = 1000) -> Sample:
    value = Pointcloud.from_points(points, frame=port, stamp_ns=stamp_ns)
    return Sample(port, stamp_ns, 0, value, id=f"{port}-{stamp_ns}")


def run_matching(dfpc: Dfpc, *samples: Sample) -> Output:
    outputs = [output for sample in samples for output in dfpc.step(sample)]
    assert len(outputs) == 1
    return outputs[0]


def source_of(points: surfaces.Points) -> surfaces.Points:
    return se3.transform_points(se3.inverse(T_TRUE), points)


def test_two_overlapping_parts_of_a_surface_are_registered_without_a_guess(
    rng: np.random.Generator,
) -> None:
    left, right = surfaces.terrain(rng, 9000), surfaces.terrain(rng, 9000)
    left, right = left[left[:, 0] < 4.0], right[right[:, 0] > -4.0]
    output = run_matching(make_configured_dfpc(), cloud("target", left), cloud("source", source_of(right)))
    assert output.quality.status is not Status.FAILED
    assert output.quality.covariance_kind is CovarianceKind.FORMAL
    T = output.value.transform
    error = se3.log_se3(T.matrix @ se3.inverse(T_TRUE))
    assert np.linalg.norm(error[:3]) < 0.03
    assert np.linalg.norm(error[3:]) < 0.005
    assert T.covariance is not None
    assert (output.frame, output.child, output.t1_ns) == ("target", "source", 1000)
    assert output.inputs == ("target-1000", "source-1000")
    assert {"matches", "match_inliers", "clique", "overlap_source", "least_agreement"} <= set(
        output.quality.metrics
    )


def test_a_source_received_before_its_target_is_processed_with_the_target(rng: np.random.Generator) -> None:
    dfpc = make_configured_dfpc()
    source, target = cloud("source", source_of(surfaces.terrain(rng))), cloud("target", surfaces.terrain(rng))
    with pytest.raises(ProductNotFoundError, match="still empty"):
        dfpc.store.get("target")
    assert run_matching(dfpc, source, target).quality.status is Status.OK
    assert dfpc.store.get("last_transform").parent_frame == "target"
    assert dfpc.store.get("target").frame == "target"


@pytest.mark.slow
def test_the_same_clouds_give_the_same_transform_bit_for_bit(rng: np.random.Generator) -> None:
    samples = cloud("target", surfaces.terrain(rng)), cloud("source", source_of(surfaces.terrain(rng)))
    first, second = (run_matching(make_configured_dfpc(), *samples).value.transform for _ in range(2))
    assert np.array_equal(first.matrix, second.matrix)
    assert np.array_equal(first.covariance, second.covariance)


@pytest.mark.parametrize("noise_m", [0.0, 0.001])
def test_a_cloud_is_registered_with_its_own_copy(rng: np.random.Generator, noise_m: float) -> None:
    points = surfaces.terrain(rng)
    copy = points + rng.normal(0.0, noise_m, points.shape)
    output = run_matching(make_configured_dfpc(), cloud("target", points), cloud("source", copy))
    assert output.quality.status is Status.OK, output.quality.reasons
    assert np.linalg.norm(se3.log_se3(output.value.transform.matrix)) < 0.002
    assert output.quality.metrics["expected_by_chance"] < 1e-20


def test_unrelated_clouds_fail_with_no_overlap(rng: np.random.Generator) -> None:
    unrelated = surfaces.terrain(rng)[:, [1, 0, 2]] * [1, 1, -2] + [0, 0, 3]
    output = run_matching(
        make_configured_dfpc(), cloud("target", surfaces.terrain(rng)), cloud("source", unrelated)
    )
    assert output.value is None
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0] == "no_overlap"


@pytest.mark.slow
@pytest.mark.parametrize("shape", [surfaces.plane, surfaces.corridor])
def test_a_shape_with_unconstrained_directions_is_refused(rng: np.random.Generator, shape: Any) -> None:
    output = run_matching(make_configured_dfpc(), cloud("target", shape(rng)), cloud("source", shape(rng)))
    assert output.quality.status is Status.FAILED


@pytest.mark.parametrize("points", [np.zeros((10, 3)), np.full((500, 3), np.nan), np.zeros((500, 3))])
def test_an_unusable_cloud_leads_to_a_failed_output(rng: np.random.Generator, points: np.ndarray) -> None:
    valid = surfaces.terrain(rng)
    bad_source = run_matching(make_configured_dfpc(), cloud("target", valid), cloud("source", points))
    bad_target = run_matching(make_configured_dfpc(), cloud("target", points), cloud("source", valid))
    assert bad_source.quality.status is bad_target.quality.status is Status.FAILED
    assert bad_source.quality.reasons[0].startswith(("bad_input", "no_overlap"))
    assert bad_target.quality.reasons[0].startswith(("bad_target", "bad_input", "no_overlap"))


def test_after_forget_a_source_waits_again(rng: np.random.Generator) -> None:
    dfpc = make_configured_dfpc()
    assert list(dfpc.step(cloud("target", surfaces.terrain(rng)))) == []
    dfpc.call("forget", {})
    assert list(dfpc.step(cloud("source", surfaces.terrain(rng)))) == []


def test_an_invalid_radius_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="support_voxels"):
        make_configured_dfpc(support_voxels=[])
    with pytest.raises(ConfigurationError, match="support_voxels"):
        make_configured_dfpc(support_voxels=[-1.0])
