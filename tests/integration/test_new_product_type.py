# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DFPC of a separate package adds a product type that is stored, searched, requested and displayed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest

from cdff_common.bus import Bus, keys
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import InputError
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import PoseTrajectory
from cdff_dev.ports import free_port
from tests.integration.conftest import Eventually, Spawn

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "orchestrator.yaml")


def planned_path() -> PoseTrajectory:
    """Return three poses along x, one second apart."""
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, 0, 3] = np.arange(3.0)
    stamps_ns = wall_ns() // 1000 * 1000 - 1_000_000_000 * np.arange(3)[::-1]
    return PoseTrajectory.from_arrays(stamps_ns, matrices, None, parent="site", child="mana/base")


def put(bus: Bus, value: Any, product: str) -> str:
    t0_ns, t1_ns = int(value.stamps_ns[0]), int(value.stamps_ns[-1])
    header = Header(
        product_id("mana", "path_planning", "path", t1_ns, 0, ""), 0, t0_ns, t1_ns, "site", "test/1"
    )
    bus.call(
        keys.dpm_rpc("ground", "put"),
        {"robot": "mana", "dfpc": "path_planning", "port": "path", "product": product},
        payload=encode(value, "uper"),
        encoding=encoding_string(type(value).__name__, "uper"),
        attachment=header.to_attachment(),
        timeout_s=20,
    )
    return header.id


@pytest.mark.slow
def test_a_product_type_of_a_plugin_is_stored_searched_requested_and_displayed(
    spawn: Spawn, router: Any, endpoint: str, eventually: Eventually
) -> None:
    http = f"http://127.0.0.1:{free_port()}"
    spawn("services.dpm", "--profile", PROFILE, "--http", http.removeprefix("http://"))
    spawn("services.orchestrator", "--profile", PROFILE)
    trajectory = planned_path()
    with Bus.open(endpoint, name="test", wait_s=20) as bus, Client(endpoint) as client:
        awaited_tokens = {keys.alive("mana", service) for service in ("dpm", "orchestrator")}
        eventually(lambda: awaited_tokens <= bus.alive(keys.alive("mana", "*")), 60, "start-up")
        with pytest.raises(InputError, match="planned_path"):
            put(bus, trajectory, "unplanned_path")
        product = put(bus, trajectory, "planned_path")
        assert [item["id"] for item in client.search("planned_path", robot="mana")] == [product]
        answer = client.request("planned_path", robot="mana", deadline_s=30.0)
        np.testing.assert_allclose(answer.value.matrices, trajectory.matrices)
        assert (
            client.request("planned_path", robot="mana", format="tum", deadline_s=30.0).data.count(b"\n") == 3
        )

    def get(path: str) -> Any:
        with urlopen(f"{http}{path}", timeout=20) as response:
            return json.load(response)

    types = {item["name"]: item for item in get("/api/v1/product_types")["items"]}
    assert types["planned_path"] == {
        "name": "planned_path",
        "title": "Planned path",
        "type_name": "PoseTrajectory",
        "other_types": [],
        "file_formats": ["tum", "npz", "geojson", "png"],
        "spatial": False,
        "requestable": True,
        "thumbnail": True,
    }
    assert get("/stac/collections/planned_path")["title"] == "Planned path"
    with urlopen(f"{http}/api/v1/products/{product}/thumbnail.png", timeout=20) as response:
        assert response.read(4) == b"\x89PNG"
