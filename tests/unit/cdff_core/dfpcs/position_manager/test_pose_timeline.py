# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Timeline of poses: thinning, pins, gaps; covariances of motions by the joint covariance of all nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import relative_jacobians
from cdff_common.interfaces.registry import Registry
from cdff_core.dfpcs.position_manager.estimate import TIMELINE_ERRORS, Estimate
from cdff_core.dfpcs.position_manager.pose_timeline import Node, PoseTimeline, to_trajectory

S = 1_000_000_000


def timeline(max_silence_s: float = 100.0) -> PoseTimeline:
    interpolation = Registry.default().make_dfn("frame_interpolation")
    interpolation.configure()
    return PoseTimeline(interpolation, round(max_silence_s * S))


def estimate(stamp_ns: int, x_m: float = 0.0) -> Estimate:
    T = UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0]), 0.01 * np.eye(6))
    return Estimate.at_start(stamp_ns, T, 0.1, np.zeros(6), np.full(9, 0.1))


def filled(stamps_s: list[float], max_silence_s: float = 100.0) -> PoseTimeline:
    result = timeline(max_silence_s)
    for t in stamps_s:
        result.append(estimate(round(t * S), x_m=t))
    return result


def seconds(timeline: PoseTimeline) -> list[float]:
    assert timeline.stamps_ns == [n.stamp_ns for n in timeline.nodes]
    return [t / S for t in timeline.stamps_ns]


def test_a_node_has_the_pose_and_the_stored_errors_of_the_estimate() -> None:
    e = estimate(3 * S, 2.0)
    node = Node.from_estimate(e)
    np.testing.assert_array_equal(node.pose, e.pose)
    np.testing.assert_array_equal(node.covariance, e.covariance[np.ix_(TIMELINE_ERRORS, TIMELINE_ERRORS)])
    np.testing.assert_array_equal(node.cross_covariance, e.cross_covariance[TIMELINE_ERRORS])


def test_an_estimate_of_the_same_time_replaces_the_newest_and_keeps_its_gap() -> None:
    line = filled([0, 1, 2.001], max_silence_s=1.0)
    assert [n.after_gap for n in line.nodes] == [False, False, True]
    line.append(estimate(round(2.001 * S), 9.0))
    assert seconds(line) == [0, 1, 2.001]
    assert (line.nodes[-1].after_gap, line.nodes[-1].pose[0, 3]) == (True, 9.0)


def test_nodes_at_a_time_stay_when_those_after_it_are_removed() -> None:
    line = filled([0, 1, 2, 3])
    line.remove_after(2 * S)
    assert seconds(line) == [0, 1, 2]
    line.remove_after(2 * S - 1)
    assert seconds(line) == [0, 1]


def test_poses_are_interpolated_between_the_first_and_the_newest_node() -> None:
    line = filled([1, 2, 3])
    assert line.pose_at(1 * S).matrix[0, 3] == 1.0
    assert line.pose_at(round(2.25 * S)).matrix[0, 3] == pytest.approx(2.25)
    assert line.pose_at(3 * S).matrix[0, 3] == 3.0
    prediction = estimate(4 * S, 4.0)
    assert line.pose_at(round(3.5 * S), prediction).matrix[0, 3] == pytest.approx(3.5)
    assert line.pose_at(4 * S, prediction).matrix[0, 3] == 4.0
    for stamp_ns, outside in ((S - 5_000_000, "0.005 s"), (3 * S + 2_000_000, "0.002 s")):
        with pytest.raises(ExtrapolationError, match=f"{outside} outside"):
            line.pose_at(stamp_ns)
    with pytest.raises(ExtrapolationError, match="no pose"):
        timeline().pose_at(0)


