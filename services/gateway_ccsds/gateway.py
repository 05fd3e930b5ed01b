# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway: it connects the DPM and the orchestrator with the ground segment during contacts."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.client import Client
from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError, CodecError, UnavailableError
from cdff_common.interfaces.contact_plan import ContactPlan, load_contact_plan
from cdff_common.output import make_folder
from services.alarms import Severity
from services.gateway_ccsds.authentication import CommandCounter, CommandKey
from services.gateway_ccsds.commands import CommandReceiver
from services.gateway_ccsds.datagrams import DatagramPort, parse_address
from services.gateway_ccsds.delivery import Delivery
from services.gateway_ccsds.feed import Feed
from services.gateway_ccsds.functions import Functions
from services.gateway_ccsds.settings import CcsdsSettings
from services.gateway_ccsds.spool import Spool
from services.gateway_ccsds.telemetry import EventSeverity, Housekeeping, Telemetry

logger = logging.getLogger(__name__)

SERVICE = "gateway_ccsds"
_STEP_S = 0.2
_STATUS_S = 1.0
#: Pause after a call that the DPM did not answer, seconds.
_RETRY_S = 2.0
#: Longest cycle of a thread; one that takes longer is reported as a problem, seconds.
_BUSY_LIMIT_S = 700.0
_SEVERITY = {Severity.WARNING: EventSeverity.MEDIUM, Severity.CRITICAL: EventSeverity.HIGH}


