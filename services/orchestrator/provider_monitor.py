# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Health of DFPCs from their liveliness and heartbeats: missing samples, FAILED outputs, resource usage."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_common.contract.wiring import Source, Wiring
from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.catalogue import ResourceUsage
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import ProviderId, SensorId

#: Time without a sample after which a sensor counts as silent, seconds; at least three sample periods.
SILENT_S = 4.0
#: Time without a process after which plans avoid a DFPC, seconds.
GONE_S = 3.0
#: Consecutive FAILED outputs after which plans avoid a DFPC.
MAX_FAILED_OUTPUTS = 5


@dataclass(slots=True)
class _Activation:
    """Observations of a provider since it became active.

    Attributes
    ----------
    since_s : float
        Time of the activation, monotonic seconds.
    samples : dict of str to (int, float)
        Port to its sample count and the time of the last increase, monotonic seconds.
    good_outputs : int
        Number of outputs that are not FAILED; -1 before the first heartbeat.
    failed_outputs : int
        Number of FAILED outputs.
    failed_at_last_good : int
        Value of ``failed_outputs`` when ``good_outputs`` last changed.
    last_failure : str
        Reasons of the last FAILED output.
    findings : tuple of str
        Findings about the sensors of its inputs.
    """

    since_s: float
    samples: dict[str, tuple[int, float]] = field(default_factory=dict)
    good_outputs: int = -1
    failed_outputs: int = 0
    failed_at_last_good: int = 0
    last_failure: str = ""
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _SensorPorts:
    """Ports of a provider connected to a sensor, with the wiring and description that they result from."""

    wired: Mapping[str, str]
    description: Mapping[str, Any]
    ports: dict[str, tuple[bool, SensorId]]


_NO_WIRING: Mapping[str, str] = {}


