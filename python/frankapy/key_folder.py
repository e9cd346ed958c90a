"""The keys of a server: its own pair, and whom it knows; docs/keys.md. The server reads the folder (src/server/keys.cpp)."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

import zmq
from google.protobuf import json_format
from google.protobuf.message import Message

from frankapy import proto
from frankapy.client_key import config_folder, read_secret
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmException

_OWN, _CLIENTS = "server.json", "clients.json"
ROLES = [name.lower() for name in proto.Role.keys() if name != "NOBODY"]


class KeyFolder:
    """A folder of keys."""

    def __init__(self, folder: str | os.PathLike[str] | None = None) -> None:
        """Of that folder; None: where a server looks for it when it is told of none."""
        self.path = Path(folder) if folder else config_folder() / "franka-interface" / "keys"

    def create(self) -> None:
        """Make the server's pair of keys. Raises FrankaArmException where there is one."""
        if (self.path / _OWN).exists():
            raise FrankaArmException(
                f"{self.path} has a server's keys already. Whoever makes new ones has to make those of all clients anew: remove the "
                "folder first if that is meant."
            )
        self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
        public, secret = zmq.curve_keypair()
        _write(self.path / _OWN, proto.ServerKey(public_key=public.decode(), secret_key=secret.decode()))

    def clients(self) -> list[proto.KnownClients.Client]:
        """Return whom the server knows."""
        return list(self._known().clients)

    def add(self, name: str, role: str) -> proto.ClientKey:
        """Make a key for a client, of one of ROLES, and let the server know it.

        Raises FrankaArmArgumentError for a name that is taken, or another role; FrankaArmException without a server's keys.
        """
        if not re.fullmatch(r"[\w.-]{1,100}", name):
            raise FrankaArmArgumentError(f"name is {name!r}: expected up to 100 letters, digits, '_', '-' and '.'")
        if role not in ROLES:
            raise FrankaArmArgumentError(f"role is {role!r}: expected one of {', '.join(ROLES)}")
        if not (self.path / _OWN).exists():
            raise FrankaArmException(f"{self.path} has no keys of a server: `frankapy keys new` makes them.")
        server = read_secret(self.path / _OWN, proto.ServerKey())
        known = self._known()
        if any(client.name == name for client in known.clients):
            raise FrankaArmArgumentError(f"There is a key {name!r}: choose another name, or `frankapy keys remove {name}` first.")
        public, secret = (key.decode() for key in zmq.curve_keypair())
        known.clients.add(name=name, role=proto.Role.Value(role.upper()), public_key=public)
        _write(self.path / _CLIENTS, known)
        return proto.ClientKey(name=name, role=known.clients[-1].role, public_key=public, secret_key=secret, server_key=server.public_key)

    def remove(self, name: str) -> None:
        """Let the server forget a client. Raises FrankaArmArgumentError where it does not know it."""
        known = self._known()
        rest = [client for client in known.clients if client.name != name]
        if len(rest) == len(known.clients):
            there = ", ".join(client.name for client in rest) or "none"
            raise FrankaArmArgumentError(f"There is no key {name!r} in {self.path}: known are {there}")
        _write(self.path / _CLIENTS, proto.KnownClients(clients=rest))

    def _known(self) -> proto.KnownClients:
        path = self.path / _CLIENTS
        return read_secret(path, proto.KnownClients(), stat.S_IWGRP | stat.S_IWOTH) if path.exists() else proto.KnownClients()


def write_client_key(path: Path, key: proto.ClientKey) -> None:
    """Write the file that a client gets, in place of one that is there."""
    _write(path, key)


def _write(path: Path, message: Message) -> None:
    """Write for this user alone, whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.unlink(missing_ok=True)
    with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(json_format.MessageToJson(message, preserving_proto_field_name=True) + "\n")
    part.replace(path)
