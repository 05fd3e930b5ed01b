# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DPM as a process with a real router, called over Zenoh and HTTP."""

import json
import os
import signal
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from cdff_common.bus import Bus, Message, Reply, keys
from cdff_common.codecs import decode, encode, encoding_string
from cdff_common.errors import DeniedError, InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, IMUSensors, Pointcloud, Time, TransformWithCovariance
from cdff_dev.ports import free_port

from .conftest import ROOT, Eventually, Spawn, wait_until

pytestmark = pytest.mark.integration

S = 1_000_000_000
PROFILE = """
name: test
body: {name: mars, site_lon_deg: 77.5, site_lat_deg: 18.4}
robots:
- id: mana
  frames:
  - {parent: mana/base, child: mana/lidar, translation_m: [0.0, 0.0, 2.0]}
  - {parent: mana/base, child: mana/imu}
  sensors:
    imu: {kind: imu, frame: mana/imu, streams: {sample: IMUSensors}}
- id: minnie
history:
- {sensor: imu, stream: sample, span_s: 1.0}
"""


class System:
    """A router, a DPM and a bus to call it."""

    def __init__(self, spawn: Spawn, eventually: Eventually, endpoint: str, tmp_path: Path) -> None:
        self._spawn, self._eventually, self._profile = spawn, eventually, tmp_path / "profile.yaml"
        self._profile.write_text(PROFILE)
        self.http = f"http://127.0.0.1:{(port := free_port())}"
        self._port, self.endpoint = port, endpoint
        spawn("services.router")
        self.bus = Bus.open(endpoint, name="test", wait_s=20)
        self.start()

    def start(self) -> None:
        """Start the DPM and wait until it answers."""
        address = f"127.0.0.1:{self._port}"
        self.process: subprocess.Popen[bytes] = self._spawn(
            "services.dpm", "--profile", str(self._profile), "--http", address
        )
        alive = keys.alive("*", "dpm")
        self._eventually(lambda: len(self.bus.alive(alive)) == 3, 30, "the DPM's tokens")

    def put(
        self, value: Any, product: str, seq: int, robot: str = "mana", scope: str | None = None, **fields: Any
    ) -> str:
        """Insert a product over the bus; return its id once it is durable."""
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
        names = {"dfpc": "test", "port": product, "product": product} | (
            {"robot": robot} if scope == "ground" else {}
        )
        reply = self.call(
            "put",
            scope=scope or robot,
            payload=encode(value, "uper"),
            attachment=header.to_attachment(),
            encoding=encoding_string(type(value).__name__, "uper"),
            **names,
        )
        assert reply.body()["id"] == header.id
        return header.id

    def call(
        self,
        verb: str,
        scope: str = "ground",
        payload: bytes = b"",
        encoding: str = "",
        attachment: bytes = b"",
        **parameters: object,
    ) -> Reply:
        """Call ``dpm/@rpc/{verb}``."""
        key = keys.dpm_rpc(scope, verb)
        return self.bus.call(
            key, parameters, payload=payload, encoding=encoding, attachment=attachment, timeout_s=20
        )

    def get(self, path: str) -> Any:
        """Return the JSON that the HTTP server serves at a path."""
        with urllib.request.urlopen(self.http + path, timeout=20) as answer:
            return json.load(answer)


@pytest.fixture
def system(spawn: Spawn, eventually: Eventually, endpoint: str, tmp_path: Path) -> Iterator[System]:
    """A system for a single test, which may break it."""
    system = System(spawn, eventually, endpoint, tmp_path)
    with system.bus:
        yield system


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    """A system for all tests that leave it running."""
    directory, endpoint = tmp_path_factory.mktemp("shared"), f"tcp/127.0.0.1:{free_port()}"
    environment = {
        "CDFF_CONNECT": endpoint,
        "CDFF_LISTEN": endpoint,
        "CDFF_DATA_DIR": str(directory / "data"),
    }
    processes: list[subprocess.Popen[bytes]] = []

    def spawn(module: str, *arguments: str) -> subprocess.Popen[bytes]:
        processes.append(
            subprocess.Popen(
                [sys.executable, "-m", module, *arguments], env={**os.environ, **environment}, cwd=ROOT
            )
        )
        return processes[-1]

    try:
        system = System(spawn, wait_until, endpoint, directory)
        with system.bus:
            yield system
    finally:
        for process in processes[::-1]:
            process.terminate()
            process.wait(10)


