"""The model card: what a model is for, how it was made, what it reached, what it does not do."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_py.brain.store import STATUS_TEXT
from models import PHYSICS_VERSION
from models.diagnosis.real_figures import REAL_SENTENCE
from models.manifest import write_whole
from models.runs import TrainingRun, without_places

_FROZEN = "## Frozen evaluation"


@dataclass(frozen=True)
class Prose:
    """The sentences of a card that no measurement gives."""

    title: str
    purpose: str
    limits: tuple[str, ...]


SURROGATE = Prose(
    "Film-force surrogate",
    "Force on the journal, friction torque and side flow of a plain aligned unfed film (Reynolds "
    "rupture, "
    "periodic, ambient ends) for the predictor in the brain.",
    (
        "One length over diameter (see `domain`); any speed, viscosity, clearance and radius.",
        "No feed, groove, tilt, wear or film memory; a moving clearance is not among its inputs.",
        "Beyond eccentricity ratio 0.98 the film keeps the shape it has there.",
    ),
)


CLASSIFIER = Prose(
    "Fault classifier",
    "Probabilities of four faults (pedestal bolt A, pedestal bolt B, motor bolt, unbalance) from "
    "the mean features of "
    "ten windows, each head on features of its own (bolts: ringing of pedestal and motor; "
    "unbalance: the first order "
    "of film, orbit and accelerations, and what the film lets it be), a novelty score, what drove "
    "each head, and what "
    "is normal for one machine; the brain derives six classes.",
    (
        f"All figures above are of simulated builds.  {REAL_SENTENCE}",
        "Trained on simulated builds of one rig only; a measured machine is another matter.  The "
        "features that hold "
        "film, position and power against each other know the sizes and the oil of that rig.",
        "A bolt at 75 % and grade G6.3 are not found, one at 50 % in part (see the grid): slight "
        "faults weigh a tenth "
        "in training, because one bolt without preload and two bolts at half of it change the "
        "modes alike.",
        "A fault is named only from its odds against normal in `named_above` on, a hundred to one "
        "at the least: a "
        "limit for each by extrapolation from healthy decisions of networks that had not seen "
        "their build; their tail "
        "is taken as bounded or exponential.  What stricter limits cost in delay stands in "
        "`limits_traded`.",
        "A machine-month is counted as 720 operating points, one an hour, each entered as the "
        "watched runs are.  By "
        "hours as eventful as the watched ones a month without alarm is not shown: see that limit "
        "beside it.",
        "A rub is judged where the shaft touches; one that the shaft has left cannot be told from "
        "a healthy machine.  "
        "A light one shows in the power alone, where the errors of oil, clearance and power "
        "reading hide it.",
        "Where the device says whirl no class is judged.  The words of the device stand beside the "
        "classes.",
        "Features, novelty parts, the weight of slight faults and the choice of a rung by log "
        "score were settled with "
        "builds of judge seed 100 in view, the least odds with the healthy ones of seeds 5 and "
        "20001; the figures here "
        "are of other seeds.",
        "The agent in the recorded loops is the guard's shield with a wish for a wide clearance, "
        "not the trained net.",
    ),
)


ACTOR = Prose(
    "Clearance policy",
    "Radial bearing clearance of least power from what a rig can measure; a proposal that the "
    "predictor checks "
    "and the guard's shield clamps.",
    (
        "The clearance alone: behind the shield nearly every wish that is wide enough gives the "
        "same power, for the "
        "shield's upper bound is where the power is least; `widest`, a constant wish, shows what "
        "it gives alone.",
        "The pair: `actor_pair.onnx` sets the supply pressure too, on the film fed from the "
        "groove.  The device does "
        "not run it; it sets the clearance only.  The predictor knows the unfed film, so no "
        "model-predictive choice "
        "stands on that board, and no direct Reynolds film.",
        "DDPG ships only if it needs less power than the lookup table at no more violation "
        "(`shipped` says which "
        "did); `actor_ddpg.onnx` is the best agent, `actor_lookup.onnx` the table.",
        "Trained and judged on one simulated rig.",
        "A figure of saving means nothing without its baseline: gap shares stand against the one "
        "fixed setting that "
        "keeps every limit in all judged episodes, and against the two reference schedules.  "
        "Episodes in which no "
        "preview schedule keeps the limits are not counted; there violation is told beyond the "
        "least one.",
    ),
)


PREDICTOR = Prose(
    "Predictor",
    "Factors that stretch the intervals of the surrogate-based forecasts (power, peak-to-peak, "
    "smallest film, whirl "
    "margin) so that they cover what they say, by regime and by state of the probes.",
    (
        "Fitted on simulated episodes of one rig: a start at the slowest speed, a run-up, "
        "forecasts of two seconds.",
        "The start matters: the slow shaft is what tells the power channel's offset from the oil's "
        "viscosity.",
        "The contact channel's law is known to 2 % here; the rig's data file gives no error "
        "for it.",
        "Growing faults are fast (seconds); slower ones are easier to follow and harder to see in "
        "ten seconds.",
        "The first forecast comes 2.5 s after a fault's start: its rate is still underestimated, "
        "and the expected time "
        "to a limit late.",
        "The device knows the regime that it recognises (one growing fault in seven is not, yet); "
        "the factors are set "
        "so that the true regimes are covered all the same.",
        "`predicted_deviation` is what the filter expects of its own error by its noise model, "
        "which allows for more than this simulator does: errors may lie below it.  It is no bound "
        "that other estimators could not pass.",
    ),
)


DATA = {
    "surrogate": "Solutions of the Reynolds equation (`sim_hil.film`) at points drawn from the "
    "seed; judged on a finer "
    "mesh at points of another seed.",
    "surrogate_fed": "Solutions of the Reynolds equation of the grooved, pressure-fed film at "
    "points drawn from the "
    "seed; judged on a finer mesh at points of another seed.",
    "predictor": "Episodes of the whole machine in software: builds, sensor errors, duties and "
    "growing faults drawn "
    "from the seed within the spreads of the rig folder; judged on episodes of another seed.",
    "classifier": "Recordings of builds of the machine in software, one group a build; "
    "judged on builds of another seed.  Measured recordings: see `docs/recordings.md`.",
    "actor": "Episodes of the machine in software, drawn as the agent learns; judged on episodes "
    "of other seeds.",
}
"""Where each model's data come from."""


