# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import CodecError, InputError
from cdff_common.formats.bal import read_bal, write_bal
from cdff_common.formats.format_detection import detect
from cdff_common.formats.libmv import read_libmv, write_libmv
from cdff_common.types import BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2
from evaluation.scenes.bundles import cost, ring

BAL = """2 1 2
0 0 10.0 20.0
1 0 -5.5 7.25
0.0 0.0 0.0 0.0 0.0 0.0 100.0 0.01 0.001
0.1 -0.2 0.05 1.0 2.0 -3.0 120.0 0.0 0.0
0.5 0.25 -4.0
"""


def test_a_bal_camera_looks_along_minus_z_and_conversion_keeps_the_cost() -> None:
    problem = read_bal(BAL.encode(), frame="site")
    x, y = 0.5 / 4.0, 0.25 / 4.0
    r2 = x * x + y * y
    scale = 100.0 * (1.0 + 0.01 * r2 + 0.001 * r2 * r2)
    residual_px = np.array([scale * x - 10.0, scale * y - 20.0])
    assert problem.lenses.free.tolist() == [FOCAL | K1 | K2] * 2
    one_observation = BundleProblem.from_arrays(
        problem.cameras.matrices[:1],
        problem.lenses.values[:1],
        problem.points.positions,
        ([0], [0]),
        problem.observations.pixels[:1],
        frame="site",
    )
    assert cost(one_observation) == pytest.approx(0.5 * residual_px @ residual_px)


@pytest.mark.req("CDFF-CORE-095")
def test_bal_and_libmv_survive_a_round_trip() -> None:
    problem = read_bal(BAL.encode(), frame="site")
    reread = read_bal(write_bal(problem), frame="site")
    assert reread.cameras.matrices == pytest.approx(problem.cameras.matrices, abs=1e-14)
    assert cost(reread) == pytest.approx(cost(problem))
    problem_with_one_lens, *_ = ring(4, 10, 3, free=FOCAL)
    data = write_libmv(problem_with_one_lens)
    assert detect(data) == "libmv"
    reread_libmv = read_libmv(data, frame="site")
    assert reread_libmv.cameras.matrices == pytest.approx(problem_with_one_lens.cameras.matrices, abs=1e-5)
    assert cost(read_libmv(write_libmv(reread_libmv), frame="site")) == pytest.approx(
        cost(problem_with_one_lens), rel=1e-3
    )
    assert reread_libmv.lenses.free.tolist() == [FOCAL | K1 | K2]


def test_big_endian_problems_are_read() -> None:
    data = write_libmv(ring(3, 4, 3)[0])
    numbers = np.frombuffer(data[2:], "<u4").astype(">u4").tobytes()
    big_endian = read_libmv(b"V" + data[1:2] + numbers, frame="site")
    assert big_endian.points.positions == pytest.approx(read_libmv(data, frame="site").points.positions)
    assert big_endian.lenses.free.tolist() == [0]


def test_inconsistent_input_is_refused() -> None:
    with pytest.raises(CodecError, match="expected"):
        read_bal(BAL.replace("2 1 2", "2 2 2").encode(), frame="site")
    with pytest.raises(CodecError, match="numbers only"):
        read_bal(BAL.replace("7.25", "seven").encode(), frame="site")
    with pytest.raises(CodecError, match="row 9"):
        read_bal(BAL.replace("1 0 -5.5", "9 0 -5.5").encode(), frame="site")
    with pytest.raises(CodecError, match="libmv"):
        read_libmv(b"vP" + b"\0" * 10, frame="site")
    with pytest.raises(InputError, match="one lens"):
        write_bal(ring(3, 4, 3)[0])
    with pytest.raises(InputError, match="one lens"):
        write_libmv(read_bal(BAL.encode(), frame="site"))


def test_real_problems_are_recognised_by_content(real_data: Callable[[str], Path]) -> None:
    folder = real_data("bundle")
    assert detect(folder / "dubrovnik-3-7-pre.txt") == "bal"
    assert detect(folder / "problem_01.bin") == "libmv"
    problem = read_libmv(folder / "problem_01.bin", frame="site")
    assert (len(problem.cameras.ids), len(problem.points.ids), len(problem.observations.cameras)) == (
        333,
        26,
        5421,
    )
    assert cost(problem) == pytest.approx(4607.594, abs=1e-2)
    assert cost(read_bal(folder / "dubrovnik-3-7-pre.txt", frame="site")) == pytest.approx(2764.220, abs=1e-3)
