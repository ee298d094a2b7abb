"""What a recording holds of the brain: each step with what it took in and what came out of it."""

from __future__ import annotations

from collections import defaultdict
from typing import Final

import msgspec

from firmware_py.brain.journal import numbers
from firmware_py.brain.normal import digest
from firmware_py.recording import TOPICS, Recording, Stored, decode_exact
from firmware_py.records import (
    Advice,
    Block,
    BrainSnapshot,
    BrainState,
    BrainStep,
    CommandReply,
    CommandRequest,
    CommissionState,
    Diagnosis,
    Forecast,
    GuardState,
    ModelsInUse,
    Normal,
    Record,
    RigReading,
    ShadowDiagnosis,
    WindowRecord,
)

OUTPUTS: Final[tuple[type[Record], ...]] = (
    Diagnosis,
    WindowRecord,
    ShadowDiagnosis,
    Forecast,
    Advice,
    BrainState,
    CommissionState,
    CommandReply,
    ModelsInUse,
)
"""What a step puts out; a learned normal state is compared by its name, which those tell."""

_OUTPUT_TOPICS: Final = {TOPICS[kind].name for kind in OUTPUTS}


class RecordedStep(msgspec.Struct):
    """One step of the brain as the recording holds it.

    ``numbers`` are those of the blocks, readings and guard states that it took; ``requests`` and
    ``normals`` the records themselves, None where the recording lacks one; ``snapshot`` the parts
    of a snapshot before it.  Unless ``followed`` by the next step, ``outputs`` may hold those of a
    lost one.
    """

    step: BrainStep
    numbers: dict[type[Record], set[int]]
    requests: list[CommandRequest | None]
    normals: list[Normal | None]
    outputs: list[Stored]
    snapshot: list[BrainSnapshot]
    followed: bool = False

    @property
    def wanted(self) -> int:
        """How many records of the guard it took."""
        return sum(map(len, self.numbers.values()))


def read_steps(recording: Recording) -> list[RecordedStep]:
    """Every step of the recording, in its order; none in one of before brains recorded their
    steps."""
    steps: list[RecordedStep] = []
    normals: dict[str, Normal] = {}
    requests: dict[int, CommandRequest] = {}
    snapshots: dict[tuple[int, int], list[BrainSnapshot]] = defaultdict(list)
    for message in recording.messages():
        if message.topic == TOPICS[BrainStep].name:
            step = decode_exact(message, BrainStep)
            if steps:
                steps[-1].followed = step.seq == steps[-1].step.seq + 1
            steps.append(_recorded(step, requests))
        elif message.topic == TOPICS[BrainSnapshot].name:
            part = decode_exact(message, BrainSnapshot)
            snapshots[part.seq, part.now_ns].append(part)
        elif message.topic == TOPICS[Normal].name:
            normal = decode_exact(message, Normal)
            normals[digest(normal)] = normal
        elif message.topic == TOPICS[CommandRequest].name:
            request = decode_exact(message, CommandRequest)
            requests[request.seq] = request
        elif message.topic in _OUTPUT_TOPICS and steps and _from_brain(message, steps[-1].step):
            steps[-1].outputs.append(message)
    for each in steps:
        each.normals = [normals.get(name) for name in each.step.normals]
        each.snapshot = snapshots.get((each.step.seq, each.step.now_ns), [])
    return steps


def _recorded(step: BrainStep, requests: dict[int, CommandRequest]) -> RecordedStep:
    taken: dict[type[Record], set[int]] = {
        Block: set(numbers(step.blocks)),
        RigReading: set(numbers(step.readings)),
        GuardState: set(numbers(step.states)),
    }
    return RecordedStep(step, taken, [requests.get(seq) for seq in step.requests], [], [], [])


def _from_brain(message: Stored, step: BrainStep) -> bool:
    """Whether a recorded output is the brain's: replies come from the guard as well."""
    if message.topic != TOPICS[CommandReply].name:
        return True
    return decode_exact(message, CommandReply).seq in step.requests
