"""The failsafe table: one line per condition, the worst action wins."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.machine.parts import ACTUATOR, has
from firmware_py.records import NodeFigures, NodeInfo
from firmware_py.wire.layout import WireLayout

CLEARANCE_STEP_UM: Final = 0.02
PRESSURE_STEP_BAR: Final = 0.002
"""Two steps of the wire: closer figures are equal."""

HEARTBEAT_LIMIT_MS: Final = (500, 5000)
"""Range of a node's heartbeat limit (``deploy/NODE.md``, 7)."""


class Action(enum.IntEnum):
    """What a condition asks for, from least to worst."""

    NOTHING = 0
    TAKE_AUTHORITY = 1
    RECOVER = 2
    DISARM = 3
    TRIP = 4


class Situation(msgspec.Struct):
    """The facts of one cycle on which failsafes, arming and authority judge."""

    now_ns: int
    link_up: bool
    samples_fresh: bool
    clock_settled: bool
    node_heard: bool
    node_reasons: list[str]
    foreign_command: bool
    foreign_heartbeat: bool
    cycle_gap: bool
    mark_lost: bool
    displacement_ok: bool
    vibration_high: bool
    speed_declared: bool
    interval_m: tuple[float, float] | None
    tripped: list[str]
    brain_connected: bool
    doubts: dict[str, str] = {}
    """Alarms of the slow readings, the oil and the link that hold now, with what a person is told
    of them."""
    pair_ok: bool = True
    speed_rpm: float = 0.0
    speeds_rpm: tuple[float, float] = (0.0, 0.0)
    vibration_um: float = 0.0
    vibration_limit_um: float = 0.0
    passed: dict[str, str] = {}
    """Alarms of protection that take authority now, each in words."""
    bypassed: dict[str, str] = {}
    """Every bypass, in words."""
    retreats: dict[str, str] = {}
    """Alarms of protection that ask for a retreat now, each in words."""
    monitor_only: str = ""
    models: str = ""
    """Sets of models that the newest advice rests on."""
    """Why nothing may be commanded here, ever; empty where it may."""

    @property
    def passed_said(self) -> str:
        """What takes authority, in words."""
        return "; ".join(self.passed.values())

    @property
    def bypassed_said(self) -> str:
        """What is bypassed, in words."""
        return "; ".join(self.bypassed.values())

    @property
    def retreats_said(self) -> str:
        """What asks for a retreat, in words."""
        return "; ".join(self.retreats.values())

    @property
    def speed_said(self) -> str:
        """The speed as a cause why no clearance is admissible, with the next step."""
        if self.mark_lost:
            return "the speed is unknown; check the once-per-turn mark"
        if not self.speed_rpm:
            return "the shaft stands (0 rpm); start the machine"
        return f"at {self.speed_rpm:.0f} rpm and this load, oil and vibration; change speed or load"


class Failsafe(msgspec.Struct, frozen=True):
    """One condition: when it holds, what it does, whether it bars arming, and what a person
    reads."""

    name: str
    holds: Callable[[Situation], bool]
    action: Action
    bars_arming: bool
    text: str
    alarms: tuple[str, ...] = ()
    """It holds while one of these of :attr:`Situation.doubts` does, whose texts follow its own."""
    alarmed: bool = False
    """Its name is that of an alarm, whose text says it all: no further event, no text of its
    own."""
    watches: bool = False
    """It is of what is watched, not of what is commanded: it holds on a machine that is monitor
    only as well."""

    def reason(self, situation: Situation) -> str:
        """What a person reads now."""
        if self.alarmed:
            return "; ".join(
                situation.doubts[name] for name in self.alarms if name in situation.doubts
            )
        text = self.text.format(s=situation)
        return ": ".join(
            [text, *(situation.doubts[name] for name in self.alarms if name in situation.doubts)]
        )


