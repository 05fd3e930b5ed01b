# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Absolute localisation with an orbital model from the DPM, which may be inserted later.

The profile connects the DPM to the input port; the fixes correct the poses of the position manager.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode, encode, encoding_string
from cdff_common.codecs.wire_types import wire_type
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import TransformWithCovariance
from cdff_dev.ports import free_port
from evaluation.scenes.orbital import Ground, PatchRun, patch
from tests.integration.conftest import Eventually, Spawn
from tests.integration.test_absolute_localisation_inputs import elevation_map

pytestmark = pytest.mark.integration

SEED, DATUM_M, STEPS = 2, 40.0, 8
PROFILE = """
name: located
body: {{name: mars}}
robots:
- id: mana
  frames:
  - {{parent: site, child: mana/odom, translation_m: {at}, rpy_deg: [0, 0, {yaw}], sigma_m: 11.5, sigma_deg: 1.5}}
  sensors:
    wheels: {{kind: wheels, frame: mana/base, streams: {{odometry: TransformWithCovariance}}}}
  dfpcs:
  - name: position_manager
    process: locating
    inputs: {{odometry: sensor/wheels/odometry, absolute_fix: product/absolute_localisation/pose}}
    parameters: {{start: {{tilt_sigma_rad: 0.001}}}}
  - name: absolute_localisation
    process: locating
    inputs:
      dem: product/digital_elevation_mapping/map
      poses: product/position_manager/pose
      odometry: sensor/wheels/odometry
      orbital: dpm/orbiter/dem
  - {{name: digital_elevation_mapping, process: mapping, inputs: {{poses: product/position_manager/pose}}}}
"""


class Rover:
    """Publishes the wheel odometry and the patches of a drive, and collects the fixes."""

    def __init__(self, bus: Bus, ground: Ground, drive: PatchRun) -> None:
        self.bus, self.ground, self.drive = bus, ground, drive
        self.fixes: list[Header] = []
        self._seq = 0
        bus.subscribe(keys.product("mana", "absolute_localisation", "pose"), self._on_fix, depth=100)

    def _on_fix(self, message: Message) -> None:
        self.fixes.append(Header.from_attachment(message.attachment))

    def status(self, dfpc: str) -> dict[str, Any]:
        return dict(self.bus.call(keys.dfpc_rpc("mana", dfpc, "status"), timeout_s=5).body())

    def received(self, dfpc: str, port: str) -> int:
        """Return the number of samples that a port has received."""
        return int(self.status(dfpc)["samples_by_port"].get(port, 0))

    def estimated_pose(self) -> TransformWithCovariance:
        """Return the pose from the position manager, site to base."""
        query = {"parent": "site", "child": "mana/base", "t_ns": -1}
        reply = self.bus.call(keys.dfpc_rpc("mana", "position_manager", "call/get_pose"), query, timeout_s=10)
        value: TransformWithCovariance = decode("TransformWithCovariance", reply.payload, "uper")
        return value

    def _is_at(self, stamp_ns: int) -> bool:
        pose_count = self.status("position_manager")["outputs_by_port"].get("pose", 0)
        return bool(pose_count) and self.estimated_pose().stamp_ns == stamp_ns

    def horizontal_error_m(self, i: int) -> float:
        """Return the horizontal error of the estimated pose at patch ``i``."""
        return float(np.hypot(*(self.estimated_pose().transform.matrix - self.drive.true_poses[i])[:2, 3]))

    def begin(self) -> bool:
        """Publish a wheel pose; return True once both DFPCs have received it."""
        self.wheels(10_000_000_000, np.eye(4))
        return all(self.received(dfpc, "odometry") for dfpc in ("position_manager", "absolute_localisation"))

    def publish(self, key: str, value: Any, t0_ns: int, t1_ns: int) -> None:
        self._seq += 1
        header = Header(
            id=product_id("mana", key[-20:], "x", t1_ns, self._seq, ""),
            seq=self._seq,
            t0_ns=t0_ns,
            t1_ns=t1_ns,
            frame="site",
            producer="test",
        )
        encoding = encoding_string(wire_type(value), "uper")
        self.bus.publish(key, encode(value, "uper"), encoding=encoding, attachment=header.to_attachment())

    def wheels(self, stamp_ns: int, T: np.ndarray) -> None:
        value = TransformWithCovariance.from_transform(
            UncertainTransform(T), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
        )
        self.publish(keys.sensor("mana", "wheels", "odometry"), value, stamp_ns, stamp_ns)

    def drive_leg(self, i: int, eventually: Eventually) -> None:
        """Drive from patch ``i - 1`` to patch ``i``; publish patch ``i`` at the position manager's pose."""
        poses = self.drive.estimated_poses
        step = se3.log_se3(se3.inverse(poses[i - 1]) @ poses[i]) / STEPS
        start_ns = i * 10_000_000_000
        for k in range(1, STEPS + 1):
            self.wheels(
                start_ns + k * 10_000_000_000 // STEPS,
                se3.inverse(poses[0]) @ poses[i - 1] @ se3.exp_se3(step * k),
            )
        end_ns = start_ns + 10_000_000_000
        eventually(lambda: self._is_at(end_ns), 20, "the pose at the end of the leg")
        T_site_base = self.estimated_pose().transform.matrix
        dem = patch(
            self.ground, self.drive.true_poses[i], T_site_base, end_ns, np.random.default_rng([SEED, i])
        )
        self.publish(keys.product("mana", "digital_elevation_mapping", "map"), dem, dem.t0_ns, end_ns)


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.make(SEED)


