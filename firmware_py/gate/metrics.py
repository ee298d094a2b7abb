"""The device's state as Prometheus text."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily, UnknownMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from firmware_py.gate.features import SignalFeatures
from firmware_py.gate.instances import ShownSignal
from firmware_py.gate.view import DeviceState

_GUARD: Final = (
    ("speed_rad_s", "Shaft speed"),
    ("mode", "0 monitor, 1 manual, 2 auto"),
    ("arm_state", "0 boot, 1 check, 2 disarmed, 3 armed, 4 recovery, 5 tripped"),
    ("authority", "1 while the model may act"),
    ("trip_request", "1 while the drive is asked to coast down"),
)
_ENVELOPE: Final = (
    ("clearance_actual_um", "Radial clearance that the node reports"),
    ("target_clearance_um", "Radial clearance that the guard asks for"),
    ("clearance_low_um", "Lower end of the admissible radial clearances"),
    ("clearance_high_um", "Upper end of the admissible radial clearances"),
    ("target_pressure_bar", "Supply pressure that the guard asks for"),
)
"""Of a machine that is not monitor only."""


def render(
    state: DeviceState, features: SignalFeatures | None, readings: Iterable[ShownSignal] = ()
) -> bytes:
    """Prometheus exposition text of ``state``, ``features`` and slow ``readings``."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(
        _Once([*_gauges(state), *_channels(features), *_readings(readings), *_counts(state)])
    )
    return generate_latest(registry)


class _Once(Collector):
    """A fixed set of metrics."""

    def __init__(self, metrics: list[Metric]) -> None:
        self._metrics = metrics

    def collect(self) -> Iterable[Metric]:
        return self._metrics


def _gauges(state: DeviceState) -> list[Metric]:
    up = GaugeMetricFamily(
        "orbitd_room_up", "1 while the room's heartbeat is fresh", labels=["room"]
    )
    for process, alive in state.rooms.items():
        up.add_metric([process], alive)
    alarm = GaugeMetricFamily("orbitd_alarm", "Active alarms with their severity", labels=["name"])
    for active in state.alarms:
        alarm.add_metric([active.name], active.severity)
    metrics: list[Metric] = [up, alarm]
    if state.guard:
        told = _GUARD if state.guard.monitor_only else _GUARD + _ENVELOPE
        metrics += [_gauge(name, text, float(getattr(state.guard, name))) for name, text in told]
        spread = GaugeMetricFamily("orbitd_peak_to_peak_um", "Shaft vibration", labels=["probe"])
        for probe, value in zip("xy", state.guard.peak_to_peak_um, strict=True):
            spread.add_metric([probe], value)
        for bearing, values in state.guard.other_peak_to_peak_um.items():
            for probe, value in zip("xy", values, strict=True):
                spread.add_metric([f"{bearing}_{probe}"], value)
        metrics.append(spread)
    if state.reading and not (state.guard and state.guard.monitor_only):
        metrics.append(
            _gauge("shaft_power_W", "Measured shaft power", state.reading.status.shaft_power_W)
        )
        metrics.append(
            _gauge(
                "oil_outlet_C", "Measured oil outlet temperature", state.reading.status.oil_outlet_C
            )
        )
    return metrics


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(f"orbitd_{name}", text, value=value)


def _channels(features: SignalFeatures | None) -> list[Metric]:
    rms = GaugeMetricFamily(
        "orbitd_channel_rms",
        "Root mean square about the mean, SI unit of the channel",
        labels=["channel"],
    )
    ok = GaugeMetricFamily("orbitd_channel_ok", "1 while the channel is OK", labels=["channel"])
    for name, channel in features.channel.items() if features else ():
        rms.add_metric([name], channel.rms)
        ok.add_metric([name], channel.ok)
    return [rms, ok]


def _readings(readings: Iterable[ShownSignal]) -> list[Metric]:
    """A metric per kind of slow reading, labelled with its name."""
    ok = GaugeMetricFamily("orbitd_reading_ok", "1 while the reading is OK", labels=["reading"])
    by_kind: dict[str, GaugeMetricFamily] = {}
    for row in readings:
        ok.add_metric([row.name], row.ok)
        name = f"orbitd_reading_{row.kind}_{row.suffix}"
        if name not in by_kind:
            text = f"Slow readings of kind {row.kind}, {row.unit}"
            by_kind[name] = GaugeMetricFamily(name, text, labels=["reading"])
        if row.value is not None:
            by_kind[name].add_metric([row.name], row.value)
    return [ok, *by_kind.values()]


def _counts(state: DeviceState) -> list[Metric]:
    counts = UnknownMetricFamily(
        "orbitd_count", "Everything the device counts, by room", labels=["room", "name"]
    )
    by_process = {
        "gate": state.counters,
        "guard": state.guard.counters if state.guard else {},
        "brain": state.brain.counters if state.brain else {},
    }
    for process, counters in by_process.items():
        for name, value in sorted(counters.items()):
            counts.add_metric([process, name], value)
    return [counts]
