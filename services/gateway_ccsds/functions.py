# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Functions that commands perform: requests, transfers of stored products, cancellations of jobs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any

from pydantic import Field

from cdff_common.client import Client
from cdff_common.client.request_options import WIRE_NAMES
from cdff_common.contract.names import PRODUCT_ID
from cdff_common.contract.parameters import Number, Parameters
from cdff_common.contract.queries import JobParameters, RequestParameters
from cdff_common.errors import InputError
from services.gateway_ccsds.authentication import Command, Function
from services.gateway_ccsds.feed import Feed

#: Default and largest duration of a request, milliseconds.
_DEADLINE_MS, _MAX_DEADLINE_MS = 20_000, 600_000
#: Parameters of a request that concern the form of the replies, or later products.
_EXCLUDED = ("deliver", "explain", "every_s", "progress", "request", "t0", "t1")
_CLIENT_NAMES = {wire: name for name, wire in WIRE_NAMES.items()}


class RequestArguments(RequestParameters):
    """Arguments of ``REQUEST``."""

    deadline_ms: Annotated[Number, Field(ge=100, le=_MAX_DEADLINE_MS)] = _DEADLINE_MS


class SendArguments(Parameters):
    """Arguments of ``SEND``."""

    id: str = Field(pattern=rf"^{PRODUCT_ID}$")
    format: str | None = Field(None, pattern="^[a-z0-9]{2,8}$")


class Functions:
    """Execution of authenticated commands.

    Parameters
    ----------
    robot : str
    client : Client
    feed : Feed
        Adds products to the spool.
    """

    def __init__(self, robot: str, client: Client, feed: Feed) -> None:
        self._robot, self._client, self._feed = robot, client, feed

    def execute(self, command: Command, report: Callable[[str], None]) -> str:
        """Execute a command and return its result in words.

        Parameters
        ----------
        report : callable
            Called with the job of a request, in words, when it changes its state.

        Raises
        ------
        InputError
            If an argument is unknown, missing or invalid.
        CdffError
            If the orchestrator or the DPM refuses.
        OSError
            If the product cannot be written.
        """
        match command.function:
            case Function.REQUEST:
                return self._request(command.arguments, report)
            case Function.SEND:
                send = SendArguments.parse(command.arguments)
                self._feed.send(send.id, send.format)
                return f"product {send.id}"
            case Function.CANCEL:
                job = JobParameters.parse(self._with_robot(command.arguments)).job
                self._client.cancel(job, self._robot)
                return f"job {job}"

    def _request(self, arguments: Mapping[str, Any], report: Callable[[str], None]) -> str:
        if excluded := [name for name in _EXCLUDED if name in arguments]:
            raise InputError(f"parameter {excluded[0]!r}: not available in a command; omit it")
        asked = RequestArguments.parse(self._with_robot(arguments))
        given = asked.to_parameters().items()
        own = ("type", "robot", "deadline_ms")
        options: Any = {_CLIENT_NAMES.get(name, name): value for name, value in given if name not in own}
        last = ""

        def on_progress(body: Mapping[str, Any]) -> None:
            nonlocal last
            if (text := f"job {body['job']}: {body['state']}") != last:
                last = text
                report(text)

        answer = self._client.request(
            asked.type,
            robot=self._robot,
            deadline_s=asked.deadline_ms / 1000.0,
            on_progress=on_progress,
            **options,
        )
        names = {"dfpc": answer.header.producer, "delivered": dict(answer.delivered)}
        self._feed.add(answer, asked.type, names, options.get("format"))
        return f"product {answer.header.id}"

    def _with_robot(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments with the robot of this gateway; raises InputError for another one."""
        if arguments.get("robot", self._robot) != self._robot:
            raise InputError(f"robot={arguments['robot']!r}: this gateway executes commands of {self._robot}")
        return {**arguments, "robot": self._robot}
