"""The ladder climbed: every rung trained on the outer builds, the simplest that wins on inner
builds chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.verdict import class_probabilities
from models.diagnosis import ladder, scores
from models.diagnosis.ladder import (
    ALL_FEATURES,
    ORDER_FEATURES,
    OWN_FEATURES,
    HeadNetwork,
    PaperNetwork,
)
from models.diagnosis.scores import Decisions, decide
from models.diagnosis.waveform_network import fit_waveforms, waveform_probability
from models.diagnosis.windowed import Views
from models.runs import TrainerSettings, progress_bar

Floats = NDArray[np.float64]


class LadderSettings(TrainerSettings, frozen=True):
    """How the rungs are trained."""

    hidden: int = 24
    own_hidden: int = 8
    members: int = 5
    l2: tuple[float, ...] = (3e-4, 1e-4, 3e-5)
    iterations: int = 600
    paper_hidden: int = 20
    paper_iterations: int = 40
    epochs: int = 30
    waveforms: bool = True
    """Whether the rungs on raw samples are climbed, which the device cannot run."""


@dataclass(frozen=True)
class Rung:
    """One classifier of the ladder: its probabilities for the views of recordings, pooled to
    decisions."""

    name: str
    probability: Callable[[Views], Floats]
    view: str = "orders"
    network: HeadNetwork | None = None

    def decisions(self, views: Views) -> Decisions:
        """Decisions at the severities that must be found."""
        return scores.required(decide(self.probability(views), getattr(views, self.view)))


def climb(
    outer: Views, inner: Views, settings: LadderSettings, rate_hz: int, seed: int
) -> list[Rung]:
    """Every rung, simplest first, trained on ``outer`` with ``inner`` as what it must not see.

    Each starts from ``seed`` alone: what is left out of the ladder changes no other rung.
    """
    rungs = [
        Rung(
            "thresholds on 1X, 2X, half order", lambda v: ladder.thresholds(outer.orders, v.orders)
        )
    ]
    for name, columns in (
        ("logistic regression, order features", ORDER_FEATURES),
        ("logistic regression, order features and ringing", ALL_FEATURES),
    ):
        rungs.append(_heads_rung(name, columns, 0, outer, inner, settings, seed))
    papers: list[tuple[str, str, NDArray[np.bool_] | None]] = [
        (f"paper's network, raw 800 points at {rate_hz} Hz", "raw", None),
        ("paper's network, order features over 32 turns", "orders", ORDER_FEATURES),
    ]
    for name, view, columns_or_none in papers[not settings.waveforms :]:
        with progress_bar(name, settings.paper_iterations) as bar:
            paper = PaperNetwork.fit(
                getattr(outer, view),
                getattr(inner, view),
                settings.paper_hidden,
                settings.paper_iterations,
                np.random.default_rng(seed),
                columns_or_none,
                bar,
            )
        rungs.append(_paper_rung(name, view, paper))
    if settings.waveforms:
        rungs.append(_waveform_rung(outer, inner, settings, seed))
    for name, columns, hidden in (
        ("logistic regression, own features of each head", OWN_FEATURES, 0),
        (f"network-{settings.hidden}, order features and ringing", ALL_FEATURES, settings.hidden),
        (
            f"network-{settings.own_hidden} a head, own features of each head",
            OWN_FEATURES,
            settings.own_hidden,
        ),
    ):
        rungs.append(_heads_rung(name, columns, hidden, outer, inner, settings, seed))
    rungs.append(_mean_rung(rungs[-1], OWN_FEATURES, outer, inner, settings, seed))
    return rungs


def _waveform_rung(outer: Views, inner: Views, settings: LadderSettings, seed: int) -> Rung:
    with progress_bar("1-D CNN on 32 turns", settings.epochs) as bar:
        waves = fit_waveforms(outer.waves, inner.waves, settings.epochs, seed, bar)
    return Rung(
        "1-D CNN, waveforms of 32 turns",
        lambda v: waveform_probability(waves, v.waves.features),
        "waves",
    )


def _paper_rung(name: str, view: str, paper: PaperNetwork) -> Rung:
    return Rung(name, lambda v: paper.probability(getattr(v, view).features), view)


def _heads_rung(
    name: str,
    columns: NDArray[np.bool_],
    hidden: int,
    outer: Views,
    inner: Views,
    settings: LadderSettings,
    seed: int,
) -> Rung:
    """Four heads; decay and temperature that are best on the inner builds."""
    tried = []
    for l2 in settings.l2:
        with progress_bar(f"{name}, l2 {l2:g}", settings.iterations) as bar:
            tried.append(
                ladder.fit_heads(
                    name,
                    columns,
                    hidden,
                    outer.orders,
                    inner.orders,
                    l2,
                    settings.iterations,
                    np.random.default_rng(seed),
                    bar,
                )
            )
    rows = inner.orders
    best = min(
        (network.calibrated(rows) for network in tried),
        key=lambda n: scores.nll(n.logits(rows.features), rows.heads, rows.weight[:, None]),
    )
    return Rung(name, lambda v: class_probabilities(best.logits(v.orders.features)), network=best)


def _mean_rung(
    first: Rung,
    columns: NDArray[np.bool_],
    outer: Views,
    inner: Views,
    settings: LadderSettings,
    seed: int,
) -> Rung:
    """The same network trained from several starts, as one network that gives their mean
    log-odds."""
    assert first.network is not None
    networks = [first.network]
    for member in range(1, settings.members):
        with progress_bar(f"mean of {settings.members} networks", settings.iterations) as bar:
            networks.append(
                ladder.fit_heads(
                    first.name,
                    columns,
                    settings.own_hidden,
                    outer.orders,
                    inner.orders,
                    first.network.l2,
                    settings.iterations,
                    np.random.default_rng([seed, member]),
                    bar,
                )
            )
    mean = ladder.side_by_side(f"mean of {settings.members}: {first.name}", networks).calibrated(
        inner.orders
    )
    return Rung(
        mean.name, lambda v: class_probabilities(mean.logits(v.orders.features)), network=mean
    )


def choose(rungs: list[Rung], inner: Views) -> tuple[HeadNetwork, list[dict[str, object]]]:
    """The simplest rung whose worst inner regime no later one betters; a row for each.

    Better is the higher log score: accuracy near one is a matter of one or two decisions.  Only
    rungs that the device can run are chosen: those with four heads on features.
    """
    best: tuple[float, HeadNetwork] | None = None
    rows: list[dict[str, object]] = []
    for rung in rungs:
        decisions = rung.decisions(inner)
        name, worst = scores.worst_group(decisions, scores.log_score)
        score = scores.log_score(decisions.subset(worst))
        rows.append(
            {
                "rung": rung.name,
                "worst_log_score": {"name": name, "log_score": round(score, 4)},
                **scores.summary(decisions),
            }
        )
        if rung.network is not None and (best is None or score > best[0]):
            best = score, rung.network
    assert best is not None  # the ladder holds regressions
    return best[1], rows
