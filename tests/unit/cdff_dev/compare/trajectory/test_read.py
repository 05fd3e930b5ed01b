# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectory files are recognised by their content; ``cdff eval trajectory`` compares trajectories."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgpack
import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.errors import CdffError
from cdff_common.formats.tum import write_tum
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import PoseTrajectory, TransformWithCovariance
from cdff_dev.compare.trajectory.read import read_track
from cdff_dev.logs import LogWriter

STAMPS_NS = np.arange(30, dtype=np.int64) * 100_000_000


def poses(rng: np.random.Generator, noise: float = 0.0) -> np.ndarray:
    steps = np.tile([0.5, 0.0, 0.02, 0.0, 0.01, 0.03], (30, 1)) + noise * rng.normal(size=(30, 6))
    T = [np.eye(4)]
    for step in se3.exp_se3(steps[1:]):
        T.append(T[-1] @ step)
    return np.array(T)


def test_tum_files_kitti_files_and_logs_give_equal_trajectories(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    T = poses(rng)
    (tmp_path / "a").write_bytes(write_tum(STAMPS_NS, T))
    np.savetxt(tmp_path / "b", T[:, :3].reshape(-1, 12))
    C = np.tile(np.eye(6), (30, 1, 1))
    with LogWriter(tmp_path / "c.msg") as log:
        trajectory = PoseTrajectory.from_arrays(STAMPS_NS, T, C, parent="site", child="rover/base")
        log.write("/rover/position_manager.trajectory", trajectory, int(STAMPS_NS[-1]))
        for stamp_ns, pose in zip(STAMPS_NS.tolist(), T, strict=True):
            value = TransformWithCovariance.from_transform(
                UncertainTransform(pose), parent="site", child="rover/base", stamp_ns=stamp_ns
            )
            log.write("/rover/truth.pose", value, stamp_ns)
    streams = {"a": None, "b": None, "c.msg": "/rover/position_manager.trajectory"}
    for name, stream in streams.items():
        track = read_track(tmp_path / name, stream)
        np.testing.assert_array_equal(track.stamps_ns, STAMPS_NS)
        np.testing.assert_allclose(track.matrices, T, atol=1e-8)
    assert read_track(tmp_path / "c.msg", "/rover/position_manager.trajectory").covariances is not None
    assert read_track(tmp_path / "c.msg", "/rover/truth.pose").covariances is None
    with pytest.raises(CdffError, match="2 streams of poses; name one of"):
        read_track(tmp_path / "c.msg")


EUROC = (
    "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], "
    "q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_x"
)
NAMED = "timestamp_ns,tx_m,ty_m,tz_m,qx,qy,qz,qw"


@pytest.mark.parametrize(
    ("header", "row"), [(EUROC, "7000,1,2,3,0.8,0.6,0,0,9"), (NAMED, "7000,1,2,3,0.6,0,0,0.8")]
)
def test_a_csv_file_is_read_by_the_names_of_its_columns(tmp_path: Path, header: str, row: str) -> None:
    (tmp_path / "a.csv").write_text(f"{header}\n{row}\n{row}\n")
    track = read_track(tmp_path / "a.csv")
    assert track.stamps_ns.tolist() == [7000]
    assert track.dropped == 1
    expected = se3.transform_from_quaternion_xyzw([1.0, 2.0, 3.0], [0.6, 0.0, 0.0, 0.8])
    np.testing.assert_allclose(track.matrices[0], expected)
    (tmp_path / "a.csv").write_text(f"{header}\n7000,1\n")
    with pytest.raises(CdffError, match="line 2"):
        read_track(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n", "3 numbers"),
        ("nothing here\n", "not a TUM file"),
        (" ".join(["1"] * 12) + "\n", "rotation"),
    ],
)
def test_a_file_without_a_trajectory_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "x").write_text(text)
    with pytest.raises(CdffError, match=message):
        read_track(tmp_path / "x")


def test_a_stream_without_samples_is_refused(tmp_path: Path) -> None:
    log = {"/mana/pom.pose.meta": {"type": "TransformWithCovariance", "timestamps": []}, "/mana/pom.pose": []}
    (tmp_path / "empty.msg").write_bytes(msgpack.packb(log))
    with pytest.raises(CdffError, match=r"/mana/pom\.pose: the stream has no samples"):
        read_track(tmp_path / "empty.msg")


