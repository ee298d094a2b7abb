"""The policy: the actor proposes a clearance, the predictor checks it, and the reasons are written
down (AG).

If the actor's proposal is not good (:mod:`firmware_py.brain.overrule`), the good candidate with the
least expected power that the guard admits is advised instead, or the safe clearance when there is
none; the forecast says so. Without models, fresh samples or a clear diagnosis there is no
proposal, and every reason is given; an advice with reasons against itself is one that nobody may
act on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.orders import Orders
from firmware_py.acquire.windows import Window
from firmware_py.brain.errors import EstimateLostError, ModelAnswerError
from firmware_py.brain.estimate import Estimate
from firmware_py.brain.measurement import Measured
from firmware_py.brain.observation import Present, window_measured
from firmware_py.brain.overrule import OverruleLimits, choose
from firmware_py.brain.prediction import CANDIDATES, HORIZON_S, Outlook, Predictor, PredictorState
from firmware_py.brain.store import OBSERVATION, Model, Models
from firmware_py.config import Config
from firmware_py.records import CHANNELS, ArmState, Diagnosis, GuardState, Mode

READING_AGE_MAX_NS: Final = 250_000_000
SAMPLE_AGE_MAX_NS: Final = 150_000_000
DIAGNOSIS_AGE_MAX_NS: Final = 1_500_000_000
UNKNOWN_MAX_S: Final = 3.0
"""An unknown state withholds the advice when it has stood this long."""

NO_FORECAST: Final = (ModelAnswerError, EstimateLostError, np.linalg.LinAlgError)
"""What may go wrong with a forecast: it is withheld, with the reason."""
_NEEDED_CHANNELS: Final = ("disp_x", "disp_y", "supply_pressure")


Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Proposal:
    """A clearance (m) or None, with every reason.

    ``forecast`` holds one clearance: where it will be after the horizon; ``expectation`` says why
    there. ``sensed`` are the virtual sensors of this moment.
    """

    clearance_m: float | None
    reasons: list[str]
    forecast: Outlook | None = None
    expectation: str = ""
    estimate: Estimate | None = None
    unbalance_kg_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sensed: Outlook | None = None
    time_to_limit_s: tuple[float, float, float] | None = None


class PolicyState(msgspec.Struct):
    """What the policy remembers: the predictor's state (None without one) and its counts."""

    predictor: PredictorState | None
    counters: dict[str, int]


