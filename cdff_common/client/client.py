# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A connection to a running system: ask for products, search and fetch them, look up poses, follow jobs."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self, Unpack

from cdff_common.bus import Bus, Reply, keys
from cdff_common.client.answer import Answer
from cdff_common.client.wishes import Wishes, parameters_of
from cdff_common.clock import monotonic_s
from cdff_common.codecs import decode
from cdff_common.codecs.encoding import parse_encoding
from cdff_common.errors import CdffError, CodecError, InputError, NoAnswerError, UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header

#: Told of every progress reply: job, state, reason, remaining_s, plan.
OnProgress = Callable[[Mapping[str, Any]], None]

_CODEC_PREFIX = "application/vnd.cdff+"
#: Formats that the DPM writes from a stored product.
_FILES = frozenset({"tif", "ply", "tum", "png"})
_PART_BYTES = 4 << 20
_RETRY_S = 0.3
#: How long one query of a standing request may last before it is asked again, seconds.
_STANDING_S = 3600.0


class Client:
    """A client of the orchestrator and the DPM; a context manager.

    Parameters
    ----------
    connect : str, optional
        Endpoint of the router; default ``CDFF_CONNECT``, then ``tcp/127.0.0.1:7447``.
    name : str
        Of this process, for logs.

    Raises
    ------
    UnavailableError
        If no router answers within 5 s.

    Notes
    -----
    Every method raises the subclass of ``CdffError`` that the answer's code stands for (``cdff_common.errors``).
    """

    def __init__(self, connect: str | None = None, *, name: str = "client") -> None:
        self._bus = Bus.open(connect, name=name)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._bus.close()

    def request(
        self,
        product: str,
        *,
        robot: str = "any",
        region: str | None = None,
        region_frame: str | None = None,
        frame: str | None = None,
        child: str | None = None,
        t_ns: int | None = None,
        max_age_s: float | None = None,
        resolution_m: float | None = None,
        min_coverage: float | None = None,
        as_type: str | None = None,
        format: str | None = None,
        deliver: str | None = None,
        priority: int | None = None,
        deadline_s: float = 20.0,
        on_progress: OnProgress | None = None,
    ) -> Answer:
        """Ask for a product and wait for it.

        Parameters
        ----------
        product : str
            ``pose trajectory pointcloud dem navigation_map image``.
        robot : str
            Robot id, or ``any``.
        region : str, optional
            ``bbox:… box:… circle:x,y,r polygon:… near:frame,r``, metres in ``region_frame`` (default ``frame``).
        frame : str, optional
            To have it in; default ``site``.
        child, t_ns
            Of a pose: which frame's, and when (mission time); default the robot's base, newest.
        max_age_s : float, optional
            Refuse what is older.
        resolution_m : float, optional
            Finer data are aggregated to it.
        min_coverage : float, optional
            Part of the region, 0 to 1, that must hold data.
        as_type, format, deliver : str, optional
            InFuse type, encoding (``uper ber xer msgpack tif ply tum png``), ``auto inline reference``.
        priority : int, optional
            0 to 9, default 5: which requests go first where not all can be taken.
        deadline_s : float
            The answer, or the reason why there is none, comes before this.
        on_progress : callable, optional

        Raises
        ------
        InputError
            If the request itself is wrong.
        DeadlineError, UnavailableError, OverloadedError
            If it cannot be answered as asked; the message says why.
        """
        parameters = parameters_of(
            product,
            robot,
            region=region,
            region_frame=region_frame,
            frame=frame,
            child=child,
            t_ns=t_ns,
            max_age_s=max_age_s,
            resolution_m=resolution_m,
            min_coverage=min_coverage,
            as_type=as_type,
            format=format,
            deliver=deliver,
            priority=priority,
        )
        return self._in_hand(self._ask(_scope(robot), parameters, monotonic_s() + deadline_s, on_progress))

    def _in_hand(self, final: Reply) -> Answer:
        """The product of a reply, fetched where it came as a reference."""
        if final.attachment.get("kind") != "reference":
            return _answer(final)
        reference = final.body()
        if reference["format"] in _FILES:
            asked = {"id": reference["id"], "format": reference["format"]}
            reply = self._call(keys.dpm_rpc(keys.GROUND, "get"), asked, 30.0)
            return _answer(Reply(reply.payload, reply.encoding, {**reply.attachment, **_of_request(final.attachment)}))
        return self._fetched(str(reference["id"]), final.attachment)

    def standing(
        self,
        product: str,
        *,
        robot: str = "any",
        every_s: float = 0.0,
        lease_s: float = 30.0,
        stop: threading.Event | None = None,
        **wishes: Unpack[Wishes],
    ) -> Generator[Answer]:
        """Yield a product now and each newer one as it comes, until the iterator is closed.

        Parameters
        ----------
        product, robot, wishes
            As of ``request``.
        every_s : float
            Least time between two answers; 0 for every change.
        lease_s : float
            How long the orchestrator goes on if this process dies; it is renewed from here while the iterator is open.
        stop : threading.Event, optional
            Ends the iteration when another thread sets it.

        Raises
        ------
        UnavailableError, OverloadedError
            As the orchestrator answers, and if nobody is there for ``lease_s``.
        """
        parameters = {**parameters_of(product, robot, **wishes), "every_s": every_s, "deadline_ms": int(lease_s * 1000)}
        key, silent_s = keys.orchestrator_rpc(_scope(robot), "request"), monotonic_s()
        with self._lease(_scope(robot), lease_s, stop or threading.Event()) as lease:
            while not lease.over.is_set():
                asked = {**parameters, "request": lease.renamed()}
                try:
                    for reply in self._stream(key, asked, _STANDING_S):
                        silent_s = monotonic_s()
                        if reply.attachment.get("kind") in ("product", "reference"):
                            yield self._in_hand(reply)
                except NoAnswerError:
                    if monotonic_s() - silent_s > lease_s:
                        raise
                except CdffError:
                    if not lease.over.is_set():  # else it is how the cancelled request ends
                        raise
                lease.over.wait(_RETRY_S)

    @contextmanager
    def _lease(self, scope: str, lease_s: float, over: threading.Event) -> Iterator[_Lease]:
        """Renew a standing request's lease from a thread; cancel the request when it is over."""
        lease = _Lease(over)

        def renew() -> None:
            asked = {"deadline_ms": int(lease_s * 1000)}
            while not over.wait(lease_s / 3):
                with suppress(CdffError):  # one that has ended is asked for again by its stream
                    self._call(keys.orchestrator_rpc(scope, "renew"), {**asked, "job": lease.name}, lease_s / 3)
            with suppress(CdffError):  # it may have ended by itself
                self._call(keys.orchestrator_rpc(scope, "cancel"), {"job": lease.name}, lease_s / 3)

        thread = threading.Thread(target=renew, name="renew", daemon=True)
        thread.start()
        try:
            yield lease
        finally:
            over.set()
            thread.join()

    def explain(
        self, product: str, *, robot: str = "any", deadline_s: float = 20.0, **wishes: Unpack[Wishes]
    ) -> dict[str, Any]:
        """Say what a request would get, without running anything; ``wishes`` are those of ``request``.

        Returns
        -------
        dict
            ``would`` (serve, make or refuse), ``stored`` (what the DPM holds for it, or None), ``plan`` with its parts
            and costs, ``alternatives``, and why not: ``why_not_stored``, ``why_not``, ``refused``, ``possible``.
        """
        asked = {**parameters_of(product, robot, **wishes), "explain": "true", "deadline_ms": int(deadline_s * 1000)}
        key = keys.orchestrator_rpc(_scope(robot), "request")
        body: dict[str, Any] = self._call(key, asked, deadline_s + 1.0).body()
        return body

    def search(self, product: str | None = None, **parameters: object) -> list[dict[str, Any]]:
        """Metadata of products in the DPM, newest first: ``robot= region= frame= t0= t1= limit= …`` (contract §5)."""
        asked = {"type": product, **parameters}
        body = self._call(keys.dpm_rpc(keys.GROUND, "search"), {k: v for k, v in asked.items() if v is not None}).body()
        items: list[dict[str, Any]] = body["items"]
        return items

    def get(self, product_id: str) -> Answer:
        """Return a product by id; raises ProductNotFoundError."""
        return self._fetched(product_id, {})

    def pose(
        self, robot: str, *, parent: str = "site", child: str | None = None, t_ns: int | None = None
    ) -> UncertainTransform:
        """``T_parent_child`` from the DPM, interpolated at ``t_ns`` (mission time), newest without; base by default."""
        asked: dict[str, object] = {"robot": robot, "parent": parent, "child": child or f"{robot}/base"}
        if t_ns is not None:
            asked["t"] = t_ns
        body = self._call(keys.dpm_rpc(keys.GROUND, "pose"), asked).body()
        return UncertainTransform(body["T"], body.get("covariance"))

    def call(
        self, robot: str, dfpc: str, operation: str, parameters: Mapping[str, object] | None = None, *,
        timeout_s: float = 10.0,
    ) -> tuple[Any, Mapping[str, Any]]:  # fmt: skip
        """Run an operation of a DFPC (``cdff dfpc show NAME`` lists them).

        Parameters
        ----------
        parameters : mapping, optional
            Of the operation, by name; the rest as described.

        Returns
        -------
        value : Any
            Plain data or a ``cdff_common.types`` object; None of an operation without a value.
        provenance : mapping
            Who made it, from what configuration, of which time and frame.

        Raises
        ------
        CdffError
            As the DFPC refuses: InputError for a parameter, UnavailableError where it does not run, NotActiveError, …
        """
        asked = {name: _text(value) for name, value in (parameters or {}).items()}
        reply = self._call(keys.dfpc_rpc(robot, dfpc, f"call/{operation}"), asked, timeout_s)
        if not reply.encoding.startswith(_CODEC_PREFIX):
            return reply.body(), reply.attachment
        type_name, codec = parse_encoding(reply.encoding)
        return decode(type_name, reply.payload, codec), reply.attachment

    def jobs(self, robot: str = "any", *, limit: int = 50) -> list[dict[str, Any]]:
        """The orchestrator's newest jobs, and where they stand."""
        body = self._call(keys.orchestrator_rpc(_scope(robot), "jobs"), {"limit": limit, **_named(robot)}).body()
        jobs: list[dict[str, Any]] = body["jobs"]
        return jobs

    def cancel(self, job: str, robot: str = "any") -> None:
        """Cancel a job by its id or its request's; whoever waits for it gets UNAVAILABLE."""
        self._call(keys.orchestrator_rpc(_scope(robot), "cancel"), {"job": job})

    def catalogue(self, robot: str = "any", product: str | None = None) -> dict[str, Any]:
        """What could be asked for, what would make it at what cost, and why not; of one product where it is named."""
        asked = {**_named(robot), **({} if product is None else {"type": product})}
        body: dict[str, Any] = self._call(keys.orchestrator_rpc(_scope(robot), "catalogue"), asked).body()
        return body

    def history(
        self, *, kinds: Sequence[str] = (), robot: str = "any", since: int = 0, limit: int = 1000
    ) -> list[dict[str, Any]]:
        """What happened after an ordinal, oldest first: insertions, audit entries, the orchestrator's decisions."""
        asked: dict[str, object] = {"since": since, "limit": limit}
        asked |= {"kind": ",".join(kinds)} if kinds else {}
        asked |= {} if robot == "any" else {"scope": robot}
        items: list[dict[str, Any]] = self._call(keys.dpm_rpc(keys.GROUND, "history"), asked).body()["items"]
        return items

    # -- inside -----------------------------------------------------------------------------------------------------

    def _ask(
        self, scope: str, parameters: Mapping[str, object], deadline_s: float, on_progress: OnProgress | None
    ) -> Reply:
        """The final reply; asked again, under a new name, where nobody was there or the answer broke off."""
        key, pause = keys.orchestrator_rpc(scope, "request"), threading.Event()
        parameters = {**parameters, "progress": "false" if on_progress is None else "true"}
        while True:
            remaining_s = max(deadline_s - monotonic_s(), 0.2)
            asked = {**parameters, "deadline_ms": int(remaining_s * 1000), "request": str(uuid.uuid4())}
            try:
                for reply in self._stream(key, asked, remaining_s + 1.0):
                    if reply.final:
                        return reply
                    if on_progress is not None:
                        on_progress(reply.body())
                raise NoAnswerError(f"{key}: the answer broke off")
            except NoAnswerError:
                if deadline_s - monotonic_s() <= _RETRY_S:
                    raise
                pause.wait(_RETRY_S)

    def _stream(self, key: str, parameters: Mapping[str, object], timeout_s: float) -> Iterator[Reply]:
        return self._bus.call_stream(key, parameters, timeout_s=timeout_s)

    def _call(self, key: str, parameters: Mapping[str, object], timeout_s: float = 10.0) -> Reply:
        return self._bus.call(key, parameters, timeout_s=timeout_s)

    def _fetched(self, product_id: str, attachment: Mapping[str, Any]) -> Answer:
        """Pull a product in parts, each of which can be asked for again."""
        parts: list[bytes] = []
        have, size = 0, 1
        while have < size:
            reply = self._call(keys.dpm_product(keys.GROUND, product_id), {"offset": have, "len": _PART_BYTES}, 30.0)
            size = int(reply.attachment["size"])
            if not reply.payload and size:
                raise UnavailableError(f"product {product_id}: the DPM sent nothing at {have} of {size} bytes")
            parts.append(reply.payload)
            have += len(reply.payload)
        return _answer(Reply(b"".join(parts), reply.encoding, {**reply.attachment, **_of_request(attachment)}))


