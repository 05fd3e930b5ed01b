# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Refusals of a secured router, counted from the log of Zenoh.

Zenoh drops a message without an answer and has no callback for it. Only its log names the refused
identity, operation and key, at level TRACE of the access control, and refused links at level WARN. The log is
written to standard output; a pipe takes its place, so that refusals become events and an alarm.
"""

from __future__ import annotations

import fcntl
import logging
import os
import re
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from cdff_common.loops import Loop
from services.alarms import Alarms
from services.identity_alarm import IdentityAlarm

logger = logging.getLogger(__name__)

#: Log levels of Zenoh with which refusals are logged.
LOG_FILTER = "error,zenoh::net::routing::interceptor=trace,zenoh_link_tls=debug"
#: Interval of the reports, seconds.
REPORT_S = 1.0
#: Interval between two reads of the pipe, seconds, because waking for each line would slow the router down;
#: size of the pipe, and the Linux command that sets it (``fcntl.h``).
_READ_S, _PIPE_BYTES, _F_SETPIPE_SZ = 0.02, 1 << 20, 1031
#: Largest number of different refusals that are counted in one interval, since an intruder chooses the keys,
#: and of known sessions.
_MAX_KINDS, _MAX_SESSIONS = 50, 1000

_INGRESS = " (ingress)"
_NOT_GRANTED = "not granted to this identity"
_NOT_ADMITTED = "certificate revoked or not admitted"

_THREAD = re.compile(r"ThreadId\((\d+)\)")
_SESSION = re.compile(
    r": (?:Using cached result: )?([0-9a-f]+) (?:on \S*CertCommonName\(([^)]*)\)\S* )?"
    r"is (un)?authorized to (.+) on (\S+)$"
)
_ACCEPTED = re.compile(r"Accepted TLS connection .* Common Name: (\S+)\.$")
_CACHING = re.compile(r"caching permissions for `(\S+)`")
_CACHED = "Using cached result"
_LAST_COMPUTED = "Declare Liveliness Subscriber"
#: Links that broke off before the handshake was complete, such as of a client that was ended meanwhile.
_BROKEN = re.compile(r"os error (104|32|110)|Connection reset|Broken pipe|\beof\b|end of file", re.IGNORECASE)
_LINK = re.compile(r"zenoh_link_tls::\w+: (.*?)(?:: verification time .*)?(?:\. Hint.*)?$")


@dataclass(frozen=True, slots=True)
class Refused:
    """A refused message or link.

    Attributes
    ----------
    identity : str
        Common name of the certificate; empty for a link without an accepted one.
    operation : str
        Such as ``Put``, ``Declare Queryable`` or ``connect``.
    key : str
        Key of the message; empty for a link.
    reason : str
    """

    identity: str
    operation: str
    key: str
    reason: str


class LogParser:
    """Parser of Zenoh's log. Lines of several threads are interleaved: the state is kept for each thread."""

    def __init__(self) -> None:
        #: By thread: the refusal in its last line; None if the refused message was outgoing, which is not
        #: counted.
        self._denied: dict[str, Refused | None] = {}
        #: By thread: the common name in the certificate of the link that it accepted last.
        self._accepted_names: dict[str, str] = {}
        #: By thread: the key whose permissions it computes in advance.
        self._computed_keys: dict[str, str] = {}
        #: By session: the common name in the certificate.
        self._session_names: dict[str, str] = {}

    def parse(self, line: str) -> Refused | None:
        """Return the refusal that a line completes, None for other lines."""
        matched = _THREAD.search(line)
        if matched is None:
            return None
        thread = matched[1]
        previous = self._denied.pop(thread, None)
        if "Msg intercepted!" in line:
            # Only this line reports a dropped message. Without a reason before it, the message belongs
            # to a session that is reported as not admitted, or withdraws a declaration that was refused.
            return previous
        if " WARN " in line:
            link = _LINK.search(line)
            is_refused = link is not None and _BROKEN.search(link[1]) is None
            return Refused("", "connect", "", link[1]) if link and is_refused else None
        if session := _SESSION.search(line):
            self._on_permission(thread, line, *session.groups())
        elif accepted := _ACCEPTED.search(line):
            self._accepted_names[thread] = accepted[1]
        elif caching := _CACHING.search(line):
            self._computed_keys[thread] = caching[1]
        elif "did not match any configured ACL subject" in line:
            return Refused(self._accepted_names.get(thread, ""), "connect", "", _NOT_ADMITTED)
        return None

    def _on_permission(
        self,
        thread: str,
        line: str,
        session: str,
        name: str | None,
        denied: str | None,
        action: str,
        key: str,
    ) -> None:
        """Remember a refusal, unless the thread computes permissions of a key in advance of messages."""
        if name:
            if len(self._session_names) >= _MAX_SESSIONS:
                self._session_names.clear()
            self._session_names[session] = name
        if self._computed_keys.get(thread) == key and _CACHED not in line:
            if _LAST_COMPUTED in action:
                del self._computed_keys[thread]
        elif denied and action.endswith(_INGRESS):
            identity = self._session_names.get(session, "")
            self._denied[thread] = Refused(identity, action.removesuffix(_INGRESS), key, _NOT_GRANTED)
        elif denied:
            self._denied[thread] = None


