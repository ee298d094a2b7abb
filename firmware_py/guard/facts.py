"""What the guard decides by: load, interval of the shield, and the situation of this cycle."""

from __future__ import annotations

from math import pi
from typing import Final

from firmware_py.guard.authority.failsafe import Situation
from firmware_py.guard.envelope.load_estimate import Look
from firmware_py.guard.envelope.shield import PERIOD_S
from firmware_py.guard.plausibility.readings import OIL
from firmware_py.guard.state import Stages
from firmware_py.guard.surroundings import FOREIGN_HOLD_NS
from firmware_py.records import Cycle

SHIELD_PERIOD_NS: Final = round(PERIOD_S * 1e9)
NODE_SILENT_NS: Final = 500_000_000

UNKNOWN_VIBRATION: Final = 1.01
"""A vibration that is not known counts as this many times what may fill the clearance: the bearing
narrows to safe."""


def look_around(g: Stages, now_ns: int) -> None:
    """Estimate the load and ask the shield: every :data:`PERIOD_S`, and anew for each command
    that is sent.

    While the mark stays away, the shaft may have any speed between the one told and the last
    reading.  On a machine that is monitor only there is neither load nor envelope to tell.
    """
    m, readings, known = g.memory, g.readings, g.readings.known()
    m.shield_due_ns = now_ns + SHIELD_PERIOD_NS
    motion, speed = g.protection.motion, g.acquire.speed
    p2p_m = max(motion.peak_to_peak_um) * 1e-6
    smaller_um = readings.smaller_clearance_um(g.acquire.node)
    m.vibration_um = (p2p_m * 1e6, g.protection.set_points_um(smaller_um)[1])
    m.vibration_high = m.vibration_um[0] > m.vibration_um[1]
    if g.monitor_only:
        return
    displacement_ok = g.protection.displacement_ok and g.pair.plausible
    if (
        not displacement_ok
    ):  # a vibration that is not known may be the largest that is admissible, and more
        share = g.config.limits.clearance_share
        p2p_m = max(p2p_m, UNKNOWN_VIBRATION * share * readings.narrowest_um(smaller_um) * 1e-6)
    if known is None or not motion.complete or not speed.known or not displacement_ok:
        m.load = g.load.declared()
    else:
        m.load = g.load.estimate(
            Look(
                now_ns * 1e-9,
                motion.mean_x_m,
                motion.mean_y_m,
                p2p_m,
                known.clearance_um * 1e-6,
                speed.reading_rad_s,
                known.oil_C,
                known.power_W,
                known.pressure_bar,
            )
        )
    oil_C, oil = g.load.oil_at(readings.value(OIL))
    narrow_m = readings.narrowest_um(smaller_um) * 1e-6
    if speed.known and motion.complete and displacement_ok:
        p2p_m = g.vibration.step(p2p_m, narrow_m, speed.reading_rad_s, now_ns)
    m.interval_m = (
        None
        if not speed.known
        else g.shield.interval(
            speed.reading_rad_s,
            m.load.low_N,
            m.load.film_N,
            oil_C,
            p2p_m,
            narrow_m,
            g.announcements.ahead(now_ns),
            oil,
            speed.speed_rad_s,
        )
    )


def situation(g: Stages, cycle: Cycle, gap: bool) -> Situation:
    """What arming, permit and requests are judged by in this cycle; ``gap``: the guard was away."""
    m, a, now_ns = g.memory, g.acquire, cycle.now_ns
    speed = a.speed
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
        brain_connected=cycle.brain_connected,
        monitor_only=g.monitor_only,
        doubts=g.readings.doubts
        | g.oil.beyond
        | g.supervision.doubts
        | g.arming.doubts
        | g.frame_loss.doubts
        | ({"link_fault": cycle.link_fault} if cycle.link_fault else {}),
    )