def cloud(n: int = 500) -> Pointcloud:
    return Pointcloud.from_points(np.random.default_rng(0).normal(0, 2, (n, 3)), frame="site", stamp_ns=S)


def patch(x0: float) -> ElevationMap:
    geometry = GridGeometry("site", 0.1, x0, 2.0, 20, 20)
    one = np.ones(geometry.shape, dtype=np.float32)
    layers = {"mean": one, "variance": one, "min": one, "max": one, "count": one, "age_s": one * 0}
    return ElevationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=0)


@pytest.mark.req("CDFF-SUP-030", "CDFF-SUP-031", "CDFF-SUP-034")
def test_a_product_is_inserted_and_retrieved_over_every_interface(
    shared: System, eventually: Eventually
) -> None:
    received: list[Message] = []
    shared.bus.subscribe(keys.event("*", "inserted"), received.append)
    product = shared.put(cloud(), "pointcloud", 1)
    id_of_repeated_put = shared.put(cloud(), "pointcloud", 1, scope="ground")
    assert id_of_repeated_put == product
    eventually(lambda: [m.key for m in received] == [keys.event("mana", "inserted")], what="one event")

    for scope in ("mana", "ground"):
        (item,) = shared.call("search", scope, type="pointcloud", region="circle:0,0,5").body()["items"]
        assert item["id"] == product
    assert (
        shared.call("search", "minnie").body()["items"][0]["id"] == product
    )  # answers do not depend on the scope
    reply = shared.call("get", id=product)
    assert reply.encoding == "application/vnd.cdff+uper;Pointcloud/1"
    assert Header.from_dict(reply.attachment).id == product
    assert decode("Pointcloud", reply.payload, "uper").points_m.shape == (500, 3)
    assert shared.call("get", id=product, format="ply").payload.startswith(b"ply")

    payload = b""
    while True:
        chunk = shared.bus.call(keys.dpm_product("mana", product), {"offset": len(payload), "len": 4000})
        payload += chunk.payload
        if len(payload) == chunk.attachment["size"]:
            break
    assert payload == reply.payload

    assert shared.get(f"/api/v1/products/{product}")["robot"] == "mana"
    assert shared.call("delete", id=product).body()["deleted"] is True
    with pytest.raises(ProductNotFoundError):
        shared.call("get", id=product)


@pytest.mark.req("CDFF-SUP-030")
def test_a_change_of_an_annotation_is_announced_to_all_clients(
    shared: System, eventually: Eventually
) -> None:
    received: list[Message] = []
    shared.bus.subscribe(keys.event("*", "updated"), received.append)
    product = shared.put(cloud(), "pointcloud", 40)
    annotation = shared.call(
        "update", payload=msgpack.packb({"tags": ["crater"]}), id=product, if_match=0
    ).body()
    assert (annotation["revision"], annotation["tags"]) == (1, ["crater"])
    with pytest.raises(InputError, match="revision 1"):
        shared.call("update", "mana", payload=msgpack.packb({"notes": "late"}), id=product, if_match=0)
    eventually(lambda: [m.key for m in received] == [keys.event("mana", "updated")], what="one event")
    assert [item["id"] for item in shared.call("search", tag="crater").body()["items"]] == [product]
    assert shared.get(f"/api/v1/products/{product}")["annotation"]["revision"] == 1
    changes = shared.call("changes", kind="updated").body()
    assert [item["id"] for item in changes["items"]] == [product]
    plan = shared.call("retention").body()
    assert (plan["applied"], plan["rules"], plan["verdicts"]) == (False, 0, [])
    assert shared.call("delete", id=product).body()["deleted"]


