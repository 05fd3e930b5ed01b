# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls, streams and liveliness of the bus between two sessions of a real router."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta

import pytest
import zenoh

from cdff_common.bus import Bus, Message, Pause, Qos, Reply, Request, Signal, keys
from cdff_common.bus.inbox import Inbox
from cdff_common.errors import DeadlineError, InputError, NoAnswerError, OverloadedError, UnavailableError
from tests.integration.conftest import Eventually, Spawn

pytestmark = pytest.mark.integration

STAT = keys.dpm_rpc("ground", "stat")
EVENT = keys.event("mana", "alarm")


@pytest.fixture
def pair(router: subprocess.Popen[bytes], endpoint: str) -> Iterator[tuple[Bus, Bus]]:
    with (
        Bus.open(endpoint, name="server", wait_s=10) as server,
        Bus.open(endpoint, name="client", wait_s=10) as client,
    ):
        yield server, client


def serve(bus: Bus, client: Bus, handler: object, eventually: Eventually, **options: float) -> None:
    """Serve ``STAT`` and wait until the client reaches it."""
    bus.serve(STAT, handler, **options)  # type: ignore[arg-type]
    bus.serve(keys.dpm_rpc("ground", "get"), lambda _r: Reply.of(True))

    def is_reachable() -> bool:
        try:
            return bool(client.call(keys.dpm_rpc("ground", "get"), timeout_s=1).body())
        except UnavailableError:
            return False

    eventually(is_reachable)