def _doubt(name: str, alarms: tuple[str, ...], text: str, *, bars_arming: bool = True) -> Failsafe:
    """A row for alarms of slow readings or of the oil: authority goes while one holds."""
    names = frozenset(alarms)
    return Failsafe(
        name,
        lambda s: not names.isdisjoint(s.doubts),
        Action.TAKE_AUTHORITY,
        bars_arming,
        text,
        alarms,
    )


def _supervised(
    name: str, action: Action, *, bars_arming: bool = True, watches: bool = False
) -> Failsafe:
    """A row for an alarm of the supervision, or of the target's way."""
    return Failsafe(
        name, lambda s: name in s.doubts, action, bars_arming, "", (name,), True, watches
    )


FAILSAFES: Final = (
    Failsafe(
        "tripped",
        lambda s: bool(s.tripped),
        Action.TRIP,
        True,
        "a danger alarm is latched; remove the cause, then `reset`",
        watches=True,
    ),
    Failsafe(
        "monitor_only",
        lambda s: bool(s.monitor_only),
        Action.TAKE_AUTHORITY,
        True,
        "monitor only: {s.monitor_only}",
        watches=True,
    ),
    Failsafe(
        "node_mismatch",
        lambda s: s.node_heard and bool(s.node_reasons),
        Action.DISARM,
        True,
        "the node is not the configured one",
        watches=True,
    ),
    Failsafe(
        "foreign_command",
        lambda s: s.foreign_command,
        Action.DISARM,
        True,
        "another device sends commands on this bus; disconnect it",
    ),
    _supervised("node_elsewhere", Action.DISARM),
    _supervised("two_senders", Action.RECOVER, watches=True),
    _supervised("node_state_frozen", Action.RECOVER),
    Failsafe(
        "link_down",
        lambda s: not s.link_up,
        Action.RECOVER,
        True,
        "the link to the node is down; check adapter, hub or port",
        ("link_fault",),
        watches=True,
    ),
    Failsafe(
        "samples_stale",
        lambda s: not s.samples_fresh,
        Action.RECOVER,
        True,
        "no fresh samples; check that the node is running",
        ("link_fault",),
        watches=True,
    ),
    Failsafe(
        "clock_unsettled",
        lambda s: s.link_up and not s.clock_settled,
        Action.RECOVER,
        True,
        "the node's clock is not settled yet; wait a second",
        watches=True,
    ),
    Failsafe(
        "node_silent",
        lambda s: not s.node_heard,
        Action.RECOVER,
        True,
        "the node gives no account of itself (NODE_STATE, NODE_INFO)",
        ("link_fault",),
    ),
    Failsafe(
        "cycle_gap",
        lambda s: s.cycle_gap,
        Action.RECOVER,
        False,
        "guard, host or node stood still for longer than the time to live; look at the load of the "
        "host, or "
        "whether it was suspended",
    ),
    _supervised("frames_lost", Action.TAKE_AUTHORITY, bars_arming=False),
    _supervised("node_not_expired", Action.TAKE_AUTHORITY),
    _supervised("node_not_following", Action.TAKE_AUTHORITY, bars_arming=False),
    _supervised("node_target_differs", Action.TAKE_AUTHORITY),
    _supervised("node_counter_frozen", Action.TAKE_AUTHORITY, bars_arming=False),
    _supervised("node_refuses", Action.TAKE_AUTHORITY, bars_arming=False),
    _supervised("clearance_not_following", Action.TAKE_AUTHORITY),
    _supervised("target_reverses", Action.TAKE_AUTHORITY, bars_arming=False),
    _supervised("pressure_not_following", Action.TAKE_AUTHORITY),
    Failsafe(
        "foreign_heartbeat",
        lambda s: s.foreign_heartbeat,
        Action.TAKE_AUTHORITY,
        True,
        "another device sends heartbeats on this bus; disconnect it",
        watches=True,
    ),
    Failsafe(
        "mark_lost",
        lambda s: s.mark_lost,
        Action.TAKE_AUTHORITY,
        False,
        "the once-per-turn mark is lost or implausible; the speed is unknown",
        watches=True,
    ),
    Failsafe(
        "displacement_not_ok",
        lambda s: not s.displacement_ok,
        Action.TAKE_AUTHORITY,
        False,
        "a shaft displacement channel is not OK or saturated; check sensor and cable",
    ),
    Failsafe(
        "pair_implausible",
        lambda s: not s.pair_ok,
        Action.TAKE_AUTHORITY,
        False,
        "the shaft displacements contradict the machine; check wiring, order, sign, gain and zero "
        "of both probes",
    ),
    Failsafe(
        "vibration_high",
        lambda s: s.vibration_high,
        Action.TAKE_AUTHORITY,
        False,
        "the shaft vibration, {s.vibration_um:.4g} um peak-to-peak, is above the danger set point "
        "of this "
        "clearance, {s.vibration_limit_um:.4g}; reduce speed or load and look at the diagnosis",
    ),
    Failsafe(
        "bypassed",
        lambda s: bool(s.bypassed),
        Action.RECOVER,
        True,
        "{s.bypassed_said}; end the bypass",
    ),
    Failsafe(
        "protection_retreat",
        lambda s: bool(s.retreats),
        Action.RECOVER,
        True,
        "{s.retreats_said}; remove the cause",
    ),
    Failsafe(
        "protection_authority",
        lambda s: bool(s.passed),
        Action.TAKE_AUTHORITY,
        True,
        "{s.passed_said}; remove the cause",
    ),
    Failsafe(
        "speed_undeclared",
        lambda s: not s.speed_declared,
        Action.TAKE_AUTHORITY,
        False,
        "the speed, {s.speed_rpm:.0f} rpm, is outside operating.speed_min_rpm .. speed_max_rpm "
        "({s.speeds_rpm[0]:g} .. {s.speeds_rpm[1]:g}); change the speed",
    ),
    _doubt(
        "oil_pressure_low",
        ("oil_pressure_low_alert", "oil_pressure_low_danger"),
        "the oil's supply pressure is too low",
    ),
    _doubt(
        "oil_outlet_high", ("oil_outlet_high_alert", "oil_outlet_high_danger"), "the oil is too hot"
    ),
    _doubt(
        "oil_undeclared",
        ("oil_outlet_low_alert",),
        "the oil is colder than declared",
        bars_arming=False,
    ),
    _doubt(
        "readings_lost",
        ("readings_stale",),
        "the slow readings are old; the worst declared oil and load count",
    ),
    _doubt(
        "oil_temperature_lost",
        ("oil_outlet_not_ok",),
        "the oil's temperature is not known; the worst of oil.inlet_min_C .. film_max_C counts",
    ),
    _doubt(
        "clearance_lost",
        ("clearance_actual_not_ok",),
        "the clearance is not known; the worst of the bearing's range and of the declared load "
        "counts",
    ),
    _doubt(
        "oil_pressure_lost",
        ("pressure_actual_not_ok", "pressure_mismatch", "pressure_unknown"),
        "the supply pressure is not known; the worst declared load counts",
    ),
    _doubt(
        "shaft_power_lost",
        ("shaft_power_not_ok",),
        "the shaft power is not known; nothing is learnt of the oil",
        bars_arming=False,
    ),
    Failsafe(
        "no_admissible_clearance",
        lambda s: s.interval_m is None,
        Action.TAKE_AUTHORITY,
        False,
        "no clearance but the safe one can be defended: {s.speed_said}",
    ),
)