@pytest.mark.req("CDFF-SUP-033", "CDFF-SUP-035")
def test_maps_and_poses_of_two_robots_are_combined(shared: System) -> None:
    shared.put(patch(0.0), "dem", 1, resolution_m=0.1)
    shared.put(patch(1.0), "dem", 2, robot="minnie", resolution_m=0.1)
    reply = shared.call("get", type="dem", robot="any", region="bbox:0,0,3,2", resolution_m=0.2)
    assert reply.attachment["coverage"] == pytest.approx(1.0)
    assert reply.attachment["robots"] == ["mana", "minnie"]
    window = decode("ElevationMap", reply.payload, "uper")
    assert (window.geometry.rows, window.geometry.cols) == (10, 15)
    by_reference = shared.call("get", type="dem", region="bbox:0,0,3,2", deliver="reference")
    assert by_reference.attachment["kind"] == "reference"
    stored = shared.call("get", id=by_reference.body()["id"])
    assert decode("ElevationMap", stored.payload, "uper").layer("count").max() == 2

    for second in (0, 2):
        T = UncertainTransform(se3.transform(np.eye(3), [second, 0, 0]), np.eye(6) * 0.01)
        value = TransformWithCovariance.from_transform(
            T, parent="site", child="mana/base", stamp_ns=second * S
        )
        shared.put(value, "pose", second, t1_ns=second * S, child="mana/base")
    pose = shared.call("pose", t=S, parent="site", child="mana/lidar", robot="mana").body()
    assert [row[3] for row in pose["T"]] == pytest.approx([1.0, 0.0, 2.0, 1.0])
    assert np.array(pose["covariance"]).shape == (6, 6)


