"""Which stage judges what, with the facts of which other stages."""

from __future__ import annotations

from math import pi

from firmware_py.acquire.stage import AcquireOutput
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.authority.failsafe import Situation, node_reasons
from firmware_py.guard.plausibility.pair_window import NO_FACTS
from firmware_py.guard.plausibility.reading_rows import CLEARANCE, OIL, PRESSURE
from firmware_py.guard.protection.added import AddedFacts, BearingNow
from firmware_py.guard.protection.permit import PermitFacts
from firmware_py.guard.state import Stages
from firmware_py.guard.supervision import ActuatorReadings, NodeReports
from firmware_py.records import ArmState, Block


def judge(g: Stages, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
    """Everything that is judged by what was acquired in this cycle, in its order."""
    notices = g.frame_loss.step(g.acquire.counters["frames_lost"], now_ns)
    if acquired.restarted or acquired.node_info is not None or acquired.figures is not None:
        a = g.acquire
        g.memory.node_reasons = node_reasons(g.config, a.node_info, a.figures)
    notices += exceptions(g, now_ns)
    notices += slow_readings(g, acquired, now_ns)
    notices += g.more.step(acquired.readings, now_ns)
    notices += supervise(g, acquired, now_ns)
    if acquired.blocks:
        cap_um = g.readings.smaller_clearance_um(g.acquire.node)
        notices += g.protection.step([g.first.block(b) for b in acquired.blocks], cap_um)
    notices += judge_speed(g, acquired, now_ns)
    notices += judge_pair(g, acquired.blocks)
    for bearing in g.bearings:
        notices += bearing.step(acquired.blocks, g.readings.value(OIL))
    if g.added.rows:
        notices += g.added.step(acquired.blocks, acquired.readings, added_facts(g), now_ns)
    return notices + g.voting.step(g.ballot, now_ns, g.bypasses.groups)


def exceptions(g: Stages, now_ns: int) -> list[Notice]:
    """What is bypassed, and by what set points are multiplied, in this cycle."""
    speed = g.acquire.speed
    rpm = speed.speed_rad_s * 30 / pi if speed.known else None
    notices = g.bypasses.step(now_ns) + g.multiply.step(rpm, now_ns)
    bypassed, factors = g.bypasses.measures, g.multiply.factors
    for each in g.set_points:
        each.bypass(bypassed)
        each.factors = factors
    return notices


def added_facts(g: Stages) -> AddedFacts:
    """What the added measures need of other stages."""
    first = g.readings.smaller_clearance_um(g.acquire.node)
    bearings = {g.first.name: BearingNow(g.protection.motion, g.protection.displacement_ok, first)}
    for each in g.bearings:
        own = each.protection
        bearings[each.name] = BearingNow(own.motion, own.displacement_ok, each.cap_um)
    speed = g.acquire.speed
    return AddedFacts(
        speed.speed_rad_s * 30 / pi if speed.known else None,
        g.turning,
        g.arming.state.commanding,
        bearings,
        g.readings.value,
    )


def judge_speed(g: Stages, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
    """Too fast, or as no shaft turns: then the speed is unknown at once; standing, or not."""
    speed = g.acquire.speed
    notices = g.rest.step(speed)
    if acquired.blocks:
        p = g.protection
        seen = g.rest.look(p.motion, p.displacement_ok, speed, now_ns)
        g.acquire.hear_motion(seen.quiet_s, seen.moving_s)
    notices += g.speed_high.step(acquired.turns, now_ns, speed.lost)
    notices += g.speed_check.step(acquired.turns, acquired.blocks, speed, now_ns)
    g.acquire.doubt_speed(g.speed_check.doubted)
    if not speed.known:
        g.memory.interval_m = None
    return notices


def supervise(g: Stages, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
    """Hold what node and actuator report against what they were told."""
    a = g.acquire
    measured = ActuatorReadings(g.readings.value(CLEARANCE), g.readings.value(PRESSURE))
    resting = not (g.turning or g.arming.state.commanding)
    return g.supervision.step(
        NodeReports(
            acquired.node_states,
            measured if acquired.readings else None,
            acquired.restarted,
            a.node,
            a.node_info,
            a.newest_tick_us if g.fresh(now_ns) else None,
            a.two_senders(now_ns),
            resting,
        ),
        now_ns,
    )


def slow_readings(g: Stages, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
    """Judge the slow readings, and by them the oil."""
    a, readings = g.acquire, g.readings
    notices = readings.step(
        acquired.blocks, a.status, a.status_heard_ns, a.node, a.speed.reading_rad_s, now_ns
    )
    return notices + g.oil.step(
        readings.pressure(now_ns), readings.outlet(now_ns), g.turning, now_ns
    )


def judge_pair(g: Stages, blocks: list[Block]) -> list[Notice]:
    """Whether the two displacements tell of one shaft, with the slow readings of now."""
    if not blocks:
        return []
    known, notices, facts = g.readings.known(), list[Notice](), NO_FACTS
    if known:
        facts = g.pair.facts(known.clearance_um * 1e-6, known.oil_C)
    elif g.readings.drawn:
        facts = g.pair.drawn(g.readings.value(OIL))
    for block in blocks:
        p2p_m = max(g.protection.motion.peak_to_peak_um) * 1e-6
        notices += g.pair.step(block, facts, p2p_m)
    return notices


def judge_permit(g: Stages, situation: Situation, blocks: bool) -> list[Notice]:
    """The permit of this cycle, after arming has judged it."""
    tripped = g.arming.state.arm_state == ArmState.TRIPPED and g.config.drive.trip_on_danger
    return g.permit.step(
        PermitFacts(
            situation.now_ns,
            situation.samples_fresh,
            blocks and situation.samples_fresh and situation.displacement_ok,
            situation.tripped if tripped else [],
            _foreign_trip(g),
        )
    )


def _foreign_trip(g: Stages) -> bool:
    """Whether the node follows somebody else, and the permit is configured to go for that."""
    return g.config.drive.trip_on_foreign and "node_elsewhere" in g.supervision.doubts
