# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lines of the log of Zenoh 1.10.2."""

from __future__ import annotations

import os

import pytest

from cdff_common.loops import Loops
from services.alarms import Alarms
from services.router.refusals import LogParser, RefusalMonitor, Refused

_ACL = "zenoh::net::routing::interceptor::access_control:"
_ON = "b7e2 on Interface(lo)+CertCommonName(mana.1)+Transport(Tls)+b7e2"
_DROPPED = "zenoh::net::routing::interceptor: Msg intercepted!"


def parse(*lines: str, parser: LogParser | None = None) -> list[Refused]:
    """Return the refusals in lines ``thread: text`` at level TRACE."""
    reader = parser or LogParser()
    texts = (line.split(": ", 1) for line in lines)
    refusals = (
        reader.parse(f"2026-11-23T17:05:03.188333Z TRACE  rx-0 ThreadId({n}) {text}") for n, text in texts
    )
    return [refused for refused in refusals if refused is not None]


def test_a_dropped_message_has_the_identity_operation_and_key_of_the_line_before() -> None:
    denied = f"8: {_ACL} {_ON} is unauthorized to Put (ingress) on cdff/@v1/minnie/product/a/b"
    (refused,) = parse(denied, f"8: {_DROPPED}")
    assert (refused.identity, refused.operation, refused.key) == (
        "mana.1",
        "Put",
        "cdff/@v1/minnie/product/a/b",
    )


def test_lines_of_other_threads_between_do_not_confuse() -> None:
    (refused,) = parse(
        f"8: {_ACL} {_ON} is unauthorized to Put (ingress) on cdff/@v1/minnie/product/a/b",
        f"9: {_ACL} {_ON} is authorized to Query (ingress) on cdff/@v1/x",
        f"8: {_DROPPED}",
    )
    assert refused.operation == "Put"


def test_permissions_that_are_computed_in_advance_are_no_refusals() -> None:
    computed = [
        f"8: {_ACL} ACL (ingress): caching permissions for `cdff/@v1/minnie/x` ...",
        f"8: {_ACL} {_ON} is unauthorized to Put (ingress) on cdff/@v1/minnie/x",
        f"8: {_ACL} {_ON} is authorized to Declare Liveliness Subscriber (ingress) on cdff/@v1/minnie/x",
    ]
    assert parse(*computed) == []
    cached = f"8: {_ACL} Using cached result: b7e2 is unauthorized to Put (ingress) on cdff/@v1/minnie/x"
    (refused,) = parse(*computed, cached, f"8: {_DROPPED}")
    assert (refused.identity, refused.operation) == ("mana.1", "Put")


def test_a_link_of_a_revoked_identity_is_reported_with_its_name_and_its_messages_are_not() -> None:
    (link,) = parse(
        "5: zenoh_link_tls::unicast: Accepted TLS connection on [::1]:1: [::1]:2. Common Name: eve.1.",
        f"5: {_ACL} 4472 did not match any configured ACL subject. Default permission `Deny` will be applied",
        f"5: {_DROPPED}",
    )
    assert (link.identity, link.operation) == ("eve.1", "connect")
    assert link.reason == "certificate revoked or not admitted"


def test_a_refused_link_has_the_reason_of_the_handshake() -> None:
    line = (
        "2026-11-23T17:05:24Z  WARN acc-0 ThreadId(06) zenoh_link_tls::unicast: invalid peer certificate: "
        "certificate expired: verification time 1795453524 (UNIX), but certificate is not valid after "
        "1795367097 (86427 seconds ago). Hint: increase the system open file limit."
    )
    assert LogParser().parse(line) == Refused(
        "", "connect", "", "invalid peer certificate: certificate expired"
    )


def test_refusals_are_reported_once_an_interval_with_their_count_and_raise_an_alarm() -> None:
    reported: list[tuple[Refused, int]] = []
    alarms = Alarms()
    monitor = RefusalMonitor(
        lambda refused, count: reported.append((refused, count)), alarms, Loops().add("log")
    )
    refused = Refused("mana.1", "Put", "cdff/@v1/minnie/product/a/b", "not granted to this identity")
    for _ in range(3):
        monitor.count(refused)
    monitor.report()
    monitor.report()
    assert reported == [(refused, 3)]
    (alarm,) = alarms.active()
    assert alarm.kind == "refused_identity"
    assert "3 refused, the last one: mana.1: Put" in alarm.what


def test_an_intruder_that_varies_the_key_does_not_fill_the_memory() -> None:
    reported: list[tuple[Refused, int]] = []
    monitor = RefusalMonitor(
        lambda refused, count: reported.append((refused, count)), Alarms(), Loops().add("log")
    )
    for i in range(1000):
        monitor.count(
            Refused("mana.1", "Put", f"cdff/@v1/minnie/product/a/x{i}", "not granted to this identity")
        )
    monitor.report()
    assert len(reported) <= 51
    assert sum(count for _, count in reported) == 1000


def test_a_link_that_broke_off_in_the_handshake_is_no_refused_identity() -> None:
    assert refused_links("Connection reset by peer (os error 104)") == []
    assert refused_links("tls handshake eof") == []
    assert refused_links("peer sent no certificates") == ["peer sent no certificates"]


def refused_links(reason: str) -> list[str]:
    """Return the reasons of the refusals in a warning of the TLS link."""
    line = f"2026-11-23T17:05:03.188333Z  WARN acc-0 ThreadId(7) zenoh_link_tls::unicast: {reason}. Hint: see"
    refused = LogParser().parse(line)
    return [] if refused is None else [refused.reason]


def test_a_log_that_cannot_be_read_is_a_problem_of_the_router() -> None:
    loops = Loops()
    monitor = RefusalMonitor(lambda refused, count: None, Alarms(), loops.add("refusals"))
    read, write = os.pipe()
    os.write(write, b"a line\nthe start of another")
    os.close(write)
    monitor._read(read)
    assert loops.problem() == ""
    os.close(read)
    with pytest.raises(OSError):
        monitor._read(read)
    assert loops.problem() == "loop refusals has ended"
