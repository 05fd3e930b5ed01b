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
from cdff_dev.evaluate._orbital import Drive, Ground, patch

DATUM_M, WAY_M = 40.0, 75.0


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.make(2)


@pytest.fixture(scope="module")
def orbital(ground: Ground) -> ElevationMap:
    return ground.orbital(2, DATUM_M)


@pytest.fixture(scope="module")
def drive(ground: Ground) -> Drive:
    return Drive.make(ground, 2, WAY_M)


def localisation(**config: Any) -> AbsoluteLocalisation:
    made = AbsoluteLocalisation()
    made.configure(config, DfpcContext("mana"))
    return made


def run(node: AbsoluteLocalisation, samples: Iterator[Sample], orbital: ElevationMap | None) -> list[Output]:
    if orbital is not None:
        assert list(node.step(Sample("orbital", 0, 0, orbital, id="o"))) == []
    return [output for sample in samples for output in node.step(sample)]


def errors_m(output: Output, drive: Drive) -> np.ndarray:
    true = drive.true[output.t1_ns // 10_000_000_000 - 1]
    error: np.ndarray = output.value.transform.matrix[:3, 3] - true[:3, 3] - [0.0, 0.0, DATUM_M]
    return error


@pytest.mark.req("CDFF-CORE-088")
def test_each_segment_of_relief_leads_to_a_fix_within_its_covariance(
    ground: Ground, orbital: ElevationMap, drive: Drive
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
    assert np.hypot(*(drive.believed[-1] - drive.true[-1])[:2, 3]) > 3.0  # what the robot itself believed


@pytest.mark.req("CDFF-CORE-088")
def test_the_model_of_other_ground_and_flat_ground_are_refused(ground: Ground, drive: Drive) -> None:
    other = run(localisation(), drive.samples(ground, 2), Ground.make(77).orbital(1, DATUM_M))
    assert [o.value for o in other] == [None, None]
    plain = Ground.make(3, 0.0)
    flat = run(localisation(), Drive.make(plain, 3, 35.0).samples(plain, 3), plain.orbital(3, 0.0))
    assert [(o.quality.status, o.quality.reasons) for o in flat] == [(Status.FAILED, ("flat",))]


def test_without_a_model_nothing_is_answered_and_nothing_is_kept_of_another(
    ground: Ground, orbital: ElevationMap, drive: Drive
) -> None:
    node = localisation()
    samples = list(drive.samples(ground, 2))
    assert run(node, iter(samples[:20]), None) == []
    with pytest.raises(ProductNotFoundError):
        node.call("get_correction", {})
    assert node.call("get_map", {}) is node.store.get("rover_map")
    first = list(node.step(Sample("orbital", 0, 0, orbital)))
    assert len(first) == 1  # the segment was long enough, the model was what was missing
    assert first[0].value is not None
    node.call("forget", {})
    with pytest.raises(ProductNotFoundError):
        node.call("get_map", {})
    assert node.store.get("orbital") is orbital


def test_the_correction_brings_the_robots_frame_onto_the_model(
    ground: Ground, orbital: ElevationMap, drive: Drive
) -> None:
    node = localisation()
    outputs = run(node, drive.samples(ground, 2), orbital)
    correction = node.call("get_correction", {})
    assert (correction.parent_frame, correction.child_frame) == ("site", "mana/map")
    last = drive.believed[outputs[-1].t1_ns // 10_000_000_000 - 1]
    np.testing.assert_allclose(correction.transform.matrix @ last, outputs[-1].value.transform.matrix, atol=1e-6)
    assert node.store.get("correction") is correction


def test_without_poses_the_extent_of_the_map_says_when_and_the_answer_is_the_maps_place(
    ground: Ground, orbital: ElevationMap, drive: Drive
) -> None:
    node = localisation(prior_m=12.0, segment_m=45.0)
    patches = (s for s in drive.samples(ground, 2) if s.port == "dem")
    outputs = run(node, patches, orbital)
    assert outputs[0].child == "mana/map"
    assert outputs[0].value is not None
    middle = drive.believed[3]
    at = (outputs[0].value.transform.matrix @ middle)[:2, 3]
    assert np.hypot(*(at - drive.true[3][:2, 3])) < 1.2


def pose_sample(port: str, T: np.ndarray, i: int) -> Sample:
    stamp_ns = (i + 1) * 10_000_000_000
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(T, np.diag([133.0, 133.0, 1.0, 1e-5, 1e-5, 7e-4])),
        parent="site", child="mana/base", stamp_ns=stamp_ns,
    )  # fmt: skip
    return Sample(port, stamp_ns, i, pose)


def moved_by(
    node: AbsoluteLocalisation,
    ground: Ground,
    drive: Drive,
    jump: Callable[[Output, np.ndarray], np.ndarray],
    odometry: bool = False,
) -> Iterator[Output]:
    """Outputs of a drive whose frame of poses moves by ``jump(answer, own pose)`` after each answer."""  # fmt: skip
    rng = np.random.default_rng([2, 10])
    moved = np.eye(4)
    for i, (true, own) in enumerate(zip(drive.true, drive.believed, strict=True)):
        stamp_ns, believed = (i + 1) * 10_000_000_000, moved @ own
        for port, T in (("odometry", own), ("poses", believed))[0 if odometry else 1 :]:
            assert list(node.step(pose_sample(port, T, i))) == []
        for output in node.step(Sample("dem", stamp_ns, i, patch(ground, true, believed, stamp_ns, rng))):
            yield output
            if output.value is not None:
                moved = jump(output, own)


def test_an_answer_that_becomes_the_next_belief_is_followed_by_another(ground: Ground, orbital: ElevationMap) -> None:
    drive, node = Drive.make(ground, 2, 110.0), localisation()
    assert list(node.step(Sample("orbital", 0, 0, orbital))) == []
    outputs = list(moved_by(node, ground, drive, lambda o, own: o.value.transform.matrix @ se3.inverse(own)))
    assert len(outputs) == 3
    assert all(o.quality.status is not Status.FAILED for o in outputs)
    assert max(np.hypot(*errors_m(o, drive)[:2]) for o in outputs) < 1.0
    assert outputs[-1].quality.metrics["way_m"] < 115.0  # 43 m of jump are not driven


def test_a_frame_that_jumps_takes_the_hypotheses_along_where_odometry_tells(
    ground: Ground, orbital: ElevationMap, drive: Drive
) -> None:
    jump = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.1])), np.array([3.0, -2.0, 1.0]))
    node = localisation()
    assert list(node.step(Sample("orbital", 0, 0, orbital))) == []
    found = moved_by(node, ground, drive, lambda output, own: jump, odometry=True)
    first = next(found)
    correction = node.call("get_correction", {}).transform.matrix
    last = next(found)
    assert [o.quality.metrics["matches"] for o in (first, last)] == [1.0, 2.0]
    assert last.quality.status is not Status.FAILED
    assert np.hypot(*errors_m(last, drive)[:2]) < 1.0
    now = node.call("get_correction", {}).transform.matrix
    assert np.hypot(*(now @ jump - correction)[:2, 3]) < 3.0  # what was drifted since
    assert last.quality.metrics["way_m"] < 75.1


