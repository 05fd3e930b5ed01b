# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Answer of a DFPC to a wrong input: refused, flagged, or accepted with an error in standard deviations."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from cdff_common.errors import CdffError
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.product import Product, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import TransformWithCovariance
from cdff_core.runtime.runner import Counters, Runner

#: Largest error of an output that is neither refused nor flagged, in stated standard deviations.
LIMIT_SIGMAS = 3.0
#: Exceptions that a DFPC must not raise.
_CRASHES = (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError, cv2.error)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One wrong input of a DFPC.

    Attributes
    ----------
    dfpc, data, fault : str
        Names of the DFPC, of the data set, and of the fault.
    port : str
        Output port whose last product is the answer.
    samples : callable
        Returns the samples; a message that cannot be made raises a ``CdffError``.
    error_sigmas : callable
        Returns the error of the value of the output in stated standard deviations.
    """

    dfpc: str
    data: str
    fault: str
    port: str
    samples: Callable[[], Sequence[Sample]]
    error_sigmas: Callable[[Any], float]
    context: DfpcContext = field(default_factory=lambda: DfpcContext(robot="robot"))
    implementation: str | None = None


def answer(case: Case, usual: Collection[str] = ()) -> dict[str, Any]:
    """Return status, reason and error of the answer to a case, and whether it is acceptable.

    The samples pass the runner, as in a service: typed errors are counted, late samples are dropped. Any
    other exception is a fault of the DFPC and not acceptable. DEGRADED for ``usual`` reasons alone, which
    the DFPC also states without the fault, does not count as flagged.
    """
    try:
        return _answer(case, usual)
    except CdffError as error:
        return _row("refused", f"{type(error).__name__}: {error}")
    except _CRASHES as error:
        return _row("crashed", f"{type(error).__name__}: {error}", is_acceptable=False)


def _answer(case: Case, usual: Collection[str]) -> dict[str, Any]:
    products, counters = replay(case.dfpc, case.samples(), case.context, case.implementation)
    answers = [product for product in products if product.port == case.port]
    refusals = [f"{counters.last_error}"] if counters.errors else []
    refusals += [f"{counters.late} late samples dropped"] if counters.late else []
    if not answers:
        failures = [p for p in products if p.header.quality.status is Status.FAILED]
        if failures:
            return _row("FAILED", ", ".join(failures[-1].header.quality.reasons))
        return _row("refused" if refusals else "silent", ", ".join(refusals), is_acceptable=bool(refusals))
    last = answers[-1]
    quality = last.header.quality
    reason = ", ".join(quality.reasons or refusals)
    if last.value is None:
        return _row("FAILED", reason, is_acceptable=bool(reason))
    error = float(case.error_sigmas(last.value))
    is_flagged = quality.status is not Status.OK and not {code(r) for r in quality.reasons} <= set(usual)
    return _row(str(quality.status), reason, error, is_flagged or error <= LIMIT_SIGMAS)


def code(reason: str) -> str:
    """Return the code of a reason, without its values."""
    return reason.split(":")[0]


def replay(
    dfpc_name: str, samples: Sequence[Sample], context: DfpcContext, implementation: str | None = None
) -> tuple[list[Product], Counters]:
    """Return the products of a DFPC and its counters."""
    dfpc = Registry.default().make_dfpc(dfpc_name)
    dfpc.configure(None, context, implementation)
    runner, products = Runner(dfpc), []
    for sample in samples:
        runner.push(sample)
        products += list(runner.drain())
    return [*products, *runner.finish()], runner.counters


def last_value(
    dfpc_name: str,
    samples: Sequence[Sample],
    context: DfpcContext,
    port: str,
    implementation: str | None = None,
) -> Any:
    """Return the last value of an output port."""
    products, _ = replay(dfpc_name, samples, context, implementation)
    return [p.value for p in products if p.port == port and p.value is not None][-1]


def _row(
    status: str, reason: str, error_sigmas: float | None = None, is_acceptable: bool = True
) -> dict[str, Any]:
    """Return the entry of the record; an error that is not finite is stated as None."""
    is_known = error_sigmas is not None and np.isfinite(error_sigmas)
    return {
        "status": status,
        "reason": " ".join(reason.split())[:160],
        "error_sigmas": round(float(error_sigmas), 2) if error_sigmas is not None and is_known else None,
        "acceptable": is_acceptable,
    }


def pose_error_sigmas(T_true: FloatArray) -> Callable[[TransformWithCovariance], float]:
    """Return a function for the largest error of a pose over its six axes, in standard deviations."""

    def largest(value: TransformWithCovariance) -> float:
        T = value.transform
        if T.covariance is None:
            return float("inf")
        sigmas = np.sqrt(np.maximum(np.diag(T.covariance), 1e-24))
        return float(np.abs(pose_error(T_true, T.matrix) / sigmas).max())

    return largest


def field_error_sigmas(error: FloatArray, sigma: FloatArray) -> float:
    """Return the 90 % quantile of errors in standard deviations; NaN for fewer than 20 of them."""
    ratio = np.abs(error / np.maximum(sigma, 1e-12))
    ratio = ratio[np.isfinite(ratio)]
    return float(np.quantile(ratio, 0.9)) if len(ratio) >= 20 else float("nan")