def test_analyses_of_heights_are_the_same_over_every_interface(shared: System, tmp_path: Path) -> None:
    from cdff_common.client import Client

    shared.put(patch(20.0), "dem", 3, resolution_m=0.1)
    region = "bbox:20,0,22,2"
    with Client(shared.endpoint) as client:
        surface = client.terrain("surface", region=region)
        statistics = client.terrain("statistics", region=region).document
        with pytest.raises(InputError, match="expected one of"):
            client.terrain("gloss")
    assert surface.geometry.bounds == pytest.approx((20.0, 0.0, 22.0, 2.0))
    assert set(surface.bands) == {"slope_deg", "slope_sigma_deg", "aspect_deg", "roughness_m"}
    assert np.nanmax(surface.bands["slope_deg"]) == pytest.approx(0.0, abs=1e-6)
    assert statistics["area_m2"] == pytest.approx(4.0)
    reply = shared.call("terrain", analysis="statistics", region=region)
    assert json.loads(reply.payload) == statistics
    assert shared.get(f"/api/v1/maps/dem/statistics?region={region}") == statistics
    out = tmp_path / "surface.tif"
    command = [sys.executable, "-m", "cdff_common.cli", "dpm", "terrain"]
    written = subprocess.run(
        [*command, "surface", "--region", region, "--out", str(out), "--json", "--connect", shared.endpoint],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert json.loads(written.stdout)["coverage"] == 1.0
    assert out.read_bytes()[:2] in (b"II", b"MM")
    printed = subprocess.run(
        [*command, "statistics", "--region", region, "--json", "--connect", shared.endpoint],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert json.loads(printed.stdout) == statistics


def test_bad_maps_are_withdrawn_by_client_and_command_line(shared: System) -> None:
    from cdff_common.client import Client

    first = shared.put(patch(30.0), "dem", 60, resolution_m=0.1)
    second = shared.put(patch(30.0), "dem", 61, robot="minnie", resolution_m=0.1)
    region = "bbox:30,0,32,2"
    command = [sys.executable, "-m", "cdff_common.cli", "dpm", "withdraw", "--connect", shared.endpoint]
    command += ["--robot", "minnie", "--t0", str(61 * S), "--reason", "lost", "--json"]
    printed = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert json.loads(printed.stdout)["withdrawn"] == [second]
    assert list(shared.call("get", type="dem", region=region).attachment["inputs"]) == [first]
    with Client(shared.endpoint) as client:
        assert client.withdraw(first, reason="1 m too high", dry_run=True)["applied"] is False
        assert client.withdraw(first, reason="1 m too high")["withdrawn"] == [first]
    with pytest.raises(ProductNotFoundError):
        shared.call("get", type="dem", region=region)
    reasons = [e["reason"] for e in shared.call("history", kind="withdrawn").body()["items"]]
    assert reasons[-2:] == ["lost", "1 m too high"]


def test_malformed_calls_are_answered_with_the_reason(shared: System) -> None:
    before = shared.call("stat").body()["products"]
    for verb, parameters, error in (
        ("search", {"nonsense": "1"}, InputError),
        ("search", {"region": "blob:1"}, InputError),
        ("get", {}, InputError),
        ("get", {"id": "nope"}, ProductNotFoundError),
        ("get", {"type": "dem", "region": "bbox:900,900,901,901"}, ProductNotFoundError),
        ("put", {"dfpc": "a"}, InputError),
        ("delete", {}, InputError),
        ("frames", {"frame": "nowhere"}, ProductNotFoundError),
        ("pose", {"t": "soon", "robot": "mana"}, InputError),
    ):
        with pytest.raises(error):
            shared.call(verb, **parameters)
    with pytest.raises(InputError, match="ask there"):
        shared.call("search", scope="mana", robot="minnie")
    assert shared.call("stat").body()["products"] == before


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-032")
def test_acknowledged_products_survive_a_kill_of_the_dpm(system: System) -> None:
    acknowledged: list[str] = []

    def insert_until_it_fails() -> None:
        try:
            for seq in range(10_000):
                product = system.put(cloud(2000), "pointcloud", seq)
                acknowledged.append(product)
        except Exception:  # noqa: BLE001  # the call that the kill interrupts may fail with any error
            return

    writer = threading.Thread(target=insert_until_it_fails)
    writer.start()
    system._eventually(lambda: len(acknowledged) >= 10, 30, "ten insertions")
    system.process.send_signal(signal.SIGKILL)
    system.process.wait(5)
    writer.join(30)
    system.start()
    expected = encode(cloud(2000), "uper")
    for product in acknowledged:
        assert system.call("get", id=product).payload == expected
    assert system.call("stat").body()["products"] in (len(acknowledged), len(acknowledged) + 1)


def test_events_are_streamed_over_http(shared: System) -> None:
    request = urllib.request.Request(shared.http + "/api/v1/events")
    with urllib.request.urlopen(request, timeout=20) as stream:
        assert stream.readline() == b": connected\n"
        product = shared.put(cloud(), "pointcloud", 7)
        lines = [stream.readline().decode() for _ in range(4)]
    assert "event: inserted\n" in lines
    assert any(product in line for line in lines)
    with urllib.request.urlopen(
        urllib.request.Request(request.full_url, headers={"Last-Event-ID": "0"}), timeout=20
    ) as stream:
        assert any(product in line.decode() for line in stream)


def test_requests_are_forwarded_to_the_orchestrator(shared: System, eventually: Eventually) -> None:
    received: list[dict[str, str]] = []

    def jobs(request: Any) -> Reply:
        received.append(dict(request.parameters))
        return Reply.of({"jobs": [{"job": "1", "state": "DONE", "accepted_ns": 5}]})

    def is_forwarded() -> bool:
        with suppress(urllib.error.HTTPError):  # 503 until the router has announced the queryable
            shared.get("/api/v1/requests")
        return bool(received)

    shared.bus.serve(keys.orchestrator_rpc("ground", "jobs"), jobs)
    eventually(is_forwarded, what="a forwarded request")
    assert shared.get("/api/v1/requests")["jobs"] == [{"job": "1", "state": "DONE", "accepted_ns": "5"}]
    shared.get("/api/v1/requests/1")
    assert received[-1]["job"] == "1"


def test_the_status_of_dfpcs_is_served_over_http(shared: System, eventually: Eventually) -> None:
    before = shared.call("stat").body()["events"]
    shared.bus.publish_latched(keys.dfpc_status("mana", "mapper"), {"name": "mapper", "state": "active"})
    shared.bus.declare_alive("mana", "mapper")
    shared.bus.publish_map(keys.event("mana", "alarm"), {"detail": "too steep"})

    def mana() -> dict[str, Any]:
        return next(robot for robot in shared.get("/api/v1/robots")["items"] if robot["id"] == "mana")

    eventually(
        lambda: mana()["dfpcs"] == [{"name": "mapper", "state": "active", "alive": True}], what="the status"
    )
    eventually(lambda: shared.call("stat").body()["events"] == before + 1, what="the alarm in the history")


def test_the_dpm_starts_without_heavy_modules_and_ends_at_once(system: System) -> None:
    maps = Path(f"/proc/{system.process.pid}/maps").read_text()
    for heavy in ("open3d", "cv2", "rasterio", "small_gicp", "gtsam"):
        assert heavy not in maps
    with urllib.request.urlopen(system.http + "/api/v1/events", timeout=20):
        system.process.terminate()
        assert system.process.wait(10) == 0


def test_a_second_dpm_on_the_same_data_is_refused(system: System, spawn: Spawn, tmp_path: Path) -> None:
    second = spawn("services.dpm", "--http", f"127.0.0.1:{free_port()}")
    assert second.wait(20) == 1
    assert "in use by process" in (tmp_path / "services.dpm.log").read_text()


@pytest.mark.req("CDFF-SUP-084")
def test_samples_on_the_bus_are_recorded_by_the_policy_of_the_profile(
    system: System, eventually: Eventually
) -> None:
    for seq in range(25):
        t_ns = seq * S // 10
        sample = IMUSensors(Time.from_ns(t_ns), np.array([0.0, 0.0, 9.81]), np.zeros(3), np.zeros(3))
        header = Header(
            id=product_id("mana", "imu", "sample", t_ns, seq, ""),
            seq=seq,
            t0_ns=t_ns,
            t1_ns=t_ns,
            frame="mana/imu",
            producer="imu",
        )
        key, encoding = keys.sensor("mana", "imu", "sample"), encoding_string("IMUSensors", "uper")
        system.bus.publish(key, encode(sample, "uper"), encoding=encoding, attachment=header.to_attachment())

    def spans() -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = system.call("search", type="imu_span", order="oldest").body()["items"]
        return items

    eventually(lambda: len(spans()) == 2, 30, "two spans of a second")
    assert [len(span["inputs"]) for span in spans()] == [10, 10]
    inputs = system.call("provenance", id=spans()[0]["id"]).body()["items"]
    assert len(inputs) == 10
    system.process.terminate()
    assert system.process.wait(20) == 0
    system.start()
    assert [len(span["inputs"]) for span in spans()] == [10, 10, 5]


@pytest.mark.req("CDFF-SUP-080", "CDFF-SUP-081")
def test_a_site_correction_is_announced_and_earlier_answers_can_be_repeated(
    shared: System, eventually: Eventually
) -> None:
    received: list[dict[str, Any]] = []
    subscription = shared.bus.subscribe(
        keys.event("ground", "reanchored"), lambda message: received.append(msgpack.unpackb(message.payload))
    )
    before = shared.call("place", frame="site").body()
    assert before["anchor"]["lon_deg"] == pytest.approx(77.5)
    anchor = {"body": "mars", "lon_deg": 77.6, "lat_deg": 18.4, "expected_revision": 1}
    revision = shared.call("place", payload=msgpack.packb(anchor), frame="site").body()
    eventually(lambda: bool(received), 10, "the event")
    assert received[0]["frames_revision"] == revision["frames_revision"]
    assert shared.call("place", frame="site").body()["anchor"]["lon_deg"] == pytest.approx(77.6)
    earlier = shared.call("place", frame="site", frames_revision=before["frames_revision"]).body()
    assert earlier["anchor"] == before["anchor"]
    with pytest.raises(InputError, match="revision 2, not 1"):
        shared.call("place", payload=msgpack.packb(anchor), frame="site")
    with pytest.raises(DeniedError):
        shared.call("place", scope="mana", payload=msgpack.packb(anchor), frame="site")
    subscription.close()


@pytest.mark.req("CDFF-SUP-083")
def test_a_transaction_over_the_bus_is_atomic(shared: System) -> None:
    ids = [shared.put(small_map(), "dem", seq, robot="minnie") for seq in (901, 902)]
    changes: list[dict[str, Any]] = [{"do": "pin", "id": ids[0]}, {"do": "delete", "id": ids[1]}]
    with pytest.raises(ProductNotFoundError):
        shared.call("transact", payload=msgpack.packb([*changes, {"do": "delete", "id": "f" * 36}]))
    assert {i["id"] for i in shared.call("search", robot="minnie", type="dem").body()["items"]} >= set(ids)
    items = shared.call("transact", payload=msgpack.packb(changes)).body()["items"]
    assert (items[0]["pinned"], items[1]["deleted"]) == (True, True)
    assert shared.call("purge", id=ids[1]).body()["bytes"] >= 0


def small_map() -> ElevationMap:
    """Return a map of 2 × 2 cells."""
    grid = GridGeometry("site", 0.5, 0.0, 1.0, 2, 2)
    layers = {"mean": np.ones((2, 2), np.float32), "count": np.ones((2, 2), np.float32)}
    return ElevationMap.from_layers(grid, layers, t0_ns=0, t1_ns=0)
