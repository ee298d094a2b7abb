"""Sample frames that are lost again and again: the bus, an adapter or this machine is overloaded or
ill.

One burst is no alarm (the samples are stale, or a gap that every timer holds over); many gaps are,
because the protection then sees a part of the machine only, although its newest sample is fresh.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.config.instances import frame_instants
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.condition import Condition, ConditionState
from firmware_py.records import Alarm, Severity

NAME: Final = "frames_lost"

BIN_NS: Final = 50_000_000
"""A burst that is shorter touches two bins at most."""

BINS: Final = 20
"""The window: one second."""

BINS_LEAST: Final = 3
"""Losses in so many bins are no single burst."""

SHARE: Final = 0.02
"""Lost frames of the window, above which it is an alarm."""

AUTHORITY_SHARE: Final = 0.05
"""Above this share the model may not act: no window of it is whole for long."""

CLEAN_NS: Final = 5_000_000_000
"""The alarm ends after this time at or below :data:`SHARE`."""


class FrameLossState(msgspec.Struct):
    """Losses by bin, the counter when last read, and the alarm; ``heavy``: it takes authority as
    well."""

    alarm: ConditionState = msgspec.field(default_factory=ConditionState)
    lost: int = 0
    bin_ns: int = 0
    bins: list[int] = []
    bad_ns: int = 0
    heavy: bool = False


class FrameLoss:
    """The alarm ``frames_lost``.

    Parameters
    ----------
    config
        Sampling rate: how many frames a whole window has.
    """

    def __init__(self, config: Config) -> None:
        self._whole = BINS * BIN_NS / (frame_instants(config) * config.sampling.period_us * 1000)
        self._condition = Condition(NAME, f"{NAME}_ended", Severity.ALERT)
        self._state = FrameLossState()

    @property
    def state(self) -> FrameLossState:
        """The stage's memory (for snapshots)."""
        self._state.alarm = self._condition.state
        return self._state

    @state.setter
    def state(self, state: FrameLossState) -> None:
        self._state, self._condition.state = state, state.alarm

    def step(self, lost: int, now_ns: int) -> list[Notice]:
        """Judge the counter of lost sample frames once in a bin."""
        s = self._state
        if now_ns - s.bin_ns < BIN_NS:
            return []
        s.bins = [*s.bins[1 - BINS :], lost - s.lost]
        s.bin_ns, s.lost = now_ns, lost
        share = sum(s.bins) / self._whole
        if share > SHARE and sum(count > 0 for count in s.bins) >= BINS_LEAST:
            s.bad_ns = now_ns
            s.heavy = s.heavy or share > AUTHORITY_SHARE
        holds = s.bad_ns > 0 and now_ns - s.bad_ns < CLEAN_NS
        s.heavy = s.heavy and holds
        return self._condition.step(
            holds,
            (
                f"{100 * share:.1f} % of the sample frames of the last second are lost (alarm "
                f"above {100 * SHARE:g} %, no "
                f"authority above {100 * AUTHORITY_SHARE:g} %); check bus load, cable and adapter, "
                f"and the load of this "
                "machine"
            ),
            now_ns,
        )

    def standing(self) -> list[Alarm]:
        """The alarm while it stands."""
        return self._condition.standing()

    @property
    def doubts(self) -> dict[str, str]:
        """The alarm with its text where it takes authority."""
        return {NAME: self._condition.state.text} if self._state.heavy else {}
