"""The guard on the rig when the oil pump is lost while a policy holds a wide clearance: is the
shaft back at its safe clearance before the film is no longer full?

``python -m tests.guard.protection.pump_loss`` prints a row for each build, with the accumulator
that the folder declares and without one.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import load_models
from firmware_py.guard.core import GuardCore
from firmware_py.machine import supply
from firmware_py.records import Decision, Mode
from firmware_py.wire.link import codec_for
from sim_hil.closed_loop import ClosedLoop
from sim_hil.demo.setting import Setting, prepare
from sim_hil.hil.rig import Rig, node_limits

SPEED_RPM, LOAD_N = 9000.0, 100.0
ARM_S, LOSE_S, END_S = 2.0, 10.0, 35.0
NEAR_UM: Final = 2.0


@dataclass(frozen=True)
class Loss:
    """What came of it; times from the loss of the pump, s (nan: never)."""

    wide_um: float
    alert_s: float
    safe_s: float
    not_full_s: float
    trip_s: float
    least_film_um: float
    """While the shaft turned with the machine's permit."""

    @property
    def margin_s(self) -> float:
        """By how much the retreat was over before the film was no longer full."""
        return self.not_full_s - self.safe_s


def setting(seed: int, hold_up: bool) -> Setting:
    """A drawn build of the bench, with its accumulator or without one."""
    found = prepare("bench", seed)
    if hold_up:
        return found
    return replace(found, rig=replace(found.rig, supply=replace(found.rig.supply, hold_up_s=0.0)))


def play(seed: int, hold_up: bool = True) -> Loss:
    """Armed under the shipped policy, then without a pump until the guard has tripped."""
    played = setting(seed, hold_up)
    config, codec = played.config, codec_for(played.config)
    rig = Rig(played.rig, codec, node_limits(played.rig, config), seed, build=played.build)
    rig.set_operating(SPEED_RPM, LOAD_N)
    models = load_models(config)
    loop = ClosedLoop(rig, GuardCore(config, codec, 1), lambda: BrainCore(config, models))
    times = {"alert": float("nan"), "trip": float("nan")}
    wide_um = lost_ns = 0.0
    for cycle in range(round(END_S * 1e3)):
        if cycle == round(ARM_S * 1e3):
            loop.command("mode", mode=Mode.AUTO)
            loop.command("arm")
        if cycle == round(LOSE_S * 1e3):
            wide_um, lost_ns = rig.truth[-1].clearance_um, loop.now_ns
            rig.inject("pressure_loss", 1.0)
        for name in _begun(loop.step()):
            times[name] = (loop.now_ns - lost_ns) * 1e-9
        if times["trip"] == times["trip"]:
            break
    return _judged(rig, config.machine.actuator.safe_radial_clearance_um, wide_um, lost_ns, times)


def _begun(decision: Decision) -> Iterator[str]:
    for event in decision.events:
        if event.name == "oil_pressure_low_alert":
            yield "alert"
        if event.name == "tripped":
            yield "trip"


def _judged(
    rig: Rig, safe_um: float, wide_um: float, lost_ns: float, times: dict[str, float]
) -> Loss:
    full_bar = rig.machine.rig.supply.full_film_Pa * 1e-5
    after = [(1e-9 * (row.t_ns - lost_ns), row) for row in rig.truth if row.t_ns > lost_ns]
    error_um = 1e6 * rig.machine.build.clearance_error_m
    never = float("nan")
    back = (t for t, row in after if abs(row.clearance_um - error_um - safe_um) < NEAR_UM)
    return Loss(
        wide_um,
        times["alert"],
        next(back, never),
        next((t for t, row in after if row.pressure_bar < full_bar), never),
        times["trip"],
        min(row.min_film_um for _, row in after),
    )


def main() -> None:
    """Print what comes of it for six builds."""
    bench = prepare("bench", 1).config
    held = supply.held_s(bench.machine.feed, bench.oil_pressure_limits_bar[0])
    sys.stdout.write(
        f"declared: full for {held:.2f} s from the alert on, retreat from the farthest clearance "
        f"{supply.retreat_s(bench.machine):.2f} s\n"
        "build  hold-up  from um  alert s  safe s  not full s  margin s  trip s  least film um\n"
    )
    for seed in range(1, 4):
        for hold_up in (True, False):
            loss = play(seed, hold_up)
            sys.stdout.write(
                f"{seed:5}  {'yes' if hold_up else 'no':>7}  {loss.wide_um:7.1f}"
                f"  {loss.alert_s:7.2f}  {loss.safe_s:6.2f}  {loss.not_full_s:10.2f}"
                f"  {loss.margin_s:8.2f}  {loss.trip_s:6.2f}  {loss.least_film_um:13.1f}\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