@dataclass(slots=True)
class _Lease:
    """The name that a standing request has now, and whether it is over."""

    over: threading.Event
    name: str = ""

    def renamed(self) -> str:
        """A new name: each query of a standing request has its own."""
        self.name = str(uuid.uuid4())
        return self.name


def _scope(robot: str) -> str:
    return keys.GROUND if robot == "any" else robot


def _named(robot: str) -> dict[str, object]:
    return {} if robot == "any" else {"robot": robot}


def _of_request(attachment: Mapping[str, Any]) -> dict[str, Any]:
    return {k: attachment[k] for k in ("asked", "delivered", "job", "request") if k in attachment}


def _text(value: object) -> object:
    """A parameter as the wire has it."""
    return str(value).lower() if isinstance(value, bool) else value


def _answer(reply: Reply) -> Answer:
    extra, value, type_name = reply.attachment, None, reply.encoding
    if reply.encoding.startswith(_CODEC_PREFIX):
        type_name, codec = parse_encoding(reply.encoding)
        value = decode(type_name, reply.payload, codec) if reply.payload else None
    try:
        header = Header.from_dict(extra)
    except InputError as error:
        raise CodecError(f"the answer's attachment is no header: {error}") from error
    return Answer(
        value,
        header,
        type_name,
        reply.payload,
        reply.encoding,
        str(extra.get("robot", "")),
        extra.get("delivered", {}),
        str(extra.get("job", "")),
        str(extra.get("request", "")),
        extra.get("asked", {}),
    )
