# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Golden replays of feature matching, triangulation and bundle adjustment on real data."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.formats.libmv import read_libmv
from cdff_common.types import BundleProblem, Frame, FramePair
from cdff_dev.logs import LogWriter, open_log
from evaluation.data_sets.image_pairs import grey, marked_dlr
from evaluation.scenes.bundles import cost

pytestmark = [pytest.mark.golden, pytest.mark.slow]

#: Final cost of the recorded run; GTSAM reaches the same cost.
RECORDED_COST = 446.959995


def replay_twice(dfpc: str, values: dict[str, object], tmp_path: Path) -> dict[str, Any]:
    """Replay a log twice, check that both outputs have the same bytes, return the last value of each port."""
    log = tmp_path / "log.msg"
    with LogWriter(log) as writer:
        for i, (port, value) in enumerate(values.items(), 1):
            writer.write(f"/mana/{port}.in", value, 1_000_000 * i)
    wiring = [argument for port in values for argument in ("--map", f"{port}=/mana/{port}.in")]
    for name in "ab":
        assert main(["replay", str(log), "--dfpc", dfpc, *wiring, "--out", str(tmp_path / name)]) == 0
    first, second = ((tmp_path / name / "outputs.msg").read_bytes() for name in "ab")
    assert first == second
    with closing(open_log(tmp_path / "a" / "outputs.msg")) as outputs:
        return {sample.stream.rsplit(".", 1)[1]: sample.value for sample in outputs.samples()}


def test_images_of_the_satellite_mock_up_give_the_recorded_matches(
    real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    pair = marked_dlr(real_data("cdff_upstream").parent)
    frames = {side: Frame.from_image(getattr(pair, side), stamp_ns=0) for side in ("left", "right")}
    outputs = replay_twice("feature_matching", frames, tmp_path)
    matches = outputs["matches"]
    assert len(matches.items) == pytest.approx(328, rel=0.05)
    for source, sink in zip(pair.points, pair.partners, strict=True):
        errors = np.maximum(
            np.hypot(*(matches.sources_px - source).T), np.hypot(*(matches.sinks_px - sink).T)
        )
        assert errors.min() <= 5.0


def test_teddy_gives_the_recorded_cloud(real_data: Callable[[str], Path], tmp_path: Path) -> None:
    folder = real_data("middlebury/teddy")
    K = np.array([[925.0, 0.0, 225.0], [0.0, 925.0, 187.5], [0.0, 0.0, 1.0]])
    left, right = (grey(folder / f"im{i}.png") for i in (2, 6))
    pair = FramePair.from_images(left, right, baseline_m=0.16, camera_matrix=K, stamp_ns=1_000_000)
    outputs = replay_twice("triangulation", {"stereo": pair}, tmp_path)
    true_disparity_px = grey(folder / "disp2.png") / 4.0
    z = outputs["cloud"].points_m[:, 2]
    assert len(z) > 0.7 * true_disparity_px.size
    assert np.median(z) == pytest.approx(
        925.0 * 0.16 / np.median(true_disparity_px[true_disparity_px > 0]), rel=0.05
    )


def test_every_tenth_camera_of_the_libmv_problem_gives_the_recorded_cost(
    real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    full_problem = read_libmv(real_data("bundle/problem_01.bin"), frame="site")
    camera_indices = np.flatnonzero(np.arange(333) % 10 == 0)
    observations = full_problem.observations
    is_selected = np.isin(observations.cameras, camera_indices)
    problem = BundleProblem.from_arrays(
        full_problem.cameras.matrices[camera_indices],
        full_problem.lenses.values,
        full_problem.points.positions,
        (
            np.searchsorted(camera_indices, observations.cameras[is_selected]),
            observations.points[is_selected],
        ),
        observations.pixels[is_selected, :2],
        frame="site",
    )
    outputs = replay_twice("bundle_adjustment", {"problem": problem}, tmp_path)
    assert cost(outputs["problem"]) == pytest.approx(RECORDED_COST, rel=1e-4)
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["failed"] == 0