def write(run: TrainingRun, report: Mapping[str, object], prose: Prose) -> None:
    """Write ``<kind>.md``, the model card, and ``data.md``, the data card, beside the model."""
    settings = json.dumps(without_places(run.settings), indent=2, sort_keys=True)
    lines = [
        f"# {prose.title}",
        "",
        prose.purpose,
        "",
        "Status: **provisional**.",
        "",
        "## Reproduce",
        "",
        f"    {run.command}",
        "",
        f"The run that wrote this took {run.minutes:.1f} min on {len(os.sched_getaffinity(0))} "
        f"cores; what an earlier "
        "one had kept in its folder was not made again.",
        "",
        "## Measured",
        "",
        "```json",
        json.dumps(report, indent=2, sort_keys=True),
        "```",
        "",
        "## Limits",
        "",
        *(f"- {limit}" for limit in prose.limits),
        "",
        "## Settings",
        "",
        "```json",
        settings,
        "```",
        "",
    ]
    (run.folder / f"{run.kind}.md").write_text("\n".join(lines), encoding="utf-8")
    data = [
        f"# Data of {prose.title.lower()}",
        "",
        DATA[run.kind],
        "",
        f"Seed {run.seed}, physics version {PHYSICS_VERSION}; every number follows from them and "
        f"the settings.",
        "",
        "Nothing was measured on a machine unless the settings name a folder of recordings.",
        "",
        "## Settings",
        "",
        "```json",
        settings,
        "```",
        "",
        "## Made again by",
        "",
        f"    {run.command}",
        "",
    ]
    (run.folder / "data.md").write_text("\n".join(data), encoding="utf-8")


def settle(path: Path, status: str, verdict: Mapping[str, Any]) -> None:
    """Put the verdict of the frozen evaluation into the model card at ``path``."""
    text = path.read_text(encoding="utf-8").partition(_FROZEN)[0]
    lines = [
        re.sub(r"Status: \*\*[^*]+\*\*", f"Status: **{STATUS_TEXT[status]}**", text) + _FROZEN,
        "",
        f"Seed {verdict['seed']}, size {verdict['size']}, against `models/bars.toml`.",
        "",
        "| figure | reached | bar | holds |",
        "|---|---|---|---|",
        *(_row(bar) for bar in verdict["bars"]),
        "",
    ]
    write_whole(path, "\n".join(lines).encode())


def _row(bar: Mapping[str, Any]) -> str:
    limits = [f"{word} {bar[word]:g}" for word in ("least", "most") if bar[word] is not None]
    reached = "not given" if bar["reached"] is None else f"{bar['reached']:.4g}"
    return (
        f"| {bar['figure']} | {reached} | {', '.join(limits)} | {'yes' if bar['holds'] else 'no'} |"
    )
