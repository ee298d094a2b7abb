"""``orbitd keys``: keys that sign sets of models, and those that a device trusts.

new NAME  make a key of one's own;  list  own keys and trusted ones;  sign FOLDER  sign a set of
models;  trust KEY  let the rig's device take sets of that key;  revoke KEY  no longer.  KEY is an
own key's name, a public key, or the start of a trusted one's fingerprint.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import msgspec

from firmware_py import launch
from firmware_py.config import SHIPPED
from firmware_py.durable import write_durable
from firmware_py.machine.folder import DEVICE
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import fingerprint, public_key
from firmware_py.model_sets.own_keys import (
    keys_folder,
    make_key,
    own_names,
    public_of,
    sign,
    with_public_keys,
)

RESTART = "restart the device (`systemctl restart orbitd.target`, or `orbitd run` again) for it"


def main(argv: list[str]) -> int:
    """Make, list, sign, trust, revoke."""
    options = _parser().parse_args(argv)
    folder = options.keys or keys_folder()
    if options.action == "new":
        public = make_key(folder, options.name)
        return _tell(
            options, {"name": options.name, "public": public}, [f"{options.name} {public}"]
        )
    if options.action == "sign":
        names = sign(folder, options.key, options.folder)
        said = f"signed {', '.join(names)} in {options.folder} with {options.key}"
        return _tell(options, {"files": names, "key": options.key}, [said])
    place = launch.shelf_place(options)
    trusted = place.config.models.public_keys
    own = {public_of(folder, name): name for name in own_names(folder)}
    if options.action == "list":
        return _list(options, own, trusted)
    key = _meant(options.key, own, trusted)
    if options.action == "trust":
        keys = [*trusted, *([] if key in trusted else [key])]
    elif key in trusted:
        keys = [each for each in trusted if each != key]
    else:
        raise SetError(f"revoke: {fingerprint(key)} is not among the trusted keys")
    _write(place.source.path, keys)
    left = "" if keys else "; no key is left: unsigned sets are taken, unless require_signature"
    done = "trusted" if options.action == "trust" else f"revoked{left}"
    return _tell(options, {"public_keys": keys}, [f"{fingerprint(key)} {done}; {RESTART}"])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="orbitd keys",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    actions = parser.add_subparsers(dest="action", required=True)
    for name, text in (
        ("new", "make a key of one's own"),
        ("list", "own keys, and those that the device trusts"),
        ("sign", "sign the set of models in a folder"),
        ("trust", "let the device take sets that a key has signed"),
        ("revoke", "no longer"),
    ):
        action = actions.add_parser(name, help=text, description=text)
        action.add_argument("--json", action="store_true", help="the answer as JSON")
        action.add_argument(
            "--keys", type=Path, metavar="DIR", help="folder of one's own keys (~/.config/orbitd)"
        )
        if name == "new":
            action.add_argument("name", metavar="NAME")
        elif name == "sign":
            action.add_argument("folder", type=Path, metavar="FOLDER")
            action.add_argument("--key", required=True, metavar="NAME", help="an own key")
        else:
            launch.add_options(action)
            if name != "list":
                action.add_argument("key", metavar="KEY")
    return parser


def _meant(text: str, own: dict[str, str], trusted: list[str]) -> str:
    """The public key that a person means."""
    found = [key for key, name in own.items() if name == text]
    found = found or [k for k in trusted if len(text) >= 6 and fingerprint(k).startswith(text)]
    if len(found) == 1:
        return found[0]
    public_key(text, repr(text[:20]))
    return text


def _write(rig: Path, keys: list[str]) -> None:
    """Put ``keys`` into the rig's file, whole or not at all."""
    path = rig / DEVICE if rig.is_dir() else rig
    if path.resolve().is_relative_to(SHIPPED):
        raise SetError(
            f"{path}: the package's own rig; `orbitd rig new FOLDER` makes one that can be changed"
        )
    text = with_public_keys(path.read_text(encoding="utf-8"), keys)
    write_durable(path, text.encode(), path.stat().st_mode & 0o777)


def _list(options: argparse.Namespace, own: dict[str, str], trusted: list[str]) -> int:
    rows = [
        {"name": own.get(key, ""), "fingerprint": fingerprint(key), "public": key,
         "trusted": key in trusted}
        for key in [*own, *(key for key in trusted if key not in own)]
    ]  # fmt: skip
    words = [
        f"{'trusted' if row['trusted'] else '-':<8} {row['fingerprint']} {row['public']} "
        f"{row['name'] or '(not here)'}"
        for row in rows
    ]
    return _tell(options, rows, words or ["no keys; `orbitd keys new NAME` makes one"])


def _tell(options: argparse.Namespace, found: object, words: list[str]) -> int:
    print(msgspec.json.encode(found).decode() if options.json else "\n".join(words))
    return 0
