"""What the guard decides by: load, interval of the shield, and the situation of this cycle."""

from __future__ import annotations

from math import pi
from typing import Final, NamedTuple

from firmware_py.config.measure_types import Effect
from firmware_py.guard.authority.failsafe import Situation
from firmware_py.guard.envelope.admissible import EnvelopeInput
from firmware_py.guard.envelope.shield import PERIOD_S
from firmware_py.guard.plausibility.reading_rows import OIL
from firmware_py.guard.state import Stages
from firmware_py.guard.surroundings import FOREIGN_HOLD_NS
from firmware_py.records import Cycle

SHIELD_PERIOD_NS: Final = round(PERIOD_S * 1e9)
NODE_SILENT_NS: Final = 500_000_000


def look_around(g: Stages, now_ns: int) -> None:
    """Ask the envelope: every :data:`PERIOD_S`, and anew for each command that is sent.

    While the mark stays away, the shaft may have any speed between the one told and the last
    reading.  On a machine that is monitor only there is neither load nor envelope to tell.
    """
    m, readings = g.memory, g.readings
    m.shield_due_ns = now_ns + SHIELD_PERIOD_NS
    motion, speed = g.protection.motion, g.acquire.speed
    p2p_m = max(motion.peak_to_peak_um) * 1e-6
    smaller_um = readings.smaller_clearance_um(g.acquire.node)
    m.vibration_um = (p2p_m * 1e6, g.protection.set_points_um(smaller_um)[1])
    m.vibration_high = m.vibration_um[0] > m.vibration_um[1]
    if g.monitor_only:
        return
    seen = EnvelopeInput(
        (motion.mean_x_m, motion.mean_y_m),
        p2p_m,
        g.protection.displacement_ok and g.pair.plausible,
        motion.complete,
        speed.reading_rad_s if speed.known else None,
        speed.speed_rad_s,
        readings.known(),
        readings.value(OIL),
        readings.narrowest_um(smaller_um),
    )
    announced = g.announcements.ahead(now_ns) if speed.known else ()
    m.load, m.interval_m = g.envelope.step(seen, announced, now_ns)


class Passed(NamedTuple):
    """What protection asks for before a trip, in words by alarm: the loss of authority, and a
    retreat."""

    authority: dict[str, str]
    retreats: dict[str, str]


def protection_says(g: Stages) -> Passed:
    """Dangers that vote, alarms that take authority or retreat, groups that cannot vote; the oil
    has failsafes of its own for authority."""
    told, found = g.oil.beyond, Passed({}, {})
    for each in g.set_points:
        for name, effect in each.acting():
            if effect is Effect.RETREAT:
                found.retreats[name] = each.said(name)
            elif name not in told:
                found.authority[name] = each.said(name)
    for name, effect, text in g.voting.acting():
        if effect is Effect.RETREAT:
            found.retreats[name] = text
        elif effect >= Effect.AUTHORITY:
            found.authority[name] = text
    return found


def situation(g: Stages, cycle: Cycle, gap: bool) -> Situation:
    """What arming, permit and requests are judged by in this cycle; ``gap``: the guard was away."""
    m, a, now_ns = g.memory, g.acquire, cycle.now_ns
    speed = a.speed
    passed, retreats = protection_says(g)
    return Situation(
        now_ns=now_ns,
        link_up=cycle.link_up,
        samples_fresh=g.fresh(now_ns),
        clock_settled=a.clock_settled,
        node_heard=a.node_age_ns(now_ns) < NODE_SILENT_NS and a.node_info is not None,
        node_reasons=m.node_reasons,
        foreign_command=now_ns - m.foreign_command_ns < FOREIGN_HOLD_NS,
        foreign_heartbeat=now_ns - m.foreign_heartbeat_ns < FOREIGN_HOLD_NS,
        cycle_gap=gap,
        mark_lost=not speed.known,
        displacement_ok=g.protection.displacement_ok,
        vibration_high=m.vibration_high,
        pair_ok=g.pair.plausible,
        speed_declared=g.speeds[0] * 0.98 <= speed.speed_rad_s <= g.speeds[1] * 1.02,
        speed_rpm=speed.speed_rad_s * 30 / pi,
        speeds_rpm=g.speeds_rpm,
        vibration_um=m.vibration_um[0],
        vibration_limit_um=m.vibration_um[1],
        interval_m=m.interval_m,
        tripped=g.tripped,
        passed=passed,
        retreats=retreats,
        bypassed=g.bypasses.said,
        brain_connected=cycle.brain_connected,
        monitor_only=g.monitor_only,
        models=m.models,
        doubts=g.readings.doubts
        | g.oil.beyond
        | g.supervision.doubts
        | g.arming.doubts
        | g.frame_loss.doubts
        | ({"link_fault": cycle.link_fault} if cycle.link_fault else {}),
    )
