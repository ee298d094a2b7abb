"""Whether the folders on the way to a socket keep other users out, and whether a socket's server
may be trusted.

Who may write to any folder on the way can put a socket of his own in place of ours.  A folder is
safe when it is root's or this user's and nobody else may write to it.  A sticky folder may be
shared (``/tmp``, ``/run/orbitd`` of the service): what lies in it belongs to whoever made it, and
that is looked at one step further down.
"""

from __future__ import annotations

import grp
import os
import pwd
import socket
import stat
import struct
from pathlib import Path


def unsafe(path: Path) -> str:
    """Why ``path`` or a folder on the way to it is not safe, empty when all are; ``path``
    exists."""
    seen: set[Path] = set()
    for start in (Path(os.path.abspath(path)), Path(os.path.realpath(path))):
        for folder in (*reversed(start.parents), start):
            if folder in seen:
                continue
            seen.add(folder)
            try:
                found = folder.lstat()
            except OSError as error:
                return f"{folder}: {error.strerror}"
            if reason := _reason(folder, found):
                return reason
    found = path.stat()
    if not stat.S_ISDIR(found.st_mode):
        return f"{path} is not a folder"
    if found.st_mode & stat.S_IWOTH:
        return f"{path} has mode {stat.filemode(found.st_mode)}: everybody may put sockets there"
    return ""


def _reason(folder: Path, found: os.stat_result) -> str:
    if found.st_uid not in (0, os.geteuid()):
        return f"{folder} belongs to user {found.st_uid}, who could put sockets there"
    if stat.S_ISLNK(found.st_mode):
        return ""  # its own mode means nothing; where it leads is looked at as well
    if found.st_mode & stat.S_ISVTX:
        return ""
    if found.st_mode & stat.S_IWOTH:
        return f"{folder} has mode {stat.filemode(found.st_mode)}: everybody may put sockets there"
    if found.st_mode & stat.S_IWGRP and found.st_uid != 0 and not _own_group(found.st_gid):
        return (
            f"{folder} has mode {stat.filemode(found.st_mode)}: the members of group "
            f"{found.st_gid} could put "
            f"sockets there; chmod g-w {folder}"
        )
    return ""


def _own_group(gid: int) -> bool:
    """Whether ``gid`` is this user's private group (same name, no other member), or root's."""
    try:
        group, name = grp.getgrgid(gid), pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return False
    return gid == 0 or (group.gr_name == name and set(group.gr_mem) <= {name})


def shared(folder: Path) -> bool:
    """Whether an administrator made ``folder`` for several users: root's, and writable to a
    group."""
    found = folder.stat()
    return found.st_uid == 0 and bool(found.st_mode & stat.S_IWGRP)


def peer_uid(sock: socket.socket) -> int:
    """User id of the process at the other end, as the kernel knows it."""
    credentials = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    uid: int = struct.unpack("3i", credentials)[1]
    return uid


def foreign_server(sock: socket.socket, path: Path, expected: int | None = None) -> str:
    """Why the server of ``path``, to which ``sock`` is connected, is not to be trusted; empty when
    it is.

    It is root, this user or ``expected``; in a folder that is shared, whoever owns the socket.
    """
    uid = peer_uid(sock)
    if expected is not None:
        return "" if uid == expected else f"{path} is served by user {uid}, not by user {expected}"
    if uid in (0, os.geteuid()):
        return ""
    try:
        if shared(path.parent) and path.lstat().st_uid == uid:
            return ""
    except OSError:
        pass
    return f"{path} is served by user {uid}; stop that program"