class ProviderMonitor:
    """Observations of all providers; not thread-safe.

    Parameters
    ----------
    profile : Profile
    observed : ObservedState
        Modes and wiring are read from it.
    descriptions : mapping of ProviderId to mapping
    """

    def __init__(
        self, profile: Profile, observed: ObservedState, descriptions: Mapping[ProviderId, Mapping[str, Any]]
    ) -> None:
        self._profile = profile
        self._observed = observed
        self._descriptions = descriptions
        self._activations: dict[ProviderId, _Activation] = {}
        self._gone_since_s: dict[ProviderId, float] = {}
        self._usage_at_s: dict[ProviderId, float] = {}
        self.usage: dict[ProviderId, ResourceUsage] = {}
        self._ports: dict[ProviderId, _SensorPorts] = {}

    def set_profile(self, profile: Profile) -> None:
        """Replace the profile, after robots have joined or changed."""
        self._profile = profile
        self._ports.clear()

    def set_alive(self, provider: ProviderId, alive: bool, now_s: float) -> None:
        """Record that the process of a provider appeared or disappeared."""
        if alive:
            self._gone_since_s.pop(provider, None)
        else:
            self._gone_since_s.setdefault(provider, now_s)
            self.usage.pop(provider, None)

    def set_active(self, provider: ProviderId, now_s: float) -> float:
        """Record that a provider is active; return for how long, seconds."""
        return now_s - self._activations.setdefault(provider, _Activation(now_s)).since_s

    def set_inactive(self, provider: ProviderId) -> None:
        """Clear the observations of an activation."""
        self._activations.pop(provider, None)

    def add_status(self, provider: ProviderId, status: Mapping[str, Any], now_s: float) -> bool:
        """Evaluate a heartbeat; return True if the provider's problem changed. Raises InputError."""
        previous_s = self._usage_at_s.get(provider, now_s)
        self.usage[provider] = ResourceUsage.of(status, self.usage.get(provider), now_s - previous_s)
        self._usage_at_s[provider] = now_s
        activation = self._activations.get(provider)
        if activation is None:
            return False
        before = (self._silence(provider, now_s), self._only_fails(provider))
        counts = status.get("samples_by_port", {})
        for port in self._sensor_ports(provider):
            count = int(counts.get(port, 0))
            if port not in activation.samples or activation.samples[port][0] != count:
                activation.samples[port] = (count, now_s)
        failed = int(status.get("failed", 0))
        good = int(status.get("outputs", 0)) - failed
        if good != activation.good_outputs:
            activation.good_outputs, activation.failed_at_last_good = good, failed
        activation.failed_outputs = failed
        activation.last_failure = str(status.get("last_failure", ""))
        findings = status.get("sensor_findings", ())
        activation.findings = tuple(
            str(f["what"]) for f in findings if isinstance(f, Mapping) and "what" in f
        )
        return before != (self._silence(provider, now_s), self._only_fails(provider))

    def problems(self, providers: Iterable[ProviderId], now_s: float) -> dict[ProviderId, str]:
        """Return the providers without input, without good output or without process, and the reason."""
        problems = {}
        for provider in providers:
            reason = self._silence(provider, now_s)
            if now_s - self._gone_since_s.get(provider, now_s) > GONE_S:
                reason = f"the process of {provider} is gone"
            elif not reason and self._only_fails(provider):
                reason = self._failure(provider)
            if reason:
                problems[provider] = reason
        return problems

    def _failure(self, provider: ProviderId) -> str:
        """Return why the last outputs of a provider failed."""
        activation = self._activations[provider]
        reasons = f" ({activation.last_failure})" if activation.last_failure else ""
        findings = "".join(f"; {finding}" for finding in activation.findings)
        return f"the last {MAX_FAILED_OUTPUTS} outputs of {provider} failed{reasons}{findings}"

    def _silence(self, provider: ProviderId, now_s: float) -> str:
        """Return why a provider lacks samples: a mandatory sensor or all its sensors are silent."""
        activation = self._activations.get(provider)
        if activation is None:
            return ""
        ports, samples = self._sensor_ports(provider), activation.samples
        silent = {
            port
            for port, (_, sensor) in ports.items()
            if port in samples
            and now_s - samples[port][1] > SILENT_S
            and now_s - samples[port][1] > self._silence_limit_s(sensor)
        }
        if silent and (silent == set(ports) or any(not ports[port][0] for port in silent)):
            sensors = ", ".join(sorted({str(ports[port][1]) for port in silent}))
            return f"no sample of {sensors} reaches {provider}"
        return ""

    def _sensor_ports(self, provider: ProviderId) -> dict[str, tuple[bool, SensorId]]:
        """Return the ports connected to a sensor: True if optional, and the sensor."""
        wired, description = self._observed.wired.get(provider, _NO_WIRING), self._descriptions[provider]
        known = self._ports.get(provider)
        if known is None or known.wired is not wired or known.description is not description:
            ports = self._parsed_ports(provider, wired, description)
            known = self._ports[provider] = _SensorPorts(wired, description, ports)
        return known.ports

    @staticmethod
    def _parsed_ports(
        provider: ProviderId, wired: Mapping[str, str], description: Mapping[str, Any]
    ) -> dict[str, tuple[bool, SensorId]]:
        ports = {}
        for port in description["inputs"]:
            name, wiring = str(port["port"]), str(port["source"])
            if name in wired or wiring:
                source = Source.parse(wired[name]) if name in wired else Wiring.parse(wiring).default
                if source.kind == "sensor":
                    ports[name] = (bool(port["optional"]), SensorId(provider.robot, source.owner))
        return ports

    def _silence_limit_s(self, sensor: SensorId) -> float:
        """Return the time without a sample after which a sensor counts as silent, seconds."""
        known = self._profile.robot(sensor.robot).sensors[sensor.sensor]
        mode = known.modes.get(self._observed.modes.get(sensor, known.initial_mode))
        return max(SILENT_S, 3.0 / mode.rate_hz) if mode is not None and mode.rate_hz else SILENT_S

    def _only_fails(self, provider: ProviderId) -> bool:
        """Return True if the last ``MAX_FAILED_OUTPUTS`` outputs of an active provider are FAILED."""
        activation = self._activations.get(provider)
        return (
            activation is not None
            and activation.failed_outputs - activation.failed_at_last_good >= MAX_FAILED_OUTPUTS
        )
