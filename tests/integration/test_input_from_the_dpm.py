# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An orbital model that the DPM holds: wired by the profile, waited for, and its fix in the position manager's pose."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode, encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.codecs.siblings import wire_type
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import TransformWithCovariance
from cdff_dev.evaluate._orbital import Drive, Ground, patch
from cdff_dev.ports import free_port
from tests.integration.conftest import Eventually, Spawn
from tests.integration.test_absolute_localisation_inputs import measured

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
    parameters: {{start_tilt_sigma_rad: 0.001}}
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
    """Wheels and patches of a drive, as a rover and its mapping would publish them; hears what is made of them."""

    def __init__(self, bus: Bus, ground: Ground, drive: Drive) -> None:
        self.bus, self.ground, self.drive = bus, ground, drive
        self.fixes: list[Header] = []
        self._seq = 0
        bus.subscribe(keys.product("mana", "absolute_localisation", "pose"), self._on_fix, depth=100)

    def _on_fix(self, message: Message) -> None:
        self.fixes.append(Header.from_attachment(message.attachment))

    def status(self, dfpc: str) -> dict[str, Any]:
        return dict(self.bus.call(keys.dfpc_rpc("mana", dfpc, "status"), timeout_s=5).body())

    def taken(self, dfpc: str, port: str) -> int:
        """Samples that a port has taken."""
        return int(self.status(dfpc)["samples_by_port"].get(port, 0))

    def believed(self) -> TransformWithCovariance:
        """Where the position manager says that the rover is, site to base."""
        asked = {"parent": "site", "child": "mana/base", "t_ns": -1}
        reply = self.bus.call(keys.dfpc_rpc("mana", "position_manager", "call/get_pose"), asked, timeout_s=10)
        value: TransformWithCovariance = decode("TransformWithCovariance", reply.payload, "uper")
        return value

    def _is_at(self, stamp_ns: int) -> bool:
        began = self.status("position_manager")["outputs_by_port"].get("pose", 0)
        return bool(began) and self.believed().stamp_ns == stamp_ns

    def off_m(self, i: int) -> float:
        """Horizontal error of what is believed at patch ``i``."""
        return float(np.hypot(*(self.believed().transform.matrix - self.drive.true[i])[:2, 3]))

    def begin(self) -> bool:
        """Whether the first wheel pose has come to both; told again and again until it has."""
        self.wheels(10_000_000_000, np.eye(4))
        return all(self.taken(dfpc, "odometry") for dfpc in ("position_manager", "absolute_localisation"))

    def publish(self, key: str, value: Any, t0_ns: int, t1_ns: int) -> None:
        self._seq += 1
        header = Header(
            id=product_id("mana", key[-20:], "x", t1_ns, self._seq, ""), seq=self._seq, t0_ns=t0_ns, t1_ns=t1_ns,
            frame="site", producer="test",
        )  # fmt: skip
        encoding = encoding_string(wire_type(value), "uper")
        self.bus.publish(key, encode(value, "uper"), encoding=encoding, attachment=header.to_attachment())

    def wheels(self, stamp_ns: int, T: np.ndarray) -> None:
        value = TransformWithCovariance.from_transform(
            UncertainTransform(T), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
        )
        self.publish(keys.sensor("mana", "wheels", "odometry"), value, stamp_ns, stamp_ns)

    def leg(self, i: int, eventually: Eventually) -> None:
        """From patch ``i - 1`` to patch ``i``, which is put where the position manager says."""
        own = self.drive.believed
        step = se3.log_se3(se3.inverse(own[i - 1]) @ own[i]) / STEPS
        begin_ns = i * 10_000_000_000
        for k in range(1, STEPS + 1):
            self.wheels(
                begin_ns + k * 10_000_000_000 // STEPS, se3.inverse(own[0]) @ own[i - 1] @ se3.exp_se3(step * k)
            )
        end_ns = begin_ns + 10_000_000_000
        eventually(lambda: self._is_at(end_ns), 20, "the pose at the end of the leg")
        placed = self.believed().transform.matrix
        dem = patch(self.ground, self.drive.true[i], placed, end_ns, np.random.default_rng([SEED, i]))
        self.publish(keys.product("mana", "digital_elevation_mapping", "map"), dem, dem.t0_ns, end_ns)


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.make(SEED)


@pytest.fixture
def rover(spawn: Spawn, endpoint: str, eventually: Eventually, tmp_path: Path, ground: Ground) -> Iterator[Rover]:
    drive = Drive.make(ground, SEED, 55.0)
    first = drive.believed[0]
    yaw = float(np.degrees(np.arctan2(first[1, 0], first[0, 0])))
    profile = tmp_path / "profile.yaml"
    profile.write_text(PROFILE.format(at=[round(float(v), 6) for v in first[:3, 3]], yaw=yaw), encoding="utf-8")
    spawn("services.router")
    spawn("services.dpm", "--profile", str(profile), "--http", f"127.0.0.1:{free_port()}")
    spawn("services.dfpc_host", "--profile", str(profile), "--process", "mana_locating")
    with Bus.open(endpoint, name="rover", wait_s=20) as bus:
        made = Rover(bus, ground, drive)
        ready = {keys.alive("mana", name) for name in ("position_manager", "absolute_localisation", "dpm")}
        eventually(lambda: ready <= bus.alive(keys.alive("mana", "*")), 60, "the processes")
        yield made


@pytest.mark.req("CDFF-CORE-088")
def test_an_orbital_model_in_the_dpm_locates_a_rover_also_where_it_comes_late(
    rover: Rover, eventually: Eventually, ground: Ground
) -> None:
    for dfpc in ("position_manager", "absolute_localisation"):
        assert rover.bus.call(keys.dfpc_rpc("mana", dfpc, "activate"), timeout_s=10).body() == {"state": "active"}
    eventually(lambda: rover.status("absolute_localisation")["last_error"], 20, "that the model is missed")
    missed = rover.status("absolute_localisation")["last_error"]
    assert "absolute_localisation.orbital: the DPM holds no dem of orbiter yet" in missed
    assert "cdff dpm put FILE --robot orbiter --type dem" in missed

    eventually(rover.begin, 20, "the first wheel pose")
    for i in range(1, 8):
        rover.leg(i, eventually)
    eventually(lambda: rover.taken("absolute_localisation", "dem") == 7, 20, "seven patches")
    assert rover.fixes == []
    assert rover.off_m(7) > 10.0
    seen = ground.orbital(SEED, DATUM_M)
    model = measured(seen.geometry, seen.layer("mean"), 0)
    header = Header(
        id=product_id("orbiter", "survey", "dem", 0, 0, ""), seq=0, t0_ns=0, t1_ns=0, frame="site",
        producer="survey", box_m=model.extent_m(),
    )  # fmt: skip
    asked = {"robot": "orbiter", "dfpc": "survey", "port": "dem", "product": "dem"}
    encoding = encoding_string(wire_type(model), "uper")
    rover.bus.call(
        keys.dpm_rpc(keys.GROUND, "put"), asked, payload=encode(model, "uper"), encoding=encoding,
        attachment=header.to_attachment(), timeout_s=10,
    )  # fmt: skip
    eventually(lambda: rover.fixes, 30, "a fix once the model is there")
    assert rover.status("absolute_localisation")["last_error"] == ""
    eventually(lambda: rover.taken("position_manager", "absolute_fix") == 1, 20, "the fix in the position manager")
    assert rover.off_m(7) < 1.0
    rover.leg(8, eventually)
    assert rover.off_m(8) < 1.5
