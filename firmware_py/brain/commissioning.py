"""Commissioning: the brain gathers healthy decisions of this machine while a person runs it over
its range.

The person vouches that the machine is healthy; what must not be learned from all the same (bad
channels, whirl, a standing alarm, a model in charge) is left out and counted.
"""

from __future__ import annotations

import hashlib
import math
from typing import Final

import msgspec
import numpy as np

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.orders import Orders
from firmware_py.acquire.windows import Window
from firmware_py.brain import normal as own
from firmware_py.brain.diagnosis import Answer, Diagnoser, forward_first_order
from firmware_py.brain.normal import NormalError
from firmware_py.brain.store import HEADS, Model
from firmware_py.brain.verdict import CLASSES, NOT_LEARNED, WINDOWS, WORDS
from firmware_py.config import Config
from firmware_py.machine import (
    ContactCircuit,
    FastChannel,
    JournalBearing,
    Lubricant,
    RotorDrawing,
    SlowReadings,
)
from firmware_py.machine.values import MachineTable
from firmware_py.records import (
    COMMISSION_ACTIONS,
    Belonging,
    CommandReply,
    CommandRequest,
    CommissionState,
    Diagnosis,
    GuardState,
    Mode,
    Normal,
)

EVERY_NS: Final = 2_500_000_000
"""Decisions this far apart share no window."""
MOST_DECISIONS: Final = 2000
"""Some 80 minutes; further ones are left out, counted."""
MODES: Final = (Mode.MONITOR, Mode.MANUAL)
"""A model that moves the clearance would teach its own habits."""


SHAPING: Final[dict[type, tuple[str, ...]]] = {
    FastChannel: (
        "name",
        "unit",
        "scale",
        "ok_low",
        "ok_high",
        "offset",
        "angle_deg",
        "slow_roll_um",
        "slow_roll_deg",
        "zeroed",
    ),
    JournalBearing: (
        "journal_radius_m",
        "length_m",
        "radial_clearance_min_um",
        "radial_clearance_max_um",
        "radial_clearance_nominal_um",
        "radial_clearance_offset_um",
        "radial_clearance_error_um",
        "load_error_share",
        "attitude_error_deg",
        "friction_error_share",
    ),
    ContactCircuit: ("circuit_V", "circuit_ohm", "film_ohm_per_m", "film_error_share"),
    Lubricant: (
        "viscosity_at_40C_Pa_s",
        "viscosity_slope_per_K",
        "inlet_min_C",
        "inlet_max_C",
        "film_max_C",
        "viscosity_error_share",
        "film_at_outlet",
        "thermal_capacity_J_K",
        "cooling_W_K",
    ),
    RotorDrawing: ("mass_at_bearing_kg", "windage_W_s3", "shaft_power_error_W"),
    SlowReadings: ("oil_outlet_error_C",),
}
"""Figures of the machine on which features depend: with others a learned state is another
machine's."""


class Learned(msgspec.Struct, frozen=True, array_like=True):
    """One healthy decision that is learned from."""

    row: own.Floats
    log_odds: own.Floats
    point: own.Floats
    first_order_m: complex


class CommissionerState(msgspec.Struct):
    """How commissioning stands, and what was gathered; counts by reason and by verdict."""

    phase: str = "none"
    text: str = ""
    kept: list[Learned] = []
    left_out: dict[str, int] = {}
    named: dict[str, int] = {}
    last_ns: int = -EVERY_NS