class Policy:
    """Actor and predictor together.

    Parameters
    ----------
    models
        Actor and surrogate; each may be absent.
    config
        Limits, ranges, actuator.
    """

    def __init__(self, models: Models, config: Config) -> None:
        self._config = config
        self._limits = OverruleLimits.of(config)
        self._models = models
        self._predictor = (
            Predictor(models.surrogate, config, models.factors) if models.surrogate else None
        )
        counted = ("proposals", "proposals_overruled", "proposals_withheld", "forecasts_refused")
        self._state = PolicyState(
            self._predictor.state if self._predictor else None, dict.fromkeys(counted, 0)
        )

    @property
    def state(self) -> PolicyState:
        """All that changes, the predictor's included."""
        return self._state

    @state.setter
    def state(self, state: PolicyState) -> None:
        self._state = state
        if self._predictor and state.predictor:
            self._predictor.state = state.predictor

    @property
    def counters(self) -> dict[str, int]:
        """Proposals made, overruled and withheld, forecasts refused."""
        return self._state.counters

    @property
    def qualified(self) -> bool:
        """Whether every model behind the advice may act."""
        used = (self._models.classifier, self._models.actor, self._models.surrogate)
        return all(model is not None and model.qualified for model in used)

    def learn(self, window: Window, orders: Orders) -> None:
        """Let a window with whole turns and readings improve the predictor's unbalance and
        runout."""
        seen = window_measured(window, orders)
        if self._predictor is None or seen is None:
            return
        try:
            self._predictor.learn(*seen)
        except NO_FORECAST:
            self.counters["forecasts_refused"] += 1

    def power_W(self, present: Present, estimate: Estimate, clearances_m: Floats) -> Floats:
        """Shaft power (n,) that is expected at each of ``clearances_m`` (n,), the rest as it is."""
        if self._predictor is None:
            return np.full(len(clearances_m), np.nan)
        return self._predictor.forecast(present.measured(), estimate, clearances_m).power_W[:, 1]

    def step(
        self,
        present: Present | None,
        diagnosis: Diagnosis | None,
        guard: GuardState | None,
        now_ns: int,
    ) -> Proposal:
        """The proposal for ``now_ns``."""
        reasons = self._missing_models() + self._doubts(present, diagnosis, now_ns)
        if present is None or self._predictor is None:
            return self._withheld(reasons)
        try:
            return self._propose(present, diagnosis, guard, reasons, self._predictor)
        except NO_FORECAST as error:
            self.counters["forecasts_refused"] += 1
            return self._withheld([*reasons, f"no forecast: {error}"])

    def _propose(
        self,
        present: Present,
        diagnosis: Diagnosis | None,
        guard: GuardState | None,
        reasons: list[str],
        predictor: Predictor,
    ) -> Proposal:
        measured = present.measured()
        estimate = predictor.estimate(measured)
        actor = self._models.actor
        wish_m = (
            self._wish(actor, present, diagnosis, guard, estimate, reasons)
            if actor and not reasons
            else None
        )
        chosen_m, overruled = None, ""
        if wish_m is not None:
            outlook = predictor.forecast(
                measured, estimate, np.append(self._candidates(guard), wish_m)
            )
            chosen_m, overruled = choose(
                outlook, present.clearance_m, _interval(guard), self._limits
            )
            self.counters["proposals_overruled"] += bool(overruled)
        self.counters["proposals" if chosen_m is not None else "proposals_withheld"] += 1
        expected_m, expectation = self._future(present, guard, chosen_m)
        forecast = predictor.forecast(measured, estimate, np.array([expected_m]))
        return Proposal(
            chosen_m,
            reasons,
            forecast,
            "; ".join(filter(None, (expectation, overruled))),
            estimate,
            predictor.unbalance_interval_kg_m,
            predictor.sense(measured, estimate),
            self._to_limit(measured, estimate, predictor),
        )

    def _to_limit(
        self, measured: Measured, estimate: Estimate, predictor: Predictor
    ) -> tuple[float, float, float] | None:
        """Time until a growing fault passes the limit of film or peak-to-peak; None while nothing
        grows."""
        if not predictor.growing(estimate):
            return None
        limits = self._config.limits
        swing_um = min(
            limits.displacement_danger_um, limits.clearance_share * measured.clearance_m * 1e6
        )
        return predictor.time_to_limit(
            measured, estimate, limits.min_film_um * 1e-6, swing_um * 1e-6
        )

    def _wish(
        self,
        actor: Model,
        present: Present,
        diagnosis: Diagnosis | None,
        guard: GuardState | None,
        estimate: Estimate,
        reasons: list[str],
    ) -> float | None:
        """What the actor wants, within what the guard admits; None (with reason) outside its
        domain."""
        share = diagnosis.evidence.get("subsync_share", 0.0) if diagnosis else 0.0
        values = observation(present, estimate.load_N, share)
        outside = actor.outside(values)
        if outside:
            reasons += outside
            return None
        row = np.array([[values[name] for name in OBSERVATION]])
        low_m, high_m = self._admitted(guard)
        return min(max(float(actor.session.run(row)["clearance"][0, 0]), low_m), high_m)

    def _admitted(self, guard: GuardState | None) -> tuple[float, float]:
        """Clearances (m) that the guard admits; the bearing's range while it admits none."""
        if guard is not None and guard.clearance_low_um < guard.clearance_high_um:
            return guard.clearance_low_um * 1e-6, guard.clearance_high_um * 1e-6
        bearing = self._config.machine.bearing
        return bearing.radial_clearance_min_um * 1e-6, bearing.radial_clearance_max_um * 1e-6

    def _candidates(self, guard: GuardState | None) -> Floats:
        """Clearances (m) from which a better one than the actor's is chosen: they span what is
        admitted."""
        return np.linspace(*self._admitted(guard), CANDIDATES)

    def _future(
        self, present: Present, guard: GuardState | None, wish_m: float | None
    ) -> tuple[float, str]:
        """Where the clearance will be after the horizon, and on what that rests."""
        actuator = self._config.machine.actuator
        target_m, why = present.clearance_m, "clearance held"
        if guard is not None and guard.node_following:
            target_m, why = guard.target_clearance_um * 1e-6, "clearance goes to the guard's target"
        if wish_m is not None and guard is not None and _acts(guard):
            target_m, why = wish_m, "clearance follows the advice"
        reach = actuator.rate_um_s * 1e-6 * max(0.0, HORIZON_S - actuator.time_constant_s)
        step = min(max(target_m - present.clearance_m, -reach), reach)
        return present.clearance_m + step, f"speed, load and oil held; {why}"

    def _missing_models(self) -> list[str]:
        return [f"no {kind}: {text}" for kind, text in self._models.refusals.items()]

    def _doubts(
        self, present: Present | None, diagnosis: Diagnosis | None, now_ns: int
    ) -> list[str]:
        """Every reason in the data not to propose anything."""
        return [*self._data_doubts(present, now_ns), *_diagnosis_doubts(diagnosis, now_ns)]

    def _data_doubts(self, present: Present | None, now_ns: int) -> list[str]:
        if present is None:
            return ["no gap-free samples of a turning shaft yet"]
        reasons = []
        sample_age, reading_age = now_ns - present.t_acq_ns, now_ns - present.reading_ns
        if sample_age > SAMPLE_AGE_MAX_NS:
            reasons.append(
                f"samples are {sample_age / 1e6:.0f} ms old (limit {SAMPLE_AGE_MAX_NS / 1e6:.0f})"
            )
        if reading_age > READING_AGE_MAX_NS:
            reasons.append(
                f"rig status is {reading_age / 1e6:.0f} ms old (limit "
                f"{READING_AGE_MAX_NS / 1e6:.0f})"
            )
        bad = [
            name for name in _NEEDED_CHANNELS if not present.channel_ok >> CHANNELS.index(name) & 1
        ]
        if bad:
            reasons.append(f"channel not OK: {', '.join(bad)}")
        return reasons

    def _withheld(self, reasons: list[str]) -> Proposal:
        self.counters["proposals_withheld"] += 1
        return Proposal(None, reasons)


