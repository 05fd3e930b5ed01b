# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import fields
from pathlib import Path

from spacepackets.ecss.tm import PusTm

from services.gateway_ccsds.telemetry import EventSeverity, Housekeeping, Telemetry, timestamp

ROOT = Path(__file__).resolve().parents[4]
XTCE = "{http://www.omg.org/spec/XTCE/20180204}"
REPORT = Housekeeping(3, 1, 2, 4, 1 << 40, 5, 6, 7, 8, 9)


def test_the_time_is_cuc_with_a_p_field() -> None:
    assert timestamp(1_500_000_000) == bytes([0x2F, 0, 0, 0, 1, 0x80, 0, 0])


def test_events_wait_for_the_contact_and_housekeeping_does_not() -> None:
    sent: list[bytes] = []
    telemetry = Telemetry(77, sent.append, lambda: 0)
    telemetry.event(EventSeverity.HIGH, "disk_full", "mana/dpm", "é" * 200)
    telemetry.housekeeping(REPORT)
    assert sent == []
    telemetry.set_contact(True)
    telemetry.housekeeping(REPORT)
    event, report = (PusTm.unpack(data, timestamp_len=8) for data in sent)
    assert (event.service, event.message_subtype, event.apid) == (5, 4, 77)
    assert event.source_data[:10] == b"\x09disk_full"
    assert event.source_data[-254:].decode() == "é" * 127
    assert (report.service, report.message_subtype, report.seq_count) == (3, 25, 1)


def test_the_description_of_the_housekeeping_report_has_its_fields_and_sizes() -> None:
    root = ElementTree.parse(ROOT / "deploy/ground_segment/yamcs/mdb/cdff.xml").getroot()
    types = {p.get("name"): p.get("parameterTypeRef") or "" for p in root.iter(f"{XTCE}Parameter")}
    container = next(c for c in root.iter(f"{XTCE}SequenceContainer") if c.get("name") == "housekeeping")
    names = [entry.get("parameterRef") for entry in container.iter(f"{XTCE}ParameterRefEntry")]
    assert names == ["structure", *(field.name for field in fields(Housekeeping))]
    assert sum(int(types[name][1:]) for name in names) == 8 * len(REPORT.pack())
