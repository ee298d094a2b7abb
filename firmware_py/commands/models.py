"""``orbitd models``: which models the device thinks with, and how another set comes into use.

list  what is in use, on the shelf and in shadow;  add FILE|FOLDER  check a set and put it on the
shelf;  shadow SET  let it run beside (`none`: nothing);  promote  let what is in shadow decide;
rollback  take that back.

`list` changes nothing.  The others hold from the next start of the device.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import msgspec

from firmware_py import launch
from firmware_py.brain.candidate import check_useful, examine, read_source
from firmware_py.brain.store import Model, Models, load_models
from firmware_py.config import Config
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

NEXT_START = "no device runs here: it holds from the next start"
NONE = "none"


def main(argv: list[str]) -> int:
    """List, add, put into shadow, compare, promote, roll back."""
    options = _parser().parse_args(argv)
    place = launch.shelf_place(options)
    shelf = Shelf(place.folder)
    done: dict[str, object]
    if options.action == "list":
        done = listed(shelf, place.config)
        print(msgspec.json.encode(done).decode() if options.json else "\n".join(list_words(done)))
        return 0
    if options.action == "add":
        done = {"set": add(shelf, place.config, options.source, options.name)}
        return _tell(options, done)
    done = {"pointer": _step(shelf, place.config, options), "note": NEXT_START}
    return _tell(options, done)


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


def add(shelf: Shelf, config: Config, source: Path, name: str | None) -> StoredSet:
    """Put the set at ``source`` on the shelf.

    Raises
    ------
    ModelError, SetError
        It is not taken; nothing has changed.
    """
    check_useful(config)
    layers = shelf.folders(list(shelf.pointer().active))
    called = (name or source.resolve().name)[:60]
    if not called.isprintable() or called == NONE:
        raise SetError(f"{called!r}: no name for a set; give another one with --name")
    note = SetNote(called, str(source.resolve()), time.time_ns())
    return shelf.put(read_source(source), note, lambda part: void(examine(part, config, layers)))


def void(_: object) -> None:
    """Of a check, only that it did not refuse."""


def _step(shelf: Shelf, config: Config, options: argparse.Namespace) -> Pointer:
    """The pointer after the action that ``options`` ask for, on files alone."""
    now_ns = time.time_ns()
    if options.action == "shadow":
        if options.set == NONE:
            return shelf.change(shadowed(None), "shadow none", now_ns)
        chosen = shelf.find(options.set)
        layers = shelf.folders(list(shelf.pointer().active))
        examine(chosen.folder, config, layers)
        return shelf.change(shadowed(chosen.id), f"shadow {chosen.note.name}", now_ns)
    if options.action == "promote":
        meant = shelf.find(options.set).id if options.set else None
        return shelf.change(lambda p: _promoted(p, meant), "promote", now_ns)
    return shelf.change(rolled_back, "rollback", now_ns)


def _promoted(pointer: Pointer, meant: str | None) -> Pointer:
    if meant is not None and pointer.shadow != meant:
        raise SetError(
            f"promote: {meant} is not in shadow ({pointer.shadow or 'nothing'} is); "
            f"`orbitd models shadow {meant}` comes first"
        )
    return promoted(pointer)


def listed(shelf: Shelf, config: Config) -> dict[str, object]:
    """What ``list`` tells."""
    pointer, trouble = Pointer(), []
    layers: list[Path] = []
    try:
        pointer = shelf.pointer()
        layers = shelf.folders(list(pointer.active))
    except SetError as error:
        trouble.append(str(error))
    models = load_models(config, layers)
    return {
        "directory": config.models.directory or "the package's",
        "signature_required": config.models.signed_only,
        "pointer": pointer,
        "in_use": [model.described for model in used(models)],
        "refused": models.refusals,
        "sets": [
            {"id": s.id, "name": s.note.name, "source": s.note.source, "files": files_in(s.folder)}
            for s in shelf.sets()
        ],
        "trouble": trouble,
        "shelf": str(shelf.folder),
    }


def used(models: Models) -> list[Model]:
    """The models of a set that are there."""
    found = (models.classifier, models.actor, models.surrogate, models.shadow)
    return [model for model in found if model]


def list_words(found: dict[str, object]) -> list[str]:
    """The same for a person."""
    pointer = found["pointer"]
    assert isinstance(pointer, Pointer)
    required = "required" if found["signature_required"] else "not required"
    lines = [
        f"models      {found['directory']}; shelf {found['shelf']}; signatures {required}",
        f"in use      generation {pointer.generation}: {_layers(pointer.active)}",
        *(f"            {text}" for text in found["in_use"]),  # type: ignore[attr-defined]
    ]
    refused = found["refused"]
    assert isinstance(refused, dict)
    lines += [f"REFUSED     {kind}: {text}" for kind, text in refused.items()]
    lines += [f"TROUBLE     {text}" for text in found["trouble"]]  # type: ignore[attr-defined]
    if pointer.former is not None:
        lines.append(f"rollback to {_layers(pointer.former)}")
    lines.append(f"in shadow   {pointer.shadow or 'nothing'}")
    if pointer.rolled_back:
        lines.append(f"ROLLED BACK {pointer.rolled_back}")
    sets = found["sets"]
    assert isinstance(sets, list)
    lines += [f"on shelf    {s['id']} {s['name']}: {', '.join(s['files'])}" for s in sets]
    return lines


def _layers(layers: list[str]) -> str:
    return " + ".join(["the device's own", *layers])


def _tell(options: argparse.Namespace, done: dict[str, object]) -> int:
    if options.json:
        print(msgspec.json.encode(done, enc_hook=str).decode())
        return 0
    stored = done.get("set")
    if isinstance(stored, StoredSet):
        print(f"added {stored.id} {stored.note.name}: {', '.join(files_in(stored.folder))}")
    pointer = done.get("pointer")
    if isinstance(pointer, Pointer):
        print(f"models {options.action}: in use {_layers(pointer.active)}; "
              f"in shadow {pointer.shadow or 'nothing'}")  # fmt: skip
    if note := done.get("note"):
        print(f"orbitd models: {note}", file=sys.stderr)
    return 0
