# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.types import ElevationMap, TransformWithCovariance
from cdff_core.dfpcs.absolute_localisation.compound import AbsoluteLocalisation
from cdff_core.dfpcs.absolute_localisation.hypotheses import Hypothesis
from evaluation.scenes.orbital import Ground, PatchRun, patch

DATUM_M, PATH_LENGTH_M = 40.0, 75.0
PATCH_PERIOD_NS = 10_000_000_000


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.make(2)


@pytest.fixture(scope="module")
def orbital(ground: Ground) -> ElevationMap:
    return ground.orbital(2, DATUM_M)


@pytest.fixture(scope="module")
def drive(ground: Ground) -> PatchRun:
    return PatchRun.make(ground, 2, PATH_LENGTH_M)


def localisation(**config: Any) -> AbsoluteLocalisation:
    result = AbsoluteLocalisation()
    result.configure(config, DfpcContext("mana"))
    return result


def run(node: AbsoluteLocalisation, samples: Iterator[Sample], orbital: ElevationMap | None) -> list[Output]:
    if orbital is not None:
        assert list(node.step(Sample("orbital", 0, 0, orbital, id="o"))) == []
    return [output for sample in samples for output in node.step(sample)]


def errors_m(output: Output, drive: PatchRun) -> np.ndarray:
    """Return the position error (3,) of a fix; the heights of the orbital model are DATUM_M larger."""
    true = drive.true_poses[output.t1_ns // PATCH_PERIOD_NS - 1]
    error: np.ndarray = output.value.transform.matrix[:3, 3] - true[:3, 3] - [0.0, 0.0, DATUM_M]
    return error


@pytest.mark.req("CDFF-CORE-088")
def test_each_segment_with_relief_yields_a_fix_of_the_stated_accuracy(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    node = localisation()
    outputs = run(node, drive.samples(ground, 2), orbital)
    assert len(outputs) == 2
    for output in outputs:
        assert output.quality.status is not Status.FAILED, output.quality.reasons
        assert np.hypot(*errors_m(output, drive)[:2]) < 1.0
        assert abs(errors_m(output, drive)[2]) < 0.2
        assert (output.frame, output.child) == ("site", "mana/base")
        assert output.quality.covariance_kind is CovarianceKind.CALIBRATED
        P = output.value.transform.covariance
        assert 0.05 < np.sqrt(P[0, 0] + P[1, 1]) < 1.0
    assert outputs[1].quality.metrics["matches"] == 2
    error_without_fixes = (drive.estimated_poses[-1] - drive.true_poses[-1])[:2, 3]
    assert np.hypot(*error_without_fixes) > 3.0


@pytest.mark.req("CDFF-CORE-088")
def test_a_model_of_another_terrain_and_flat_terrain_are_refused(ground: Ground, drive: PatchRun) -> None:
    of_other_terrain = run(localisation(), drive.samples(ground, 2), Ground.make(77).orbital(1, DATUM_M))
    assert [o.value for o in of_other_terrain] == [None, None]
    flat_ground = Ground.make(3, 0.0)
    flat = run(
        localisation(),
        PatchRun.make(flat_ground, 3, 35.0).samples(flat_ground, 3),
        flat_ground.orbital(3, 0.0),
    )
    assert [o.quality.status for o in flat] == [Status.FAILED]
    assert any(reason.startswith("uncertain") for reason in flat[0].quality.reasons)


def test_without_a_model_nothing_is_published_and_forget_clears_the_map(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    node = localisation()
    samples = list(drive.samples(ground, 2))
    assert run(node, iter(samples[:20]), None) == []
    with pytest.raises(ProductNotFoundError):
        node.call("get_correction", {})
    assert node.call("get_map", {}) is node.store.get("rover_map")
    (output,) = node.step(Sample("orbital", 0, 0, orbital))  # the segment was long enough before
    assert output.value is not None
    node.call("forget", {})
    with pytest.raises(ProductNotFoundError):
        node.call("get_map", {})
    assert node.store.get("orbital") is orbital


def test_the_correction_transforms_the_frame_of_the_robots_poses_into_the_orbital_frame(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    node = localisation()
    outputs = run(node, drive.samples(ground, 2), orbital)
    correction = node.call("get_correction", {})
    assert (correction.parent_frame, correction.child_frame) == ("site", "mana/map")
    last = drive.estimated_poses[outputs[-1].t1_ns // PATCH_PERIOD_NS - 1]
    np.testing.assert_allclose(
        correction.transform.matrix @ last, outputs[-1].value.transform.matrix, atol=1e-6
    )
    assert node.store.get("correction") is correction


def test_without_poses_the_extent_of_the_map_ends_a_segment_and_the_fix_is_the_pose_of_the_map(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    node = localisation(prior_m=12.0, segment_m=45.0)
    patches = (s for s in drive.samples(ground, 2) if s.port == "dem")
    outputs = run(node, patches, orbital)
    assert outputs[0].child == "mana/map"
    assert outputs[0].value is not None
    middle = drive.estimated_poses[3]
    position = (outputs[0].value.transform.matrix @ middle)[:2, 3]
    assert np.hypot(*(position - drive.true_poses[3][:2, 3])) < 1.2
    # Roll and pitch, which are not measured, have a standard deviation of 1 degree.
    tilt_covariance = outputs[0].value.transform.covariance[3:5, 3:5]
    np.testing.assert_allclose(tilt_covariance, np.radians(1.0) ** 2 * np.eye(2), rtol=1e-6, atol=1e-12)


def pose_sample(port: str, T: np.ndarray, i: int) -> Sample:
    stamp_ns = (i + 1) * PATCH_PERIOD_NS
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(T, np.diag([133.0, 133.0, 1.0, 1e-5, 1e-5, 7e-4])),
        parent="site",
        child="mana/base",
        stamp_ns=stamp_ns,
    )
    return Sample(port, stamp_ns, i, pose)


def drive_with_jumps(
    node: AbsoluteLocalisation,
    ground: Ground,
    drive: PatchRun,
    jump: Callable[[Output, np.ndarray], np.ndarray],
    odometry: bool = False,
) -> Iterator[Output]:
    """Yield the outputs of a drive; each fix sets ``T_new_old`` to ``jump(output, odometry_pose)``."""
    rng = np.random.default_rng([2, 10])
    T_new_old = np.eye(4)
    for i, (true, odometry_pose) in enumerate(zip(drive.true_poses, drive.estimated_poses, strict=True)):
        stamp_ns, pose = (i + 1) * PATCH_PERIOD_NS, T_new_old @ odometry_pose
        for port, T in (("odometry", odometry_pose), ("poses", pose))[0 if odometry else 1 :]:
            assert list(node.step(pose_sample(port, T, i))) == []
        for output in node.step(Sample("dem", stamp_ns, i, patch(ground, true, pose, stamp_ns, rng))):
            yield output
            if output.value is not None:
                T_new_old = jump(output, odometry_pose)


def test_further_fixes_follow_a_fix_that_the_pose_filter_uses(ground: Ground, orbital: ElevationMap) -> None:
    drive, node = PatchRun.make(ground, 2, 110.0), localisation()
    assert list(node.step(Sample("orbital", 0, 0, orbital))) == []
    outputs = list(
        drive_with_jumps(
            node,
            ground,
            drive,
            lambda o, odometry_pose: o.value.transform.matrix @ se3.inverse(odometry_pose),
        )
    )
    assert len(outputs) == 3
    assert all(o.quality.status is not Status.FAILED for o in outputs)
    assert max(np.hypot(*errors_m(o, drive)[:2]) for o in outputs) < 1.0
    assert outputs[-1].quality.metrics["path_length_m"] < 115.0  # without 43 m of jumps


def test_hypotheses_follow_a_jump_that_odometry_measures(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    jump = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.1])), np.array([3.0, -2.0, 1.0]))
    node = localisation()
    assert list(node.step(Sample("orbital", 0, 0, orbital))) == []
    result = drive_with_jumps(node, ground, drive, lambda output, odometry_pose: jump, odometry=True)
    first = next(result)
    correction = node.call("get_correction", {}).transform.matrix
    last = next(result)
    assert [o.quality.metrics["matches"] for o in (first, last)] == [1.0, 2.0]
    assert last.quality.status is not Status.FAILED
    assert np.hypot(*errors_m(last, drive)[:2]) < 1.0
    new_correction = node.call("get_correction", {}).transform.matrix
    assert np.hypot(*(new_correction @ jump - correction)[:2, 3]) < 3.0  # plus drift
    assert last.quality.metrics["path_length_m"] < 75.1


JUMP = se3.transform(np.eye(3), np.array([3.0, -2.0, 1.0]))


def test_a_backward_jump_of_the_mission_clock_clears_the_state(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    node = localisation()
    assert list(node.step(Sample("orbital", 0, 0, orbital))) == []
    first, second = (
        list(drive_with_jumps(node, ground, drive, lambda o, odometry_pose: JUMP, odometry=True))
        for _ in range(2)
    )
    assert [o.t1_ns for o in second] == [o.t1_ns for o in first]
    assert [o.quality.metrics["matches"] for o in second] == [1.0, 2.0]


def test_a_new_orbital_model_clears_earlier_matches(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    node = localisation()
    assert list(node.step(Sample("orbital", 0, 0, orbital))) == []
    fix = next(drive_with_jumps(node, ground, drive, lambda o, odometry_pose: JUMP, odometry=True))
    assert list(node.step(Sample("orbital", fix.t1_ns, 1, orbital))) == []
    i = fix.t1_ns // PATCH_PERIOD_NS
    for port, T in (("odometry", drive.estimated_poses[i]), ("poses", JUMP @ drive.estimated_poses[i])):
        assert list(node.step(pose_sample(port, T, i))) == []
    with pytest.raises(ProductNotFoundError, match="since the frame of poses jumped"):
        node.call("get_correction", {})


def test_patches_in_another_frame_than_the_poses_are_refused(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    pose, dem = list(drive.samples(ground, 2))[:2]
    elsewhere = ElevationMap.from_layers(
        type(dem.value.geometry)("elsewhere", *_placement(dem.value)),
        {name: dem.value.layer(name) for name in dem.value.layer_names},
        t0_ns=0,
        t1_ns=1000,
    )
    outputs = run(localisation(), iter([pose, Sample("dem", 1000, 0, elsewhere)]), orbital)
    assert outputs[0].quality.status is Status.FAILED
    assert "elsewhere" in outputs[0].quality.reasons[0]


@pytest.mark.parametrize(("cell_m", "limit_m"), [(0.5, 60.0), (1.0, 60.0), (2.0, 120.0)])
def test_the_largest_search_is_sixty_cells_and_at_least_sixty_metres(cell_m: float, limit_m: float) -> None:
    uncertain = Hypothesis(np.eye(4), np.diag([1e8, 1e8, 1.0, 1e-6]), np.zeros(3))
    range_m, _ = localisation()._search_range((uncertain,), cell_m)
    assert range_m == limit_m


def test_with_non_default_parameters_the_covariance_is_formal(
    ground: Ground, orbital: ElevationMap, drive: PatchRun
) -> None:
    outputs = run(localisation(match={"candidates": 8}), drive.samples(ground, 2), orbital)
    assert outputs[0].quality.covariance_kind is CovarianceKind.FORMAL
    with pytest.raises(ConfigurationError, match="segment"):
        localisation(segment_m=0.0)


def _placement(dem: ElevationMap) -> tuple[float, float, float, int, int]:
    g = dem.geometry
    return g.resolution_m, g.xmin_m, g.ymax_m, g.rows, g.cols
