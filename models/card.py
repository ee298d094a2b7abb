"""The model card: what a model is for, how it was made, what it reached, what it does not do."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from models.runs import Run


@dataclass(frozen=True)
class Prose:
    """The sentences of a card that no measurement gives."""

    title: str
    purpose: str
    limits: tuple[str, ...]


SURROGATE = Prose(
    "Film-force surrogate",
    "Force on the journal, friction torque and side flow of a plain aligned unfed film (Reynolds rupture, "
    "periodic, ambient ends) for the predictor in the brain.",
    (
        "One length over diameter (see `domain`); any speed, viscosity, clearance and radius.",
        "No feed, groove, tilt, wear or film memory; a moving clearance is not among its inputs.",
        "Beyond eccentricity ratio 0.98 the film keeps the shape it has there.",
    ),
)


def write(run: Run, report: Mapping[str, object], prose: Prose) -> None:
    """Write ``<kind>.md`` beside the model."""
    settings = json.dumps(msgspec.to_builtins(run.settings), indent=2, sort_keys=True)
    lines = [
        f"# {prose.title}", "", prose.purpose, "", "Status: **provisional**.", "",
        "## Reproduce", "", f"    {run.command}", "",
        "## Measured", "", "```json", json.dumps(report, indent=2, sort_keys=True), "```", "",
        "## Limits", "", *(f"- {limit}" for limit in prose.limits), "",
        "## Settings", "", "```json", settings, "```", "",
    ]  # fmt: skip
    (run.folder / f"{run.kind}.md").write_text("\n".join(lines), encoding="utf-8")
