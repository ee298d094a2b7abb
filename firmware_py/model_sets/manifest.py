"""The manifest of a set of models: SHA-256 and size of each file, signed as a whole.

``manifest.json`` names every file of the set; ``manifest.json.sig`` is an Ed25519 signature of its
bytes.  One key or another of ``models.public_keys`` must have made it where signatures are
required.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.decoding import FILE_LIMIT_BYTES, OutsideError, from_json
from firmware_py.model_sets.errors import SetError

MANIFEST: Final = "manifest.json"
SIGNATURE: Final = "manifest.json.sig"
FACTORS: Final = "predictor.json"
OWN: Final = "own.onnx"
"""A classifier of one's own recordings."""
KINDS: Final = {
    "classifier": "classifier.onnx",
    "actor": "actor.onnx",
    "surrogate": "surrogate.onnx",
    "predictor": FACTORS,
    "measured classifier": OWN,
}
"""Files of a set that the device loads, by the kind in their card."""


class ManifestEntry(msgspec.Struct, frozen=True):
    """One file: digest in hexadecimal, size in bytes."""

    sha256: str
    bytes: int


class Manifest(msgspec.Struct, frozen=True):
    """The files of a set by name."""

    schema: int
    files: dict[str, ManifestEntry]


def manifest_of(files: Iterable[tuple[str, bytes]]) -> bytes:
    """The text of the manifest of ``files``, name and content each."""
    entries = {
        name: {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
        for name, data in files
    }
    text = msgspec.json.encode({"schema": 1, "files": entries}, order="sorted")
    return msgspec.json.format(text, indent=2) + b"\n"


def read_manifest(data: bytes, where: str) -> Manifest:
    """The manifest in ``data``.

    Raises
    ------
    SetError
        It is none.
    """
    try:
        return from_json(data, Manifest, FILE_LIMIT_BYTES)
    except OutsideError as error:
        raise SetError(f"{where}: no manifest ({error}); write it again") from error


def set_id(manifest: bytes) -> str:
    """The name under which a set is known: the start of its manifest's SHA-256."""
    return hashlib.sha256(manifest).hexdigest()[:16]


def unlike(entry: ManifestEntry, data: bytes) -> str:
    """How ``data`` differs from what its manifest says; empty: not at all."""
    digest = hashlib.sha256(data).hexdigest()
    if len(data) != entry.bytes:
        return f"{len(data)} bytes, the manifest says {entry.bytes}"
    if digest != entry.sha256:
        said = f"the manifest says {entry.sha256[:12]}.."
        return f"SHA-256 {digest[:12]}.., {said}: changed after packaging"
    return ""


def signed_by(data: bytes, signature: bytes, public_keys: Sequence[str]) -> str:
    """Which of ``public_keys`` signed ``data``; empty: none of them.

    Raises
    ------
    SetError
        One of the keys is none.
    """
    # Imported here: a device whose models need no signature starts without cryptography.
    from cryptography.exceptions import InvalidSignature

    for number, text in enumerate(public_keys):
        key = public_key(text, f"models.public_keys[{number}]")
        try:
            key.verify(signature, data)  # type: ignore[attr-defined]
        except InvalidSignature:
            continue
        return text
    return ""


def public_key(text: str, place: str) -> object:
    """The Ed25519 public key whose base64 is ``text``.

    Raises
    ------
    SetError
        It is none; ``place`` says where it stands.
    """
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_der_public_key

    try:
        key = load_der_public_key(base64.b64decode(text, validate=True))
    except (binascii.Error, ValueError, UnsupportedAlgorithm) as error:
        raise SetError(
            f"{place}: not the base64 of a public key; take the line that `orbitd keys list` "
            "shows, or the middle line of `openssl pkey -pubout`"
        ) from error
    if not isinstance(key, Ed25519PublicKey):
        raise SetError(f"{place}: not an Ed25519 key; make one with `orbitd keys new`")
    return key


def fingerprint(text: str) -> str:
    """The short name of a public key for people: the start of its SHA-256."""
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def files_in(folder: Path) -> list[str]:
    """Names of the files in ``folder`` that the device loads."""
    return [name for name in KINDS.values() if (folder / name).is_file()]
