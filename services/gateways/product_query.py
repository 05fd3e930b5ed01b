# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Request of a robot for any listed product: the parameters that it may state, and the answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.bus.message import parse_parameters
from cdff_common.client import Answer, Client
from cdff_common.client.request_options import WIRE_NAMES, RequestOptions
from cdff_common.errors import DeniedError, InputError

OnProgress = Callable[[Mapping[str, Any]], None]
#: Keyword arguments of the client for the parameters of a query that a robot may state. Encoding and delivery
#: are those of the gateway.
_ARGUMENTS = {
    WIRE_NAMES.get(name, name): name
    for name in RequestOptions.__annotations__
    if name not in ("format", "deliver")
}


@dataclass(frozen=True, slots=True)
class ProductQuery:
    """Rules for requests of a robot.

    Attributes
    ----------
    products : tuple of str
        Types of products.
    max_deadline_s : float
        Longest time of a request.
    robot : str
        Robot whose products are requested.
    """

    products: tuple[str, ...]
    max_deadline_s: float
    robot: str

    def answer(
        self, query: str, deadline_s: float, client: Client, on_progress: OnProgress | None = None
    ) -> Answer:
        """Return the product of a query such as ``type=dem;region=circle:0,0,10``.

        Parameters
        ----------
        deadline_s : float
            Time of this request; 0 for the longest.

        Raises
        ------
        DeniedError
            If the product is not listed.
        InputError
            If the query or the deadline is not allowed.
        CdffError
            As ``Client.request``.
        """
        options: dict[str, Any] = dict(parse_parameters(query))
        product = options.pop("type", "")
        if product not in self.products:
            raise DeniedError(f"type={product[:80]!r}: expected one of {', '.join(self.products)}")
        refused = [name for name in options if name not in _ARGUMENTS]
        if refused:
            raise InputError(f"{refused[0][:80]}: expected type and some of {', '.join(sorted(_ARGUMENTS))}")
        limit_s = self.max_deadline_s
        if not 0.0 <= deadline_s <= limit_s:
            raise InputError(f"deadline_s={deadline_s:g}: expected at most {limit_s:g}, or 0 for that")
        arguments: dict[str, Any] = {_ARGUMENTS[name]: value for name, value in options.items()}
        return client.request(
            product,
            robot=self.robot,
            deadline_s=deadline_s or limit_s,
            on_progress=on_progress,
            **arguments,
        )
