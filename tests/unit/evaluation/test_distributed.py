# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import RefusedError
from evaluation import camera_models, distributed
from tests.support.dask_cluster import DaskCluster


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[DaskCluster]:
    """A scheduler of Dask with two workers."""
    for package in ("distributed", "pyarrow"):
        pytest.importorskip(package, reason="Dask is not installed: pip install 'cdff[campaign]'")
    cluster = DaskCluster(tmp_path)
    yield cluster
    cluster.close()


def origin(commit: str, created: str) -> dict[str, Any]:
    return {
        "commit": commit,
        "tree_differs": False,
        "lock_sha256": "none",
        "python": "3.11",
        "machine": "x86_64, 2 cores",
        "created": created,
    }


@pytest.mark.slow
def test_an_evaluation_on_a_worker_has_the_same_results_and_is_repeated_only_for_another_commit(
    cluster: DaskCluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = argparse.Namespace(dask=cluster.address, seed=None, count=None)
    data = tmp_path / "data"
    data.mkdir()

    def figures(name: str, commit: str, created: str) -> dict[str, Any]:
        return distributed.figures(tmp_path, [name], data, args, origin(commit, created))[name]

    first = figures("camera_models", "a", "12:00")
    assert first == camera_models.evaluate(data, lambda _: None)
    (unit,) = tmp_path.glob("build/evaluation/*/camera_models/unit.json")
    written_ns = unit.stat().st_mtime_ns
    assert figures("camera_models", "a", "13:00") == first
    assert unit.stat().st_mtime_ns == written_ns
    with pytest.raises(RefusedError, match="evaluation nonsense failed"):
        figures("nonsense", "b", "14:00")
    assert len(list(tmp_path.glob("build/evaluation/*"))) == 2
