# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A store on a real file, and products to put into it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common.clock import ManualClock
from cdff_common.interfaces.product import Header, product_id
from dpm_store import Insertion, Store, open_store

NAMES = {
    "robot": "mana", "dfpc": "digital_elevation_mapping", "port": "map", "product": "dem", "type_name": "ElevationMap",
}  # fmt: skip


def header(seq: int, **fields: Any) -> Header:
    """A header whose id follows from ``seq``; captured at ``seq`` seconds unless said otherwise."""
    t1_ns = fields.pop("t1_ns", seq * 1_000_000_000)
    given = {"frame": "site", "producer": "test", "t0_ns": t1_ns, "config_hash": "c"} | fields
    return Header(id=product_id("mana", "test", "map", t1_ns, seq, "c"), seq=seq, t1_ns=t1_ns, **given)


def put(store: Store, a_header: Header, payload: bytes = b"payload", **names: str) -> Insertion:
    """Insert a product of ``mana``'s unless said otherwise."""
    return store.put(a_header, payload, **(NAMES | names))


@pytest.fixture
def clock() -> ManualClock:
    """A clock that moves when told to."""
    return ManualClock(1_000_000_000_000)


@pytest.fixture(scope="session")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of an empty store, to be copied: migrating takes longer than most tests."""
    directory = tmp_path_factory.mktemp("empty")
    open_store(f"sqlite:///{directory}").close()
    return directory


@pytest.fixture
def store(tmp_path: Path, clock: ManualClock, empty: Path) -> Iterator[Store]:
    """An empty store."""
    shutil.copytree(empty, tmp_path / "data")
    with open_store(f"sqlite:///{tmp_path}/data", clock) as opened:
        yield opened
