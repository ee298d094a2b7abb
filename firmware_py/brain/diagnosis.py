"""The diagnosis: from the features of the last windows to one word that a person can act on (ISO
13374 HA).

In this order: ``sensor_fault:CHANNEL`` (a bad channel is never called a machine fault), ``none``
(nothing to judge from), ``whirl`` (from clearance or light load, told to the policy),
``no_channel:CHANNEL`` (the rig has not what the model was taught with), ``unknown``
(unlike everything that was taught), ``doubt`` (more windows, please), then one of the six classes.
Beside it stands *why*: what was measured, how the first order has moved, and which channels drove
the verdict.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import GROUPS, at_one_rate, from_orders
from firmware_py.acquire.orders import Orders, analyse
from firmware_py.acquire.windows import Window
from firmware_py.brain.baseline import BaselineState, FirstOrderBaseline
from firmware_py.brain.errors import ModelAnswerError
from firmware_py.brain.normal import (
    Detector,
    baseline_at,
    digest,
    first_order_distance,
    operating_point,
    prior_of,
)
from firmware_py.brain.store import HEADS, Model
from firmware_py.brain.verdict import (
    CLASSES,
    CONFIRM_NS,
    NO_CHANNEL,
    SENSOR_FAULT,
    WINDOWS,
    WORDS,
    Found,
    VerdictLimits,
    class_probabilities,
    held_since_ns,
    is_whirl,
    log_odds,
    verdicts,
)
from firmware_py.config.instances import places
from firmware_py.machine import Machine
from firmware_py.records import CHANNELS, Diagnosis, Normal, Quality

_HISTORY_NS: Final = 6_000_000_000
_DRIVERS: Final = 3

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Answer:
    """What the model says of the last windows.

    ``beyond`` (4,) log-odds beyond what this machine shows when healthy, ``log_odds`` (4,) as
    the model gives them; ``score``: novelty by the model; ``own``: distances of each part and of
    the first order from the normal state, 1 at their limits; ``drivers`` (groups, 4) in log-odds;
    ``departures`` (groups,); ``normal`` (k,) whitened residuals.
    """

    beyond: Floats
    log_odds: Floats
    score: float
    drivers: Floats
    departures: Floats
    normal: Floats | None
    own: dict[str, float]

    @property
    def heads(self) -> Floats:
        """Probabilities (4,) beyond what this machine shows when healthy."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.beyond)))


class Features(msgspec.Struct, frozen=True, array_like=True):
    """Features ``vector`` (n,) of the window that ended at ``end_ns``."""

    end_ns: int
    vector: Floats


class DiagnoserState(msgspec.Struct):
    """What the diagnoser remembers: ``held_since_ns`` is since when ``verdict`` has stood."""

    baseline: BaselineState
    normal: Normal | None = None
    windows: list[Features] = []
    verdict: str = "none"
    held_since_ns: int = 0
    seq: int = 0
    model_answers_refused: int = 0


