# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Damaged recordings of each format give typed errors with bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evaluation.log_mutations import table
from evaluation.runs.log_mutations import MEMORY_BYTES, mutated, outcome, run
from evaluation.scenes.log_files import SIMULATED, recordings

_FAST, _SLOW = 60, 250  # the evaluation record has 100 000 of each format


def test_copies_of_a_number_are_equal_and_mostly_differ_from_the_original() -> None:
    content = bytes(range(200))
    copies = [mutated(content, np.random.default_rng(k)) for k in range(20)]
    assert copies == [mutated(content, np.random.default_rng(k)) for k in range(20)]
    assert sum(copy != content for copy in copies) >= 18


@pytest.mark.parametrize("name", SIMULATED)
def test_recordings_that_are_not_damaged_are_read(name: str, tmp_path: Path) -> None:
    for k, files in enumerate(recordings(None, name)[name]):
        assert outcome(files, None, tmp_path / f"recording_{k}") == "read"


@pytest.mark.slow
def test_readers_of_all_formats_pass(real_data: Callable[[str], Path]) -> None:
    result = run("all", 0, _FAST, real_data("pocolog").parent)
    assert result["faults"] == []
    assert sum(result["outcomes"].values()) == _FAST
    assert "No faults." in table({"all": {"count": _FAST, "seed": 0, **result}})


@pytest.mark.slow
@pytest.mark.parametrize("name", SIMULATED)
def test_readers_of_a_format_pass(name: str) -> None:
    result = run(name, 0, _SLOW, None)
    assert result["faults"] == []
    assert result["memory_mb"] < MEMORY_BYTES / 2**20


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("MCAP", (23859, 71851)),  # a cloud defined without its fields, and a field without its name
        ("KITTI raw", (34493, 72822)),  # a year after 2262, and a rotation that is not finite
        ("scans", (49114, 62884, 66124)),  # compressed points that end the decoder
        ("BOP", (36424,)),  # a number of an image that is not a number
        ("KITTI odometry", (52806, 64927)),  # true poses that are not finite
    ],
)
def test_copies_that_were_faults_are_refused_or_read_in_part(
    name: str, numbers: tuple[int, ...], tmp_path: Path
) -> None:
    recorded = [(k, files) for k, files in enumerate(recordings(None, name)[name])]
    for number in numbers:
        k, files = recorded[number % len(recorded)]
        assert outcome(files, None, tmp_path / f"recording_{k}") == "read"
        assert outcome(files, number, tmp_path / f"recording_{k}") in ("refused", "read up to an error")
