# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Client of a running system: requests, searches, products, poses, jobs."""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from types import TracebackType
from typing import Any, Self, Unpack

from cdff_common.bus import Bus, Reply, keys
from cdff_common.bus.message import pack
from cdff_common.client.answer import Answer
from cdff_common.client.live_world import retrieve_world
from cdff_common.client.request_options import RequestOptions, parameters_of
from cdff_common.client.stored_product import StoredProduct
from cdff_common.client.terrain_result import TerrainResult
from cdff_common.clock import from_datetime, monotonic_s
from cdff_common.codecs import CODECS, decode_payload, parse_encoding
from cdff_common.contract.queries import (
    TERRAIN_ANALYSES,
    ContactParameters,
    RequestParameters,
    SearchParameters,
    WithdrawalParameters,
)
from cdff_common.errors import (
    CdffError,
    CodecError,
    InputError,
    NoAnswerError,
    OverloadedError,
    ProductNotFoundError,
    UnavailableError,
)
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header
from cdff_common.world import World

logger = logging.getLogger(__name__)

#: Called with the body of each progress reply: job, state, reason, remaining_s, plan.
OnProgress = Callable[[Mapping[str, Any]], None]

_CODEC_PREFIX = "application/vnd.cdff+"
#: Size of the parts in which a payload is read, and pause before a request is repeated.
_PART_BYTES = 4 << 20
_RETRY_S = 0.3
#: Timeouts of a call and of the retrieval of a product, seconds.
_CALL_S, _RETRIEVE_S = 10.0, 30.0
#: Longest duration of one query of a standing request, after which it is repeated, seconds.
_STANDING_S = 3600.0


