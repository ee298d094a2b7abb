"""Keys of one's own that sign sets of models, and the list of those that a device trusts."""

from __future__ import annotations

import base64
import os
import re
import stat
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from firmware_py.durable import sync_folder, write_durable, write_new
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import (
    MANIFEST,
    SIGNATURE,
    files_in,
    manifest_of,
    read_manifest,
    unlike,
)

SUFFIX: Final = ".key"
_NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}\Z"
_HEAD, _KEYS = re.compile(r"^\s*\[\s*models\s*\]"), re.compile(r"^\s*public_keys\s*=")


def keys_folder() -> Path:
    """Where a person's keys lie."""
    home = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(home) / "orbitd" / "keys"


def make_key(folder: Path, name: str) -> str:
    """Make the private key ``name`` in ``folder``, readable by its owner alone; its public key.

    Raises
    ------
    SetError
        No such name, a key of that name, or the folder cannot be written.
    """
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import (
        Encoding,
        NoEncryption,
        PrivateFormat,
    )

    path, key = _path(folder, name), Ed25519PrivateKey.generate()
    data = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_new(path, data, 0o600)
        sync_folder(folder)
    except FileExistsError as error:
        raise SetError(
            f"{path}: there is a key of that name; nothing was overwritten: choose another name"
        ) from error
    except OSError as error:
        raise SetError(f"{path}: {error.strerror}; free or change the disk") from error
    return public_of(folder, name)


def own_names(folder: Path) -> list[str]:
    """Names of the keys in ``folder``."""
    return sorted(path.stem for path in folder.glob(f"*{SUFFIX}"))


def public_of(folder: Path, name: str) -> str:
    """The public key of ``name``, as it stands in ``models.public_keys``.

    Raises
    ------
    SetError
        See :func:`sign`.
    """
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    public = _private(folder, name).public_key()
    return base64.b64encode(
        public.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    ).decode()


def sign(folder: Path, name: str, models: Path) -> list[str]:
    """Sign the set in the folder ``models`` with the key ``name``; the files that it covers.

    A manifest that says what is there stays as it is; else it is written anew.

    Raises
    ------
    SetError
        No such key, others may read it, no set there, or it cannot be written.
    """
    key, names = _private(folder, name), files_in(models)
    if not names:
        raise SetError(f"{models}: no models in it; name the folder of a set")
    try:
        files = {each: (models / each).read_bytes() for each in names}
        path = models / MANIFEST
        data = path.read_bytes() if path.is_file() else b""
        if not data or not _holds(data, files):
            data = manifest_of(files.items())
            write_durable(path, data, 0o644)
        write_durable(models / SIGNATURE, key.sign(data), 0o644)
    except OSError as error:
        raise SetError(f"{models}: {error.strerror}; nothing was signed") from error
    return names


def _holds(data: bytes, files: dict[str, bytes]) -> bool:
    """Whether the manifest ``data`` names each of ``files`` as it is."""
    try:
        listed = read_manifest(data, MANIFEST).files
    except SetError:
        return False
    return all(n in listed and not unlike(listed[n], content) for n, content in files.items())


def _path(folder: Path, name: str) -> Path:
    if not re.search(_NAME, name):
        raise SetError(f"{name!r}: no name for a key; use 1 to 40 letters, digits, - . and _")
    return folder / f"{name}{SUFFIX}"


def _private(folder: Path, name: str) -> Any:
    """The private key ``name``; one that others may read is refused."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    path = _path(folder, name)
    try:
        mode, data = path.stat().st_mode, path.read_bytes()
    except OSError as error:
        known = ", ".join(own_names(folder)) or "none"
        raise SetError(
            f"{path}: {error.strerror}; there are: {known}; `orbitd keys new` makes one"
        ) from error
    if stat.S_IMODE(mode) & 0o077:
        raise SetError(f"{path}: others may read it; `chmod 600` it, or make a new one")
    try:
        key = load_pem_private_key(data, password=None)
    except (ValueError, TypeError) as error:
        raise SetError(f"{path}: no private key without a password ({error})") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise SetError(f"{path}: not an Ed25519 key; make one with `orbitd keys new`")
    return key


def with_public_keys(text: str, keys: Sequence[str]) -> str:
    """``device.toml`` with ``models.public_keys = keys`` and everything else as it was.

    Raises
    ------
    SetError
        The text is laid out so that this cannot be done for sure; the text says what to write.
    """
    quoted = ", ".join(f'"{key}"' for key in keys)
    row = f"public_keys = [{quoted}]"
    lines = text.splitlines()
    head = next((i for i, line in enumerate(lines) if _HEAD.match(line)), None)
    if head is None:
        lines += ["", "[models]", row]
    else:
        after = range(head + 1, len(lines))
        end = next((i for i in after if lines[i].lstrip().startswith("[")), len(lines))
        first = next((i for i in range(head + 1, end) if _KEYS.match(lines[i])), None)
        last = None if first is None else _closing(lines, first)
        lines[head + 1 if first is None else first : head + 1 if last is None else last + 1] = [row]
    changed = "\n".join(lines) + "\n"
    try:
        wanted, found = tomllib.loads(text), tomllib.loads(changed)
    except tomllib.TOMLDecodeError:
        found, wanted = {}, {"": ""}
    else:
        wanted.setdefault("models", {})["public_keys"] = list(keys)
    if found != wanted:
        raise SetError(f"device.toml: write it by hand into [models]: {row}")
    return changed


def _closing(lines: Sequence[str], first: int) -> int:
    """The line at which the list that begins at ``first`` ends."""
    for last in range(first, len(lines)):
        if "]" in lines[last].partition("#")[0]:
            return last
    return first
