"""One set of models at work: diagnosis, commissioning and policy on what the machine sends."""

from __future__ import annotations

import msgspec

from firmware_py.acquire.windows import Window
from firmware_py.brain.commissioning import Commissioner, CommissionerState
from firmware_py.brain.diagnosis import Diagnoser, DiagnoserState
from firmware_py.brain.observation import Present
from firmware_py.brain.policy import Policy, PolicyState, Proposal
from firmware_py.brain.prediction import slow_roll_forward
from firmware_py.brain.store import Models
from firmware_py.config import Config
from firmware_py.records import Diagnosis, GuardState, Normal


class LineState(msgspec.Struct):
    """All that changes in a line, and its newest diagnosis."""

    diagnoser: DiagnoserState
    commissioner: CommissionerState
    policy: PolicyState
    diagnosis: Diagnosis | None = None


class Line:
    """What one set of models makes of windows and of the present.

    Parameters
    ----------
    models
        The set; what is absent withholds what it is needed for.
    config
        The device's configuration.
    """

    def __init__(self, models: Models, config: Config) -> None:
        slow_roll_m = slow_roll_forward(config)
        self.models = models
        self.diagnoser = Diagnoser(models.classifier, config.machine, slow_roll_m)
        self.commissioner = Commissioner(models.classifier, config, self.diagnoser, slow_roll_m)
        self.policy = Policy(models, config)
        self.diagnosis: Diagnosis | None = None

    @property
    def state(self) -> LineState:
        """All that changes."""
        return LineState(
            self.diagnoser.state, self.commissioner.state, self.policy.state, self.diagnosis
        )

    @state.setter
    def state(self, state: LineState) -> None:
        self.diagnoser.state, self.commissioner.state = state.diagnoser, state.commissioner
        self.policy.state, self.diagnosis = state.policy, state.diagnosis

    @property
    def labels(self) -> list[str]:
        """Its models, as records name them."""
        m = self.models
        return [model.label for model in (m.classifier, m.actor, m.surrogate) if model]

    @property
    def refused(self) -> int:
        """Answers so far that could not be used."""
        return (
            self.diagnoser.counters["model_answers_refused"]
            + self.policy.counters["forecasts_refused"]
        )

    def adopt(self, normal: Normal) -> None:
        """Use a stored normal state, or refuse it by name; what is being gathered goes first."""
        if not self.commissioner.gathering:
            self.commissioner.adopt(normal)

    def look(self, window: Window, guard: GuardState | None) -> Diagnosis:
        """Diagnosis of ``window``; the policy learns from it."""
        diagnosis, orders = self.diagnoser.step(window)
        self.commissioner.gather(window, orders, diagnosis, self.diagnoser.answer, guard)
        if orders is not None:
            self.policy.learn(window, orders)
        self.diagnosis = diagnosis
        return diagnosis

    def propose(self, present: Present | None, guard: GuardState | None, now_ns: int) -> Proposal:
        """What it would advise now."""
        return self.policy.step(present, self.diagnosis, guard, now_ns)

    def take_late(self) -> int:
        """Answers that came after their deadline since the last call; of this computer's load, no
        part of the state."""
        m = self.models
        models = [model for model in (m.classifier, m.actor, m.surrogate) if model]
        return sum(model.session.take_late() for model in models)
