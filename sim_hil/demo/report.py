"""The demo's result: one dictionary with the keys that programs read, and the words that people
read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from firmware_py.records import Severity
from sim_hil.demo.counterfactual import Counterfactual
from sim_hil.demo.host import HostTiming
from sim_hil.demo.observer import StoryObserver, StoryTruth
from sim_hil.demo.scores import FaultScore, FilmScore, ForecastScore, KillScore
from sim_hil.demo.story import Story

TARGET_SAFE_MS: Final = 1000.0
"""A killed brain must leave the node's target at the retreat value within this."""

POWER_FORECAST_PCT: Final = 10.0


@dataclass(frozen=True)
class BusCount:
    """Sample frames from the rig to the guard."""

    interface: str
    frames_expected: int
    frames_in: int
    frames_lost: int
    blocks_lost: int


@dataclass(frozen=True)
class LoopTiming:
    """The guard's cycle; zero lateness on the simulated clock by construction."""

    rate_hz: float
    late_share: float
    lateness_ms: dict[str, float]


@dataclass(frozen=True)
class Outcome:
    """Everything that was measured in one demo."""

    story: Story
    observer: StoryObserver
    duty_truth: list[StoryTruth]
    bus: BusCount
    host: HostTiming
    lag_ms_max: float
    loop: LoopTiming
    latency: dict[str, Any]
    faults: list[FaultScore]
    forecast: ForecastScore
    film: FilmScore
    kills: list[KillScore]
    counterfactual: Counterfactual
    lacking: Mapping[str, str] = field(default_factory=dict)
    """What the device lacks on this machine, of `CLASSIFIER` and `COMMAND`, and why."""

    @property
    def actual_W(self) -> float:
        """Mean shaft power of the duty act."""
        return sum(truth.power_W for truth in self.duty_truth) / len(self.duty_truth)

    @property
    def trips(self) -> list[dict[str, Any]]:
        """Trips that the guard latched."""
        return [
            {"t_s": round(t_s, 2), "name": event.name, "text": event.text}
            for t_s, event in self.observer.events
            if event.severity == Severity.DANGER and event.name == "tripped"
        ]


CLASSIFIER, COMMAND = "classifier", "command"

TERMS: Final[dict[str, Callable[[Outcome], bool]]] = {
    "no frame or block lost": lambda o: o.bus.frames_lost == 0 and o.bus.blocks_lost == 0,
    "film never below its limit": lambda o: o.film.violation_s == 0.0,
    "every fault named": lambda o: all(fault.correct for fault in o.faults),
    "less power than the fixed nominal clearance": lambda o: (
        o.actual_W < o.counterfactual.nominal_fixed_W
    ),
    f"power forecast within {POWER_FORECAST_PCT:g} % (p95)": lambda o: (
        o.forecast.power_error_pct_p95 is not None
        and o.forecast.power_error_pct_p95 <= POWER_FORECAST_PCT
    ),
    f"target safe within {TARGET_SAFE_MS:g} ms of a kill, process back": lambda o: all(
        kill.target_safe_ms is not None
        and kill.target_safe_ms <= TARGET_SAFE_MS
        and kill.back_s is not None
        for kill in o.kills
    ),
    "no trip": lambda o: not o.trips,
    "latencies measured": lambda o: (
        not any(isinstance(found, dict) and "failed" in found for found in o.latency.values())
    ),
}
"""``ok`` is the conjunction of these; ``failed_terms`` names those that do not hold."""

NEEDS: Final = {
    "every fault named": CLASSIFIER,
    "less power than the fixed nominal clearance": COMMAND,
    f"power forecast within {POWER_FORECAST_PCT:g} % (p95)": COMMAND,
    f"target safe within {TARGET_SAFE_MS:g} ms of a kill, process back": COMMAND,
}
"""Terms that a device without that cannot hold: they are named and not judged."""


def as_dict(outcome: Outcome) -> dict[str, Any]:
    """The result under its published keys."""
    missing = {name: outcome.lacking[k] for name, k in NEEDS.items() if k in outcome.lacking}
    failed = [n for n, holds in TERMS.items() if n not in missing and not holds(outcome)]
    estimate = _device_estimate_W(outcome)
    actual = outcome.actual_W
    return {
        "duration_s": outcome.story.seconds,
        "seed": outcome.story.seed,
        "bus": asdict(outcome.bus),
        "host": asdict(outcome.host),
        "rig": {"lag_ms_max": round(outcome.lag_ms_max, 2)},
        "loop": asdict(outcome.loop),
        "latency_ms": outcome.latency,
        "faults": [_fault_dict(fault) for fault in outcome.faults],
        "forecast": asdict(outcome.forecast),
        "power": {
            "actual_W": round(actual, 2),
            "source": "the rig's own truth, mean over the duty act",
            "device_estimate_W": estimate,
            "estimate_error_pct": None
            if estimate is None
            else round(100 * (estimate - actual) / actual, 2),
            "counterfactual": asdict(outcome.counterfactual),
        },
        "film": asdict(outcome.film),
        "kills": [asdict(kill) for kill in outcome.kills],
        "trips": outcome.trips,
        "ok": not failed,
        "ok_is": "all of: " + "; ".join(TERMS),
        "failed_terms": failed,
        "not_judged": missing,
    }


