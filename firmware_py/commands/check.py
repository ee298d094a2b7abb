"""``orbitd check CONFIG``: everything the device would refuse at start, found before it starts."""

from __future__ import annotations

import argparse
from pathlib import Path

import msgspec

from firmware_py.brain.store import Models, load_models
from firmware_py.config import Config, load
from firmware_py.guard.shield import Shield, check_safe


def main(argv: list[str]) -> int:
    """Check the configuration, the safe value over the declared range, and the models."""
    parser = argparse.ArgumentParser(prog="orbitd check", description=__doc__)
    parser.add_argument("config", type=Path, help="TOML configuration")
    parser.add_argument("--json", action="store_true", help="the effective configuration and findings as JSON")
    options = parser.parse_args(argv)
    config, source = load(options.config)
    check_safe(config, source)
    low_um, high_um = (1e6 * bound for bound in Shield(config).fixed_range() or (float("nan"), float("nan")))
    models = load_models(config)
    if options.json:
        found = {"config": config, "admissible_everywhere_um": [low_um, high_um], "models": _labels(models)}
        print(msgspec.json.encode({**found, "refused_models": models.refusals}).decode())
    else:
        print(f"{options.config.name}: good")
        print(f"  safe radial clearance {config.actuator.safe_radial_clearance_um:g} um; {low_um:.1f} .. {high_um:.1f}"
              " um is admissible over the whole declared range")
        print("\n".join(f"  model {label}" for label in _labels(models)))
        for kind, reason in models.refusals.items():
            print(f"  REFUSED {kind}: {reason}")
        for line in _defaults(config, source.text):
            print(f"  default {line}")
    return 1 if models.refusals else 0


def _labels(models: Models) -> list[str]:
    return [model.label for model in (models.classifier, models.actor, models.surrogate) if model]


def _defaults(config: Config, text: str) -> list[str]:
    """Every setting that the file leaves to its default, with the value in force."""
    return [
        f"{section}.{key} = {value!r}"
        for section, table in msgspec.structs.asdict(config).items()
        if isinstance(table, msgspec.Struct)
        for key, value in msgspec.structs.asdict(table).items()
        if f"{key} =" not in text
    ]
