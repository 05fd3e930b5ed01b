# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The visual map of an earlier drive: made from its images, stored in the DPM, and its use counted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.product import Header
from cdff_dev.missions import earlier_drive
from cdff_dev.missions.script import EarlierDrive
from services.dpm.bus.service import serve
from services.dpm.operations.dpm import Dpm
from tests.support import textured_walls as walls
from tests.unit.services.dpm.conftest import clock, dpm, empty_store
from tests.unit.services.map_merging.test_archive import LocalBus

__all__ = ["clock", "dpm", "empty_store"]

DRIVE = EarlierDrive(scenario="camera_outing", robot="mana", frame="mana/earlier_drive")
PATH = [se3.transform(se3.exp_so3([0.0, -0.06 * i, 0.0]), [0.25 * i, 0.0, 0.0]) for i in range(4)]


@pytest.fixture
def images(monkeypatch: pytest.MonkeyPatch) -> None:
    """A drive along walls instead of the simulated terrain, with samples of another sensor."""

    def entries(_scenario: object, _workers: int) -> Any:
        for i, T in enumerate(PATH):
            header = SimpleNamespace(seq=i, id=str(i))
            yield (
                SimpleNamespace(stream="/mana/navcam.pair", stamp_ns=(i + 1) * 10**9, header=header),
                walls.pair(T),
            )
            yield SimpleNamespace(stream="/mana/imu.sample", stamp_ns=(i + 1) * 10**9, header=header), None

    monkeypatch.setattr(earlier_drive, "simulate", entries)


def test_the_map_is_in_its_own_frame_and_is_found_in_the_dpm(images: None, dpm: Dpm) -> None:
    visual_map = earlier_drive.map_of_drive(DRIVE)
    assert visual_map.frame == "mana/earlier_drive"
    vertices = visual_map.graph.vertices
    assert len(vertices.ids) > 1
    for stamp_ns, T in zip(vertices.stamps_ns.tolist(), vertices.matrices, strict=True):
        assert np.linalg.norm(T[:3, 3] - PATH[stamp_ns // 10**9 - 1][:3, 3]) < 0.02
    bus: Any = LocalBus()
    serve(bus, dpm, ("mana",))
    calls: list[dict[str, Any]] = []

    def call(key: str, parameters: dict[str, str], **sent: Any) -> None:
        header = Header.from_attachment(sent["attachment"])
        names = {name: parameters[name] for name in ("robot", "dfpc", "port", "product")}
        dpm.writer.put(names, sent["payload"], sent["encoding"], sent["attachment"])
        calls.append({"key": key, "frame": header.frame})

    earlier_drive.store_visual_map(SimpleNamespace(call=call), visual_map, "mana")  # type: ignore[arg-type]
    assert calls == [{"key": "cdff/@v1/ground/dpm/@rpc/put", "frame": "mana/earlier_drive"}]
    parameters = {"type": "visual_map", "robot": "mana"}
    reply = bus.call("cdff/@v1/ground/dpm/@rpc/get", parameters)
    assert Header.from_dict(reply.attachment).frame == "mana/earlier_drive"


def test_located_images_are_counted() -> None:
    status = {"samples_by_port": {"pair": 20, "map": 1}, "failed": 5}
    bus: Any = SimpleNamespace(call=lambda _key: SimpleNamespace(body=lambda: status))
    mission: Any = SimpleNamespace(robots={"mana": ()})
    assert list(earlier_drive.located_images(bus, mission)) == [
        "mana: 15 of 20 images located in the map of the earlier drive"
    ]
