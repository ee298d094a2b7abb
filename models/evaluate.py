"""``orbitd evaluate MODEL --seed N``: judge a model on builds, duties and noise that follow from
N."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from firmware_py.options import count, seed, window_seconds
from models import ARTIFACTS

EXIT_BAD_INPUT = 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="orbitd evaluate", description=__doc__)
    parser.add_argument("model", choices=tuple(_JUDGES))
    parser.add_argument(
        "--seed", type=seed, default=1, help="decides every build, duty and noise of the judgement"
    )
    parser.add_argument("--file", type=Path, help="model file to judge (default: the shipped one)")
    parser.add_argument(
        "--size",
        "--episodes",
        type=count,
        help="films, builds or episodes (default: as in training)",
    )
    parser.add_argument(
        "--rate-hz", type=int, default=5000, choices=(5000, 10000), help="classifier: sampling rate"
    )
    parser.add_argument(
        "--data", type=Path, help="classifier: measured recordings (docs/recordings.md)"
    )
    parser.add_argument(
        "--group", default="group", help="with --data: column whose values are left out one by one"
    )
    parser.add_argument(
        "--channels", type=Path, help="with --data: channel map (default: its channels.toml)"
    )
    parser.add_argument(
        "--window-s",
        type=window_seconds,
        default=1.0,
        help="with --data: length of a window (default: 1; with --file: that of the model)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs"), help="folder where recordings are kept"
    )
    parser.add_argument(
        "--qualify",
        action="store_true",
        help="frozen evaluation (its own seed and size) against bars.toml; marks the file",
    )
    parser.add_argument(
        "--ship",
        action="store_true",
        help="with --qualify: ship it unless the shipped one is better",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of lines")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Entry of ``orbitd evaluate``; returns the exit code."""
    args = _parser().parse_args(argv)
    if args.data and args.model != "classifier":
        print(
            f"orbitd evaluate: --data: recordings judge the classifier, not the {args.model}",
            file=sys.stderr,
        )
        return EXIT_BAD_INPUT
    path = (
        args.file or ARTIFACTS / f"{args.model}{'.json' if args.model == 'predictor' else '.onnx'}"
    )
    if not (args.data or path.is_file()):
        print(
            f"orbitd evaluate: {path}: no such file; train one with `orbitd train {args.model}`",
            file=sys.stderr,
        )
        return EXIT_BAD_INPUT
    try:
        judge = _qualified if args.qualify else _judged
        report = _measured(args) if args.data else judge(path, args)
    except ValueError as error:
        print(f"orbitd evaluate: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    report = {"model": args.model, "seed": args.seed, **report}
    print(json.dumps(report, indent=2, sort_keys=True) if args.json else "\n".join(_lines(report)))
    return 0


def _judged(path: Path, args: argparse.Namespace) -> dict[str, object]:
    """The model's own evaluation; what the device calls often is timed as well."""
    report = _JUDGES[args.model](path, args)
    if path.suffix == ".onnx":
        from models.export import milliseconds_per_call

        report["milliseconds_per_call"] = milliseconds_per_call(path)
    return report


def _qualified(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models.qualify import qualify

    def evaluate(file: Path, seed: int, size: int) -> dict[str, object]:
        return _judged(file, argparse.Namespace(**vars(args) | {"seed": seed, "size": size}))

    return qualify(args.model, path, evaluate, ship=args.ship)


def _surrogate_fed(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models.film import surrogate_fed

    return surrogate_fed.evaluate(path, args.seed, args.size, args.out)


def _predictor(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models.prediction import predictor

    return predictor.evaluate(path, args.seed, args.size, args.out)


def _surrogate(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models.film import surrogate

    return surrogate.evaluate(path, args.seed, args.size, args.out)


def _classifier(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models.diagnosis import classifier

    return classifier.evaluate(path, args.seed, args.size, args.out, args.rate_hz)


def _measured(args: argparse.Namespace) -> dict[str, object]:
    from models.diagnosis import measured, measured_judge, measured_normal
    from models.diagnosis.dataset_folder import read_folder
    from models.diagnosis.measured_features import windows_of

    found = read_folder(args.data, args.group, args.channels)
    if args.file:
        return measured_judge.judge(args.file, found, args.seed)
    data = windows_of(found, args.window_s)
    if len(data.labels) == 1:
        return measured_normal.normal_only(data)
    return {
        **measured.evaluate(data, args.seed),
        "fit_normal_then_detect": measured_normal.detect(data),
    }


def _actor(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models.control import actor

    return actor.evaluate(path, args.seed, args.size, args.out)


_JUDGES = {
    "surrogate": _surrogate,
    "surrogate_fed": _surrogate_fed,
    "predictor": _predictor,
    "classifier": _classifier,
    "actor": _actor,
}


def _lines(report: object, prefix: str = "") -> list[str]:
    """One ``a.b.c = value`` a figure."""
    if isinstance(report, dict):
        return [
            line
            for key, item in report.items()
            for line in _lines(item, f"{prefix}.{key}".lstrip("."))
        ]
    return [f"{prefix} = {report}"]
