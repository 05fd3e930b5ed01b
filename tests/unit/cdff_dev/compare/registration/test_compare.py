# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff eval registration``: recall, errors, consistency of covariances and false accepts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.geometry import UncertainTransform, se3
from cdff_dev.compare.registration import Pair, compare
from cdff_dev.compare.registration.rates import interval, nees_band

T_TRUE = se3.exp_se3([1.0, -2.0, 0.5, 0.1, 0.2, -0.4])


def pose_file(path: Path, T: np.ndarray, covariance: np.ndarray | None = None) -> None:
    value = {"T": T.tolist(), "covariance": None if covariance is None else covariance.tolist()}
    path.write_text(json.dumps(value), encoding="utf-8")


def report(folder: Path, T: np.ndarray | None, **metrics: float) -> None:
    folder.mkdir(parents=True)
    entry: dict[str, Any] = {"type": "TransformWithCovariance"}
    if T is not None:
        entry["value"] = {"T": T.tolist(), "covariance": (1e-4 * np.eye(6)).tolist()}
    text = json.dumps({"outputs": {"transform": entry}, "quality": {"metrics": metrics}})
    (folder / "outputs.json").write_text(text, encoding="utf-8")


def evaluate(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    assert main(["eval", "registration", *map(str, arguments), "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def test_a_pose_is_evaluated_by_each_gate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    inaccurate = T_TRUE.copy()
    inaccurate[0, 3] += 0.1
    pose_file(tmp_path / "est.json", inaccurate)
    np.savetxt(tmp_path / "truth.txt", T_TRUE)
    row = evaluate(capsys, tmp_path / "est.json", tmp_path / "truth.txt")
    assert row["within_0.3_m_3_deg"]["recall"]["count"] == 1
    assert row["within_0.02_m_0.1_deg"]["wrong"]["count"] == 1
    assert row["error_m"]["median"] == pytest.approx(0.1, abs=1e-6)
    assert row["nees"] == {"count": 0}


@pytest.mark.req("CDFF-DEV-052")
def test_refusals_and_false_accepts_of_a_folder_of_runs_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report(tmp_path / "est" / "a", T_TRUE, matches=100.0, match_inliers=20.0)
    report(tmp_path / "est" / "b", None, matches=50.0)
    report(tmp_path / "est" / "nothing", T_TRUE, matches=30.0)
    (tmp_path / "truth").mkdir()
    for name in "ab":
        pose_file(tmp_path / "truth" / f"{name}.json", T_TRUE)
    (tmp_path / "truth" / "nothing.json").touch()
    row = evaluate(capsys, tmp_path / "est", tmp_path / "truth", "--gate", "0.1,1")
    assert row["within_0.1_m_1_deg"]["recall"] == interval(1, 2)
    assert row["false_accepts"] == interval(1, 1)
    assert row["counts"]["matches"] == 50.0
    assert main(["eval", "registration", str(tmp_path / "est"), str(tmp_path / "truth")]) == 0
    assert "false accepts: 1 of 1" in capsys.readouterr().out


def test_consistent_covariances_are_within_the_band_and_optimistic_ones_above(
    rng: np.random.Generator,
) -> None:
    C = np.diag([0.01, 0.02, 0.01, 0.001, 0.001, 0.002]) ** 2
    truth, estimate = {}, {}
    for i in range(200):
        e = rng.multivariate_normal(np.zeros(6), C)
        truth[str(i)] = Pair(
            UncertainTransform(se3.transform(se3.exp_so3(e[3:]) @ T_TRUE[:3, :3], T_TRUE[:3, 3] + e[:3]))
        )
        estimate[str(i)] = Pair(UncertainTransform(T_TRUE, C))
    comparison = compare(estimate, truth, [(1.0, 10.0)])
    assert comparison["nees"]["inside"]
    assert comparison["nees"]["mean_sigma_m"] == pytest.approx(0.01414, rel=1e-3)
    optimistic = {name: Pair(UncertainTransform(T_TRUE, 0.25 * C)) for name in estimate}
    assert compare(optimistic, truth, [])["nees"]["mean"] > nees_band(200)[1]


def test_trajectories_are_compared_pose_by_pose(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [f"{i}.0 {i} 0 0 0 0 0 1" for i in range(3)]
    (tmp_path / "truth.tum").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (tmp_path / "est.tum").write_text("\n".join(lines[:2]) + "\n", encoding="utf-8")
    row = evaluate(capsys, tmp_path / "est.tum", tmp_path / "truth.tum")
    assert (row["pairs"], row["answered"], row["refused"]) == (3, 2, 1)


def test_inconsistent_input_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truth").mkdir()
    (tmp_path / "est").mkdir()
    pose_file(tmp_path / "est" / "x.json", T_TRUE)
    pose_file(tmp_path / "truth" / "y.json", T_TRUE)
    assert main(["eval", "registration", str(tmp_path / "est"), str(tmp_path / "truth")]) == 1
    assert "'x'" in capsys.readouterr().err
    assert main(["eval", "registration", str(tmp_path / "est"), str(tmp_path / "none")]) == 1
    assert main(["eval", "registration", str(tmp_path / "est"), str(tmp_path / "truth"), "--gate", "3"]) == 1
    assert "--gate 3" in capsys.readouterr().err


def test_clopper_pearson_has_the_published_values() -> None:
    """Compare with Clopper and Pearson (1934), values of R's binom.test: 0 of 500, and 15 of 20."""
    assert interval(0, 500)["high"] == pytest.approx(0.0074, abs=1e-4)
    assert (interval(15, 20)["low"], interval(15, 20)["high"]) == pytest.approx((0.5090, 0.9134), abs=1e-4)


def test_the_command_draws_the_errors_with_the_gates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("est", "truth"):
        (tmp_path / folder).mkdir()
    for number in range(3):
        np.savetxt(tmp_path / "truth" / f"{number}.txt", T_TRUE)
        if number:
            np.savetxt(tmp_path / "est" / f"{number}.txt", T_TRUE @ se3.exp_se3([0.01 * number, *[0.0] * 5]))
    plot = tmp_path / "errors.svg"
    command = ["eval", "registration", str(tmp_path / "est"), str(tmp_path / "truth"), "--plot", str(plot)]
    assert main([*command, "--gate", "0.015,1"]) == 0
    capsys.readouterr()
    text = plot.read_text()
    for label in ("2 of 3 pairs", "0.015 m, 1°", "rotation error, degrees"):
        assert label in text


def test_errors_without_any_pair_are_not_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "est").mkdir()
    (tmp_path / "truth").mkdir()
    np.savetxt(tmp_path / "truth" / "a.txt", T_TRUE)
    command = ["eval", "registration", str(tmp_path / "est"), str(tmp_path / "truth")]
    assert main([*command, "--plot", str(tmp_path / "plot.png")]) == 1
    assert "nothing to draw" in capsys.readouterr().err
