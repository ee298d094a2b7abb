"""What happens in a demo, and when: drawn from the seed, unknown to the device.

A story is a list of acts (what a person is told) and of beats (what is done to the rig or to the
device). All times count from the moment at which samples flow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from firmware_py.machine import OperatingRange

SHORTEST_S = 20.0
"""Shortest story that still arms, moves the clearance and names one fault."""

LONGEST_S = 86_400.0
"""Longest story: a day."""

FAULT_VERDICTS = {
    "unbalance": "unbalance",
    "pedestal_bolt": "pedestal_bolt_loose",
    "pedestal_two_bolts": "pedestal_two_bolts_loose",
    "motor_bolt": "motor_bolt_loose",
    "pedestal_and_motor_bolt": "pedestal_and_motor_bolt_loose",
}
"""Fault that is injected, and the verdict that names it."""

UNBALANCE_GRADES_G = (16.0,)
"""Severity at which the unbalance must be named (as the task requires).  A sudden G40 in a
clearance that is wide to save power passes danger before the clearance is narrow again: the guard
rightly trips, the story would end."""

BOLT_PRELOADS_PERCENT = (25.0, 0.0)
"""Severities at which a bolt must be named (as the task requires: preload <= 25 %)."""

RAMP_SHARE = 0.9
"""Share of the declared fastest unannounced ramp that the duty uses."""

LONGEST_RAMP_S = 6.0
"""Of the duty: over the whole range of load, or of speed."""

FEWEST_POINTS = 3
"""Of the duty's usual speeds that lie in a machine's range; with fewer it takes its own."""

Verb = Literal["operating", "inject", "clear", "arm", "kill_brain"]


@dataclass(frozen=True)
class Beat:
    """One thing done at ``t_s``: numbers in SI except where the name says otherwise."""

    t_s: float
    verb: Verb
    speed_rpm: float = 0.0
    load_N: float = 0.0
    ramp_s: float = 0.0
    fault: str = ""
    severity: float = 0.0


@dataclass(frozen=True)
class StoryAct:
    """A stretch of the story with one thing to watch."""

    name: str
    start_s: float
    end_s: float
    text: str


@dataclass(frozen=True)
class Story:
    """Acts and beats of one demo."""

    seconds: float
    seed: int
    acts: tuple[StoryAct, ...]
    beats: tuple[Beat, ...]

    def act_at(self, t_s: float) -> StoryAct:
        """The act that plays at ``t_s``; the last one after the end."""
        return next((act for act in self.acts if t_s < act.end_s), self.acts[-1])


@dataclass(frozen=True)
class _OperatingPoint:
    """An operating point of the rig."""

    speed_rpm: float
    load_N: float


def draw(seconds: float, seed: int, operating: OperatingRange, fault: str | None = None) -> Story:
    """Draw the story of ``seconds`` from ``seed``.

    Under 60 s the second fault is left out, under 50 s the kill of the brain too; the rest is
    shortened.

    Parameters
    ----------
    operating
        The declared range: ramps stay within it.
    fault
        Name of the second fault (see :data:`FAULT_VERDICTS`); None draws a loosened bolt.
    """
    teller = _Teller(np.random.default_rng(seed), operating, fault)
    first = teller.within(_START)
    scenes = {
        teller.healthy: 0.12,
        teller.duty: 0.40,
        teller.unbalance: 0.17,
        teller.second_fault: 0.17 if seconds >= 60 else 0.0,
        teller.kill: 0.14 if seconds >= 50 else 0.0,
    }
    acts: list[StoryAct] = []
    beats = [Beat(0.0, "operating", first.speed_rpm, first.load_N), Beat(2.0, "arm")]
    point, start = first, 0.0
    for scene, share in scenes.items():
        if share:
            end = start + seconds * share / sum(scenes.values())
            act, new_beats, point = scene(start, end, point)
            acts.append(act)
            beats.extend(new_beats)
            start = end
    return Story(seconds, seed, tuple(acts), tuple(beats))


_Scene = tuple[StoryAct, list[Beat], _OperatingPoint]
_START = _OperatingPoint(6000.0, 100.0)


@dataclass(frozen=True)
class _Teller:
    """Draws one scene after the other; each takes its start, end and the operating point it
    finds."""

    rng: np.random.Generator
    operating: OperatingRange
    fault: str | None

    def healthy(self, start: float, end: float, point: _OperatingPoint) -> _Scene:
        return (
            StoryAct(
                "healthy", start, end, "healthy running; the device checks, is armed, takes over"
            ),
            [],
            point,
        )

    def duty(self, start: float, end: float, point: _OperatingPoint) -> _Scene:
        """Holds of 4 to 7 s at speeds and loads of the whole range, joined by ramps within the
        declared rate."""
        low, high = self.operating.speed_min_rpm, self.operating.speed_max_rpm
        speeds = np.array([1500, 3000, 4500, 6000, 9000, 12000])
        loads = np.array([30, 60, 100, 200, 300])
        speeds = speeds[(speeds >= low) & (speeds <= high)]
        if len(speeds) < FEWEST_POINTS:
            speeds = np.geomspace(low, high, FEWEST_POINTS)
        if np.sum((loads >= self.operating.load_min_N) & (loads <= self.operating.load_max_N)) < 2:
            loads = np.geomspace(self.operating.load_min_N, self.operating.load_max_N, len(loads))
        beats, t = [], start
        while t < end - LONGEST_RAMP_S:
            target = _OperatingPoint(
                float(self.rng.choice(speeds)), self._load(float(self.rng.choice(loads)))
            )
            ramp = self._ramp_s(point, target)
            beats.append(Beat(t, "operating", target.speed_rpm, target.load_N, ramp))
            point, t = target, t + ramp + float(self.rng.uniform(4.0, 7.0))
        return (
            StoryAct(
                "duty", start, end, "changing speed and load; the clearance follows to save power"
            ),
            beats,
            point,
        )

    def unbalance(self, start: float, end: float, point: _OperatingPoint) -> _Scene:
        return self._injected("unbalance", start, end, point)

    def second_fault(self, start: float, end: float, point: _OperatingPoint) -> _Scene:
        bolts = [name for name in FAULT_VERDICTS if name != "unbalance"]
        return self._injected(self.fault or str(self.rng.choice(bolts)), start, end, point)

    def kill(self, start: float, end: float, point: _OperatingPoint) -> _Scene:
        beats = [Beat(start + float(self.rng.uniform(1.0, 2.0)), "kill_brain")]
        return (
            StoryAct(
                "kill", start, end, "the brain is killed; the actuator goes to its safe value"
            ),
            beats,
            point,
        )

    def _injected(self, name: str, start: float, end: float, point: _OperatingPoint) -> _Scene:
        """A hold, one fault injected at a drawn moment, cleared at the end of the act."""
        low, high = self.operating.speed_min_rpm, self.operating.speed_max_rpm
        severity = float(
            self.rng.choice(UNBALANCE_GRADES_G if name == "unbalance" else BOLT_PRELOADS_PERCENT)
        )
        slowest = max(low, 0.25 * high)
        speed_rpm = float(self.rng.uniform(slowest, max(slowest, 0.6 * high)))
        hold = _OperatingPoint(speed_rpm, self._load(float(self.rng.uniform(60, 200))))
        ramp = self._ramp_s(point, hold)
        beats = [
            Beat(start, "operating", hold.speed_rpm, hold.load_N, ramp),
            Beat(
                start + ramp + float(self.rng.uniform(1.0, 2.5)),
                "inject",
                fault=name,
                severity=severity,
            ),
            Beat(end - 0.2, "clear", fault=name),
        ]
        return (
            StoryAct(
                "fault", start, end, "something is wrong with the machine: does the device name it?"
            ),
            beats,
            hold,
        )

    def within(self, point: _OperatingPoint) -> _OperatingPoint:
        """``point``, moved into the declared range where it lies outside."""
        low, high = self.operating.speed_min_rpm, self.operating.speed_max_rpm
        return _OperatingPoint(min(max(point.speed_rpm, low), high), self._load(point.load_N))

    def _load(self, load_N: float) -> float:
        return min(max(load_N, self.operating.load_min_N), self.operating.load_max_N)

    def _ramp_s(self, start: _OperatingPoint, end: _OperatingPoint) -> float:
        """Shortest ramp that keeps within :data:`RAMP_SHARE` of the declared rates, at least 1
        s."""
        speed_s = abs(end.speed_rpm - start.speed_rpm) / (
            RAMP_SHARE * self.operating.speed_ramp_unannounced_rpm_s
        )
        load_s = abs(end.load_N - start.load_N) / (
            RAMP_SHARE * self.operating.load_ramp_unannounced_N_s
        )
        return max(1.0, speed_s, load_s)
