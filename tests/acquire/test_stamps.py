import pytest

from firmware_py.acquire.stamps import ARRIVAL_AGE_MAX_NS, ARRIVAL_AHEAD_MAX_NS, bounded_arrival_ns

NOW_NS = 10**12
MS = 1_000_000


@pytest.mark.parametrize(
    ("arrival_ns", "expected_ns", "ahead", "behind"),
    [
        (NOW_NS, NOW_NS, 0, 0),
        (NOW_NS - 2 * MS, NOW_NS - 2 * MS, 0, 0),
        (NOW_NS + ARRIVAL_AHEAD_MAX_NS, NOW_NS, 0, 0),
        (NOW_NS + ARRIVAL_AHEAD_MAX_NS + 1, NOW_NS, 1, 0),
        (NOW_NS + 3_600_000 * MS, NOW_NS, 1, 0),
        (NOW_NS - 6 * MS, NOW_NS - 5 * MS, 0, 1),
        (NOW_NS - ARRIVAL_AGE_MAX_NS - 1, NOW_NS, 0, 1),
        (NOW_NS - 3_600_000 * MS, NOW_NS, 0, 1),
        (0, NOW_NS, 0, 1),
    ],
)
def test_an_arrival_lies_between_the_one_before_it_and_now(
    arrival_ns: int, expected_ns: int, ahead: int, behind: int
) -> None:
    counters = {"stamps_ahead": 0, "stamps_behind": 0}
    assert bounded_arrival_ns(arrival_ns, NOW_NS - 5 * MS, NOW_NS, counters) == expected_ns
    assert counters == {"stamps_ahead": ahead, "stamps_behind": behind}


def test_a_newest_arrival_from_a_clock_that_ran_ahead_is_no_bound() -> None:
    counters = {"stamps_ahead": 0, "stamps_behind": 0}
    assert bounded_arrival_ns(NOW_NS - MS, NOW_NS + MS, NOW_NS, counters) == NOW_NS - MS