def test_a_bus_works_after_it_refused_an_encoding(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair
    serve(server, client, lambda request: Reply(b"", request.encoding * 2), eventually)
    for encoding in ("e" * 300, "e" * 200):  # refused by the client's bus, and by the server's
        with pytest.raises(InputError, match="at most 255"):
            client.call(STAT, encoding=encoding)
    assert client.call(STAT, encoding="e").encoding == "ee"


def test_a_bus_works_after_it_refused_a_key(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair
    serve(server, client, lambda request: Reply.of(True), eventually)
    for key in ("", "k" * 70_000):
        with pytest.raises(InputError, match="key"):
            client.publish(key, b"")
        with pytest.raises(InputError, match="key"):
            client.call(key)
    for key in ("cdff//x", "cdff/#x"):
        with pytest.raises(UnavailableError, match="Invalid Key Expr"):
            client.call(key)
    assert client.call(STAT).body() is True


#: A client of Zenoh alone that sends a message whose encoding and then key are too long for Zenoh 1.10.
FOREIGN = """
import json, os, sys, zenoh
failures = []
for key, encoding in (("k", "e" * 300), ("k" * 70_000, "e")):
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
    session = zenoh.open(config)
    try:
        session.put("cdff/@v1/mana/event/" + key, b"1", encoding=encoding)
    except BaseException as error:
        failures.append(type(error).__name__)
print(failures, flush=True)
os._exit(0)  # its sessions cannot be closed
"""


def test_a_foreign_client_whose_message_zenoh_cannot_send_harms_only_itself(
    pair: tuple[Bus, Bus], endpoint: str, eventually: Eventually
) -> None:
    server, client = pair
    received: list[str] = []
    server.subscribe("cdff/@v1/mana/event/**", lambda message: received.append(message.encoding))
    serve(server, client, lambda request: Reply.of(True), eventually)
    foreign = subprocess.run(
        [sys.executable, "-c", FOREIGN, endpoint], capture_output=True, text=True, timeout=60, check=True
    )
    assert foreign.stdout.strip() == "['PanicException', 'PanicException']", (
        "Zenoh refuses such messages in another way: see _MAX_KEY_BYTES in cdff_common/bus/message.py"
    )
    client.publish("cdff/@v1/mana/event/k", b"1", encoding="e")
    eventually(lambda: received == ["e"])
    assert client.call(STAT).body() is True


def test_the_clock_of_a_machine_has_no_effect_on_its_messages(
    router: subprocess.Popen[bytes], endpoint: str, eventually: Eventually
) -> None:
    received: list[zenoh.Sample] = []
    config = zenoh.Config()
    settings = {"mode": "client", "connect/endpoints": [endpoint]}
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    day_ahead = zenoh.Timestamp(datetime.now(UTC) + timedelta(days=1), b"\1")
    with (
        Bus.open(endpoint, name="mana", wait_s=10) as bus,
        zenoh.open(config) as fast,
        zenoh.open(config) as reader,
    ):
        reader.declare_subscriber(EVENT, received.append)

        def both_arrive() -> bool:
            bus.publish_map(EVENT, {})
            fast.put(EVENT, b"", timestamp=day_ahead)
            return {sample.timestamp is None for sample in received} == {True, False}

        eventually(both_arrive)
    stamps = {sample.timestamp.get_time() for sample in received if sample.timestamp is not None}
    assert stamps == {day_ahead.get_time()}, "the router passes the message of a clock a day ahead as it is"


def test_a_closed_bus_refuses_to_publish(endpoint: str, router: subprocess.Popen[bytes]) -> None:
    bus = Bus.open(endpoint, name="closed", wait_s=10)
    bus.close()
    with pytest.raises(UnavailableError, match="is not published"):
        bus.publish_map(EVENT, {})


def test_a_call_carries_parameters_payload_and_attachment_both_ways(
    pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    server, client = pair

    def handler(request: Request) -> Reply:
        return Reply(
            request.payload[::-1],
            request.encoding,
            {"echo": dict(request.parameters), "scope": request.scope},
        )

    serve(server, client, handler, eventually)
    reply = client.call(STAT, {"a": "b;c=d", "region": "bbox:-1,2"}, payload=b"abc", encoding="application/x")
    assert reply.payload == b"cba"
    assert reply.encoding == "application/x"
    assert reply.attachment == {
        "kind": "result",
        "final": True,
        "echo": {"a": "b;c=d", "region": "bbox:-1,2"},
        "scope": "ground",
    }


def test_progress_is_received_before_the_final_reply(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair

    def handler(_request: Request) -> Iterator[Reply]:
        yield Reply.of(1, kind="progress", final=False)
        yield Reply.of(2, kind="product")

    serve(server, client, handler, eventually)
    assert [(r.body(), r.final) for r in client.call_stream(STAT)] == [(1, False), (2, True)]
    assert client.call(STAT).body() == 2


@pytest.mark.req("CDFF-SUP-027")
def test_a_call_without_a_server_fails_with_unavailable(pair: tuple[Bus, Bus]) -> None:
    with pytest.raises(UnavailableError, match="no service answers"):
        pair[1].call(STAT)


def test_errors_are_raised_as_the_class_of_the_server(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair

    def handler(_request: Request) -> Reply:
        raise InputError("region=x: expected bbox")

    serve(server, client, handler, eventually)
    with pytest.raises(InputError, match="region=x"):
        client.call(STAT)


def test_a_bug_in_a_handler_is_answered_with_internal(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair

    def handler(_request: Request) -> Reply:
        raise ZeroDivisionError("oops")

    serve(server, client, handler, eventually)
    with pytest.raises(Exception, match="ZeroDivisionError"):
        client.call(STAT)


def test_a_reply_without_a_final_part_raises_unavailable(
    pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    server, client = pair
    serve(server, client, lambda _r: iter([Reply.of(1, kind="progress", final=False)]), eventually)
    with pytest.raises(UnavailableError, match="broke off"):
        client.call(STAT)


def test_a_handler_slower_than_the_timeout_raises_a_deadline_error(
    pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    server, client = pair
    release = threading.Event()

    def handler(_request: Request) -> Reply:
        release.wait(10)
        return Reply.of(1)

    serve(server, client, handler, eventually)
    with pytest.raises(DeadlineError):
        client.call(STAT, timeout_s=0.3)
    release.set()


def test_handlers_run_concurrently_and_excess_calls_are_refused_at_once(
    pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    server, client = pair
    release, entered = threading.Event(), threading.Semaphore(0)

    def handler(_request: Request) -> Reply:
        entered.release()
        release.wait(10)
        return Reply.of(1)

    serve(server, client, handler, eventually, workers=2, backlog=1)
    results: list[object] = []

    def call() -> None:
        try:
            results.append(client.call(STAT, timeout_s=10).body())
        except OverloadedError as error:
            results.append(error)

    threads = [threading.Thread(target=call) for _ in range(4)]
    for thread in threads:
        thread.start()
    assert entered.acquire(timeout=5)
    assert entered.acquire(timeout=5)
    eventually(lambda: any(isinstance(r, OverloadedError) for r in results))
    release.set()
    for thread in threads:
        thread.join(10)
    assert results.count(1) == 3


def test_the_payloads_of_waiting_calls_are_bounded(
    pair: tuple[Bus, Bus], eventually: Eventually, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, client = pair
    monkeypatch.setattr(server._calls, "inbox", Inbox(1_500_000))
    entered, release = threading.Semaphore(0), threading.Event()

    def handler(request: Request) -> Reply:
        entered.release()
        release.wait(10)
        return Reply.of(len(request.payload))

    serve(server, client, handler, eventually, workers=4, backlog=60)
    payload = bytes(1_000_000)
    with ThreadPoolExecutor(4) as pool:
        calls = [pool.submit(client.call, STAT, payload=payload, timeout_s=10) for _ in range(2)]
        assert entered.acquire(timeout=5)
        assert entered.acquire(timeout=5)
        with pytest.raises(OverloadedError, match="repeat the call later"):
            client.call(STAT, payload=payload)
        calls.append(pool.submit(client.call, STAT, timeout_s=10))  # without a payload
        assert entered.acquire(timeout=5)
        release.set()
        assert [call.result().body() for call in calls] == [1_000_000, 1_000_000, 0]
    assert client.call(STAT, payload=payload).body() == 1_000_000, "the space is free again"


def test_a_call_that_hangs_is_a_problem_of_its_process(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair
    release = threading.Event()

    def handler(_request: Request) -> Reply:
        release.wait(10)
        return Reply.of(1)

    serve(server, client, handler, eventually, busy_limit_s=0.3)
    with ThreadPoolExecutor(1) as pool:
        call = pool.submit(client.call, STAT, timeout_s=10)
        eventually(lambda: f"call {STAT} is busy for" in server.loops.problem())
        release.set()
        assert call.result().body() == 1
    eventually(lambda: server.loops.problem() == "")


@pytest.mark.req("CDFF-SUP-040")
def test_a_slow_subscriber_drops_and_counts_its_oldest_samples_and_blocks_no_other_subscriber(
    pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    server, client = pair
    release = threading.Event()
    received: list[int] = []

    def slow(message: Message) -> None:
        release.wait(10)
        received.append(message.payload[0])

    subscription = client.subscribe(EVENT, slow, depth=4)
    serve(server, client, lambda _r: Reply.of(1), eventually)
    ready: list[Message] = []
    client.subscribe(keys.event("mana", "ready"), ready.append)

    def is_subscribed() -> bool:
        server.publish(keys.event("mana", "ready"), b"")
        return bool(ready)

    eventually(is_subscribed)
    for i in range(100):
        server.publish(EVENT, bytes([i]))
    assert client.call(STAT, timeout_s=5).body() == 1
    eventually(lambda: subscription.dropped >= 90)
    release.set()
    eventually(lambda: len(received) + subscription.dropped == 100)
    assert received[-4:] == [96, 97, 98, 99]


def test_a_failing_subscriber_is_counted_and_continues(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair
    received: list[bytes] = []

    def fails_first(message: Message) -> None:
        received.append(message.payload)
        if len(received) == 1:
            raise ZeroDivisionError

    subscription = client.subscribe(EVENT, fails_first)

    def received_twice() -> bool:
        server.publish(EVENT, b"x")
        return len(received) >= 2

    eventually(received_twice)
    assert subscription.failed == 1


def test_late_subscribers_receive_the_latched_value(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair
    status = keys.dfpc_status("mana", "vo")
    server.publish_latched(status, {"state": "inactive"})
    server.publish_latched(status, {"state": "active"})

    def last_state_is_active() -> bool:
        try:
            return bool(client.call(status).body()["state"] == "active")
        except UnavailableError:
            return False

    eventually(last_state_is_active)


def test_liveliness_follows_the_service(pair: tuple[Bus, Bus], endpoint: str, eventually: Eventually) -> None:
    _, client = pair
    changes: list[tuple[str, bool]] = []
    client.watch_alive(keys.alive("mana", "*"), lambda key, alive: changes.append((key, alive)))
    with Bus.open(endpoint, name="service") as service:
        service.declare_alive("mana", "vo")
        eventually(lambda: (keys.alive("mana", "vo"), True) in changes)
        tokens = {keys.alive("ground", "router"), keys.alive("mana", "vo")}
        eventually(lambda: client.alive(keys.alive("*", "*")) == tokens)
    eventually(lambda: (keys.alive("mana", "vo"), False) in changes)


@pytest.mark.req("CDFF-SUP-043")
def test_calls_and_streams_work_again_after_the_router_was_killed(
    pair: tuple[Bus, Bus], router: subprocess.Popen[bytes], spawn: Spawn, eventually: Eventually
) -> None:
    server, client = pair
    serve(server, client, lambda _r: Reply.of(1), eventually)
    received: list[bytes] = []
    client.subscribe(EVENT, lambda m: received.append(m.payload))
    router.kill()
    router.wait()
    with pytest.raises(UnavailableError):
        client.call(STAT, timeout_s=1)
    spawn("services.router")

    def calls_and_streams_work() -> bool:
        try:
            server.publish(EVENT, b"x")
            return client.call(STAT, timeout_s=1).body() == 1 and bool(received)
        except UnavailableError:
            return False

    eventually(calls_and_streams_work, timeout_s=10)


def test_the_mission_clock_follows_its_publisher(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair
    clock = client.mission_clock

    def follows_publisher() -> bool:
        server.publish_map(keys.CLOCK, {"now_ns": 5_000_000_000, "rate": 1.0})
        return 5_000_000_000 <= clock.now_ns() < 60_000_000_000

    eventually(follows_publisher)


def test_opening_a_bus_without_a_router_fails_with_advice(endpoint: str) -> None:
    started_s = time.monotonic()
    with pytest.raises(UnavailableError, match="cdff up"):
        Bus.open(endpoint, name="x", wait_s=0.2)
    assert time.monotonic() - started_s < 10


def test_a_second_router_on_the_same_endpoint_ends_with_a_known_error(
    router: subprocess.Popen[bytes], pair: tuple[Bus, Bus], spawn: Spawn
) -> None:
    assert spawn("services.router").wait(10) == 1


def test_an_unknown_verb_is_answered_with_an_error(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair
    serve(server, client, lambda _r: Reply.of(1), eventually)
    unknown = keys.dpm_rpc("ground", "nonsense")
    with pytest.raises(UnavailableError, match="starting"):
        client.call(unknown)
    server.declare_alive("ground", "dpm")
    with pytest.raises(InputError, match="no verb 'nonsense'; it has get, stat"):
        client.call(unknown)


def test_open_calls_are_answered_as_retriable_when_a_service_closes(
    router: subprocess.Popen[bytes], endpoint: str, eventually: Eventually
) -> None:
    running, errors = threading.Event(), []

    def handler(_request: Request) -> Reply:
        running.set()
        threading.Event().wait(5.0)
        return Reply.of(True)

    with Bus.open(endpoint, name="client", wait_s=10) as client:

        def call() -> None:
            try:
                client.call(STAT, timeout_s=20)
            except UnavailableError as error:
                errors.append(error)

        with Bus.open(endpoint, name="server", wait_s=10) as server:
            serve(server, client, handler, eventually, workers=1)
            threads = [threading.Thread(target=call) for _ in range(3)]  # one runs, two wait
            for thread in threads:
                thread.start()
            assert running.wait(5)
            eventually(lambda: sum(len(d._open) for d in server._declarations if hasattr(d, "_open")) == 3)
        for thread in threads:
            thread.join(5)
    assert len(errors) == 3
    for error in errors:
        assert not isinstance(error, NoAnswerError)
        assert (error.retriable, error.retry_after_s) == (True, 1.0)


def test_a_call_without_a_router_names_the_lost_connection_at_once(
    router: subprocess.Popen[bytes], pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    _, client = pair
    router.kill()
    router.wait()
    start_s = time.monotonic()
    with pytest.raises(NoAnswerError, match="connection to the router is lost"):
        client.call(STAT, timeout_s=20)
    assert time.monotonic() - start_s < 2.0


def test_samples_are_not_dropped_while_the_router_gets_no_processor_time(
    router: subprocess.Popen[bytes], pair: tuple[Bus, Bus], eventually: Eventually
) -> None:
    subscriber, publisher = pair
    received: list[bytes] = []
    key = keys.sensor("mana", "lidar", "cloud")
    subscriber.subscribe(key, lambda message: received.append(message.attachment))
    subscriber.alive(keys.alive("*", "router"))  # its answer follows the subscription
    for i in range(8):  # more than the buffers of the link hold
        router.send_signal(signal.SIGSTOP)
        threading.Timer(0.05, router.send_signal, (signal.SIGCONT,)).start()
        publisher.publish(key, bytes(8_000_000), attachment=b"%d" % i, qos=Qos.STREAM)
        publisher.publish(key, b"1", attachment=b"small %d" % i, qos=Qos.STREAM)
    expected = [name % i for i in range(8) for name in (b"%d", b"small %d")]
    eventually(lambda: received == expected)


def test_calls_that_pause_occupy_no_thread(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair
    started = threading.Semaphore(0)
    signals = [Signal() for _ in range(40)]
    threads: set[int] = set()

    def handler(request: Request) -> Iterator[Reply | Pause]:
        number = int(request.parameters["n"])
        for pause in (Pause(signals[number], 20.0), Pause(Signal(), 0.01)):
            started.release()
            yield pause
            threads.add(threading.get_ident())
        yield Reply.of(number)

    serve(server, client, handler, eventually, workers=2, backlog=60)
    with ThreadPoolExecutor(40) as pool:
        calls = [pool.submit(client.call, STAT, {"n": n}, timeout_s=20) for n in range(40)]
        assert all(started.acquire(timeout=10) for _ in range(40))
        for wakes in signals:
            wakes.set()
        assert [call.result().body() for call in calls] == list(range(40))
    assert len(threads) <= 2


def test_calls_are_answered_when_the_bus_closes_while_they_pause(
    router: subprocess.Popen[bytes], endpoint: str, eventually: Eventually
) -> None:
    started = threading.Event()

    def handler(_request: Request) -> Iterator[Reply | Pause]:
        started.set()
        yield Pause(Signal(), 60.0)
        yield Reply.of(1)

    with Bus.open(endpoint, name="client", wait_s=10) as client, ThreadPoolExecutor(1) as pool:
        with Bus.open(endpoint, name="server", wait_s=10) as server:
            serve(server, client, handler, eventually)
            call = pool.submit(client.call, STAT, timeout_s=20)
            assert started.wait(10)
        with pytest.raises(UnavailableError, match="is stopping"):
            call.result()


def test_an_error_after_a_pause_reaches_the_caller(pair: tuple[Bus, Bus], eventually: Eventually) -> None:
    server, client = pair

    def handler(_request: Request) -> Iterator[Reply | Pause]:
        yield Reply(b"", attachment={"final": False})
        yield Pause(Signal(), 0.01)
        raise InputError("after the pause")

    serve(server, client, handler, eventually, workers=1, backlog=1)
    for _ in range(5):  # their places are free again
        replies = client.call_stream(STAT)
        assert next(replies).final is False
        with pytest.raises(InputError, match="after the pause"):
            next(replies)