@pytest.fixture
def rover(
    spawn: Spawn, endpoint: str, eventually: Eventually, tmp_path: Path, ground: Ground
) -> Iterator[Rover]:
    drive = PatchRun.make(ground, SEED, 55.0)
    first = drive.estimated_poses[0]
    yaw = float(np.degrees(np.arctan2(first[1, 0], first[0, 0])))
    profile = tmp_path / "profile.yaml"
    profile.write_text(
        PROFILE.format(at=[round(float(v), 6) for v in first[:3, 3]], yaw=yaw), encoding="utf-8"
    )
    spawn("services.router")
    spawn("services.dpm", "--profile", str(profile), "--http", f"127.0.0.1:{free_port()}")
    spawn("services.dfpc_host", "--profile", str(profile), "--process", "mana_locating")
    with Bus.open(endpoint, name="rover", wait_s=20) as bus:
        result = Rover(bus, ground, drive)
        ready = {keys.alive("mana", name) for name in ("position_manager", "absolute_localisation", "dpm")}
        eventually(lambda: ready <= bus.alive(keys.alive("mana", "*")), 60, "the processes")
        yield result


@pytest.mark.req("CDFF-CORE-088")
@pytest.mark.slow
def test_an_orbital_model_in_the_dpm_locates_a_rover_even_if_inserted_late(
    rover: Rover, eventually: Eventually, ground: Ground
) -> None:
    for dfpc in ("position_manager", "absolute_localisation"):
        answer = rover.bus.call(keys.dfpc_rpc("mana", dfpc, "activate"), timeout_s=10).body()
        assert answer["state"] == "active"
    eventually(
        lambda: rover.status("absolute_localisation")["last_error"], 20, "the report of the missing model"
    )
    last_error = rover.status("absolute_localisation")["last_error"]
    assert "absolute_localisation.orbital: the DPM holds no dem of orbiter yet" in last_error
    assert "cdff dpm put FILE --robot orbiter --type dem" in last_error

    eventually(rover.begin, 20, "the first wheel pose")
    for i in range(1, 8):
        rover.drive_leg(i, eventually)
    eventually(lambda: rover.received("absolute_localisation", "dem") == 7, 20, "seven patches")
    assert rover.fixes == []
    assert rover.horizontal_error_m(7) > 10.0
    orbital_map = ground.orbital(SEED, DATUM_M)
    model = elevation_map(orbital_map.geometry, orbital_map.layer("mean"), 0)
    header = Header(
        id=product_id("orbiter", "survey", "dem", 0, 0, ""),
        seq=0,
        t0_ns=0,
        t1_ns=0,
        frame="site",
        producer="survey",
        box_m=model.extent_m(),
    )
    parameters = {"robot": "orbiter", "dfpc": "survey", "port": "dem", "product": "dem"}
    encoding = encoding_string(wire_type(model), "uper")
    rover.bus.call(
        keys.dpm_rpc(keys.GROUND, "put"),
        parameters,
        payload=encode(model, "uper"),
        encoding=encoding,
        attachment=header.to_attachment(),
        timeout_s=10,
    )
    eventually(lambda: rover.fixes, 30, "a fix after the model was stored")
    assert rover.status("absolute_localisation")["last_error"] == ""
    eventually(
        lambda: rover.received("position_manager", "absolute_fix") == 1, 20, "the fix in the position manager"
    )
    assert rover.horizontal_error_m(7) < 1.0
    rover.drive_leg(8, eventually)
    assert rover.horizontal_error_m(8) < 1.5