def observation(present: Present, load_N: float, subsync_share: float) -> dict[str, float]:
    """The actor's observation by name (:data:`~firmware_py.brain.store.OBSERVATION`), SI."""
    values = (
        present.speed_rad_s,
        *present.mean_m,
        *present.peak_to_peak_m,
        present.clearance_m,
        present.supply_pressure_bar,
        present.shaft_power_W,
        present.oil_outlet_C,
        load_N,
        subsync_share,
    )
    return dict(zip(OBSERVATION, values, strict=True))


def _interval(guard: GuardState | None) -> tuple[float, float]:
    """Clearances (m) that the guard admits; everything before it has spoken."""
    return (
        (guard.clearance_low_um * 1e-6, guard.clearance_high_um * 1e-6) if guard else (0.0, np.inf)
    )


def _acts(guard: GuardState) -> bool:
    return guard.authority and guard.mode == Mode.AUTO and guard.arm_state == ArmState.ARMED


def _diagnosis_doubts(diagnosis: Diagnosis | None, now_ns: int) -> list[str]:
    """Verdicts that forbid a proposal.

    Doubt is none of them: it asks for more windows to tell which class it is, and no class by
    itself makes a clearance unsafe (the forecast and the guard judge that).  What was never taught
    is another matter.
    """
    if diagnosis is None:
        return ["no diagnosis yet"]
    age_ns = now_ns - diagnosis.t_acq_ns
    if age_ns > DIAGNOSIS_AGE_MAX_NS:
        return [
            f"the diagnosis is {age_ns / 1e9:.1f} s old (limit {DIAGNOSIS_AGE_MAX_NS / 1e9:.1f})"
        ]
    held_s = diagnosis.evidence.get("held_s", 0.0)
    if diagnosis.verdict == "whirl":
        return [
            f"whirl: {100 * diagnosis.evidence['subsync_share']:.0f} % of the orbit's energy at "
            f"half order"
        ]
    if diagnosis.verdict == "unknown" and held_s >= UNKNOWN_MAX_S:
        return [f"diagnosis unknown for {held_s:.1f} s"]
    if diagnosis.verdict == "none":
        return ["no diagnosis from the newest window"]
    return []
