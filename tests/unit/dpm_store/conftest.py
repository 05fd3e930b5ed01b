# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the store tests: a clock and a store in real files."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from dpm_store import Store, open_store


@pytest.fixture
def clock() -> ManualClock:
    """A clock that is advanced by the test."""
    return ManualClock(1_000_000_000_000)


@pytest.fixture(scope="session")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of an empty store that tests copy, because a migration takes longer than most tests."""
    directory = tmp_path_factory.mktemp("empty")
    open_store(f"sqlite:///{directory}").close()
    return directory


@pytest.fixture
def store(tmp_path: Path, clock: ManualClock, empty: Path) -> Iterator[Store]:
    """An empty store."""
    shutil.copytree(empty, tmp_path / "data")
    with open_store(f"sqlite:///{tmp_path}/data", clock) as store:
        yield store
