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
from firmware_py.config.instances import places
from firmware_py.machine import Machine
from firmware_py.records import CHANNELS, Diagnosis, Normal, Quality

WINDOWS: Final = 10
"""Windows whose features are averaged, as the authors voted over ten: noise falls before anything
is decided."""
DOUBT_BELOW: Final = 0.7
"""Probability of the best class under which the word is ``doubt``."""
CONFIRM_NS: Final = 3_000_000_000
"""A verdict held this long is confirmed."""
WHIRL_SHARE: Final = 0.3
WHIRL_CLEARANCE_SHARE: Final = 0.05
"""Whirl: the half-order band holds this share of the orbit's energy, with this amplitude per
clearance."""

_HISTORY_NS: Final = 6_000_000_000
_DRIVERS: Final = 3

CLASSES: Final[dict[str, tuple[int, ...]]] = {
    "normal": (),
    "pedestal_bolt_loose": (0,),
    "pedestal_two_bolts_loose": (0, 1),
    "motor_bolt_loose": (2,),
    "unbalance": (3,),
    "pedestal_and_motor_bolt_loose": (0, 2),
}
"""Heads that each of the six classes switches on."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Answer:
    """What the model says of the last windows.

    ``heads`` (4,) probabilities beyond what this machine shows when healthy, ``log_odds`` (4,) as
    the model gives them; ``score``: novelty by the model; ``own``: distances of each part and of
    the first order from the normal state, 1 at their limits; ``drivers`` (groups, 4) in log-odds;
    ``departures`` (groups,); ``normal`` (k,) whitened residuals.
    """

    heads: Floats
    log_odds: Floats
    score: float
    drivers: Floats
    departures: Floats
    normal: Floats | None
    own: dict[str, float]


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
        self._threshold = _setting(model, "novelty_threshold", math.inf)
        self._named_above = _odds_by_fault(model)
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
        classes = class_probabilities(answer.heads) if answer else {}
        verdict = self._verdict(window, orders, bad, classes, answer)
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
        given = np.clip(said["heads"][0], 1e-6, 1 - 1e-6)
        log_odds = np.log(given / (1.0 - given))
        quiet = np.array(self.normal.quiet) if self.normal else np.zeros(len(HEADS))
        rows = said["normal"] if self._detector else None
        away = (
            self._detector.by_part(rows)[0].tolist() if self._detector and rows is not None else []
        )
        return Answer(
            heads=1.0 / (1.0 + np.exp(quiet - log_odds)),
            log_odds=log_odds,
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
        self,
        window: Window,
        orders: Orders | None,
        bad: list[str],
        classes: dict[str, float],
        answer: Answer | None,
    ) -> str:
        if bad:
            return f"sensor_fault:{'+'.join(bad)}"
        if orders is None:
            return "none"
        if is_whirl(orders, window.clearance_m):
            return "whirl"
        if self._absent:
            return f"no_channel:{'+'.join(self._absent)}"
        if answer is None or window.end_ns != self._state.windows[-1].end_ns:
            return "none"
        best = max(classes, key=lambda name: classes[name])
        if self._is_unknown(answer, best, classes[best]):
            return "unknown"
        sure = classes[best] >= max(
            DOUBT_BELOW, self._named_above.get(best, 0.0) * classes["normal"]
        )
        return best if sure and len(self._state.windows) == WINDOWS else "doubt"

    def _is_unknown(self, answer: Answer, best: str, probability: float) -> bool:
        """Unlike all that was taught; on a commissioned machine, unlike its own normal and no fault
        that was taught."""
        strange = answer.score > self._threshold
        if self.normal is None:
            return strange
        taught = best != "normal" and probability >= DOUBT_BELOW and not strange
        return max(answer.own.values()) > 1.0 and not taught

    def _evidence(
        self, window: Window, orders: Orders | None, answer: Answer | None, verdict: str
    ) -> dict[str, float]:
        """Why: the amplitudes behind the verdict, what drove it, and for how long it has stood."""
        state = self._state
        if verdict != state.verdict:
            state.verdict, state.held_since_ns = verdict, window.end_ns
        held_ns = window.end_ns - state.held_since_ns
        evidence = {
            "windows": float(len(state.windows)),
            "held_s": held_ns * 1e-9,
            "confirmed": float(held_ns >= CONFIRM_NS),
        }
        if answer is not None:
            evidence |= {"novelty": answer.score, "novelty_threshold": self._threshold}
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


def class_probabilities(heads: Floats) -> dict[str, float]:
    """Probabilities of the six classes from four independent heads, normalised over the six."""
    joint = {
        name: math.prod(p if i in on else 1 - p for i, p in enumerate(heads.tolist()))
        for name, on in CLASSES.items()
    }
    total = sum(joint.values())
    return {name: value / total for name, value in joint.items()}


def is_whirl(orders: Orders, clearance_m: float) -> bool:
    """Whether a forward half-order orbit of notable size stands beside the first order."""
    return (
        orders.subsync_share > WHIRL_SHARE
        and orders.half_forward > WHIRL_CLEARANCE_SHARE * clearance_m
    )


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


def _setting(model: Model | None, name: str, default: float) -> float:
    """A limit from the model's metadata."""
    value = model.card.settings.get(name) if model else None
    return float(value) if isinstance(value, int | float) else default


def _odds_by_fault(model: Model | None) -> dict[str, float]:
    """Odds against normal from which each fault is named, chosen in training for the rate of false
    alarms."""
    given = model.card.settings.get("named_above") if model else None
    return {str(k): float(v) for k, v in given.items()} if isinstance(given, dict) else {}
