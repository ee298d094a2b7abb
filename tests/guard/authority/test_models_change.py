"""Other models under an armed device: authority is gone at once and comes back only with another
arming; a set that was rolled back is an alarm until a person has acted."""

from __future__ import annotations

import msgspec
import pytest

from firmware_py.guard.process.budget import REASON_CHARS_MAX, bounded
from firmware_py.records import Advice, Mode
from tests.guard.scripted_node import Bench, armed, working


def change(bench: Bench, **changed: str) -> None:
    """Let every further advice say ``changed`` of its models."""
    given = bench.advice

    def advice() -> Advice | None:
        found = given()
        return msgspec.structs.replace(found, **changed) if found else None

    bench.advice = advice  # type: ignore[method-assign]


def test_a_promotion_takes_authority_until_the_device_is_armed_again() -> None:
    bench = working()
    assert bench.authority
    safe_um = bench.config.machine.actuator.safe_radial_clearance_um
    change(bench, models="0123456789abcdef")
    bench.run(0.2)
    assert not bench.authority
    assert bench.names()[-2:] == ["models_changed", "authority_lost"]
    assert bench.core.stages.memory.target.clearance_um == safe_um
    bench.run(2.5)  # longer than authority takes to come back
    assert not bench.authority
    said = bench.core.stages.arming.state.authority.reasons
    assert said == ["the models have changed since the device was armed; look, then `orbitd arm`"]
    assert bench.ask("arm") == (True, [])
    bench.until(lambda: bench.authority, 4.0)
    bench.run(0.1)
    assert bench.core.stages.memory.target.clearance_um != safe_um


@pytest.mark.slow
def test_going_back_to_the_former_set_asks_for_arming_as_well() -> None:
    bench = working()
    for name in ("0123456789abcdef", ""):
        change(bench, models=name)
        bench.run(0.3)
    bench.run(5.0)
    assert not bench.authority
    assert bench.names().count("models_changed") == 2


@pytest.mark.slow
def test_a_device_that_is_armed_with_promoted_models_follows_them() -> None:
    bench = armed(Mode.MANUAL)
    bench.ask("disarm")
    bench.advise_um = 70.0
    change(bench, models="0123456789abcdef")
    bench.run(0.3)
    bench.ask("mode", mode=Mode.AUTO)
    assert bench.ask("arm") == (True, [])
    bench.run(4.0)
    assert bench.authority


def test_a_set_beside_costs_nothing_and_is_told() -> None:
    bench = working()
    change(bench, beside="0123456789abcdef")
    bench.run(3.0)
    assert bench.authority
    told = [event for event in bench.events if event.name == "models_beside"]
    assert [event.text for event in told] == ["0123456789abcdef, before no set"]


def test_a_roll_back_is_an_alarm_until_a_person_has_acted() -> None:
    bench = working()
    change(bench, rolled_back="rolled back from x: an answer was not finite")
    bench.run(0.3)
    state = next(d.state for d in reversed(bench.run(0.3)) if d.state)
    alarm = next(a for a in state.alarms if a.name == "models_rolled_back")
    assert alarm.text == "rolled back from x: an answer was not finite"
    change(bench, rolled_back="")
    bench.run(0.3)
    assert [n for n in bench.names() if n.startswith("models")] == [
        "models_rolled_back",
        "models_acknowledged",
    ]


def test_words_of_a_brain_are_cut_to_what_a_person_reads() -> None:
    long = "x" * 10_000
    advice = Advice(1, 0, 0, 0, None, None, True, [], None, long, long, long)
    cut = bounded(advice)
    assert max(map(len, (cut.models, cut.beside, cut.rolled_back))) == REASON_CHARS_MAX
    assert bounded(cut) is cut