JUMP = se3.transform(np.eye(3), np.array([3.0, -2.0, 1.0]))


def test_a_mission_clock_that_goes_back_begins_anew(ground: Ground, orbital: ElevationMap, drive: Drive) -> None:
    node = localisation()
    assert list(node.step(Sample("orbital", 0, 0, orbital))) == []
    first, again = (list(moved_by(node, ground, drive, lambda o, own: JUMP, odometry=True)) for _ in range(2))
    assert [o.t1_ns for o in again] == [o.t1_ns for o in first]
    assert [o.quality.metrics["matches"] for o in again] == [1.0, 2.0]


def test_what_was_answered_on_another_orbital_model_is_not_carried_onto_the_new_one(
    ground: Ground, orbital: ElevationMap, drive: Drive
) -> None:
    node = localisation()
    assert list(node.step(Sample("orbital", 0, 0, orbital))) == []
    answer = next(moved_by(node, ground, drive, lambda o, own: JUMP, odometry=True))
    assert list(node.step(Sample("orbital", answer.t1_ns, 1, orbital))) == []
    i = answer.t1_ns // 10_000_000_000
    for port, T in (("odometry", drive.believed[i]), ("poses", JUMP @ drive.believed[i])):
        assert list(node.step(pose_sample(port, T, i))) == []
    with pytest.raises(ProductNotFoundError, match="since the frame of poses jumped"):
        node.call("get_correction", {})


def test_patches_in_another_frame_than_the_poses_are_refused(
    ground: Ground, orbital: ElevationMap, drive: Drive
) -> None:
    pose, dem = list(drive.samples(ground, 2))[:2]
    moved = ElevationMap.from_layers(
        type(dem.value.geometry)("elsewhere", *_placement(dem.value)),
        {name: dem.value.layer(name) for name in dem.value.layer_names}, t0_ns=0, t1_ns=1000,
    )  # fmt: skip
    outputs = run(localisation(), iter([pose, Sample("dem", 1000, 0, moved)]), orbital)
    assert outputs[0].quality.status is Status.FAILED
    assert "elsewhere" in outputs[0].quality.reasons[0]


def test_configured_otherwise_the_covariance_is_formal(ground: Ground, orbital: ElevationMap, drive: Drive) -> None:
    outputs = run(localisation(match={"candidates": 8}), drive.samples(ground, 2), orbital)
    assert outputs[0].quality.covariance_kind is CovarianceKind.FORMAL
    with pytest.raises(ConfigurationError, match="segment"):
        localisation(segment_m=0.0)


def _placement(dem: ElevationMap) -> tuple[float, float, float, int, int]:
    g = dem.geometry
    return g.resolution_m, g.xmin_m, g.ymax_m, g.rows, g.cols