class Diagnoser:
    """Turns windows into diagnoses.

    Parameters
    ----------
    model
        ``classifier.onnx``; without it the verdict is ``none`` (or whirl, or a sensor fault).
    machine
        Whose readings they are; without one of the standard channels only whirl is told.
    slow_roll_m
        Forward first order of the probes' runout, complex, phase from the mark.
    """

    def __init__(self, model: Model | None, machine: Machine, slow_roll_m: complex = 0j) -> None:
        self._absent = places(machine.channel).absent
        self._model = model
        self._machine = machine
        self._limits = VerdictLimits.of(model.card.settings if model else {})
        self._slow_roll_m = slow_roll_m
        self.prior = prior_of(model)
        self.normal_name = ""
        self.answer: Answer | None = None
        self._detector = Detector(self.prior) if self.prior else None
        self._baseline = FirstOrderBaseline()
        self._state = DiagnoserState(self._baseline.state)

    @property
    def state(self) -> DiagnoserState:
        """All that changes, the baseline's included."""
        return self._state

    @state.setter
    def state(self, state: DiagnoserState) -> None:
        self._state, self._baseline.state = state, state.baseline
        self.use(state.normal)

    @property
    def normal(self) -> Normal | None:
        """The machine's own normal state; None: the fleet's."""
        return self._state.normal

    @property
    def counters(self) -> dict[str, int]:
        """Diagnoses given and answers of the model refused."""
        state = self._state
        return {"diagnoses": state.seq, "model_answers_refused": state.model_answers_refused}

    def use(self, normal: Normal | None) -> None:
        """Judge against this machine's own state from now on; None: against the fleet."""
        self._state.normal = normal if self.prior else None
        self.normal_name = digest(self.normal) if self.normal else ""
        self._detector = Detector(self.prior, self.normal) if self.prior else None

    def step(self, window: Window) -> tuple[Diagnosis, Orders | None]:
        """Diagnosis after ``window``, and the window's order analysis (None without usable
        turns)."""
        window = at_one_rate(window)
        orders = None if window.quality & Quality.NO_MARK else analyse(window)
        bad = [
            name
            for index, name in enumerate(CHANNELS)
            if not window.channel_ok >> index & 1 and name not in self._absent
        ]
        if self._model is not None and orders is not None and not bad and not self._absent:
            self._hear(window, orders)  # a model comes only at a rate that has its features
        windows = self._state.windows
        while windows and window.end_ns - windows[0].end_ns > _HISTORY_NS:
            windows.pop(0)
        answer = self.answer = self._ask(window, orders)
        classes = _by_class(answer) if answer else {}
        verdict = self._verdict(window, orders, bad, answer)
        self._state.seq += 1
        record = Diagnosis(
            seq=self._state.seq,
            t_acq_ns=window.end_ns,
            quality=int(window.quality),
            verdict=verdict,
            probability=classes.get(verdict, max(classes.values(), default=0.0)),
            heads=dict(zip(HEADS, answer.heads.tolist(), strict=True)) if answer else {},
            classes=classes,
            doubt=verdict == "doubt",
            unknown=verdict == "unknown",
            evidence=self._evidence(window, orders, answer, verdict),
            model=self._model.label if self._model else "",
        )
        return record, orders

    def _hear(self, window: Window, orders: Orders) -> None:
        """Keep the features of one window; those that rest on a missing reading are left out."""
        vector = from_orders(window, orders, self._machine).astype(np.float64)
        if np.isfinite(vector).all():
            windows = self._state.windows
            windows.append(Features(window.end_ns, vector))
            del windows[:-WINDOWS]

    def _ask(self, window: Window, orders: Orders | None) -> Answer | None:
        """The model's answer on the mean features; None without a model, windows or a finite
        answer."""
        if self._model is None or not self._state.windows:
            return None
        mean = np.mean([features.vector for features in self._state.windows], axis=0)
        try:
            said = self._model.session.run(mean[None, :])
        except ModelAnswerError:
            self._state.model_answers_refused += 1
            return None
        odds = log_odds(said["heads"][0])
        quiet = np.array(self.normal.quiet) if self.normal else np.zeros(len(HEADS))
        rows = said["normal"] if self._detector else None
        away = (
            self._detector.by_part(rows)[0].tolist() if self._detector and rows is not None else []
        )
        return Answer(
            beyond=odds - quiet,
            log_odds=odds,
            score=float(said["score"][0, 0]),
            drivers=said.get("drivers", np.zeros((1, 0)))[0].reshape(-1, len(HEADS)),
            departures=said.get("departures", np.zeros((1, 0)))[0],
            normal=rows[0] if rows is not None else None,
            own=(dict(zip(self.prior.parts, away, strict=True)) if self.prior else {})
            | self._moved(window, orders),
        )

    def _moved(self, window: Window, orders: Orders | None) -> dict[str, float]:
        """How far the first order of a commissioned machine has moved."""
        if self.normal is None or orders is None or not math.isfinite(window.clearance_m):
            return {}
        first_order_m = forward_first_order(orders) - self._slow_roll_m
        return first_order_distance(self.normal, operating_point(window, orders), first_order_m)

    def _verdict(
        self, window: Window, orders: Orders | None, bad: list[str], answer: Answer | None
    ) -> str:
        """The word, with the names of the channels that it is about."""
        word = int(verdicts(self._found(window, orders, bad, answer), self._limits)[0])
        about = {SENSOR_FAULT: bad, NO_CHANNEL: self._absent}.get(word)
        return f"{WORDS[word]}:{'+'.join(about)}" if about else WORDS[word]

    def _found(
        self, window: Window, orders: Orders | None, bad: list[str], answer: Answer | None
    ) -> Found:
        """What the verdict on ``window`` rests on: one row."""
        kept = self._state.windows
        answered = answer is not None and window.end_ns == kept[-1].end_ns
        whirl = orders is not None and is_whirl(
            np.array([orders.subsync_share]),
            np.array([orders.half_forward]),
            np.array([window.clearance_m]),
        )
        own = max(answer.own.values()) if answer and self.normal else math.nan
        return Found(
            answer.beyond[None] if answer else np.zeros((1, len(HEADS))),
            np.array([answer.score if answer else math.nan]),
            np.array([own]),
            np.array([bool(whirl)]),
            np.array([len(kept)]),
            bad=np.array([bool(bad)]),
            turning=np.array([orders is not None]),
            answered=np.array([answered]),
            absent=bool(self._absent),
        )

    def _evidence(
        self, window: Window, orders: Orders | None, answer: Answer | None, verdict: str
    ) -> dict[str, float]:
        """Why: the amplitudes behind the verdict, what drove it, and for how long it has stood."""
        state = self._state
        words, ends = [state.verdict, verdict], [state.held_since_ns, window.end_ns]
        state.verdict = verdict
        state.held_since_ns = int(held_since_ns(np.array(words), np.array(ends))[-1])
        held_ns = window.end_ns - state.held_since_ns
        evidence = {
            "windows": float(len(state.windows)),
            "held_s": held_ns * 1e-9,
            "confirmed": float(held_ns >= CONFIRM_NS),
        }
        if answer is not None:
            evidence |= {"novelty": answer.score, "novelty_threshold": self._limits.novelty}
            evidence |= {f"normal_{part}": value for part, value in answer.own.items()}
            evidence |= drivers(answer.drivers, verdict) | departures(answer.departures, verdict)
        if orders is None:
            self._baseline.drop()
            return evidence
        return evidence | amplitudes(orders) | self._first_order(window, orders, verdict)

    def _first_order(self, window: Window, orders: Orders, verdict: str) -> dict[str, float]:
        """The orbit's forward first order without the runout, its baseline, and its move from
        there.

        The baseline is the commissioned one at this operating point; without it, what stayed normal
        near here.  Where neither is known no move is told.
        """
        forward_m = forward_first_order(orders) - self._slow_roll_m
        found = {
            "shaft_1x_compensated_um": abs(forward_m) * 1e6,
            "shaft_1x_phase_deg": math.degrees(cmath.phase(forward_m)),
        }
        if not (math.isfinite(window.clearance_m) and window.clearance_m > 0.0):
            self._baseline.drop()
            return found
        point = operating_point(window, orders)
        self._baseline.note(window.end_ns, point, forward_m, normal=verdict == "normal")
        base_m = self._baseline.at(point)
        if self.normal is not None:
            um = baseline_at(self.normal.baseline, point)
            base_m = um * 1e-6 if um is not None else None
            found["shaft_1x_baseline_scatter_um"] = self.normal.baseline.scatter_um
        if base_m is not None:
            found |= {
                "shaft_1x_baseline_um": abs(base_m) * 1e6,
                "shaft_1x_baseline_phase_deg": math.degrees(cmath.phase(base_m)),
                "shaft_1x_move_um": abs(forward_m - base_m) * 1e6,
            }
        return found