def _fault_dict(fault: FaultScore) -> dict[str, Any]:
    found = asdict(fault)
    for key in ("injected_s", "probability", "delay_s"):
        found[key] = None if found[key] is None else round(found[key], 3)
    return {**found, "correct": fault.correct}


def _device_estimate_W(outcome: Outcome) -> float | None:
    """Mean of the device's own power forecasts during the duty act."""
    start_s, end_s = outcome.duty_truth[0].t_s, outcome.duty_truth[-1].t_s
    expected = [
        forecast.power_W[1] for t, forecast in outcome.observer.forecasts if start_s <= t <= end_s
    ]
    return round(sum(expected) / len(expected), 2) if expected else None


def summary(result: dict[str, Any]) -> list[str]:
    """The result in a person's words."""
    power, bus = result["power"], result["bus"]
    fixed = power["counterfactual"]
    lines = [
        f"bus       {bus['frames_in']} of {bus['frames_expected']} sample frames, "
        f"{bus['frames_lost']} lost",
        f"power     {power['actual_W']:.1f} W in the duty; the nominal clearance held fixed would "
        f"burn "
        f"{fixed['nominal_fixed_W']:.1f} W "
        f"({_saving(power['actual_W'], fixed['nominal_fixed_W'])})",
    ]
    if fixed["best_um"] is not None:
        lines.append(
            f"          the best fixed clearance in hindsight ({fixed['best_um']:.0f} um): "
            f"{fixed['best_feasible_fixed_W']:.1f} W "
            f"({_saving(power['actual_W'], fixed['best_feasible_fixed_W'])})"
        )
    lines += [_fault_line(fault) for fault in result["faults"]]
    forecast = result["forecast"]
    if forecast["scored"]:
        lines.append(
            f"forecast  {forecast['horizon_s']:.0f} s ahead: power within "
            f"{forecast['power_error_pct_p95']:.1f} %, "
            f"orbit within {forecast['peak_to_peak_error_pct_p95']:.0f} % (95 % of "
            f"{forecast['scored']})"
        )
    film = result["film"]
    lines.append(
        f"film      {film['min_um']:.1f} um at least; {film['violation_s']:.1f} s below the limit"
    )
    lines += [_kill_line(kill) for kill in result["kills"]]
    lines += [f"trip      at {trip['t_s']:.1f} s: {trip['text']}" for trip in result["trips"]]
    lines += _latency_lines(result["latency_ms"])
    verdict = "all held" if result["ok"] else "did not hold: " + "; ".join(result["failed_terms"])
    missing = [f"missing   {name}: {why}" for name, why in result["not_judged"].items()]
    return [*lines, *missing, f"verdict   {verdict}"]


def _latency_lines(latency: dict[str, Any]) -> list[str]:
    """The guard's reaction, where it was measured or failed to be."""
    reaction = latency["exceedance_to_safe"]
    if reaction is None:
        return []
    if "failed" in reaction:
        return [f"reaction  not measured: {reaction['failed'].splitlines()[-1]}"]
    return [
        f"reaction  from danger to the safe command in {reaction['p50']:.1f} ms, at most "
        f"{reaction['max']:.1f} in {reaction['trials']} trials without the delay"
    ]


def _saving(actual_W: float, other_W: float) -> str:
    share = 100 * (other_W - actual_W) / other_W
    return f"{share:.1f} % saved" if share >= 0 else f"{-share:.1f} % more burnt"


def _fault_line(fault: dict[str, Any]) -> str:
    told = f"fault     {fault['name']} ({fault['severity']:g}) "
    if fault["named"] is None:
        return told + "was not named"
    verdict = "named" if fault["correct"] else "WRONGLY named"
    beside = "".join(f", also {name}" for name in fault["also_named"])
    return told + (
        f"{verdict} {fault['named']} after {fault['delay_s']:.1f} s, "
        f"{100 * fault['probability']:.0f} %{beside}"
    )


def _kill_line(kill: dict[str, Any]) -> str:
    safe = "never" if kill["target_safe_ms"] is None else f"after {kill['target_safe_ms']:.0f} ms"
    there = (
        "not in time" if kill["arrived_safe_s"] is None else f"after {kill['arrived_safe_s']:.1f} s"
    )
    back = "not back" if kill["back_s"] is None else f"back after {kill['back_s']:.1f} s"
    return f"kill      {kill['process']}: target safe {safe}, clearance there {there}, {back}"
