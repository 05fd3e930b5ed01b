# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conditions on products, at which a replay stops: ``pose.status==FAILED``."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.interfaces.product import Product, Status

_CONDITION = re.compile(r"(\w+)\.(\w+)(?:\.(\w+))?\s*(==|!=|<=|>=|<|>|~)\s*(\S.*)")
_OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_FORMS = (
    "PORT.status==OK|DEGRADED|FAILED, PORT.reasons~TEXT, PORT.metrics.NAME<NUMBER, PORT.sigma_m>NUMBER, "
    "PORT.sigma_deg>NUMBER or PORT.seq==NUMBER"
)


@dataclass(frozen=True, slots=True)
class Condition:
    """Condition on a product of a port.

    Attributes
    ----------
    text : str
    port : str
    field, metric : str
        Field of the product, and the metric of ``metrics``.
    comparison : str
        ``== != < <= > >=``, or ``~`` for contained text.
    value : float or str
        A number, or the text of status and reasons.
    """

    text: str
    port: str
    field: str
    metric: str
    comparison: str
    value: float | str

    def holds(self, product: Product) -> bool:
        """Return whether a product fulfils the condition; a number that does not exist fulfils none."""
        if product.port != self.port:
            return False
        quality = product.header.quality
        if self.field == "reasons":
            return any(str(self.value) in reason for reason in quality.reasons)
        product_value: Any = quality.status.name if self.field == "status" else self._number(product)
        return product_value is not None and _OPERATORS[self.comparison](product_value, self.value)

    def _number(self, product: Product) -> float | None:
        """Return the value of the field of a product that is compared; None if the product lacks it."""
        if self.field == "metrics":
            number = product.header.quality.metrics.get(self.metric)
            return None if number is None else float(number)
        if self.field == "seq":
            return float(product.header.seq)
        transform = getattr(product.value, "transform", None)
        if transform is None or transform.covariance is None:
            return None
        variances = np.diag(transform.covariance)
        part = variances[:3] if self.field == "sigma_m" else np.degrees(np.degrees(variances[3:]))
        return math.sqrt(float(part.max()))


def parse_condition(text: str, ports: tuple[str, ...]) -> Condition:
    """Return a condition.

    Raises
    ------
    InputError
        If it has another form, or the port is not one of ``ports``.
    """
    match = _CONDITION.fullmatch(text.strip())
    if match is None:
        raise InputError(f"--until {text!r}: expected {_FORMS}")
    port, field, metric, comparison, value = match.groups()
    if port not in ports:
        raise InputError(f"--until {text!r}: no port {port!r}; expected one of {', '.join(ports)}")
    is_valid = (
        (field == "status" and not metric and comparison in ("==", "!=") and value in Status.__members__)
        or (field == "reasons" and not metric and comparison == "~")
        or (_is_number(value) and comparison != "~" and _is_numeric_field(field, metric))
    )
    if not is_valid:
        raise InputError(f"--until {text!r}: expected {_FORMS}")
    is_text = field in ("status", "reasons")
    return Condition(text, port, field, metric or "", comparison, value if is_text else float(value))


def _is_numeric_field(field: str, metric: str | None) -> bool:
    return (field == "metrics") == bool(metric) and field in ("metrics", "sigma_m", "sigma_deg", "seq")


def _is_number(text: str) -> bool:
    """Return whether a text is a finite number."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