class Commissioner:
    """Learns, adopts and forgets the machine's normal state; the diagnoser uses it.

    Parameters
    ----------
    model
        The classifier; its metadata hold the fleet's statistics.
    config
        The device's configuration.
    diagnoser
        Gets the state.
    slow_roll_m
        Forward first order of the probes' runout.
    """

    def __init__(
        self, model: Model | None, config: Config, diagnoser: Diagnoser, slow_roll_m: complex
    ) -> None:
        self._device = belonging(model, config) if model else None
        self._prior = diagnoser.prior
        self._diagnoser = diagnoser
        self._slow_roll_m = slow_roll_m
        operating = config.machine.operating
        reach = math.log(operating.speed_max_rpm / operating.speed_min_rpm)
        self._speed_steps_declared = math.ceil(reach / own.LOG_SPEED_STEP)
        self.state = CommissionerState()

    @property
    def gathering(self) -> bool:
        """Whether decisions are being learned from."""
        return self.state.phase == "gathering"

    def _begin(self, phase: str, text: str = "") -> None:
        self.state = CommissionerState(phase, text)

    def obey(self, request: CommandRequest) -> tuple[CommandReply, Normal | None]:
        """Answer to a person's wish, and the state that was learned with ``stop``."""
        try:
            reasons, learned = self._carry_out(request.action)
        except NormalError as error:
            return CommandReply(request.seq, False, [str(error)]), None
        return CommandReply(request.seq, True, reasons), learned

    def _carry_out(self, action: str) -> tuple[list[str], Normal | None]:
        if action not in COMMISSION_ACTIONS:
            raise NormalError(f"commission: {action!r} is none of {', '.join(COMMISSION_ACTIONS)}")
        if action == "forget":
            self._use(None, "none", "")
            return [], None
        if action == "start":
            self._check_possible()
            self._begin("gathering")
            return [], None
        if not self.gathering:
            raise NormalError(
                f"commission {action}: nothing is being gathered; `orbitd commission start` comes "
                f"first"
            )
        if action == "cancel":
            self._stand(self._diagnoser.normal)
            return [], None
        learned, warnings = self._fit(), self._warnings()
        self._stand(learned)
        return warnings, learned

    def _check_possible(self) -> None:
        if self._device is None:
            raise NormalError("commission start: no classifier is in use, see `orbitd status`")
        if self._prior is None:
            raise NormalError(
                "commission start: this classifier carries no statistics of healthy machines "
                "(output "
                "`normal`); use one that this version has trained"
            )

    def adopt(self, normal: Normal) -> None:
        """Use a stored state, or refuse it by name."""
        if self._device is None or self._prior is None:
            self._use(
                None,
                "refused",
                "no classifier in use knows what to do with the machine's normal state",
            )
            return
        try:
            own.check_belongs(normal, self._device)
        except NormalError as error:
            self._use(None, "refused", str(error))
            return
        self._stand(normal)

    def _use(self, normal: Normal | None, phase: str, text: str) -> None:
        self._diagnoser.use(normal)
        self._begin(phase, text)

    def _stand(self, normal: Normal | None) -> None:
        self._use(normal, "commissioned" if normal else "none", "")

    def gather(
        self,
        window: Window,
        orders: Orders | None,
        diagnosis: Diagnosis,
        answer: Answer | None,
        guard: GuardState | None,
    ) -> None:
        """Learn from the decision after ``window``, when it may be learned from."""
        if not self.gathering or window.end_ns - self.state.last_ns < EVERY_NS:
            return
        reason = self._reason_against(diagnosis, answer, guard)
        if reason or answer is None or answer.normal is None or orders is None:
            _count(self.state.left_out, reason or "no answer of the classifier")
            return
        self.state.last_ns = window.end_ns
        if diagnosis.verdict in CLASSES and diagnosis.verdict != "normal":
            _count(self.state.named, diagnosis.verdict)
        self.state.kept.append(
            Learned(
                answer.normal,
                answer.log_odds,
                own.operating_point(window, orders),
                forward_first_order(orders) - self._slow_roll_m,
            )
        )

    def _reason_against(
        self, diagnosis: Diagnosis, answer: Answer | None, guard: GuardState | None
    ) -> str:
        """Why a decision must not be learned from; empty when it may."""
        if guard is None or guard.mode not in MODES:
            return f"mode {Mode(guard.mode).name.lower()}" if guard else "no word of the guard"
        if guard.alarms:
            return f"alarm {guard.alarms[0].name}"
        word = diagnosis.verdict.partition(":")[0]
        if WORDS.index(word) in NOT_LEARNED:
            return word
        if answer is None or diagnosis.evidence["windows"] < WINDOWS:
            return f"fewer than {WINDOWS} windows"
        full = len(self.state.kept) >= MOST_DECISIONS
        return f"more than {MOST_DECISIONS} decisions" if full else ""

    def _fit(self) -> Normal:
        if self._prior is None or self._device is None:
            raise NormalError("commission stop: the classifier is gone")
        kept = self.state.kept
        rows = np.array([d.row for d in kept]).reshape(-1, len(self._prior.between))
        log_odds = np.array([d.log_odds for d in kept]).reshape(-1, len(HEADS))
        first_order_m = np.array([d.first_order_m for d in kept], np.complex128)
        return own.fit(
            rows, log_odds, self._points(), first_order_m, self._prior, self._device, self._minutes
        )

    @property
    def _minutes(self) -> float:
        return len(self.state.kept) * EVERY_NS / 60e9

    def _points(self) -> own.Floats:
        return np.array([d.point for d in self.state.kept]).reshape(-1, len(own.POINT))

    def _warnings(self) -> list[str]:
        return [
            f"{count} decisions were named {name}: if the machine is not healthy, repair it and "
            f"commission again"
            for name, count in self.state.named.items()
        ]

    def report(self, seq: int, t_ns: int) -> CommissionState:
        """How commissioning stands."""
        normal, points, state = self._diagnoser.normal, self._points(), self.state
        if normal is not None and not self.gathering:
            return CommissionState(
                seq,
                t_ns,
                state.phase,
                state.text,
                normal.decisions,
                normal.minutes,
                normal.points,
                ranges=normal.ranges,
                normal=self._diagnoser.normal_name,
            )
        return CommissionState(
            seq,
            t_ns,
            state.phase,
            state.text,
            len(points),
            self._minutes,
            own.count_points(points),
            own.speed_steps(points[:, 0]),
            self._speed_steps_declared,
            own.ranges(points) if len(points) else {},
            dict(state.left_out),
            dict(state.named),
            self._diagnoser.normal_name,
        )


def belonging(model: Model, config: Config) -> Belonging:
    """What a state is learned with: classifier, features, rig, and the configuration that features
    depend on."""
    m = config.machine
    shaped = (
        [_figures(channel) for channel in m.channel],
        config.sampling,
        *(_figures(table) for table in (m.bearing, m.contact, m.lubricant, m.rotor, m.readings)),
    )
    return Belonging(
        model.sha256,
        _digest("\n".join(FEATURE_NAMES).encode()),
        config.device.rig,
        _digest(msgspec.json.encode(shaped)),
    )


def _figures(table: MachineTable | None) -> dict[str, object] | None:
    """What features depend on of ``table``, in a fixed order; other figures may come and go."""
    keys = SHAPING.get(type(table), ())
    return None if table is None else {key: getattr(table, key) for key in keys}


def _count(counts: dict[str, int], name: str) -> None:
    counts[name] = counts.get(name, 0) + 1


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:12]
