"""``orbitd models``: which models the device thinks with, and how another set comes into use.

list  what is in use, on the shelf and in shadow;  add FILE|FOLDER  check a set and put it on the
shelf;  shadow SET  let it run beside (`none`: nothing);  compare  what both have said;  promote
let what is in shadow decide;  rollback  take that back.

`list` and `compare` change nothing.  The others are commands to the device where one runs; else
they hold from its next start.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import msgspec

from firmware_py import launch
from firmware_py.brain.candidate import check_useful, examine, read_source
from firmware_py.brain.store import load_models
from firmware_py.commands.authority import connect
from firmware_py.commands.models_words import (
    Compared,
    Listing,
    compared,
    compared_words,
    layers,
    list_words,
)
from firmware_py.config import Config
from firmware_py.gate.client import Client
from firmware_py.gate.session import SessionError
from firmware_py.gate.view import DeviceState
from firmware_py.model_sets.compared import pair, read_compared
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import files_in
from firmware_py.model_sets.shelf import (
    Pointer,
    SetNote,
    Shelf,
    StoredSet,
    promoted,
    rolled_back,
    shadowed,
)
from firmware_py.records import CommandReply

NONE = "none"
NEXT_START = "no device runs here: it holds from the next start"


class ModelsOutcome(msgspec.Struct, frozen=True):
    """What a change came to: ``reply`` of a running device, ``pointer`` without one."""

    action: str
    set: str
    reply: CommandReply | None
    pointer: Pointer | None

    @property
    def done(self) -> bool:
        """Whether it was carried out."""
        return self.reply is None or self.reply.accepted


def main(argv: list[str]) -> int:
    """List, add, put into shadow, compare, promote, roll back."""
    options = _parser().parse_args(argv)
    place = launch.shelf_place(options)
    shelf = Shelf(place.folder)
    if options.action == "list":
        found = listed(shelf, place.config, options)
        return _print(options, found, list_words(found))
    if options.action == "compare":
        both = comparison(shelf, options)
        return _print(options, both, compared_words(both))
    outcome = change(shelf, place.config, options)
    _print(options, outcome, _words(outcome))
    return 0 if outcome.done else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="orbitd models",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    actions = parser.add_subparsers(dest="action", required=True)
    for name, text in (
        ("list", "what is in use and on the shelf"),
        ("add", "check a set or a single model, and put it on the shelf"),
        ("shadow", "let a set run beside the active one"),
        ("compare", "what the active set and the one beside have said"),
        ("promote", "let the set in shadow decide"),
        ("rollback", "take the last promotion back"),
    ):
        action = actions.add_parser(name, help=text, description=text)
        launch.add_options(action)
        action.add_argument("--json", action="store_true", help="the answer as JSON")
        if name == "add":
            action.add_argument("source", type=Path, metavar="FILE|FOLDER")
            action.add_argument("--name", help="what to call it (default: the source's name)")
        elif name == "shadow":
            action.add_argument("set", metavar="SET", help="name or start of its id, or `none`")
        elif name == "promote":
            action.add_argument("set", nargs="?", metavar="SET", help="the one in shadow")
    return parser


def change(shelf: Shelf, config: Config, options: argparse.Namespace) -> ModelsOutcome:
    """Carry out what ``options`` ask for: by the running device, else on files.

    Raises
    ------
    ModelError, SetError
        It is refused here; nothing has changed.
    """
    action = options.action
    named = "" if action == "rollback" else getattr(options, "set", None) or ""
    if action == "add":
        stored = add(shelf, config, options.source, options.name)
    elif named in ("", NONE):
        stored = None
    else:
        stored = shelf.find(named)
    if action == "shadow" and stored is not None:
        examine(stored.folder, config, _in_use(shelf))
    target = stored.id if stored else ""
    try:
        with connect(options) as client:
            return ModelsOutcome(action, target, _asked(client, action, target), None)
    except SessionError:
        return ModelsOutcome(action, target, None, _on_files(shelf, action, target))


def _asked(client: Client, action: str, target: str) -> CommandReply:
    value: dict[str, object] = {"action": action, "set": target}
    return client.ask("models", value)


def _on_files(shelf: Shelf, action: str, target: str) -> Pointer:
    """The pointer after ``action``, where no device runs."""
    now_ns = time.time_ns()
    if action == "shadow":
        return shelf.change(shadowed(target or None), f"shadow {target}", now_ns)
    if action == "promote":
        return shelf.change(lambda p: _promoted(p, target), "promote", now_ns)
    if action == "rollback":
        return shelf.change(rolled_back, "rollback", now_ns)
    return shelf.pointer()


def _promoted(pointer: Pointer, meant: str) -> Pointer:
    if meant and pointer.shadow != meant:
        raise SetError(
            f"promote: {meant} is not in shadow ({pointer.shadow or 'nothing'} is); "
            f"`orbitd models shadow {meant}` comes first"
        )
    return promoted(pointer)


def add(shelf: Shelf, config: Config, source: Path, name: str | None) -> StoredSet:
    """Put the set at ``source`` on the shelf.

    Raises
    ------
    ModelError, SetError
        It is not taken; nothing has changed.
    """
    check_useful(config)
    below = _in_use(shelf)
    called = (name or source.resolve().name)[:60]
    if not called.isprintable() or called == NONE:
        raise SetError(f"{called!r}: no name for a set; give another one with --name")
    note = SetNote(called, str(source.resolve()), time.time_ns())
    return shelf.put(read_source(source), note, lambda part: examine(part, config, below))


def _in_use(shelf: Shelf) -> list[Path]:
    """Folders of the sets in use."""
    return shelf.folders(list(shelf.pointer().active))


def listed(shelf: Shelf, config: Config, options: argparse.Namespace) -> Listing:
    """What is in use, of the device where one runs, and on the shelf."""
    pointer, below, trouble = Pointer(), list[Path](), list[str]()
    try:
        pointer = shelf.pointer()
        below = shelf.folders(list(pointer.active))
    except SetError as error:
        trouble.append(str(error))
    models = load_models(config, below)
    found = (models.classifier, models.actor, models.surrogate, models.shadow)
    state = _state(options)
    return Listing(
        config.models.directory or "the package's",
        str(shelf.folder),
        config.models.signed_only,
        pointer,
        [model.described for model in found if model],
        models.refusals,
        [
            {
                "id": s.id,
                "name": s.note.name,
                "source": s.note.source,
                "folder": str(s.folder),
                "files": ", ".join(files_in(s.folder)),
            }
            for s in shelf.sets()
        ],
        state.models if state else None,
        trouble,
    )


def comparison(shelf: Shelf, options: argparse.Namespace) -> Compared:
    """What the device counts, or what stands on disk of the pair that the pointer names."""
    state = _state(options)
    if state and state.models:
        said = state.models
        return compared(said.active, said.beside, said.role, state.compared)
    pointer = shelf.pointer()
    active, beside, role = list(pointer.active), pointer.former, "former"
    if pointer.shadow is not None:
        beside, role = [*active, pointer.shadow], "shadow"
    counts = {} if beside is None else read_compared(shelf.folder).get(pair(active, beside), {})
    return compared(active, beside, role if beside is not None else "", counts)


def _state(options: argparse.Namespace) -> DeviceState | None:
    """Of the running device; None without one."""
    try:
        with connect(options) as client:
            return client.status()
    except SessionError:
        return None


def _words(outcome: ModelsOutcome) -> list[str]:
    what = f"models {outcome.action}{f' {outcome.set}' if outcome.set else ''}"
    if outcome.reply is not None:
        said = "accepted" if outcome.reply.accepted else "refused"
        return [f"{what}: {said}", *(f"  - {reason}" for reason in outcome.reply.reasons)]
    if outcome.pointer is None or outcome.action == "add":
        return [f"{what}: on the shelf"]
    p = outcome.pointer
    return [f"{what}: in use {layers(p.active)}, in shadow {p.shadow or 'nothing'}; {NEXT_START}"]


def _print(options: argparse.Namespace, found: object, words: list[str]) -> int:
    print(msgspec.json.encode(found).decode() if options.json else "\n".join(words))
    return 0
