"""What the guard reports: events, standing alarms, its state."""

from __future__ import annotations

from math import pi
from typing import Final

import msgspec

from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.envelope.target import Target
from firmware_py.guard.protection.vibration import zone
from firmware_py.guard.state import Stages
from firmware_py.records import Alarm, Event, GuardState, NodeMode, Severity

STATE_PERIOD_NS: Final = 100_000_000
STATE_GAP_NS: Final = 20_000_000
"""A request brings the next state forward, to so long after the one before."""


def events(g: Stages, notices: list[Notice], now_ns: int) -> list[Event]:
    """The notices that are due as events."""
    return [_event(g, notice, count, now_ns) for notice, count in g.telling.step(notices, now_ns)]


def state_when_due(g: Stages, now_ns: int, *, soon: bool) -> GuardState | None:
    """The guard's state ten times a second, ``soon`` after a request; None between."""
    m = g.memory
    if soon:
        m.state_due_ns = min(m.state_due_ns, m.state_ns + STATE_GAP_NS)
    return guard_state(g, now_ns) if now_ns >= m.state_due_ns else None


def counters(g: Stages) -> dict[str, int]:
    """What came in and what was lost or refused, by name."""
    return dict(
        g.acquire.counters,
        cycle_gaps=g.memory.cycle_gaps,
        advices_ahead=g.memory.advices_ahead,
        speed_doubts=g.speed_check.state.doubts,
        hard_stops=g.rest.state.hard_stops,
    )


def _event(g: Stages, notice: Notice, count: int, now_ns: int) -> Event:
    g.memory.event_seq += 1
    return Event(
        g.memory.event_seq,
        now_ns,
        int(notice.severity),
        notice.name,
        notice.text,
        notice.value,
        notice.limit,
        count,
    )


def standing(g: Stages) -> list[Alarm]:
    """Every alarm that stands, one of each name: protection's, the failsafes', the link's."""
    m = g.memory
    link = [Alarm("link_fault", Severity.FAULT, m.link_fault_ns, 0.0, 0.0, False, m.link_fault)]
    found = [
        *g.protection.standing(),
        *g.pair.standing(),
        *(alarm for bearing in g.bearings for alarm in bearing.standing()),
        *g.readings.standing(),
        *g.oil.standing(),
        *g.added.standing(),
        *g.multiply.standing(),
        *g.bypasses.standing(),
        *g.voting.standing(),
        *g.speed_high.standing(),
        *g.speed_check.standing(),
        *g.supervision.standing(),
        *g.frame_loss.standing(),
        *g.more.standing(),
        *g.permit.standing(),
        *g.unwritable.standing(),
        *g.models_back.standing(),
        *(link if m.link_fault else []),
        *g.arming.standing(),
    ]
    alarms = list({alarm.name: alarm for alarm in reversed(found)}.values())[::-1]
    shelved = g.bypasses.state.shelved
    if not shelved:
        return alarms
    return [msgspec.structs.replace(a, shelved=True) if a.name in shelved else a for a in alarms]


def guard_state(g: Stages, now_ns: int) -> GuardState:
    """Everything the guard says about itself."""
    m, arming, a = g.memory, g.arming.state, g.acquire
    m.state_ns, m.state_due_ns = now_ns, now_ns + STATE_PERIOD_NS
    m.state_seq += 1
    permit = g.permit.state
    low_m, high_m = m.interval_m or (0.0, 0.0)
    p2p_um = g.protection.motion.peak_to_peak_um
    node, causes = a.node, g.protection.causes
    others = {bearing.name: bearing.peak_to_peak_um for bearing in g.bearings}
    for bearing in g.bearings:
        causes = causes | bearing.causes
    target = Target(0.0, 0.0) if g.monitor_only else m.target
    return GuardState(
        seq=m.state_seq,
        t_ns=now_ns,
        mode=int(arming.mode),
        arm_state=int(arming.arm_state),
        authority=arming.authority.held,
        authority_reasons=list(arming.authority.reasons),
        speed_rad_s=a.speed.speed_rad_s,
        load_estimate_N=0.5 * (m.load.low_N + m.load.high_N),
        clearance_low_um=low_m * 1e6,
        clearance_high_um=high_m * 1e6,
        target_clearance_um=target.clearance_um,
        target_pressure_bar=target.pressure_bar,
        clearance_actual_um=a.status.clearance_actual_um if a.status and g.measures else 0.0,
        peak_to_peak_um=p2p_um,
        run_permit=permit.granted,
        trip_request=permit.trip_request,
        node_following=node is not None
        and node.mode == NodeMode.FOLLOWING
        and node.session == g.session,
        alarms=standing(g),
        counters=counters(g),
        zone=zone(max(p2p_um), a.speed.speed_rad_s * 30 / pi),
        permit_reasons=permit.reasons,
        channel_causes=causes,
        monitor_only=g.monitor_only,
        other_peak_to_peak_um=others,
        first_out=g.first_out,
    )