MONITORED: Final = tuple(failsafe for failsafe in FAILSAFES if failsafe.watches)


def active(situation: Situation) -> list[Failsafe]:
    """Every failsafe that holds, worst first; on a machine that is monitor only, those of what is
    watched."""
    rows = MONITORED if situation.monitor_only else FAILSAFES
    return [failsafe for failsafe in rows if failsafe.holds(situation)]


def node_reasons(
    config: Config, info: NodeInfo | None, figures: NodeFigures | None = None
) -> list[str]:
    """Every way in which the node is not the configured one; empty when it conforms.

    ``info`` is None while it has not said yet, which gives an empty list: not having heard it is
    another matter.  Of a node without an actuator only what it measures is compared.
    """
    if info is None:
        return []
    a, period_us = config.machine.actuator, config.sampling.period_us
    schema, layout = config.bus.schema, WireLayout.of(config)
    moves = has(config.machine, ACTUATOR)
    step = "update one of the two" if schema == 1 else "update one of the two, or set bus.schema"
    checks = (
        (
            info.schema == schema,
            f"node: schema = {info.schema}: this device speaks {schema}; {step}",
        ),
        (
            info.schema != schema or info.layout_hash == layout.hash,
            f"node: layout {info.layout_hash:#010x} is not {layout.hash:#010x} of the configured "
            f"channels and readings; give node and device the same list (`orbitd rig dbc`)",
        ),
        (
            not moves
            or abs(info.boot_clearance_um - a.safe_radial_clearance_um) < CLEARANCE_STEP_UM,
            f"node: boot clearance {info.boot_clearance_um:g} um is not "
            f"actuator.safe_radial_clearance_um = "
            f"{a.safe_radial_clearance_um:g}; make them equal",
        ),
        (
            not moves or abs(info.boot_pressure_bar - a.safe_pressure_bar) < PRESSURE_STEP_BAR,
            f"node: boot pressure {info.boot_pressure_bar:g} bar is not "
            f"actuator.safe_pressure_bar = "
            f"{a.safe_pressure_bar:g}; make them equal",
        ),
        (
            not moves or info.time_to_live_ms == a.time_to_live_ms,
            f"node: time to live {info.time_to_live_ms} ms is not actuator.time_to_live_ms = "
            f"{a.time_to_live_ms}",
        ),
        (
            info.sample_period_us == period_us,
            f"node: sample period {info.sample_period_us} us is not that of sampling.rate_hz "
            f"({period_us} us)",
        ),
        (
            not moves or info.rate_um_s >= a.rate_um_s - 0.1,
            f"node: rate {info.rate_um_s:g} um/s is below actuator.rate_um_s = {a.rate_um_s:g}; "
            f"lower the latter",
        ),
    )
    reasons = [text for holds, text in checks if not holds]
    if schema == 1 or info.schema != schema or not moves:
        return reasons
    return reasons + _figure_reasons(config, figures)