def test_the_command_prints_a_table_or_json_and_writes_a_plot(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, noise in (("est", 0.01), ("ref", 0.0)):
        (tmp_path / name).write_bytes(write_tum(STAMPS_NS, poses(rng, noise)))
    command = ["eval", "trajectory", str(tmp_path / "est"), str(tmp_path / "ref")]
    assert main([*command, "--plot", str(tmp_path / "plot.svg")]) == 0
    assert "30 poses compared" in capsys.readouterr().out
    assert (tmp_path / "plot.svg").read_text().startswith("<svg")
    assert main([*command, "--json", "--align", "origin", "--segments-m", "2,4"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert [s["length_m"] for s in results["drift"]["segments"]] == [2.0, 4.0]
    assert main([*command, "--segments-m", "x"]) == 1


#: Program that runs evo in a separate process, because evo is GPL and must not be imported here.
PEER = """
import copy, json, sys
from evo.core import metrics
from evo.tools import file_interface
ref, est = (file_interface.read_kitti_poses_file(path) for path in sys.argv[1:3])
of = metrics.PoseRelation
relations = {"translation_m": of.translation_part, "rotation_deg": of.rotation_angle_deg}
answers = []
for case in json.loads(sys.argv[3]):
    moved = copy.deepcopy(est)
    if case["align"] == "origin":
        moved.align_origin(ref)
    elif case["align"] != "none":
        moved.align(ref, correct_scale=case["align"] == "sim3")
    statistics = {}
    for name, relation in relations.items():
        ape, rpe = metrics.APE(relation), metrics.RPE(
            relation, case["delta"], metrics.Unit(case["delta_unit"]), all_pairs=case["all_pairs"])
        for key, metric in (("ate", ape), ("rpe", rpe)):
            metric.process_data((ref, moved))
            statistics[key + name] = metric.get_all_statistics()
    answers.append(statistics)
print(json.dumps(answers))
"""


@pytest.fixture
def drifting(real_data: Callable[[str], Path], tmp_path: Path) -> tuple[Path, Path]:
    """Files of a drifting odometry and of the true poses of KITTI 00, every tenth pose."""
    rows = np.loadtxt(real_data("kitti_velodyne/00_poses_cam0.txt"))[::10].reshape(-1, 3, 4)
    true = se3.transform(se3.normalise_rotation(rows[:, :, :3]), rows[:, :, 3])
    noise = np.random.default_rng(0).normal(size=(len(true), 6)) * np.repeat([0.05, 0.003], 3)
    estimated = [true[0]]
    for a, b, e in zip(true[:-1], true[1:], noise, strict=False):
        estimated.append(estimated[-1] @ se3.inverse(a) @ b @ se3.exp_se3(e))
    for name, T in (("ref", true), ("est", np.array(estimated))):
        np.savetxt(tmp_path / name, T[:, :3].reshape(-1, 12), fmt="%.17g")
    return tmp_path / "est", tmp_path / "ref"


@pytest.mark.req("CDFF-DEV-051")
@pytest.mark.slow
def test_evo_computes_the_same_errors(drifting: tuple[Path, Path]) -> None:
    from cdff_dev.compare.trajectory.compare import compare

    if importlib.util.find_spec("evo") is None:
        pytest.skip("evo is not installed: uv pip install evo")
    est, ref = drifting
    cases = [
        {"align": align, "delta": delta, "delta_unit": unit, "all_pairs": all_pairs}
        for align, delta, unit, all_pairs in (
            ("se3", 1.0, "frames", False),
            ("none", 7.0, "frames", True),
            ("origin", 50.0, "m", False),
            ("sim3", 50.0, "m", True),
        )
    ]
    command = [sys.executable, "-c", PEER, str(ref), str(est), json.dumps(cases)]
    home = os.environ | {"HOME": str(est.parent), "MPLBACKEND": "agg"}
    completed = subprocess.run(command, check=True, capture_output=True, text=True, env=home)
    for case, peer in zip(cases, json.loads(completed.stdout.splitlines()[-1]), strict=True):
        results = compare(read_track(est), read_track(ref), **case).results
        for kind in ("ate", "rpe"):
            for name in ("translation_m", "rotation_deg"):
                for key, value in peer[kind + name].items():
                    assert results[kind][name][key] == pytest.approx(value, abs=1e-6), (case, kind, name, key)
