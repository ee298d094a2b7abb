import msgspec
import pytest

from firmware_py.config import AuthorityConfig
from firmware_py.guard.authority.model_authority import AHEAD_MAX_NS, Authority
from firmware_py.records import Advice

S = 1_000_000_000
CONFIG = AuthorityConfig(good_advices=10, regain_after_s=2.0, max_regains_per_hour=3)


def advice(**changes: object) -> Advice:
    good = Advice(1, 10 * S, 10 * S, S // 2, 60.0, 1.0, True, [], None)
    return msgspec.structs.replace(good, **changes)


def reasons(given: Advice | None, now_ns: int = 10 * S, connected: bool = True) -> list[str]:
    return Authority(CONFIG).advice_reasons(given, connected, now_ns)


def test_good_advice_has_nothing_against_it() -> None:
    assert reasons(advice()) == []


@pytest.mark.parametrize(
    "bad",
    [
        {"clearance_um": None},
        {"clearance_um": float("nan")},
        {"clearance_um": float("inf")},
        {"pressure_bar": float("nan")},
        {"qualified": False},
        {"reasons": ["doubt"]},
        {"t_ns": 10 * S - 500_000_001},
        {"t_acq_ns": 9 * S},
        {"lifetime_ns": -1},
        {"t_ns": 10 * S + AHEAD_MAX_NS + 1},
        {"t_ns": 2**62, "lifetime_ns": 2**62},
        {"t_acq_ns": 10 * S + AHEAD_MAX_NS + 1},
        {"t_ns": 11 * S, "t_acq_ns": 11 * S},
    ],
)
def test_each_flaw_is_a_reason(bad: dict[str, object]) -> None:
    assert len(reasons(advice(**bad))) == 1


def test_a_stamp_within_the_tolerance_of_now_is_good() -> None:
    assert reasons(advice(t_ns=10 * S + AHEAD_MAX_NS, t_acq_ns=10 * S + AHEAD_MAX_NS)) == []


def test_no_brain_and_no_advice_are_reasons() -> None:
    assert reasons(None) == ["the brain has given no advice yet"]
    assert reasons(advice(), connected=False) == ["the brain is not connected"]


@pytest.mark.parametrize(("age_ms", "good"), [(0, True), (499, True), (500, True), (501, False)])
def test_advice_expires(age_ms: int, good: bool) -> None:
    assert (reasons(advice(lifetime_ns=10 * S), 10 * S + age_ms * 1_000_000) == []) == good


def test_a_provisional_model_acts_only_where_that_is_configured() -> None:
    permissive = Authority(msgspec.structs.replace(CONFIG, provisional_may_act=True))
    assert permissive.advice_reasons(advice(qualified=False), True, 10 * S) == []


class Story:
    """Ten advices a second against the stage."""

    def __init__(self) -> None:
        self.stage = Authority(CONFIG)
        self.t_ns, self.seq = 0, 0
        self.stage.start(0, "")

    def good(self, seconds: float) -> list[str]:
        names = []
        for _ in range(round(seconds * 10)):
            self.t_ns += S // 10
            self.seq += 1
            names += [n.name for n in self.stage.step([], self.seq, self.t_ns)]
        return names

    def doubt(self) -> list[str]:
        self.t_ns += S // 10
        return [n.name for n in self.stage.step(["doubt"], self.seq, self.t_ns)]


def test_comes_after_enough_advices_and_enough_time() -> None:
    story = Story()
    assert story.good(1.9) == []
    assert not story.stage.state.held
    assert story.good(0.2) == ["authority_gained"]


def test_the_same_advice_does_not_count_twice() -> None:
    story = Story()
    story.seq = 1
    for _ in range(100):
        story.t_ns += S // 10
        story.stage.step([], 1, story.t_ns)
    assert not story.stage.state.held
    assert story.stage.state.reasons == ["1 of 10 good advices in a row"]


def test_one_doubt_takes_it_at_once_and_the_count_begins_anew() -> None:
    story = Story()
    story.good(3)
    assert story.doubt() == ["authority_lost"]
    assert story.good(1.9) == []
    assert story.good(0.2) == ["authority_gained"]


def test_after_too_many_returns_only_a_person_gives_it_back() -> None:
    story = Story()
    story.good(3)
    for _ in range(3):
        story.doubt()
        assert "authority_gained" in story.good(3)
    story.doubt()
    assert "authority_exhausted" in story.good(30)
    assert not story.stage.state.held
    story.stage.reset()
    assert "authority_gained" in story.good(3)


def test_returns_are_forgotten_after_an_hour() -> None:
    story = Story()
    story.good(3)
    for _ in range(6):
        story.doubt()
        assert "authority_gained" in story.good(3)
        story.t_ns += 1300 * S