def _figure_reasons(config: Config, figures: NodeFigures | None) -> list[str]:
    """How what the node was built with (wire schema 2) contradicts the configuration."""
    if figures is None:
        return ["node: says nothing of its figures (NODE_FIGURES); it must send them every second"]
    b, f, drive = config.machine.bearing, config.machine.feed, config.drive
    ranges = (
        (
            "clearance", "um", figures.clearance_min_um, figures.clearance_max_um,
            b.radial_clearance_min_um, b.radial_clearance_max_um, CLEARANCE_STEP_UM,
        ),
        (
            "pressure", "bar", figures.pressure_min_bar, figures.pressure_max_bar,
            f.pressure_min_bar, f.pressure_max_bar, PRESSURE_STEP_BAR,
        ),
    )  # fmt: skip
    reasons = [
        f"node: its {what} is {has_low:g} .. {has_high:g} {unit}, the configuration wants "
        f"{low:g} .. {high:g}; narrow the latter"
        for what, unit, has_low, has_high, low, high, step in ranges
        if has_low > low + step or has_high < high - step
    ]
    least_ms, most_ms = HEARTBEAT_LIMIT_MS
    if not least_ms <= figures.heartbeat_limit_ms <= most_ms:
        reasons.append(
            f"node: heartbeat limit {figures.heartbeat_limit_ms} ms is outside {least_ms} .. "
            f"{most_ms}; correct it at the node"
        )
    if figures.coasts_on_silence != drive.coast_down_on_lost_heartbeat:
        reasons.append(
            f"node: its drive {'coasts' if figures.coasts_on_silence else 'runs on'} when the "
            f"heartbeat is lost, drive.coast_down_on_lost_heartbeat = "
            f"{str(drive.coast_down_on_lost_heartbeat).lower()}; make them agree"
        )
    return reasons
