"""``orbitd evaluate MODEL --seed N``: judge a model on builds, duties and noise that follow from N."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from models import ARTIFACTS

EXIT_BAD_INPUT = 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="orbitd evaluate", description=__doc__)
    parser.add_argument("model", choices=("surrogate", "classifier", "actor"))
    parser.add_argument("--seed", type=int, default=1, help="decides every build, duty and noise of the judgement")
    parser.add_argument("--file", type=Path, help="ONNX file to judge (default: the shipped one)")
    parser.add_argument("--size", type=int, help="films, builds or episodes to judge with (default: as in training)")
    parser.add_argument("--rate-hz", type=int, default=5000, choices=(5000, 10000), help="classifier: sampling rate")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="folder where recordings are kept")
    parser.add_argument("--json", action="store_true", help="print JSON instead of lines")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Entry of ``orbitd evaluate``; returns the exit code."""
    args = _parser().parse_args(argv)
    path = args.file or ARTIFACTS / f"{args.model}.onnx"
    if not path.is_file():
        print(f"orbitd evaluate: {path}: no such file; train one with `orbitd train {args.model}`", file=sys.stderr)
        return EXIT_BAD_INPUT
    try:
        report = _JUDGES[args.model](path, args)
    except ValueError as error:
        print(f"orbitd evaluate: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    report = {"model": args.model, "seed": args.seed, **report}
    print(json.dumps(report, indent=2, sort_keys=True) if args.json else "\n".join(_lines(report)))
    return 0


def _surrogate(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models import surrogate
    from models.film_rivals import table_error

    settings = surrogate.SurrogateSettings(judge_points=args.size or 300)
    films = surrogate.unseen(settings, np.random.default_rng([surrogate.JUDGE_SEED, args.seed]))
    length_over_diameter = settings.length_over_diameter
    return {
        "unseen_films": surrogate.judge(surrogate.of_file(path), films, length_over_diameter),
        "spline_table": table_error(films, length_over_diameter),
    }


def _classifier(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models import classifier

    settings = classifier.ClassifierSettings(judged_builds=args.size or 80, rate_hz=args.rate_hz)
    verdicts = classifier.of_file(path)
    views = classifier.judged_views(settings, args.seed, args.out)
    threshold = classifier.novelty_threshold(path)
    return {
        "unseen_builds": classifier.judge(verdicts, views.orders),
        "unknown_faults": classifier.judge_unknown(verdicts, threshold, settings, args.seed, args.out),
    }


def _actor(path: Path, args: argparse.Namespace) -> dict[str, object]:
    from models import actor

    settings = actor.ActorSettings(judged_episodes=args.size or 12)
    return {"unseen_episodes": actor.compare(actor.of_file(path), settings, args.seed)}


_JUDGES = {"surrogate": _surrogate, "classifier": _classifier, "actor": _actor}


def _lines(report: object, prefix: str = "") -> list[str]:
    """One ``a.b.c = value`` a figure."""
    if isinstance(report, dict):
        return [line for key, item in report.items() for line in _lines(item, f"{prefix}.{key}".lstrip("."))]
    return [f"{prefix} = {report}"]
