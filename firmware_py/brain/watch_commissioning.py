"""Commissioning of a machine that is monitor only: as on any other, but all is its own."""

from __future__ import annotations

import hashlib
import math
from typing import Final

import msgspec
import numpy as np

from firmware_py.brain import watch_normal
from firmware_py.brain.commissioning import EVERY_NS, MOST_DECISIONS, SHAPING
from firmware_py.brain.normal import LOG_SPEED_STEP, NormalError, check_belongs, digest, speed_steps
from firmware_py.brain.watch import Figures, OrbitWatch
from firmware_py.config import Config
from firmware_py.machine import FastChannel
from firmware_py.records import (
    COMMISSION_ACTIONS,
    Belonging,
    CommandReply,
    CommandRequest,
    CommissionState,
    Diagnosis,
    GuardState,
    Normal,
)

UNTAUGHT: Final = "not commissioned: nothing is judged yet; `orbitd commission start`"
"""Of a machine without a model and a fleet."""
NOT_LEARNED: Final = ("sensor_fault", "none", "whirl")
"""Verdicts in which nothing is learned."""


class WatchCommissionState(msgspec.Struct):
    """How commissioning stands, and what was gathered."""

    phase: str = "none"
    text: str = UNTAUGHT
    kept: list[Figures] = []
    left_out: dict[str, int] = {}
    last_ns: int = -EVERY_NS


class WatchCommissioner:
    """Learns, adopts and forgets the machine's normal state; ``watch`` uses it.

    Parameters
    ----------
    watch
        Whose figures are learned from.
    config
        Channels and sampling, on which the figures depend.
    """

    def __init__(self, watch: OrbitWatch, config: Config) -> None:
        self._watch, self._device = watch, _belonging(watch, config)
        operating = config.machine.operating
        reach = math.log(operating.speed_max_rpm / operating.speed_min_rpm)
        self._steps_declared = math.ceil(reach / LOG_SPEED_STEP)
        self.state = WatchCommissionState()

    @property
    def normal_name(self) -> str:
        """Short name of the state in use; empty without one."""
        normal = self._watch.state.normal
        return digest(normal) if normal else ""

    def obey(self, request: CommandRequest) -> tuple[CommandReply, Normal | None]:
        """Answer to a person's wish, and the state that was learned with ``stop``."""
        try:
            learned = self._carry_out(request.action)
        except NormalError as error:
            return CommandReply(request.seq, False, [str(error)]), None
        return CommandReply(request.seq, True, []), learned

    def _carry_out(self, action: str) -> Normal | None:
        state = self.state
        if action not in COMMISSION_ACTIONS:
            raise NormalError(f"commission: {action!r} is none of {', '.join(COMMISSION_ACTIONS)}")
        if action == "forget":
            self._use(None, "none")
        elif action == "start":
            self.state = WatchCommissionState("gathering", "")
        elif state.phase != "gathering":
            raise NormalError(
                f"commission {action}: nothing is being gathered; `orbitd commission start` comes "
                f"first"
            )
        elif action == "cancel":
            self._use(self._watch.state.normal)
        else:
            learned = self._fit()
            self._use(learned)
            return learned
        return None

    def adopt(self, normal: Normal) -> None:
        """Use a stored state, or refuse it by name."""
        try:
            check_belongs(normal, self._device)
            if normal.own is None:
                raise NormalError(
                    "the stored normal state is one of a machine that is not monitor only: "
                    "commission again (`orbitd commission start`)"
                )
        except NormalError as error:
            self._use(None, "refused", str(error))
            return
        self._use(normal)

    def _use(self, normal: Normal | None, phase: str = "", text: str = "") -> None:
        self._watch.state.normal = normal
        none = "" if normal else UNTAUGHT
        self.state = WatchCommissionState(
            phase or ("commissioned" if normal else "none"), text or none
        )

    def gather(self, diagnosis: Diagnosis, guard: GuardState | None) -> None:
        """Learn from the decision behind ``diagnosis``, when it may be learned from."""
        state, mean = self.state, self._watch.mean
        if state.phase != "gathering" or diagnosis.t_acq_ns - state.last_ns < EVERY_NS:
            return
        word = diagnosis.verdict.partition(":")[0]
        full = len(state.kept) >= MOST_DECISIONS
        reason = (
            "no word of the guard" if guard is None
            else f"alarm {guard.alarms[0].name}" if guard.alarms
            else word if word in NOT_LEARNED
            else "fewer than 10 windows" if mean is None
            else f"more than {MOST_DECISIONS} decisions" if full
            else ""
        )  # fmt: skip
        if reason or mean is None:
            state.left_out[reason] = state.left_out.get(reason, 0) + 1
            return
        state.last_ns = diagnosis.t_acq_ns
        state.kept.append(mean)

    def _fit(self) -> Normal:
        kept, watch = self.state.kept, self._watch
        rows = np.array([each.row for each in kept]).reshape(-1, len(watch.names))
        return watch_normal.fit(
            rows, self._speeds, watch.names, watch.parts, watch.columns, watch.floors,
            self._device, self._minutes,
        )  # fmt: skip

    @property
    def _minutes(self) -> float:
        return len(self.state.kept) * EVERY_NS / 60e9

    @property
    def _speeds(self) -> watch_normal.Floats:
        return np.array([each.speed_rad_s for each in self.state.kept], np.float64)

    def report(self, seq: int, t_ns: int) -> CommissionState:
        """How commissioning stands."""
        state, normal, speeds = self.state, self._watch.state.normal, self._speeds
        if normal is not None and state.phase != "gathering":
            return CommissionState(
                seq, t_ns, state.phase, state.text, normal.decisions, normal.minutes,
                normal.points, ranges=normal.ranges, normal=self.normal_name,
            )  # fmt: skip
        ranges = {"speed_rad_s": (float(speeds.min()), float(speeds.max()))} if len(speeds) else {}
        steps = speed_steps(speeds)
        return CommissionState(
            seq, t_ns, state.phase, state.text, len(speeds), self._minutes, steps, steps,
            self._steps_declared, ranges, dict(state.left_out), {}, self.normal_name,
        )  # fmt: skip


def _belonging(watch: OrbitWatch, config: Config) -> Belonging:
    """What a state is learned with: figures, rig, channels and sampling; no classifier."""
    keys = SHAPING[FastChannel]
    shaped = (
        [{key: getattr(channel, key) for key in keys} for channel in config.machine.channel],
        config.sampling,
    )
    return Belonging(
        "monitor only",
        _digest("\n".join(watch.names).encode()),
        config.device.rig,
        _digest(msgspec.json.encode(shaped)),
    )


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:12]
