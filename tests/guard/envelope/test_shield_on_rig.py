"""The shield against the rotor rig in software: the worst advice there is, over the whole published
duty."""

import numpy as np
import pytest

from firmware_py.guard.core import GuardCore
from firmware_py.records import (
    Advice,
    ArmState,
    CommandRequest,
    Cycle,
    GuardState,
    PlannedRamp,
    RawFrame,
)
from firmware_py.wire.codec import CanCodec
from models.control.episodes import untripped
from models.control.shielded import ANNOUNCED_S, ShieldedRotors, fast_ramps
from sim_hil.gym.control_task import CONTROL_S, Disturbances, actions_of
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.hil.rig import Rig, node_limits
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.rigs import load_rig

from ..scripted_node import MS, bench

RIG = load_rig("bench")
ARM_S, START_S, END_S = 3, 8, 74

UNANNOUNCED = Duty(
    (0.0, 3.0, 5.0, 8.0, 10.0, 13.0, 15.0, 20.0),
    (8000.0, 8000.0, 12000.0, 12000.0, 8000.0, 8000.0, 12000.0, 12000.0),
    (130.0, 130.0, 30.0, 30.0, 130.0, 130.0, 30.0, 30.0),
)
"""Speed and load as fast as they may change unannounced, to the corner where whirl is next."""

UNBALANCED = [9900009, 9900010, 9900011, 9900021, 9900025, 9900029]
"""Machines that whirled there while the shield judged unbalance in thin oil alone, and less of
it."""


@pytest.mark.parametrize("commissioned", [False, True])
def test_after_the_fastest_unannounced_ramps_no_machine_out_of_balance_whirls(
    commissioned: bool,
) -> None:
    seconds, count = UNANNOUNCED.time_s[-1], len(UNBALANCED)
    rotors = RotorVectorEnv(count, "bench", seconds, UNANNOUNCED, limits=untripped(RIG),
                            disturbances=Disturbances(developing=0.0))  # fmt: skip
    shielded = ShieldedRotors(rotors, commissioned=commissioned)
    shielded.reset(seed=list(UNBALANCED))
    widest = actions_of(rotors.rig, np.full((count, 1), 160e-6))
    share = np.array([seen["peak_to_peak_m"] / seen["clearance_m"] for *_, seen in (
        shielded.step(widest) for _ in range(round(seconds / CONTROL_S) - 1))])  # fmt: skip
    assert share.max() < 0.45


@pytest.mark.slow
@pytest.mark.parametrize("advised_um", [160.0, 40.0])
def test_the_widest_and_the_narrowest_advice_violate_nothing(advised_um: float) -> None:
    config, codec, drawing = bench(), CanCodec(), RIG
    rig = Rig(drawing, codec, node_limits(drawing, config), 1, duty=Duty.hold(12000.0, 30.0))
    core = GuardCore(config, codec, 77)
    ramps = fast_ramps(config, Duty.published(drawing))
    now_ns, out, states = 10**12, list[RawFrame](), list[GuardState]()
    for k in range(END_S * 1000):
        now_ns += MS
        frames = rig.step(now_ns, out)
        commands = (
            [CommandRequest(1, "mode", mode=2), CommandRequest(2, "arm")]
            if k == ARM_S * 1000
            else []
        )
        if ramps and k >= (START_S + ramps[0].start_s - ANNOUNCED_S) * 1000:
            r = ramps.pop(0)
            rpm = round(r.speed_rad_s / RAD_S_PER_RPM, 6)
            told = PlannedRamp(ANNOUNCED_S, ANNOUNCED_S + r.end_s - r.start_s, rpm, r.load_N)
            commands.append(CommandRequest(k, "announce", ramp=told))
        if k == START_S * 1000:
            rig.follow(Duty.published(drawing))
        advice = (
            Advice(k, now_ns, now_ns, 300 * MS, advised_um, None, True, [], None)
            if k % 100 == 0
            else None
        )
        decision = core.step(Cycle(k, now_ns, frames, advice, commands, True, True, True))
        out = decision.frames_out
        states += [decision.state] if decision.state else []
        assert all(reply.accepted for reply in decision.replies)
    truth = [t for t in rig.truth if t.t_ns > 10**12 + START_S * 10**9]
    assert min(t.min_film_um for t in truth) >= config.limits.min_film_um
    assert max(t.peak_to_peak_um / t.clearance_um for t in truth) <= config.limits.clearance_share
    assert states[-1].arm_state == ArmState.ARMED
    assert states[-1].counters["frames_lost"] == 0
    held = [s for s in states if s.t_ns > 10**12 + START_S * 10**9 and s.authority]
    assert len(held) > 0.9 * (END_S - START_S) * 10
    assert (max(s.target_clearance_um for s in held) > 85.0) == (advised_um == 160.0)
