"""``orbitd train MODEL``: train, judge, export; ``orbitd evaluate MODEL --file FILE --qualify
--ship`` ships it."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import msgspec

from firmware_py.options import seed, window_seconds
from models.runs import TrainingRun, load_settings

EXIT_BAD_INPUT = 2

TRAINERS = {
    "surrogate": "models.film.surrogate",
    "surrogate_fed": "models.film.surrogate_fed",
    "predictor": "models.prediction.predictor",
    "classifier": "models.diagnosis.classifier",
    "actor": "models.control.actor",
}
MEASURED = "models.diagnosis.measured_model"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="orbitd train", description=__doc__)
    parser.add_argument("model", choices=tuple(TRAINERS))
    parser.add_argument("--seed", type=seed, default=0, help="every random number follows from it")
    parser.add_argument(
        "--smoke", action="store_true", help="the same steps in seconds, a model for tests only"
    )
    parser.add_argument("--config", type=Path, help="TOML file with training settings")
    parser.add_argument(
        "--data", type=Path, help="classifier: measured recordings (docs/recordings.md)"
    )
    parser.add_argument(
        "--group", default="group", help="with --data: column whose values never cross a split"
    )
    parser.add_argument(
        "--channels", type=Path, help="with --data: channel map (default: its channels.toml)"
    )
    parser.add_argument(
        "--window-s", type=window_seconds, help="with --data: length of a window (default: 1)"
    )
    parser.add_argument(
        "--rig", metavar="NAME_OR_FOLDER", help="machine to train for (default: as in the settings)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs"), help="folder for the run (default: runs)"
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on where the same training was interrupted"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Entry of ``orbitd train``; returns the exit code."""
    args = _parser().parse_args(argv)
    if args.data and args.model != "classifier":
        print(
            f"orbitd train: --data: recordings train a classifier, not the {args.model}",
            file=sys.stderr,
        )
        return EXIT_BAD_INPUT
    try:
        report = _train(args)
    except ValueError as error:
        print(f"orbitd train: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(json.dumps(report, indent=2, sort_keys=True))
    return 0


def _train(args: argparse.Namespace) -> dict[str, object]:
    name = "measured_model" if args.data else args.model
    trainer = importlib.import_module(
        MEASURED if args.data else TRAINERS[name]
    )  # brings torch: only the one asked for
    settings = load_settings(trainer.SETTINGS, args.config)
    settings = settings.smoked() if args.smoke else settings
    if args.rig and "rig" in settings.__struct_fields__:
        settings = msgspec.structs.replace(settings, rig=args.rig)
    if args.data:
        settings = msgspec.structs.replace(
            settings,
            data=str(args.data),
            group=args.group,
            channels=str(args.channels or ""),
            window_s=settings.window_s if args.window_s is None else args.window_s,
        )
    run = TrainingRun(
        args.out,
        name,
        args.seed,
        settings,
        smoke=args.smoke,
        resume=args.resume,
        config=args.config,
    )
    with closing(run):
        report: dict[str, object] = trainer.train(run, settings)
    return report
