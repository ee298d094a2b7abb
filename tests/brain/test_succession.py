"""Sets of models at work: in shadow, promoted, rolled back by a person and by themselves; latched
until a person acts; and the same bits again in a brain that goes on from any snapshot."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import Models
from firmware_py.brain.succession import LATE_MOST, named
from firmware_py.config import SHIPPED, load
from firmware_py.model_sets.shelf import Shelf, promoted, shadowed
from firmware_py.records import (
    LOST,
    Advice,
    CommandReply,
    CommandRequest,
    Diagnosis,
    ModelsInUse,
    PeerRecord,
    decode,
    encode,
)

from .machine import Machine
from .onnx_models import actor, classifier
from .shelves import brain, put, rig_with_models
from .test_brain_core import feed, guard_state, of

QUICK = {"disagreement_decisions": 10}


class Flight:
    """A brain on a machine, with a shelf; commands come between two stretches."""

    def __init__(self, folder: Path, **changed: object) -> None:
        self.folder, self.machine, self.seq = folder, Machine(), 0
        self.config = rig_with_models(folder / "own", **changed)
        self.shelf = Shelf(folder / "shelf")
        self.core: BrainCore = brain(self.config, self.shelf)
        self.said: list[PeerRecord] = []

    def put(self, name: str, **files: bytes) -> str:
        return put(self.shelf, self.folder, name, **files)

    def run(self, seconds: float) -> list[PeerRecord]:
        said = feed(self.core, [guard_state(), *self.machine.run(seconds)])
        self.said += said
        return said

    def ask(self, action: str, target: str = "") -> CommandReply:
        self.seq += 1
        request = CommandRequest(self.seq, "models", action=action, target=target)
        said = self.core.step([request], self.machine.now_ns)
        self.said += said
        return of(CommandReply, said)[0]

    @property
    def stands(self) -> ModelsInUse:
        return of(ModelsInUse, self.said)[-1]

    @property
    def advice(self) -> Advice:
        return of(Advice, self.said)[-1]


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    return Flight(tmp_path)


@pytest.mark.slow
def test_nothing_follows_from_a_set_in_shadow(tmp_path: Path) -> None:
    alone, accompanied = Flight(tmp_path / "a"), Flight(tmp_path / "b")
    new = accompanied.put("new", actor=actor(60e-6), classifier=classifier((9.0, -4, -4, -4)))
    assert accompanied.ask("shadow", new).accepted
    alone.said += alone.core.step([], alone.machine.now_ns)
    for each in (alone, accompanied):
        each.run(6.5)
    assert of(Diagnosis, alone.said) == of(Diagnosis, accompanied.said)
    blank = {"beside": ""}
    assert of(Advice, alone.said) == [
        msgspec.structs.replace(each, **blank) for each in of(Advice, accompanied.said)
    ]
    stands = accompanied.stands
    assert (stands.active, stands.beside, stands.role) == ([], [new], "shadow")
    counts = stands.compared
    assert sum(n for name, n in counts.items() if name.startswith("said:normal>")) > 0
    assert counts["apart_um"] / counts["both"] == pytest.approx(20.0, abs=0.01)
    assert counts["priced"] > 0
    assert counts["active_forecasts"] > 0
    assert counts["active_W"] < counts["beside_W"]  # a wider film costs less


@pytest.mark.slow
def test_promotion_keeps_what_the_shadow_has_learned_and_rolls_back(flight: Flight) -> None:
    new = flight.put("new", actor=actor(60e-6))
    assert flight.ask("promote").reasons == [
        "promote: no set is in shadow; `orbitd models shadow SET` comes first"
    ]
    assert flight.ask("add", new).accepted
    assert flight.ask("shadow", new).accepted
    flight.run(6.0)
    assert flight.advice.clearance_um == pytest.approx(80.0)
    assert not flight.ask("promote", "0" * 16).accepted
    assert flight.ask("promote", new).accepted
    said = of(Advice, flight.run(0.5))
    assert said[0].models == new
    assert said[0].beside == ""
    assert all(each.clearance_um == pytest.approx(60.0) for each in said)  # at once, without doubt
    assert flight.stands.former == []
    assert (flight.stands.beside, flight.stands.role) == ([], "former")
    numbers = [d.seq for d in of(Diagnosis, flight.said)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert flight.ask("rollback").accepted
    assert of(Advice, flight.run(0.5))[-1].clearance_um == pytest.approx(80.0)
    assert flight.stands.former is None
    assert flight.ask("rollback").reasons == [
        "rollback: nothing was promoted that could be taken back"
    ]


def test_a_former_set_that_does_not_run_is_loaded(flight: Flight) -> None:
    one, two = (flight.put(n, actor=actor(um * 1e-6)) for n, um in (("one", 60), ("two", 70)))
    flight.ask("shadow", one)
    flight.ask("promote")
    flight.ask("shadow", two)  # in place of the former one
    assert flight.stands.former == []
    assert flight.stands.beside == [one, two]
    assert flight.ask("rollback").accepted
    assert flight.stands.active == []
    assert flight.stands.beside is None


def test_a_set_that_cannot_be_loaded_is_refused_and_nothing_changes(flight: Flight) -> None:
    before = flight.run(0.5)
    assert before
    wrong = flight.put("wrong", actor=actor(60e-6, physics_version="9"))
    for action in ("add", "shadow"):
        reply = flight.ask(action, wrong)
        assert not reply.accepted
        assert "physics_version '9'" in reply.reasons[0]
    assert "is not in" in flight.ask("shadow", "0" * 16).reasons[0]
    assert (flight.stands.active, flight.stands.beside) == ([], None)


BAD = {
    "not finite": ({"actor": actor(float("nan"))}, "an answer was not finite"),
    "classifier not finite": ({"classifier": classifier(score=np.nan)}, "not finite"),
    "another word": ({"classifier": classifier((9.0, -4, -4, -4))}, "diagnoses differ"),
    "another clearance": ({"actor": actor(150e-6)}, "would-be clearances differ"),
}
SLOW = [pytest.param(what, marks=pytest.mark.slow) for what in list(BAD)[2:]]


@pytest.mark.parametrize("what", [*list(BAD)[:2], *SLOW])
def test_a_promoted_set_that_goes_wrong_is_rolled_back_once(tmp_path: Path, what: str) -> None:
    files, words = BAD[what]
    flight = Flight(tmp_path, **QUICK)
    finite = "finite" not in what
    flight.run(6.0 if finite else 0.5)
    bad = flight.put("bad", **files)
    flight.ask("shadow", bad)
    flight.ask("promote")
    said = flight.run(14.0 if finite else 1.0)
    stands = flight.stands
    assert (stands.active, stands.beside, stands.former) == ([], None, None)
    assert stands.rolled_back.startswith(f"rolled back from {bad}: ")
    assert words in stands.rolled_back
    names = [advice.models for advice in of(Advice, said)]
    assert sum(a != b for a, b in pairwise(names)) == (names[0] == bad)
    assert of(Advice, said)[-1].rolled_back == stands.rolled_back
    assert not finite or of(Advice, said)[-1].clearance_um == pytest.approx(80.0)
    flight.run(1.5)
    assert flight.stands.rolled_back  # it stands until a person acts
    assert not flight.ask("promote", bad).accepted
    assert flight.stands.rolled_back
    assert flight.ask("shadow", "").accepted
    assert flight.stands.rolled_back == ""


@pytest.mark.slow
def test_a_disagreement_that_is_allowed_changes_nothing(tmp_path: Path) -> None:
    flight = Flight(tmp_path, disagreement_max=1.0, **QUICK)
    flight.run(6.0)
    flight.ask("shadow", flight.put("other", **BAD["another clearance"][0]))
    flight.ask("promote")
    flight.run(14.0)
    assert flight.stands.rolled_back == ""
    assert flight.advice.clearance_um == pytest.approx(150.0)


def late(flight: Flight, active: int, beside: int, times: int) -> None:
    for _ in range(times):
        flight.said += flight.core.step([], flight.machine.now_ns, (active, beside))


def test_late_answers_cost_a_promoted_set_its_place_and_a_busy_computer_does_not(
    flight: Flight,
) -> None:
    new = flight.put("new", actor=actor(60e-6))
    flight.ask("shadow", new)
    flight.ask("promote")
    late(flight, 1, 1, 3 * LATE_MOST)
    assert flight.stands.rolled_back == ""
    late(flight, 1, 0, LATE_MOST)
    assert "5 answers within 60 s took longer than models.deadline_ms = 20" in (
        flight.stands.rolled_back
    )
    assert flight.stands.active == []
    flight.run(1.0)  # an account with all that was counted
    flight.ask("shadow", new)
    late(flight, 0, 1, LATE_MOST)
    assert flight.stands.rolled_back.startswith("taken out of shadow")
    assert flight.stands.beside is None


def test_the_time_of_an_answer_is_held_against_the_deadline(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    line = flight.core._sets.active
    for model in (line.models.classifier, line.models.actor, line.models.surrogate):
        assert model is not None
        assert model.session.deadline_s == pytest.approx(0.02)
        model.session.deadline_s = 0.0
    flight.run(1.0)
    assert flight.core.take_late()[0] > 0
    assert flight.core.take_late() == (0, 0)


def test_a_machine_that_is_monitor_only_takes_none() -> None:
    kit = load(SHIPPED / "kit")[0]
    core = BrainCore(kit, Models())
    said = core.step([CommandRequest(1, "models", action="shadow", target="0" * 16)], 1)
    assert "monitor only" in of(CommandReply, said)[0].reasons[0]


@pytest.mark.slow
def test_a_start_follows_the_pointer(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    one, two = (flight.put(n, actor=actor(um * 1e-6)) for n, um in (("one", 60), ("two", 70)))
    flight.shelf.change(shadowed(one), "", 1)
    flight.shelf.change(promoted, "", 1)
    flight.core = brain(flight.config, flight.shelf)
    flight.run(6.0)
    assert (flight.stands.active, flight.stands.beside, flight.stands.role) == ([one], [], "former")
    assert flight.advice.clearance_um == pytest.approx(60.0)
    flight.shelf.change(shadowed(two), "", 1)
    flight.core = brain(flight.config, flight.shelf)
    flight.run(1.0)
    assert flight.stands.beside == [one, two]
    assert flight.stands.role == "shadow"
    (flight.shelf.folder / "sets" / one).rename(tmp_path / "away")
    flight.core = brain(flight.config, flight.shelf)
    flight.run(1.0)
    assert (flight.stands.active, flight.stands.role) == ([], LOST)
    assert flight.advice.clearance_um is None
    assert any("add it again" in reason for reason in flight.advice.reasons)


def script(flight: Flight) -> list[tuple[list[PeerRecord], int, tuple[int, int]]]:
    """Steps with everything: shadow, promotion, a roll-back by itself, late answers."""
    bad = flight.put("bad", **BAD["another word"][0])
    good = flight.put("good", actor=actor(75e-6))
    asked = {
        50: ("shadow", good), 90: ("promote", good), 130: ("shadow", bad), 170: ("promote", bad),
    }  # fmt: skip
    steps, batch = [], list[PeerRecord]([guard_state()])
    for record in flight.machine.run(14.0):
        batch.append(record)
        if len(batch) < 4:
            continue
        number = len(steps)
        if number in asked:
            action, target = asked[number]
            batch.insert(0, CommandRequest(number, "models", action=action, target=target))
        now_ns = flight.machine.offset_ns + getattr(record, "t_acq_ns", 0) + 6_000_000
        steps.append((batch, now_ns, (int(number % 40 == 7), 0)))
        batch = []
    return steps


@pytest.mark.slow
def test_a_brain_restored_at_any_snapshot_goes_on_bit_for_bit(tmp_path: Path) -> None:
    flight = Flight(tmp_path, **QUICK)
    snapshots, out = [], []
    steps = script(flight)
    for number, (records, now_ns, slow) in enumerate(steps):
        snapshots.append(([encode(p) for p in flight.core.snapshot(number, now_ns)],
                          [encode(b) for b in flight.core.recent]))  # fmt: skip
        out.append([encode(r) for r in flight.core.step(records, now_ns, slow)])
    stands = [decode(r) for each in out for r in each]
    roles = {(*m.active, m.role) for m in of(ModelsInUse, stands)}
    assert len(roles) >= 4
    assert of(ModelsInUse, stands)[-1].rolled_back
    for at in (20, 60, 100, 140, 175, 200, len(steps) - 20):
        core = brain(flight.config, flight.shelf)
        parts, blocks = ([decode(x) for x in part] for part in snapshots[at])
        core.restore(parts, blocks)  # type: ignore[arg-type]
        for number in range(at, min(at + 25, len(steps))):
            records, now_ns, slow = steps[number]
            found = [encode(r) for r in core.step(records, now_ns, slow)]
            assert _plain(found) == _plain(out[number]), (at, number)


def _plain(said: list[bytes]) -> list[bytes]:
    """Without snapshots, whose times a restored brain chooses anew."""
    return [each for each in said if type(decode(each)).__name__ != "BrainSnapshot"]


def test_names_of_many_sets_differ() -> None:
    def names(n: int) -> list[str]:
        return [f"{k:016x}" for k in range(n)]

    assert named([]) == ""
    assert named(names(2)).count("+") == 1
    assert len({named(names(n)) for n in range(12)}) == 12
    assert max(len(named(names(n))) for n in range(12)) < 100
