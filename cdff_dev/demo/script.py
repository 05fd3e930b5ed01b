# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The script of a demonstration: which profile, how fast, what is asked when."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel, validated
from cdff_common.interfaces.yaml_file import read_mapping


class Ask(StrictModel):
    """One request of OG2; all but ``at_s`` goes to the orchestrator as it stands (contract §5)."""

    at_s: Annotated[float, Field(ge=0)]
    type: str
    robot: str
    frame: str = "site"
    region: str | None = None
    resolution_m: Annotated[float, Field(gt=0)] | None = None
    max_age_s: Annotated[float, Field(gt=0)]
    min_coverage: Annotated[float, Field(ge=0, le=1)] | None = None
    as_: Annotated[str | None, Field(alias="as")] = None
    format: str | None = None
    deadline_ms: Annotated[int, Field(gt=0)]

    @property
    def parameters(self) -> dict[str, Any]:
        """Keyword arguments of ``Client.request``, the type aside."""
        fields = ("robot", "frame", "region", "resolution_m", "max_age_s", "min_coverage", "format")
        parameters = {name: getattr(self, name) for name in fields if getattr(self, name) is not None}
        if self.as_ is not None:
            parameters["as_type"] = self.as_
        return {**parameters, "deadline_s": self.deadline_ms / 1000}

    @property
    def title(self) -> str:
        """One line for a person."""
        parts = [f"{self.type} of {self.robot} in {self.frame}"]
        if self.region:
            parts.append(self.region)
        if self.resolution_m:
            parts.append(f"{self.resolution_m:g} m")
        if self.as_ or self.format:
            parts.append(f"as {self.as_ or self.format}")
        return ", ".join(parts)


class Sharing(StrictModel):
    """What is judged of a map that two robots share, against the log's truth, when the requests are answered.

    ``within_m`` says which places of the two belong to the overlap, ``at_most_m`` how far off one may be as seen from
    the other; ``region`` and ``resolution_m`` are of the elevation map of both.
    """

    robots: tuple[str, str]
    within_m: Annotated[float, Field(gt=0)]
    at_most_m: Annotated[float, Field(gt=0)]
    region: str
    resolution_m: Annotated[float, Field(gt=0)]
    wait_s: Annotated[float, Field(gt=0)] = 60.0


class Script(StrictModel):
    """Contents of ``deploy/demo/*.yaml``; ``rate`` is mission seconds per second."""

    profile: str
    rate: Annotated[float, Field(gt=0, le=100)] = 1.0
    requests: Annotated[tuple[Ask, ...], Field(min_length=1)]
    sharing: Sharing | None = None


def load_script(path: Path) -> Script:
    """Read a script; raises ConfigurationError naming file and key."""
    return validated(Script, read_mapping(path), str(path))
