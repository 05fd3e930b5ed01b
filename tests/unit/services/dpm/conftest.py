# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DPM over a real store, HTTP in front of it, and products of each kind."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.codecs import encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap, Pointcloud, TransformWithCovariance
from dpm_store import open_store
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.operations import Dpm
from services.dpm.settings import Settings

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from fastapi.testclient import TestClient

S = 1_000_000_000


def elevation(
    x0: float, height: float = 0.0, t1_ns: int = 0, *, cells: int = 20, resolution_m: float = 0.1
) -> ElevationMap:
    """A flat square patch with its lower left corner at (x0, 0)."""
    geometry = GridGeometry("site", resolution_m, x0, cells * resolution_m, cells, cells)
    one = np.ones(geometry.shape, dtype=np.float32)
    layers = {
        "mean": one * height,
        "variance": one * 0.01,
        "min": one * (height - 0.1),
        "max": one * (height + 0.1),
        "count": one * 2,
        "age_s": one * 0,
    }
    return ElevationMap.from_layers(geometry, layers, t0_ns=t1_ns, t1_ns=t1_ns)


def navigation() -> NavigationMap:
    """Half safe, half hazard."""
    geometry = GridGeometry("site", 0.1, 0.0, 1.0, 10, 10)
    classes = np.ones(geometry.shape, dtype=np.uint8)
    classes[:, 5:] = 3
    return NavigationMap.from_layers(geometry, {"class": classes}, t0_ns=0, t1_ns=0)


def cloud(n: int = 300) -> Pointcloud:
    """Points in a ball."""
    return Pointcloud.from_points(np.random.default_rng(0).normal(0, 2, (n, 3)), frame="site", stamp_ns=S)


def pose(second: int, x: float) -> TransformWithCovariance:
    """``site`` to ``mana/base`` at ``(x, 0, 0)``."""
    T = UncertainTransform(se3.transform(np.eye(3), [x, 0, 0]), np.eye(6) * 0.01)
    return TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=second * S)


Parcel = tuple[dict[str, str], bytes, str, bytes]


def parcel(value: Any, product: str, seq: int = 0, robot: str = "mana", codec: str = "uper", **fields: Any) -> Parcel:
    """Names, payload, encoding and attachment of a product, as they travel."""
    t1_ns = fields.pop("t1_ns", seq * S)
    header = Header(
        id=product_id(robot, "test", product, t1_ns, seq, "c"),
        seq=seq,
        t0_ns=t1_ns,
        t1_ns=t1_ns,
        producer="test",
        config_hash="c",
        **({"frame": "site"} | fields),
    )
    names = {"robot": robot, "dfpc": "test", "port": product, "product": product}
    return names, encode(value, codec), encoding_string(type(value).__name__, codec), header.to_attachment()


@pytest.fixture
def clock() -> ManualClock:
    """Mission time 100 s."""
    return ManualClock(100 * S)


@pytest.fixture(scope="session")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of an empty store, to be copied: migrating takes longer than most tests."""
    directory = tmp_path_factory.mktemp("empty")
    open_store(f"sqlite:///{directory}").close()
    return directory


@pytest.fixture
def dpm(tmp_path: Path, clock: ManualClock, empty: Path) -> Iterator[Dpm]:
    """A DPM over an empty store."""
    shutil.copytree(empty, tmp_path, dirs_exist_ok=True)
    with open_store(f"sqlite:///{tmp_path}", clock) as store:
        yield Dpm(store, max_payload_bytes=1 << 20)


@pytest.fixture
def http(dpm: Dpm, tmp_path: Path) -> TestClient:
    """HTTP without a bus."""
    settings = Settings(tmp_path, max_body_bytes=2 << 20)
    return TestClient(
        create_app(Context(dpm, settings)), base_url="http://127.0.0.1:8080", raise_server_exceptions=False
    )


@pytest.fixture
def filled(dpm: Dpm) -> Callable[[str], str]:
    """One product of each kind; gives its id by kind."""
    ids = {}
    for seq, (kind, value, fields) in enumerate(
        [
            ("dem", elevation(0.0), {"resolution_m": 0.1}),
            ("navigation_map", navigation(), {"resolution_m": 0.1}),
            ("pointcloud", cloud(), {}),
            ("pose", pose(3, 1.0), {"child": "mana/base"}),
        ]
    ):
        _, header = dpm.put(*parcel(value, kind, seq, **fields))
        ids[kind] = header.id
    return ids.__getitem__