class RefusalMonitor:
    """Counts refusals and reports them at intervals.

    Parameters
    ----------
    report : callable
        Called with each refusal and its count, at most once a second for each.
    alarms : Alarms
        Has the alarm ``refused_identity`` while there are refusals.
    loop : Loop
        Health of the thread that reads the log. Without a reader the pipe fills and stops the router.
    """

    def __init__(self, report: Callable[[Refused, int], None], alarms: Alarms, loop: Loop) -> None:
        self._report, self._loop = report, loop
        self._alarm = IdentityAlarm(alarms, "router")
        self._lock = threading.Lock()
        self._counts: Counter[Refused] = Counter()

    def watch_log(self) -> None:
        """Redirect standard output, where Zenoh writes its log, to this monitor. Call it before a session."""
        os.environ.update({"RUST_LOG": LOG_FILTER, "NO_COLOR": "1"})
        read, write = os.pipe()
        fcntl.fcntl(write, _F_SETPIPE_SZ, _PIPE_BYTES)
        os.dup2(write, 1)
        os.close(write)
        threading.Thread(target=self._read, args=(read,), name="refusals", daemon=True).start()

    def count(self, refused: Refused) -> None:
        """Count a refusal; beyond 50 different ones in an interval, keys are no longer distinguished."""
        with self._lock:
            if refused not in self._counts and len(self._counts) >= _MAX_KINDS:
                refused = Refused(refused.identity[:64], "several", "", "more different refusals")
            self._counts[refused] += 1

    def report(self) -> None:
        """Report the refusals since the last report, and begin or end the alarm."""
        with self._lock:
            counts, self._counts = self._counts, Counter()
        for refused, count in counts.items():
            self._report(refused, count)
            who = refused.identity or "a link without an accepted certificate"
            self._alarm.refuse(f"{who}: {refused.operation} {refused.key} ({refused.reason})", count)
        self._alarm.update()

    def _read(self, descriptor: int) -> None:
        parser, incomplete_line, pause = LogParser(), b"", threading.Event()

        def wait() -> bytes | None:
            pause.wait(_READ_S)
            return os.read(descriptor, _PIPE_BYTES) or None

        def work(data: bytes) -> None:
            nonlocal incomplete_line
            *lines, incomplete_line = (incomplete_line + data).split(b"\n")
            for line in lines:
                if b" is authorized to " in line and b"Liveliness" not in line:
                    continue  # most lines
                try:
                    self._on_line(parser, line.decode(errors="replace"))
                except Exception:
                    logger.exception("a line of the log of Zenoh is not understood")

        self._loop.run(wait, work)

    def _on_line(self, parser: LogParser, line: str) -> None:
        refused = parser.parse(line)
        if refused is not None:
            self.count(refused)
        elif " ERROR " in line:
            logger.error("%s", line)
