# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.dask_cluster import DaskCluster


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[DaskCluster]:
    """Yield a Dask cluster of a scheduler and two workers, and close it after the test."""
    pytest.importorskip("distributed", reason="Dask is not installed: pip install 'cdff[campaign]'")
    cluster = DaskCluster(tmp_path)
    yield cluster
    cluster.close()
