"""What two sets of models say of one machine: counted side by side, and whether they still agree.

Every count and sum is one number under one name, so that what several runs of the brain have
counted is their sum.

=============================== =================================================================
name                            what is counted or summed up
=============================== =================================================================
decisions, agreed               diagnoses by as many windows as a diagnosis takes; the same word
said:A>B                        decisions in which the active said A and the other B
advices                         looks at both proposals, once a second
active_only, beside_only        of these, only one proposed
both, apart_um                  both did; absolute difference inside the guard's interval
priced, active_W, beside_W      power at both clearances, by the active predictor
SET_forecasts                   forecasts of SET (active, beside) that came true as assumed
SET_power_W, SET_swing_um       their absolute errors against what was then measured
SET_refused, SET_late           answers that were not finite, or later than models.deadline_ms
=============================== =================================================================
"""

from __future__ import annotations

from typing import Final, Literal

import msgspec
import numpy as np

from firmware_py.brain.observation import Present
from firmware_py.brain.policy import Policy, Proposal
from firmware_py.brain.prediction import HORIZON_S
from firmware_py.brain.verdict import WINDOWS
from firmware_py.config import ModelsConfig
from firmware_py.records import Diagnosis, GuardState

EVERY_NS: Final = 1_000_000_000
"""Between two looks at the proposals; a price costs as much as a forecast."""
HELD_UM: Final = 2.0
HELD_SHARE: Final = 0.01
"""A forecast came true as assumed when the clearance is this near to its own, and the speed has not
changed by more than that share."""

SetName = Literal["active", "beside"]


class Due(msgspec.Struct, frozen=True, array_like=True):
    """A forecast that waits for what comes."""

    of: SetName
    due_ns: int
    clearance_um: float
    speed_rad_s: float
    power_W: float
    swing_um: float


class ComparisonState(msgspec.Struct):
    """Counts, forecasts that wait, and the newest agreements (1: they disagreed)."""

    counts: dict[str, float] = {}
    due: list[Due] = []
    words: list[int] = []
    clearances: list[int] = []
    next_ns: int = 0


class Comparison:
    """Holds two sets against each other.

    Parameters
    ----------
    settings
        Table ``[models]``: how many decisions count, and how far clearances may lie apart.
    """

    def __init__(self, settings: ModelsConfig) -> None:
        self._most = settings.disagreement_decisions
        self._apart_um = settings.disagreement_um
        self.state = ComparisonState()

    def add(self, name: str, value: float = 1.0) -> None:
        """Count ``value`` under ``name``; nothing is no count."""
        if value:
            counts = self.state.counts
            counts[name] = counts.get(name, 0.0) + value

    def diagnoses(self, active: Diagnosis, beside: Diagnosis) -> None:
        """Hold two diagnoses of one window against each other."""
        if min(d.evidence.get("windows", 0.0) for d in (active, beside)) < WINDOWS:
            return  # one of them has not heard enough to be sure of anything
        said, would = (d.verdict.partition(":")[0] for d in (active, beside))
        self.add("decisions")
        self.add("agreed" if said == would else f"said:{said}>{would}")
        self.state.words = [*self.state.words, int(said != would)][-self._most :]

    def proposals(
        self,
        active: Proposal,
        beside: Proposal,
        present: Present,
        guard: GuardState | None,
        judge: Policy,
        now_ns: int,
    ) -> None:
        """Once a second: judge forecasts that are due, and hold two proposals against each other.

        Parameters
        ----------
        judge
            Whose predictor prices both.
        """
        state = self.state
        if now_ns < state.next_ns:
            return
        state.next_ns = now_ns + EVERY_NS
        self._came(present)
        for name, proposal in (("active", active), ("beside", beside)):
            if (due := _waiting(name, proposal, present, now_ns)) is not None:
                state.due.append(due)
        self.add("advices")
        at_m = [_inside(each.clearance_m, guard) for each in (active, beside)]
        if at_m[0] is None or at_m[1] is None:
            self.add("active_only", at_m[0] is not None)
            self.add("beside_only", at_m[1] is not None)
            apart = at_m[0] is not at_m[1]
        else:
            apart_um = abs(at_m[0] - at_m[1]) * 1e6
            self.add("both")
            self.add("apart_um", apart_um)
            apart = apart_um > self._apart_um
            self._price(active, present, [at_m[0], at_m[1]], judge)
        state.clearances = [*state.clearances, int(apart)][-self._most :]

    def _price(self, active: Proposal, present: Present, at_m: list[float], judge: Policy) -> None:
        if active.estimate is None:
            return
        power_W = judge.power_W(present, active.estimate, np.array(at_m))
        if np.isfinite(power_W).all():
            self.add("priced")
            self.add("active_W", float(power_W[0]))
            self.add("beside_W", float(power_W[1]))

    def _came(self, present: Present) -> None:
        """Judge the forecasts whose time has come by what is measured now."""
        state = self.state
        ripe = [due for due in state.due if present.t_acq_ns >= due.due_ns]
        state.due = [due for due in state.due if present.t_acq_ns < due.due_ns]
        for due in ripe:
            held = abs(present.clearance_m * 1e6 - due.clearance_um) <= HELD_UM
            drift = abs(present.speed_rad_s - due.speed_rad_s)
            if not (held and drift <= HELD_SHARE * due.speed_rad_s):
                continue
            swing_um = present.probe_peak_to_peak_m * 1e6
            self.add(f"{due.of}_forecasts")
            self.add(f"{due.of}_power_W", abs(present.shaft_power_W - due.power_W))
            self.add(f"{due.of}_swing_um", abs(swing_um - due.swing_um))

    def disagreement(self) -> tuple[float, str]:
        """Share of the newest decisions, of diagnosis or clearance, in which the two disagree, and
        which; 0 before there are enough."""
        shares = [
            (sum(found) / self._most, name)
            for name, found in (
                ("diagnoses", self.state.words),
                ("would-be clearances", self.state.clearances),
            )
            if len(found) == self._most
        ]
        return max(shares, default=(0.0, ""))


def _waiting(name: str, proposal: Proposal, present: Present, now_ns: int) -> Due | None:
    """The forecast of ``proposal``, as it will be judged."""
    outlook = proposal.forecast
    if outlook is None:
        return None
    return Due(
        "active" if name == "active" else "beside",
        now_ns + round(HORIZON_S * 1e9),
        float(outlook.clearance_m[0]) * 1e6,
        present.speed_rad_s,
        float(outlook.power_W[0, 1]),
        float(outlook.peak_to_peak_m[0, 1]) * 1e6,
    )


def _inside(clearance_m: float | None, guard: GuardState | None) -> float | None:
    """``clearance_m`` as the guard would clamp it; None: nothing is proposed."""
    if clearance_m is None or guard is None or guard.clearance_low_um >= guard.clearance_high_um:
        return clearance_m
    low_m, high_m = guard.clearance_low_um * 1e-6, guard.clearance_high_um * 1e-6
    return min(max(clearance_m, low_m), high_m)
