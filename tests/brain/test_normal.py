"""What is normal for one machine: its offset is learned, its limit keeps the stated rate, others'
are refused."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from firmware_py.brain import normal as own
from firmware_py.brain.normal import Detector, NormalError, Prior
from firmware_py.records import Belonging, Normal

COLUMNS = [6, 20]
BETWEEN = np.r_[np.full(3, 9.0), np.zeros(3), np.full(5, 4.0), np.zeros(15)]
BELONGS = Belonging(classifier="a" * 64, features="f" * 12, rig="bench", configuration="c" * 12)


def machines(n: int, decisions: int, seed: int) -> np.ndarray:
    """Whitened residuals of ``n`` machines of the fleet, ``(n, decisions, 26)``."""
    rng = np.random.default_rng(seed)
    offset = rng.normal(size=(n, 1, 26)) * np.sqrt(BETWEEN)
    return offset + rng.normal(size=(n, decisions, 26))


def prior() -> Prior:
    fleet = machines(4000, 1, 0)[:, 0] ** 2 / (1 + BETWEEN)
    away = [np.sqrt(part.mean(axis=1)) for part in np.split(fleet, [COLUMNS[0]], axis=1)]
    return Prior(
        ["floating", "ringing"],
        COLUMNS,
        BETWEEN.tolist(),
        [float(np.quantile(a, 0.99)) for a in away],
        [float(np.median(a)) for a in away],
    )


PRIOR = prior()


def points(n: int) -> np.ndarray:
    """So many operating points, none twice."""
    k = np.arange(n)
    return np.column_stack(
        [150.0 * 1.25**k, 40e-6 + 10e-6 * (k % 5), np.full(n, 0.35), np.full(n, 50.0)]
    )


def fit(
    rows: np.ndarray, log_odds: np.ndarray | None = None, at: np.ndarray | None = None
) -> Normal:
    n = len(rows)
    return own.fit(
        rows,
        np.full((n, 4), -5.0) if log_odds is None else log_odds,
        points(n) if at is None else at,
        np.full(n, 1e-6 + 2e-6j),
        PRIOR,
        BELONGS,
        3.0,
    )


def test_limit_keeps_the_stated_rate_with_and_without_commissioning() -> None:
    """1 % a part, over machines that nobody has seen."""
    fleet = Detector(PRIOR).novelty(machines(3000, 1, 1)[:, 0])
    assert np.mean(fleet > 1.0) == pytest.approx(0.02, abs=0.01)
    rows = machines(300, 20, 2)
    later = [Detector(PRIOR, fit(m[:10])).novelty(m[10:]) for m in rows]
    assert np.mean(np.concatenate(later) > 1.0) == pytest.approx(0.02, abs=0.015)


def test_a_fault_within_the_fleet_is_found_only_by_who_knows_the_machine() -> None:
    rows = machines(200, 11, 3)
    faulty = rows[:, 10:] + np.r_[np.full(3, 4.0), np.zeros(23)]
    fleet = np.mean([Detector(PRIOR).novelty(m) > 1.0 for m in faulty])
    known = np.mean(
        [
            Detector(PRIOR, fit(m)).novelty(f) > 1.0
            for m, f in zip(rows[:, :10], faulty, strict=True)
        ]
    )
    assert fleet < 0.3
    assert known > 0.9


def test_many_windows_at_one_point_count_once() -> None:
    one = machines(1, 4, 4)[0]
    again = np.repeat(one, 50, axis=0)
    once, often = fit(one), fit(again, at=np.repeat(points(4), 50, axis=0))
    assert often.offset == pytest.approx(once.offset)
    assert (often.points, often.decisions) == (4, 200)
    assert max(once.variance) == pytest.approx(1 + 9 / 37)


def test_a_machine_that_scatters_more_gets_a_wider_limit_but_not_at_once() -> None:
    rows = machines(1, 200, 5)[0]
    offset = rows.mean(axis=0)
    wide = offset + 2.0 * (rows - offset)
    few, many = (
        np.array(fit(wide[:n], at=points(n) if n < 20 else np.repeat(points(40), 5, axis=0)).scale)
        for n in (6, 200)
    )
    assert (many > few).all()
    assert (many < 2.0).all()
    assert many == pytest.approx(1.8, abs=0.15)


def test_a_head_must_say_more_than_it_said_of_the_healthy_machine() -> None:
    log_odds = np.full((6, 4), -6.0)
    log_odds[2, 3] = 1.5
    assert fit(machines(1, 6, 6)[0], log_odds).quiet == [0.0, 0.0, 0.0, 1.5 + own.QUIET_MARGIN]


def test_first_order_is_followed_over_the_operating_range_and_not_beyond() -> None:
    rng = np.random.default_rng(7)
    at = np.column_stack(
        [
            np.exp(rng.uniform(5.0, 7.0, 60)),
            rng.uniform(40e-6, 120e-6, 60),
            rng.uniform(0.1, 0.6, 60),
            np.full(60, 50.0),
        ]
    )

    def truth_um(p: np.ndarray) -> np.ndarray:
        return (
            (2.0 - 1.0j)
            + (1.0 + 2.0j) * (np.log(p[:, 0]) - 6) ** 2
            + 3.0 * (p[:, 1] - 80e-6) / 40e-6
            + 1j * p[:, 2]
        )

    noise = 0.15 * (rng.normal(size=60) + 1j * rng.normal(size=60))
    normal = own.fit(
        machines(1, 60, 8)[0],
        np.zeros((60, 4)),
        at,
        (truth_um(at) + noise) * 1e-6,
        PRIOR,
        BELONGS,
        9.0,
    )
    where = np.array([[np.exp(6.3), 70e-6, 0.3, 50.0]])
    found = own.baseline_at(normal.baseline, where[0])
    assert found is not None
    assert abs(found - truth_um(where)[0]) < 0.2
    assert normal.baseline.scatter_um == pytest.approx(0.21, abs=0.05)
    limit_um = own.MOVED * normal.baseline.scatter_um
    moved = own.first_order_distance(normal, where[0], (found + 2j * limit_um) * 1e-6)
    assert moved == {"first_order": pytest.approx(2.0)}
    far = np.array([np.exp(9.5), 70e-6, 0.3, 50.0])
    assert own.baseline_at(normal.baseline, far) is None
    assert own.first_order_distance(normal, far, 1.0) == {}
    few = msgspec.structs.replace(normal, points=own.BASELINE_POINTS - 1)
    assert own.first_order_distance(few, where[0], 1.0) == {}


def test_too_few_points_and_broken_numbers_are_refused_by_name() -> None:
    rows = machines(1, 6, 9)[0]
    with pytest.raises(
        NormalError, match="2 operating points in 6 decisions, at least 4 are needed"
    ):
        fit(rows, at=np.repeat(points(2), 3, axis=0))
    with pytest.raises(NormalError, match="0 operating points in 0 decisions"):
        fit(rows[:0])
    rows[3, 1] = np.nan
    with pytest.raises(NormalError, match="residuals: decision 3 is not finite"):
        fit(rows)


@pytest.mark.parametrize("what", Belonging.__struct_fields__)
def test_a_state_of_something_else_is_refused_by_name(what: str) -> None:
    normal = fit(machines(1, 6, 10)[0])
    own.check_belongs(normal, BELONGS)
    with pytest.raises(
        NormalError, match=f"{what} '.*', this device has 'other'.*commission again"
    ):
        own.check_belongs(normal, msgspec.structs.replace(BELONGS, **{what: "other"}))


def test_a_state_comes_back_from_a_file_bit_by_bit() -> None:
    normal = fit(machines(1, 6, 11)[0])
    again = msgspec.json.decode(msgspec.json.encode(normal), type=Normal)
    assert again == normal
    assert own.digest(again) == own.digest(normal)
    assert own.digest(msgspec.structs.replace(normal, points=5)) != own.digest(normal)
