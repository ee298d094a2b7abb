"""Which stage follows which key of ``machine.toml``: each key is changed alone, and what every
stage makes of the machine is compared with before.

``python -m tests.machine.key_matrix`` prints the page ``docs/machine_keys.md``.
"""

from __future__ import annotations

import hashlib
import sys
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from firmware_py.config import Config
from firmware_py.machine.simulation import Simulation
from sim_hil.hil.rig import node_limits
from sim_hil.rigs import RigData
from sim_hil.rigs.loading import NotSimulated, rig_of
from tests.machine.key_changes import NEEDS, SCHEMA_2, base, changed, faults, fed, keys
from tests.machine.stage_outputs import of_device, of_rig

STAGES: Final = (
    "check", "acquire", "envelope", "protection", "prediction", "diagnosis", "simulator", "trainer",
)  # fmt: skip
"""Columns of the matrix, in the order of the sample's way."""

ABOUT: Final = {
    "check": "what `orbitd check` derives and says, and what the wire carries",
    "acquire": "samples in SI, and the figures by which channels and speed are judged",
    "envelope": "the guard's admissible clearances, load and oil estimates",
    "protection": "the guard's limits, plausibility of readings, supervision, targets",
    "prediction": "the brain's estimate and forecast",
    "diagnosis": "the film's features, whose model and whose normal state fits",
    "simulator": "truth, samples and readings of the machine in software, and its node",
    "trainer": "observation, reward and draw of the training environment",
}

NOT_FOLLOWED: Final[Mapping[str, str]] = {
    "rotor.unbalance_normal_kg_m": "the drawing has it; a drawn build, and so the trainer, takes a "
    "balance grade within `[spread]` of simulation.toml",
    "feed.groove_area_min_mm2": "bounds for the guard; the film in software takes the drawn groove",
    "feed.groove_area_max_mm2": "as groove_area_min_mm2",
    "feed_port.recess_volume_mm3": "on the rotor's film a recess follows at once; `orbitd check` "
    "says how late it is, the solver takes it with a memory",
    "feed_port.air_share": "as recess_volume_mm3",
    "contact.film_error_share": "an uncertainty of the brain's; the circuit in software is exact",
    "channel.bandwidth_hz": "the trainer's sensors have no lag (stated in "
    "sim_hil/gym/vector_environment.py)",
    "rotor.shaft_end_to_cg_m": "`orbitd rig show` reckons with it, and check holds it against "
    "the bearing's place",
    "channel.unit": "each kind has one unit: any other is refused, which is what the key is for",
    "channel.kind": "another kind than that of the unit is refused",
}
"""Why a stage that might does not follow."""

Marks = dict[str, str]
"""A fingerprint of each stage's outputs, by stage."""


def fingerprint(value: object) -> str:
    """Of nested outputs."""
    parts: dict[str, list[str]] = defaultdict(list)
    _mark(value, parts[""])
    return hashlib.sha256("\n".join(parts[""]).encode()).hexdigest()


def _mark(value: object, parts: list[str]) -> None:
    if isinstance(value, np.ndarray):
        parts.append(hashlib.sha256(value.tobytes()).hexdigest())
    elif isinstance(value, Mapping):
        for item in value.items():
            _mark(item, parts)
    elif isinstance(value, list | tuple):
        for each in value:
            _mark(each, parts)
    else:
        parts.append(repr(value))


def marks(config: Config, key: str, known: Before | None = None) -> Marks:
    """Fingerprints of all stages; the rig of ``known`` is not played again."""
    if faults(config):
        return {"check": fingerprint(faults(config))}
    found = {stage: fingerprint(value) for stage, value in of_device(config).items()}
    try:
        rig = rig_of(config, SIMULATION)
    except NotSimulated as error:
        return found | {stage: str(error) for stage in ("simulator", "node", "trainer")}
    found["node"] = fingerprint(node_limits(rig, config))
    if known and known.rig and known.rig == replace(rig, name=known.rig.name):
        return found | {stage: known.marks[stage] for stage in ("simulator", "trainer")}
    return found | {stage: fingerprint(v) for stage, v in of_rig(config, rig, key).items()}


SIMULATION: Final = Simulation()


class Before(NamedTuple):
    """A machine before one of its keys is changed, and what the stages make of it."""

    config: Config
    rig: RigData | None
    marks: Marks


def before(key: str, kept: dict[str, Before]) -> Before:
    """Of the machine in which ``key`` is changed; the same for many keys."""
    film = "grooved" if key.startswith("feed.groove") else "fed" if fed(key) else ""
    film = key if key.startswith("feed_port.") else film
    group = f"{film} {key.startswith('reading.')} {key in SCHEMA_2} {NEEDS.get(key)}"
    if group not in kept:
        config = base(key)
        assert faults(config) == []
        rig = None if key in SCHEMA_2 else rig_of(config, SIMULATION)
        kept[group] = Before(config, rig, marks(config, key))
    return kept[group]


def followers(key: str, kept: dict[str, Before]) -> list[str]:
    """Stages whose output is another with another value of ``key``; a value that `check` refuses
    reaches no other."""
    known = before(key, kept)
    now = marks(changed(known.config, key), key, known if known.rig else None)
    moved = {stage for stage in now if now[stage] != known.marks[stage]}
    if "node" in moved:
        moved.add("simulator")
    return [stage for stage in STAGES if stage in moved]


def matrix() -> dict[str, list[str]]:
    """The stages that follow each key."""
    kept: dict[str, Before] = {}
    return {key: followers(key, kept) for key in keys()}


def page(found: Mapping[str, list[str]]) -> str:
    """``docs/machine_keys.md``."""
    lines = [
        "# Who follows which key of machine.toml",
        "",
        "Written by `python -m tests.machine.key_matrix > docs/machine_keys.md`: each key of the",
        "rig `bench` is changed alone, and the output of every stage is compared with before. A",
        "test holds this page against the code.",
        "",
        *(f"* **{stage}**: {ABOUT[stage]}" for stage in STAGES),
        "",
        f"| key | {' | '.join(STAGES)} |",
        f"|---|{'---|' * len(STAGES)}",
        *(
            f"| `{key}` | {' | '.join('x' if s in stages else ' ' for s in STAGES)} |"
            for key, stages in found.items()
        ),
        "",
        "What might be expected to follow and does not:",
        "",
        *(f"* `{key}`: {why}." for key, why in NOT_FOLLOWED.items()),
        "",
        "Bearings that are only watched (`other_bearing`, the bearing of a channel) are left out:",
        "the bench has none.",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(page(matrix()))
