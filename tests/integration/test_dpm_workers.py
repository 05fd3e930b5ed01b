# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DPM with workers and a standby on one PostgreSQL database and one object store, behind one address."""

import json
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any

import msgpack
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CdffError
from cdff_common.interfaces.product import Header, product_id
from cdff_dev.ports import free_port
from tests.support import postgresql, seaweedfs
from tests.support.dpm_products import cloud

from .conftest import process_starter, wait_until

pytestmark = [pytest.mark.integration, pytest.mark.slow]

S = 1_000_000_000
PROFILE = "name: test\nbody: {name: mars, site_lon_deg: 77.5, site_lat_deg: 18.4}\nrobots:\n- id: mana\n"


class Processes:
    """A router, a DPM, a standby, and two workers on one address."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self.cluster = stack.enter_context(postgresql.cluster())
        objects = stack.enter_context(seaweedfs.object_server())
        self.cluster.execute("CREATE DATABASE mission")
        self.endpoint, self.port = f"tcp/127.0.0.1:{free_port()}", free_port()
        self.http = f"http://127.0.0.1:{self.port}"
        store = self.store_in(folder / "data")
        self.folder = folder
        self._profile = folder / "profile.yaml"
        self._profile.write_text(PROFILE)
        environment = objects.environment | {"CDFF_STORE": store}
        self._spawn = stack.enter_context(process_starter(self.endpoint, folder, **environment))
        self._spawn("services.router")
        self.bus = stack.enter_context(Bus.open(self.endpoint, name="test", wait_s=20))
        self.running = {"dpm": self.start("dpm")}
        self.wait_alive("dpm")
        for worker in (1, 2):
            self.running[f"dpm_{worker}"] = self.start(f"dpm_{worker}", "--worker", str(worker))
        for worker in (1, 2):
            self.wait_alive(f"dpm_{worker}")

    def store_in(self, directory: Path) -> str:
        """Return the URL of the store; one process keeps its local files in ``directory``."""
        return self.cluster.url("mission", directory, f"s3://{seaweedfs.BUCKET}/mission")

    def start(self, name: str, *options: str) -> subprocess.Popen[bytes]:
        """Start a DPM or a worker."""
        address, profile = f"127.0.0.1:{self.port}", str(self._profile)
        return self._spawn("services.dpm", "--http", address, "--share-port", "--profile", profile, *options)

    def wait_alive(self, name: str, *, is_alive: bool = True) -> None:
        """Wait until a process has, or has no longer, its liveliness token."""
        key = keys.alive(keys.GROUND, name)
        wait_until(lambda: bool(self.bus.alive(key)) is is_alive, 60, f"token of {name}: {is_alive}")

    def kill(self, name: str) -> None:
        """Kill a process as ``kill -9`` does."""
        self.running[name].kill()
        self.running[name].wait()
        self.wait_alive(name, is_alive=False)

    def put(self, seq: int) -> str:
        """Insert a cloud over the bus and return its id."""
        header = Header(
            id=product_id("mana", "test", "pointcloud", seq * S, seq, "c"),
            seq=seq,
            t0_ns=seq * S,
            t1_ns=seq * S,
            producer="test",
            config_hash="c",
            frame="site",
        )
        self.bus.call(
            keys.dpm_rpc("mana", "put"),
            {"dfpc": "test", "port": "pointcloud", "product": "pointcloud"},
            payload=encode(cloud(), "uper"),
            attachment=header.to_attachment(),
            encoding=encoding_string("Pointcloud", "uper"),
            timeout_s=20,
        )
        return header.id


@pytest.fixture(scope="module")
def processes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Processes]:
    """The processes, for all tests of the module in their order."""
    reason = postgresql.missing() or seaweedfs.missing()
    if reason:
        pytest.skip(reason)
    with ExitStack() as stack:
        yield Processes(stack, tmp_path_factory.mktemp("workers"))


def arrives(stream: HTTPResponse, ordinals: list[int]) -> bool:
    """Return whether these events arrive in a stream of events; a read ends after 20 s."""
    missing = set(ordinals)
    while missing and (line := stream.readline()):
        if line.startswith(b"id: "):
            missing.discard(int(line[4:]))
    return not missing


class Connection:
    """A connection to one of the processes: the system selects which.

    Attributes
    ----------
    process : str
        Name of the process.
    """

    def __init__(self, processes: Processes) -> None:
        self._connection = HTTPConnection("127.0.0.1", processes.port, timeout=20)
        self.process: str = json.loads(self.call("GET", "/api/v1/status"))["process"]

    def call(self, method: str, path: str, body: object = None, **headers: str) -> bytes:
        """Return the body of an answer."""
        text = None if body is None else json.dumps(body)
        self._connection.request(method, path, text, {"Content-Type": "application/json", **headers})
        answer = self._connection.getresponse()
        data = answer.read()
        assert answer.status < 300, data
        return data

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()


@contextmanager
def connections(processes: Processes, count: int) -> Iterator[dict[str, Connection]]:
    """Open a connection to each of ``count`` processes, by name."""
    found: dict[str, Connection] = {}
    with ExitStack() as stack:
        for _ in range(100):
            connection = stack.enter_context(closing(Connection(processes)))
            found.setdefault(connection.process, connection)
            if len(found) == count:
                break
        yield found


def product_ids(connection: Connection) -> set[str]:
    """Return the ids of all products that a process finds, after it has also read their payloads."""
    items = json.loads(connection.call("GET", "/api/v1/products?robot=mana&limit=100"))["items"]
    for item in items:
        assert len(connection.call("GET", f"/api/v1/products/{item['id']}/payload")) > 1000
    return {item["id"] for item in items}


def test_every_process_behind_the_address_has_every_product(processes: Processes) -> None:
    ids = {processes.put(seq) for seq in range(3)}
    with connections(processes, 3) as by_process:
        assert sorted(by_process) == ["dpm", "dpm_1", "dpm_2"]
        for connection in by_process.values():
            assert product_ids(connection) == ids


def test_a_change_by_a_worker_is_published_once_and_reaches_clients_of_all_processes(
    processes: Processes,
) -> None:
    product = processes.put(10)
    published: list[dict[str, Any]] = []

    def on_event(message: Message) -> None:
        published.append(msgpack.unpackb(message.payload))

    processes.bus.subscribe(keys.event("*", "updated"), on_event)
    with ExitStack() as stack, connections(processes, 3) as by_process:
        streams = [
            stack.enter_context(urllib.request.urlopen(f"{processes.http}/api/v1/events", timeout=20))
            for _ in range(8)
        ]
        for n, name in enumerate(sorted(by_process)):
            headers = {"If-Match": f'"r{n}"'}
            by_process[name].call("PATCH", f"/api/v1/products/{product}", {"notes": name}, **headers)
        wait_until(lambda: len(published) >= 3, 10, "events on the bus")
        ordinals = [event["ordinal"] for event in published]
        assert all(arrives(stream, ordinals) for stream in streams)
    processes.put(11)  # after its answer, a second event of an earlier change would have been published
    assert len(set(ordinals)) == len(ordinals) == 3
    assert [event["ordinal"] for event in published] == ordinals


def test_workers_answer_while_the_dpm_is_dead_and_a_standby_replaces_it(processes: Processes) -> None:
    standby = processes.start("dpm", "--store", processes.store_in(processes.folder / "standby"))
    log = processes.folder / "services.dpm.log"
    wait_until(lambda: "this one waits until it ends" in log.read_text(), 60, "the standby waits")
    processes.kill("dpm")
    products = {processes.put(seq) for seq in range(20, 23)}  # by a worker, perhaps before the standby runs
    processes.running["dpm"] = standby
    processes.wait_alive("dpm")
    published: list[str] = []
    processes.bus.subscribe(
        keys.event("*", "inserted"), lambda message: published.append(msgpack.unpackb(message.payload)["id"])
    )
    products.add(last := processes.put(23))
    wait_until(lambda: last in published, 10, "event of the new DPM")
    processes.kill("dpm_1")
    with connections(processes, 2) as by_process:
        assert sorted(by_process) == ["dpm", "dpm_2"]
        for connection in by_process.values():
            assert product_ids(connection) >= products


def test_a_restart_of_the_database_keeps_the_lease_and_the_events(processes: Processes) -> None:
    processes.cluster.kill()
    processes.cluster.start()
    published: list[str] = []
    processes.bus.subscribe(
        keys.event("*", "inserted"), lambda message: published.append(msgpack.unpackb(message.payload)["id"])
    )

    def has_stored() -> bool:
        with suppress(CdffError):
            processes.put(30)
            return True
        return False

    wait_until(has_stored, 20, "insertion after the restart")
    last = processes.put(31)
    wait_until(lambda: last in published, 10, "event after the restart")
    assert processes.running["dpm"].poll() is None