class Client:
    """Client of the orchestrator and the DPM; a context manager.

    Parameters
    ----------
    connect : str, optional
        Endpoint of the router; default ``CDFF_CONNECT``, then ``tcp/127.0.0.1:7447``.
    name : str
        Name of this process in logs.

    Raises
    ------
    UnavailableError
        If no router answers within 5 s.

    Notes
    -----
    Every method raises the subclass of ``CdffError`` of the code in the reply (``cdff_common.errors``).
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
        deadline_s: float = 20.0,
        on_progress: OnProgress | None = None,
        **options: Unpack[RequestOptions],
    ) -> Answer:
        """Request a product and wait for it, at most ``deadline_s`` seconds.

        Parameters
        ----------
        product : str
            ``pose trajectory pointcloud dem navigation_map image``.
        robot : str
            Robot id, or ``any``.

        Raises
        ------
        InputError
            If the request is malformed.
        DeadlineError, UnavailableError, OverloadedError
            If the request cannot be fulfilled; the message contains the reason.
        """
        key, deadline = _orchestrator_key(robot, "request"), monotonic_s() + deadline_s
        parameters = parameters_of(product, robot, **options)
        parameters["progress"] = "false" if on_progress is None else "true"
        reported: UnavailableError | None = None
        while True:
            remaining_s = max(deadline - monotonic_s(), 0.2)
            query = {**parameters, "deadline_ms": int(remaining_s * 1000), "request": str(uuid.uuid4())}
            try:
                for reply in self._bus.call_stream(key, query, timeout_s=remaining_s + 1.0):
                    if reply.final:
                        break
                    if on_progress is not None:
                        on_progress(reply.body())
            except UnavailableError as error:  # repeated with a new request id until the deadline
                retry_after_s = self._retry_after_s(error, robot)
                if retry_after_s is None or deadline - monotonic_s() <= retry_after_s:
                    raise
                if not isinstance(error, type(reported)):
                    logger.warning("request for %s: %s; it is repeated", product, error)
                reported = error
                time.sleep(retry_after_s)
            else:
                return self._retrieve(reply)

    def standing(
        self,
        product: str,
        *,
        robot: str = "any",
        every_s: float = 0.0,
        lease_s: float = 30.0,
        stop: threading.Event | None = None,
        **options: Unpack[RequestOptions],
    ) -> Generator[Answer]:
        """Yield the current product, then each newer one, until the iterator is closed.

        Parameters
        ----------
        product, robot, options
            As in ``request``.
        every_s : float
            Least time between two answers; 0 for every change.
        lease_s : float
            Time for which the request outlives this process; the lease is renewed while the iterator is open.
        stop : threading.Event, optional
            Ends the iteration when another thread sets it.

        Raises
        ------
        UnavailableError, OverloadedError
            If the orchestrator replies so, or is unreachable for ``lease_s``.
        """
        parameters = parameters_of(product, robot, **options)
        deadline = {"deadline_ms": int(lease_s * 1000)}
        stopped, name = stop or threading.Event(), ""

        def renew() -> None:
            while not stopped.wait(lease_s / 3):
                with suppress(CdffError):  # an ended request is repeated by the loop below
                    self._orchestrator(robot, "renew", {**deadline, "job": name}, lease_s / 3)
            with suppress(CdffError):  # the request may have ended already
                self._orchestrator(robot, "cancel", {"job": name}, lease_s / 3)

        key, answered_s = _orchestrator_key(robot, "request"), monotonic_s()
        reported: UnavailableError | None = None
        thread = threading.Thread(target=renew, name="renew", daemon=True)
        thread.start()
        try:
            while not stopped.is_set():
                name = str(uuid.uuid4())
                query = {**parameters, **deadline, "every_s": every_s, "request": name}
                try:
                    for reply in self._bus.call_stream(key, query, timeout_s=_STANDING_S):
                        answered_s, reported = monotonic_s(), None
                        if reply.attachment.get("kind") in ("product", "reference"):
                            yield self._retrieve(reply)
                except UnavailableError as error:
                    if stopped.is_set():  # the request was cancelled
                        break
                    if self._retry_after_s(error, robot) is None or monotonic_s() - answered_s > lease_s:
                        raise
                    if not isinstance(error, type(reported)):
                        logger.warning("standing request for %s: %s; it is repeated", product, error)
                    reported = error
                except CdffError:
                    if not stopped.is_set():  # otherwise the request was cancelled
                        raise
                stopped.wait(_RETRY_S)
        finally:
            stopped.set()
            thread.join()

    def schedule(
        self,
        product: str,
        t0: int | datetime,
        t1: int | datetime,
        *,
        robot: str = "any",
        every_s: float | None = None,
        **options: Unpack[RequestOptions],
    ) -> dict[str, Any]:
        """Request a product that is captured in a time window in the future; return at once.

        Parameters
        ----------
        product, robot, options
            As in ``request``.
        t0, t1 : int or datetime
            Window of the end of capture, mission time: nanoseconds, or with a time zone.
        every_s : float, optional
            Least time between two products; by default there is one.

        Returns
        -------
        dict
            ``request`` (its id, for ``scheduled`` and ``cancel``), ``plan`` or the reasons ``why_not`` there is
            none now.
        """
        query = parameters_of(product, robot, **options)
        window = {"t0": t0, "t1": t1, "every_s": every_s}
        checked = RequestParameters.parse(query | {k: v for k, v in window.items() if v is not None})
        return self._orchestrator(robot, "request", checked.to_parameters())

    def scheduled(self, robot: str = "any") -> list[dict[str, Any]]:
        """Return the scheduled requests with their states and the ids of their products."""
        scheduled: list[dict[str, Any]] = self.requests(robot, limit=1)["scheduled"]
        return scheduled

    def explain(
        self, product: str, *, robot: str = "any", deadline_s: float = 20.0, **options: Unpack[RequestOptions]
    ) -> dict[str, Any]:
        """Return the plan of a request without running it; arguments as in ``request``.

        Returns
        -------
        dict
            ``would`` (serve, make or refuse), ``stored`` (the product in the DPM, or None), ``plan`` with
            its parts and costs, ``alternatives``, and the reasons ``why_not_stored``, ``why_not``,
            ``refused``, ``possible``.
        """
        query = parameters_of(product, robot, **options)
        query |= {"explain": "true", "deadline_ms": int(deadline_s * 1000)}
        return self._orchestrator(robot, "request", query, deadline_s + 1.0)

    def search(self, /, product: str | None = None, **parameters: object) -> list[StoredProduct]:
        """Return metadata of products in the DPM, newest first; parameters of ``SearchParameters``.

        Times are nanoseconds, RFC 3339 texts or datetimes with a time zone.
        """
        all_parameters = {"type": product or (), **parameters}
        query = SearchParameters.parse(
            {k: v for k, v in all_parameters.items() if v is not None}
        ).to_parameters()
        return [StoredProduct.from_dict(item) for item in self._dpm("search", query)["items"]]

    def get(self, product_id: str, form: str | None = None) -> Answer:
        """Return a product by id, as stored or in a codec or file format; raises ProductNotFoundError."""
        return self._get(product_id, form, {})

    def terrain(self, analysis: str, **parameters: object) -> TerrainResult:
        """Return an analysis of the heights in the DPM.

        Parameters
        ----------
        analysis : str
            ``surface viewshed difference contours statistics``.
        parameters
            Those of ``TERRAIN_ANALYSES``: region, frame, resolution_m, …; rasters are retrieved as arrays
            unless ``format`` is ``tif``.
        """
        model = TERRAIN_ANALYSES.get(analysis)
        if model is None:
            raise InputError(f"analysis={analysis!r}: expected one of {', '.join(TERRAIN_ANALYSES)}")
        given_parameters = {name: value for name, value in parameters.items() if value is not None}
        if "format" in model.model_fields:
            given_parameters.setdefault("format", "npz")
        query = {"analysis": analysis, **model.parse(given_parameters).to_parameters()}
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "terrain"), query, timeout_s=_RETRIEVE_S)
        return TerrainResult(reply.payload, reply.encoding, reply.attachment)

    def withdraw(self, *product_ids: str, reason: str, **selection: object) -> dict[str, Any]:
        """Remove products, or with ``robot=`` (and ``t0 t1 dfpc type``) all maps of a robot, from all maps.

        Returns
        -------
        dict
            ``withdrawn`` and ``derived`` (ids), ``robots``, ``applied`` (False with ``dry_run=True``).
        """
        given_selection = {name: value for name, value in selection.items() if value is not None}
        parameters = WithdrawalParameters.parse(
            {"id": product_ids, "reason": reason, **given_selection}
        ).to_parameters()
        reply: dict[str, Any] = self._bus.call(
            keys.dpm_rpc(keys.GROUND, "withdraw"), parameters, timeout_s=_RETRIEVE_S
        ).body()
        return reply

    def contact(self, what: str = "status", *, robot: str | None = None, **parameters: object) -> Any:
        """Return the state of the exchange with robots over contact windows.

        Parameters
        ----------
        what : str
            ``status`` of all robots, ``plan`` (windows that have not ended), ``estimate`` of the arrival of
            the products of ``robot``, or ``requests`` that are kept for robots.
        robot : str, optional
        parameters
            Further fields of ``ContactParameters``: ``id`` of a request, ``limit``; ``first``, the id of a
            product of ``robot`` that is sent before all others.
        """
        fields = {"what": what, "robot": robot, **parameters}
        given_fields = {name: value for name, value in fields.items() if value is not None}
        return self._dpm("contact", ContactParameters.parse(given_fields).to_parameters())

    def request_after_contact(
        self, product: str, robot: str, *, expires_s: float | None = None, **options: Unpack[RequestOptions]
    ) -> dict[str, Any]:
        """Keep a request for a robot that is out of contact; return its ``id`` and ``state`` at once.

        ``contact("requests", id=…)`` returns the state and, when it is ``answered``, the id of the product.
        """
        fields = {"robot": robot} if expires_s is None else {"robot": robot, "expires_s": expires_s}
        parameters = ContactParameters.parse(fields).to_parameters()
        asked = {k: str(v) for k, v in parameters_of(product, robot, **options).items() if k != "robot"}
        key = keys.dpm_rpc(keys.GROUND, "contact")
        reply = self._bus.call(key, parameters, payload=pack({"parameters": asked}), timeout_s=_CALL_S)
        body: dict[str, Any] = reply.body()
        return body

    def pose(
        self,
        robot: str,
        *,
        parent: str = "site",
        child: str | None = None,
        t_ns: int | datetime | None = None,
    ) -> UncertainTransform:
        """Return ``T_parent_child`` from the DPM, interpolated at ``t_ns`` (mission time in nanoseconds, or a
        datetime), by default the newest; the default child is the base of the robot.
        """
        query: dict[str, object] = {"robot": robot, "parent": parent, "child": child or f"{robot}/base"}
        if t_ns is not None:
            query["t"] = from_datetime(t_ns) if isinstance(t_ns, datetime) else t_ns
        body = self._dpm("pose", query)
        return UncertainTransform(body["T"], body.get("covariance"))

    def world(self, t_ns: int | None = None, *, values: bool = True) -> World:
        """Return the frames of the DPM and the newest product of each producer at a mission time.

        Parameters
        ----------
        t_ns : int, optional
            Mission time; by default that of the newest pose.
        values : bool
            False retrieves only the metadata of the products.
        """
        return retrieve_world(self, self._dpm, t_ns, values=values)

    def call(
        self,
        robot: str,
        dfpc: str,
        operation: str,
        parameters: Mapping[str, object] | None = None,
        *,
        timeout_s: float = 10.0,
    ) -> tuple[Any, Mapping[str, Any]]:
        """Run an operation of a DFPC (``cdff dfpc show NAME`` lists them) with its parameters by name.

        Returns
        -------
        value : Any
            Plain data or a ``cdff_common.types`` object; None for an operation without a value.
        provenance : mapping
            Producer, configuration, time and frame.

        Raises
        ------
        CdffError
            If the DFPC refuses: InputError for a parameter, UnavailableError if it does not run,
            NotActiveError, …
        """
        query = {k: str(v).lower() if isinstance(v, bool) else v for k, v in (parameters or {}).items()}
        reply = self._bus.call(keys.dfpc_rpc(robot, dfpc, f"call/{operation}"), query, timeout_s=timeout_s)
        if not reply.encoding.startswith(_CODEC_PREFIX):
            return reply.body(), reply.attachment
        return decode_payload(reply.payload, reply.encoding), reply.attachment

    def jobs(self, robot: str = "any", *, limit: int = 50) -> list[dict[str, Any]]:
        """Return the newest jobs of the orchestrator with their states."""
        jobs: list[dict[str, Any]] = self.requests(robot, limit=limit)["jobs"]
        return jobs

    def requests(self, robot: str = "any", *, limit: int = 50) -> dict[str, Any]:
        """Return the newest ``jobs``, the ``scheduled`` requests, the ``leases`` of DFPCs, and the robots
        whose orchestrator did not answer (``unreachable``).
        """
        return self._orchestrator(robot, "jobs", {"limit": limit})

    def cancel(self, job: str, robot: str = "any") -> None:
        """Cancel a job by its id or the id of its request; the client of the job receives UNAVAILABLE."""
        self._orchestrator(robot, "cancel", {"job": job})

    def catalogue(self, robot: str = "any", product: str | None = None) -> dict[str, Any]:
        """Return the requestable products, or only ``product``, with their providers and costs, or the
        reasons why they cannot be requested.
        """
        return self._orchestrator(robot, "catalogue", {} if product is None else {"type": product})

    def history(
        self, *, kinds: Sequence[str] = (), robot: str = "any", since: int = 0, limit: int = 1000
    ) -> list[dict[str, Any]]:
        """Return the events after an ordinal, oldest first: insertions, audit entries, decisions."""
        query: dict[str, object] = {"since": since, "limit": limit}
        query |= {"kind": ",".join(kinds)} if kinds else {}
        query |= {} if robot == "any" else {"scope": robot}
        items: list[dict[str, Any]] = self._dpm("history", query)["items"]
        return items

    def _orchestrator(
        self, robot: str, verb: str, query: Mapping[str, object], timeout_s: float = _CALL_S
    ) -> dict[str, Any]:
        """Return the body of the reply of the orchestrator.

        Raises ProductNotFoundError for an unknown robot.
        """
        try:
            reply = self._bus.call(_orchestrator_key(robot, verb), query, timeout_s=timeout_s)
        except NoAnswerError:
            self._check_robot(robot)
            raise
        body: dict[str, Any] = reply.body()
        return body

    def _retry_after_s(self, error: UnavailableError, robot: str) -> float | None:
        """Return the pause before a request is repeated; None if it shall not be repeated.

        It is repeated while no orchestrator answers, and after the orderly stop of one. Raises
        ProductNotFoundError for an unknown robot.
        """
        if isinstance(error, NoAnswerError):
            self._check_robot(robot)
            return _RETRY_S
        return None if isinstance(error, OverloadedError) else error.retry_after_s

    def _check_robot(self, robot: str) -> None:
        """Raise ProductNotFoundError if an orchestrator runs, but none for this robot."""
        if robot == "any":
            return
        # orchestrator_ground: the ground's orchestrator, in the scope of a robot that should have its own.
        services = ("orchestrator", "orchestrator_ground")
        scopes = {key.split("/")[2] for s in services for key in self._bus.alive(keys.alive("*", s))}
        if keys.GROUND in scopes and robot not in scopes:
            robots = ", ".join(sorted(scopes - {keys.GROUND}))
            raise ProductNotFoundError(f"no robot {robot!r}: expected any or one of {robots}")

    def _dpm(self, verb: str, query: Mapping[str, object]) -> Any:
        """Return the body of the reply of the DPM."""
        return self._bus.call(keys.dpm_rpc(keys.GROUND, verb), query, timeout_s=_CALL_S).body()

    def _retrieve(self, final: Reply) -> Answer:
        """Return the product of a reply, retrieved from the DPM if it is a reference."""
        if final.attachment.get("kind") != "reference":
            return _answer(final)
        reference = final.body()
        form = None if reference["format"] in CODECS else reference["format"]
        return self._get(str(reference["id"]), form, final.attachment)

    def _get(self, product_id: str, form: str | None, request: Mapping[str, Any]) -> Answer:
        if form is None:
            return self._download(product_id, request)
        query = {"id": product_id, "format": form}
        reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), query, timeout_s=_RETRIEVE_S)
        return _answer(reply, request)

    def _download(self, product_id: str, request: Mapping[str, Any]) -> Answer:
        """Return a product, downloaded in parts."""
        key, data, size = keys.dpm_product(keys.GROUND, product_id), bytearray(), 1
        while len(data) < size:
            query = {"offset": len(data), "len": _PART_BYTES}
            reply = self._bus.call(key, query, timeout_s=_RETRIEVE_S)
            size = int(reply.attachment["size"])
            if not reply.payload and size:
                raise UnavailableError(
                    f"product {product_id}: the DPM sent nothing at {len(data)} of {size} bytes"
                )
            data += reply.payload
        return _answer(Reply(bytes(data), reply.encoding, reply.attachment), request)


def _orchestrator_key(robot: str, verb: str) -> str:
    return keys.orchestrator_rpc(keys.GROUND if robot == "any" else robot, verb)


def _answer(reply: Reply, request: Mapping[str, Any] | None = None) -> Answer:
    """Return the answer in a reply; ``request`` is the attachment with the properties of the request."""
    request_attachment = reply.attachment if request is None else request
    value, type_name = None, reply.encoding
    if reply.encoding.startswith(_CODEC_PREFIX):
        type_name, _ = parse_encoding(reply.encoding)
        value = decode_payload(reply.payload, reply.encoding) if reply.payload else None
    try:
        header = Header.from_dict(reply.attachment)
    except InputError as error:
        raise CodecError(f"the attachment of the answer is no header: {error}") from error
    return Answer(
        value=value,
        header=header,
        type_name=type_name,
        data=reply.payload,
        encoding=reply.encoding,
        robot=str(reply.attachment.get("robot", "")),
        delivered=request_attachment.get("delivered", {}),
        job=str(request_attachment.get("job", "")),
        request=str(request_attachment.get("request", "")),
        asked=request_attachment.get("asked", {}),
    )
