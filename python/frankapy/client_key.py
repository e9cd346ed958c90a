"""The key with which a client connects to a server that has keys; docs/keys.md."""

from __future__ import annotations

import dataclasses
import os
import stat
from pathlib import Path
from typing import TypeVar

import zmq
from google.protobuf import json_format
from google.protobuf.message import Message
from zmq.utils import z85

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError

KEY_VARIABLE = "FRANKAPY_KEY"

_SIZE = 40  # characters of a key, Z85

AnyMessage = TypeVar("AnyMessage", bound=Message)


@dataclasses.dataclass(frozen=True)
class ClientKey:
    """A key, and where it comes from."""

    content: proto.ClientKey
    path: Path
    named: bool  # for this connection, and not for all

    def __repr__(self) -> str:
        """Return its name and file, and no secret."""
        return f"the key {self.content.name!r} of {self.path}"

    def use_for(self, socket: zmq.Socket[bytes]) -> None:
        """Let a socket that is not connected yet connect with it, and to nobody but its server."""
        socket.curve_publickey = self.content.public_key.encode()
        socket.curve_secretkey = self.content.secret_key.encode()
        socket.curve_serverkey = self.content.server_key.encode()


def config_folder() -> Path:
    """Return the folder of the user's configuration."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")


def usual_file() -> Path:
    """Return where a client looks for its key when it is told of none."""
    return config_folder() / "frankapy" / "key.json"


def find_key(key: str | os.PathLike[str] | None = None) -> ClientKey | None:
    """Return the key of that file, else of $FRANKAPY_KEY, else of the usual one; None where there is none.

    Raises FrankaArmArgumentError for a file that is no key, or that others can read.
    """
    if key is not None and not isinstance(key, (str, os.PathLike)):
        raise FrankaArmArgumentError(f"key is {key!r}: expected the file of a key, which `frankapy keys add` has made")
    if key:
        return _read(Path(key), named=True)
    if variable := os.environ.get(KEY_VARIABLE):
        return _read(Path(variable), named=False)
    return _read(usual_file(), named=False) if usual_file().exists() else None


def _read(path: Path, named: bool) -> ClientKey:
    content = read_secret(path, proto.ClientKey())
    for field in ("public_key", "secret_key", "server_key"):
        if not _is_key(getattr(content, field)):
            raise FrankaArmArgumentError(f"{path}: {field} is no key: expected a file that `frankapy keys add` has made")
    return ClientKey(content, path, named)


def _is_key(text: str) -> bool:
    try:
        return len(text) == _SIZE and len(z85.decode(text.encode())) == 32
    except (KeyError, ValueError):
        return False


def read_secret(path: Path, into: AnyMessage, forbidden: int = stat.S_IRWXG | stat.S_IRWXO) -> AnyMessage:
    """Read a file of keys into a message, which is returned.

    Raises FrankaArmArgumentError where it is none, or where others may do with it what is `forbidden` (bits of a mode).
    """
    try:
        mode = path.stat().st_mode
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise FrankaArmArgumentError(f"{path}: cannot be read ({reason}): expected a file that `frankapy keys` has made") from None
    if mode & forbidden:
        raise FrankaArmArgumentError(
            f"{path}: others can read or change it (mode {mode & 0o777:03o}): `chmod 600` it; where somebody may have read it, have "
            "a new key made (`frankapy keys remove`, `frankapy keys add`)"
        )
    try:
        return json_format.Parse(text, into)
    except json_format.ParseError:
        raise FrankaArmArgumentError(f"{path}: is no {into.DESCRIPTOR.name}: expected a file that `frankapy keys` has made") from None
