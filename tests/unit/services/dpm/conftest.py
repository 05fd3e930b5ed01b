# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the DPM tests: a DPM with a real store, its HTTP interface, and products of each kind."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from dpm_store import open_store
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings
from tests.support.dpm_products import S, cloud, elevation, navigation, pose, put_arguments

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from fastapi.testclient import TestClient


@pytest.fixture
def clock() -> ManualClock:
    """A clock at mission time 100 s."""
    return ManualClock(100 * S)


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of an empty store that tests copy, because a migration takes longer than most tests."""
    directory = tmp_path_factory.mktemp("empty")
    open_store(f"sqlite:///{directory}").close()
    return directory


@pytest.fixture
def dpm(tmp_path: Path, clock: ManualClock, empty_store: Path) -> Iterator[Dpm]:
    """A DPM with an empty store."""
    shutil.copytree(empty_store, tmp_path, dirs_exist_ok=True)
    with open_store(f"sqlite:///{tmp_path}", clock) as store:
        yield Dpm(store, max_payload_bytes=1 << 20)


@pytest.fixture
def http(dpm: Dpm, tmp_path: Path) -> Iterator[TestClient]:
    """A client of the HTTP interface of the DPM, without a bus; one event loop serves all its requests."""
    app = create_app(Context(dpm, Settings(tmp_path, max_body_bytes=2 << 20)))
    with TestClient(app, base_url="http://127.0.0.1:8080", raise_server_exceptions=False) as client:
        yield client


@pytest.fixture
def inserted_id(dpm: Dpm) -> Callable[[str], str]:
    """Insert a DEM, navigation map, cloud and pose; return a function from a product type to the id."""
    ids = {}
    for seq, (product, value, fields) in enumerate(
        [
            ("dem", elevation(0.0), {"resolution_m": 0.1}),
            ("navigation_map", navigation(), {"resolution_m": 0.1}),
            ("pointcloud", cloud(), {}),
            ("pose", pose(3, 1.0), {"child": "mana/base"}),
        ]
    ):
        _, header = dpm.writer.put(*put_arguments(value, product, seq, **fields))
        ids[product] = header.id
    return ids.__getitem__
