# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The interface of a Data Fusion Node: ``configure()``, then ``process()``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Generic, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from cdff_common.errors import ConfigurationError


class StrictModel(BaseModel):
    """Base of every configuration: frozen; unknown keys, NaN and infinity are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class DfnConfig(StrictModel):
    """Parameters of a DFN implementation; each field has bounds, and its unit in its name or description."""


ConfigT = TypeVar("ConfigT", bound=DfnConfig)
InputsT = TypeVar("InputsT")
OutputsT = TypeVar("OutputsT")


class Dfn(ABC, Generic[ConfigT, InputsT, OutputsT]):
    """An atomic processing unit with one data fusion function.

    A DFN holds no clock, file, socket or global state. ``process`` depends on its inputs, its configuration
    and the state of earlier calls only; inputs are not modified. It raises InputError,
    RefusedError or DegenerateGeometryError; the DFPC decides on the reaction.
    """

    #: Configuration model of this implementation: the type argument of its base class.
    Config: ClassVar[type[DfnConfig]] = DfnConfig

    config: ConfigT
    #: Restrictions of the outputs of the last call, as short codes; empty if there are none.
    reasons: tuple[str, ...] = ()
    #: Quality metrics of the outputs of the last call, units in the names.
    metrics: Mapping[str, float] = MappingProxyType({})

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        for base in cls.__dict__.get("__orig_bases__", ()):
            for argument in get_args(base):
                if isinstance(argument, type) and issubclass(argument, DfnConfig):
                    cls.Config = argument

    def configure(self, config: ConfigT | dict[str, Any] | None = None) -> None:
        """Validate and store the configuration, allocate, compile.

        Raises
        ------
        ConfigurationError
            If a key is unknown or a value out of bounds; the message names it.
        """
        self.config = validated(self.Config, config, type(self).__name__)  # type: ignore[assignment]
        self.setup()

    def setup(self) -> None:
        """Allocate and warm up; called by ``configure`` with ``self.config`` set."""

    @abstractmethod
    def process(self, inputs: InputsT) -> OutputsT:
        """Compute the outputs of one call."""


ModelT = TypeVar("ModelT", bound=BaseModel)


def validated(model: type[ModelT], config: Any, owner: str) -> ModelT:
    """Return ``config`` as an instance of ``model``; raises ConfigurationError."""
    if config is None:
        config = {}
    if isinstance(config, model):
        return config
    if isinstance(config, BaseModel):
        raise ConfigurationError(f"{owner}: got a {type(config).__name__}, expected {model.__name__}")
    try:
        return model.model_validate(config)
    except ValidationError as error:
        faults = "; ".join(
            f"{'.'.join(str(p) for p in e['loc']) or 'value'}={_short(e.get('input'))}: {e['msg']}"
            for e in error.errors()
        )
        known = ", ".join(model.model_fields)
        raise ConfigurationError(f"{owner}: {faults}. Known keys: {known or 'none'}") from error


def _short(value: Any) -> str:
    """Return at most 80 characters of the text of a value."""
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