def forward_first_order(orders: Orders) -> complex:
    """Forward first order of the orbit ``x + jy``, m, phase from the mark."""
    return complex(0.5 * (orders.harmonics[0, 0] + 1j * orders.harmonics[1, 0]))


def drivers(log_odds: Floats, verdict: str) -> dict[str, float]:
    """The groups of features that did most for ``verdict``: log-odds that its heads gained by
    them."""
    if verdict not in CLASSES or not log_odds.size:
        return {}
    sign = np.array([1.0 if head in CLASSES[verdict] else -1.0 for head in range(len(HEADS))])
    gained = log_odds @ sign
    first = np.argsort(-gained, kind="stable")[:_DRIVERS]
    return {f"driver_{GROUPS[i]}": float(gained[i]) for i in first if gained[i] > 0.0}


def departures(sizes: Floats, verdict: str) -> dict[str, float]:
    """The groups of features that lie farthest from a healthy machine at this operating point, in
    its scatters."""
    if verdict != "unknown" or not sizes.size:
        return {}
    return {
        f"departure_{GROUPS[i]}": float(sizes[i])
        for i in np.argsort(-sizes, kind="stable")[:_DRIVERS]
    }


def _by_class(answer: Answer) -> dict[str, float]:
    """Probabilities of the six classes by name."""
    return dict(zip(CLASSES, class_probabilities(answer.beyond[None])[0].tolist(), strict=True))


def amplitudes(orders: Orders) -> dict[str, float]:
    """The full spectrum, orders and levels in the units of a report (um, m/s2)."""
    shaft = {
        f"shaft_{way}_{k}x_um": float(value) * 1e6
        for way, values in (("forward", orders.forward), ("backward", orders.backward))
        for k, value in enumerate(values, 1)
    }
    acceleration = {
        f"{CHANNELS[c]}_{what}_m_s2": float(value)
        for c in (2, 3, 4)
        for what, value in (
            ("rms", orders.rms[c]),
            ("1x", abs(orders.harmonics[c, 0])),
            ("2x", abs(orders.harmonics[c, 1])),
        )
    }
    return (
        shaft
        | acceleration
        | {
            "speed_rpm": orders.speed_rad_s * 30 / math.pi,
            "shaft_half_um": orders.half_forward * 1e6,
            "shaft_half_backward_um": orders.half_backward * 1e6,
            "shaft_not_1x_um": float(np.hypot(orders.not_1x[0], orders.not_1x[1])) * 1e6,
            "subsync_share": orders.subsync_share,
            "centre_x_um": float(orders.mean[0]) * 1e6,
            "centre_y_um": float(orders.mean[1]) * 1e6,
        }
    )