def test_no_pose_is_interpolated_over_a_silence() -> None:
    line = filled([0, 1, 3], max_silence_s=1.0)
    assert line.pose_at(S // 2).matrix[0, 3] == pytest.approx(0.5)
    with pytest.raises(ExtrapolationError, match=f"from {S} to {3 * S}"):
        line.pose_at(2 * S)
    assert line.pose_at(3 * S).matrix[0, 3] == 3.0


def test_nodes_are_thinned_to_one_per_period_before_the_dense_part() -> None:
    line = filled([k * 0.25 for k in range(17)])
    line.thin(3 * S, S, 0)
    assert seconds(line) == [0, 1, 2, 3, 3.25, 3.5, 3.75, 4]
    assert not any(n.after_gap for n in line.nodes)
    assert line.pose_at(round(1.6 * S)).matrix[0, 3] == pytest.approx(1.6)


def test_nodes_farther_apart_than_the_period_stay() -> None:
    line = filled([0, 0.6, 1.2, 1.8, 2.4, 5])
    line.thin(5 * S, S, 0)
    assert seconds(line) == [0, 0.6, 1.2, 1.8, 2.4, 5]


def test_old_nodes_are_removed_except_the_first_the_newest_and_those_around_pins() -> None:
    line = filled([float(t) for t in range(11)])
    line.pins = {round(3.5 * S), 6 * S}
    line.thin(9 * S, S, 8 * S)
    assert seconds(line) == [0, 3, 4, 6, 8, 9, 10]
    assert [n.after_gap for n in line.nodes] == [False, True, False, True, True, False, False]
    assert line.pose_at(round(3.5 * S)).matrix[0, 3] == pytest.approx(3.5)
    with pytest.raises(ExtrapolationError, match="removed"):
        line.pose_at(5 * S)


def correlated(rng: np.random.Generator, n: int) -> tuple[PoseTimeline, np.ndarray]:
    """Return a timeline whose errors are a random Markov chain, and their joint covariance (9 n, 9 n)."""
    line = timeline()
    joint = np.zeros((9 * n, 9 * n))
    nodes, previous = [], None
    for k in range(n):
        F, root = np.eye(9) + 0.1 * rng.normal(size=(9, 9)), 0.1 * rng.normal(size=(9, 9))
        rows = slice(9 * k, 9 * k + 9)
        if previous is None:
            covariance, cross = root @ root.T + 0.01 * np.eye(9), np.zeros((9, 9))
        else:
            covariance, cross = F @ previous @ F.T + root @ root.T, F @ previous
            before = slice(9 * k - 9, 9 * k)
            joint[rows, : 9 * k] = F @ joint[before, : 9 * k]
            joint[: 9 * k, rows] = joint[rows, : 9 * k].T
        joint[rows, rows], previous = covariance, covariance
        nodes.append(Node(k * S, se3.exp_se3(rng.normal(size=6)), covariance, cross))
    line.restore(nodes, set())
    return line, joint


def expected_motion(joint: np.ndarray, line: PoseTimeline, i: int, j: int) -> np.ndarray:
    """Return the covariance of the motion between two nodes by their blocks of the joint covariance."""
    Ja, Jb = relative_jacobians(line.nodes[i].pose, line.nodes[j].pose)
    rows = np.r_[9 * i : 9 * i + 6, 9 * j : 9 * j + 6]
    J = np.hstack([Ja, Jb])
    return np.asarray(J @ joint[np.ix_(rows, rows)] @ J.T)


@pytest.mark.parametrize(("i", "j"), [(0, 1), (0, 4), (1, 3), (2, 4)])
def test_the_covariance_of_a_motion_contains_the_correlation_of_its_ends(
    rng: np.random.Generator, i: int, j: int
) -> None:
    line, joint = correlated(rng, 5)
    motion = line.motion(i * S, j * S)
    np.testing.assert_allclose(motion.matrix, np.linalg.inv(line.nodes[i].pose) @ line.nodes[j].pose)
    np.testing.assert_allclose(motion.covariance, expected_motion(joint, line, i, j), atol=1e-8)
    back = line.motion(j * S, i * S)
    np.testing.assert_allclose(back.matrix @ motion.matrix, np.eye(4), atol=1e-12)


def test_the_correlation_is_preserved_by_thinning(rng: np.random.Generator) -> None:
    line, joint = correlated(rng, 7)
    full = replace(line.nodes[0]), list(line.nodes)
    line.thin(6 * S, 3 * S, 0)
    assert seconds(line) == [0, 3, 6]
    whole_timeline = timeline()
    whole_timeline.restore(full[1], set())
    for i, j in ((0, 3), (3, 6), (0, 6)):
        np.testing.assert_allclose(
            line.motion(i * S, j * S).covariance, expected_motion(joint, whole_timeline, i, j), atol=1e-8
        )


def test_a_motion_without_duration_is_exact(rng: np.random.Generator) -> None:
    line, _ = correlated(rng, 3)
    motion = line.motion(S, S)
    np.testing.assert_array_equal(motion.matrix, np.eye(4))
    assert motion.covariance is None or not np.any(motion.covariance)


def test_a_motion_within_an_interval_has_less_error_than_independent_ends(rng: np.random.Generator) -> None:
    line, _ = correlated(rng, 3)
    a, b = round(1.25 * S), round(1.5 * S)
    Ja, Jb = relative_jacobians(line.pose_at(a).matrix, line.pose_at(b).matrix)
    independent = sum(J @ np.asarray(line.pose_at(t).covariance) @ J.T for J, t in ((Ja, a), (Jb, b)))
    assert np.trace(line.motion(a, b).covariance) < 0.5 * np.trace(independent)


def test_a_trajectory_has_the_nodes_between_two_times_in_microseconds() -> None:
    line = filled([1, 2, 3, 4])
    line.append(estimate(5 * S + 1_999, 5.0))
    part = line.trajectory(2 * S, 4 * S, "mana/base", "mana")
    assert part.stamps_ns.tolist() == [2 * S, 3 * S, 4 * S]
    assert (part.metadata.parent_frame_id, part.metadata.child_frame_id) == ("site", "mana/base")
    np.testing.assert_array_equal(part.matrices[:, 0, 3], [2.0, 3.0, 4.0])
    assert line.trajectory(-1, 2 * S, "mana/base", "").stamps_ns.tolist() == [S, 2 * S]
    assert line.trajectory(4 * S, -1, "mana/base", "").stamps_ns.tolist() == [4 * S, 5 * S + 1_000]
    assert len(line.trajectory(0, 9 * S, "mana/base", "").stamps_ns) == 5
    with pytest.raises(ExtrapolationError, match="no estimate"):
        line.trajectory(S + 1, 2 * S - 1, "mana/base", "")


def test_a_trajectory_may_be_empty() -> None:
    empty = to_trajectory([], [], "mana/base", "mana")
    assert len(empty.stamps_ns) == 0
    assert empty.matrices.shape == (0, 4, 4)