class Gateway:
    """Gateway between the bus and a ground segment.

    Parameters
    ----------
    settings : CcsdsSettings
    folder : Path
        Folder of the files that the settings name.
    data_dir : Path
        The state of the gateway is in its folder ``gateway_ccsds/{robot}``.
    bus : Bus
    client : Client

    Raises
    ------
    ConfigurationError
        If the contact plan or the key cannot be read.
    UnavailableError
        If an address is in use.
    StorageError
        If the state cannot be read or written.
    """

    def __init__(
        self, settings: CcsdsSettings, folder: Path, data_dir: Path, bus: Bus, client: Client
    ) -> None:
        self._settings, self._bus = settings, bus
        robot, state = settings.robot, make_folder(data_dir / SERVICE / settings.robot)
        self._plan = _plan(settings, folder)
        key = None if settings.command_key is None else CommandKey.read(folder / settings.command_key)
        self._clock = bus.mission_clock
        packets, cfdp = settings.packets, settings.cfdp
        self._packet_port = DatagramPort(parse_address(packets.listen), parse_address(packets.peer))
        self._pdu_port = DatagramPort(parse_address(cfdp.listen), parse_address(cfdp.peer))
        self._telemetry = Telemetry(packets.apid, self._packet_port.send, self._clock.now_ns)
        self._spool = Spool(make_folder(state / "outgoing"), cfdp.transaction_bytes)
        self._feed = Feed(
            robot,
            client,
            self._spool,
            settings.products,
            state / "position",
            cfdp.spool_bytes,
            self._on_alarm_event,
        )
        self._commands = CommandReceiver(
            robot,
            packets.apid,
            key,
            CommandCounter(state / "command_counter"),
            self._telemetry,
            Functions(robot, client, self._feed).execute,
            bus.loops.add("commands", _BUSY_LIMIT_S),
            bus.loops.add("cancellations", _BUSY_LIMIT_S),
        )
        self._delivery = Delivery(
            cfdp,
            self._spool,
            self._pdu_port,
            state / "transaction",
            self._commands.on_file,
            bus.loops.add("cfdp", _BUSY_LIMIT_S),
            max((window.delay_s for window in self._windows()), default=0.0),
        )
        self._alarms: dict[str, list[Mapping[str, Any]]] = {}
        for scope in (robot, keys.GROUND):
            bus.subscribe(keys.alarms(scope, "*"), self._on_alarms)
        self._feed_pause_s, self._problem = 0.0, ""

    def run(self, stop: threading.Event) -> None:
        """Run until ``stop`` is set."""
        with ExitStack() as stack:
            stack.callback(self._packet_port.close)
            self._packet_port.start(self._commands.on_packet)
            stack.callback(self._commands.close)
            self._delivery.start()
            stack.callback(self._delivery.close)
            status_s = report_s = 0.0
            while not stop.wait(_STEP_S):
                self._set_contact()
                self._read()
                now_s = monotonic_s()
                if now_s >= report_s:
                    report_s = now_s + self._settings.packets.housekeeping_s
                    self._telemetry.housekeeping(self.housekeeping())
                if now_s >= status_s:
                    status_s = now_s + _STATUS_S
                    self._bus.publish_latched(
                        keys.gateway_status(self._settings.robot, SERVICE), self.status()
                    )

    def problem(self) -> str:
        """Return the reason why no datagrams can be received; empty if they can."""
        ports = (self._packet_port, self._pdu_port)
        return "" if all(port.is_healthy for port in ports) else "a thread that receives datagrams has ended"

    def housekeeping(self) -> Housekeeping:
        """Return the current housekeeping report."""
        products, size = self._spool.size()
        alarms = [alarm for items in tuple(self._alarms.values()) for alarm in items]
        critical = sum(alarm.get("severity") == Severity.CRITICAL for alarm in alarms)
        alive = (self._bus.alive(keys.alive(scope, "*")) for scope in (self._settings.robot, keys.GROUND))
        return Housekeeping(
            services=sum(len(tokens) for tokens in alive),
            warnings=len(alarms) - critical,
            criticals=critical,
            waiting_products=products,
            waiting_bytes=size,
            delivered_files=self._delivery.counters["delivered"],
            repeated_files=self._delivery.counters["repeated"],
            commands=self._commands.counters["accepted"],
            refused_commands=self._commands.counters["refused"],
            position=(self._feed.position or 0) & 0xFFFFFFFF,
        )

    def status(self) -> dict[str, Any]:
        """Return the message of the status key."""
        products, size = self._spool.size()
        return {
            "in_contact": self._delivery.in_contact,
            "waiting": {"products": products, "bytes": size, "unconfirmed": self._delivery.unconfirmed},
            "position": self._feed.position,
            "products": dict(self._feed.counters),
            "files": dict(self._delivery.counters),
            "commands": dict(self._commands.counters),
            "packets": dict(self._packet_port.counters),
            "pdus": dict(self._pdu_port.counters),
            "problem": self._problem,
        }

    def _windows(self) -> list[Any]:
        return [] if self._plan is None else self._plan.of(self._settings.robot)

    def _set_contact(self) -> None:
        """Begin or end a contact according to the plan."""
        in_contact = (
            self._plan is None or self._plan.current(self._settings.robot, self._clock.now_ns()) is not None
        )
        if in_contact != self._delivery.in_contact:
            logger.info("contact %s", "begins" if in_contact else "ends")
            self._delivery.in_contact = in_contact
            self._telemetry.set_contact(in_contact)

    def _read(self) -> None:
        """Read the events of the DPM; after an error, try again after a pause."""
        if monotonic_s() < self._feed_pause_s:
            return
        try:
            if self._feed.position is None and not self._settings.backlog:
                self._feed.skip()
            while self._feed.read():
                pass
            self._problem = ""
        except UnavailableError as error:
            self._feed_pause_s, self._problem = monotonic_s() + _RETRY_S, str(error)
        except (CdffError, OSError) as error:
            if self._problem != str(error):
                logger.error("products are not read: %s", error)
            self._feed_pause_s, self._problem = monotonic_s() + _RETRY_S, str(error)

    def _on_alarms(self, message: Message) -> None:
        try:
            items = unpack(message.payload)["items"]
        except (CodecError, KeyError, TypeError):
            return
        self._alarms[message.key] = [item for item in items if isinstance(item, dict)]

    def _on_alarm_event(self, event: Mapping[str, Any]) -> None:
        """Send the start or the end of an alarm as an event report."""
        is_active = bool(event.get("active"))
        severity = _SEVERITY.get(event.get("severity", ""), EventSeverity.LOW)
        self._telemetry.event(
            severity if is_active else EventSeverity.INFORMATIVE,
            str(event.get("alarm", "alarm")),
            str(event.get("source", "")),
            str(event.get("what", "")) if is_active else f"ended: {event.get('what', '')}",
        )


def _plan(settings: CcsdsSettings, folder: Path) -> ContactPlan | None:
    return None if settings.contact_plan is None else load_contact_plan(folder / settings.contact_plan)
