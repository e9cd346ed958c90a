"""The command frankapy keys."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from frankapy import proto
from frankapy.client_key import KEY_VARIABLE, usual_file
from frankapy.exceptions import FrankaArmException
from frankapy.key_folder import ROLES, KeyFolder, write_client_key
from frankapy.terminal import print_rows
from frankapy.writing import require_writable, writing_to


def add_commands(add: Callable[[str, object, str], argparse.ArgumentParser]) -> None:
    """Add the command."""
    keys = add("keys", _list, "say who may command the arms of a server: make, list and remove keys (docs/keys.md)")
    actions = keys.add_subparsers(metavar="new|add|list|remove")

    def action(name: str, run: object, text: str) -> argparse.ArgumentParser:
        command = actions.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        command.set_defaults(run=run)
        command.add_argument("--folder", help="of the server's keys (default: franka-interface/keys in your configuration)")
        return command

    keys.set_defaults(folder=None)
    action("new", _new, "make a server's keys")
    client = action("add", _add, "make the key of a client: one file, which goes to its computer")
    client.add_argument("name", help="whose it is")
    client.add_argument("--role", choices=ROLES, required=True, help="read: reads and stops; user: commands; lab: changes what is protected")
    client.add_argument("--to", type=Path, metavar="FILE", help="where it is written (default: NAME.key.json)")
    action("list", _list, "list whom the server knows")
    action("remove", _remove, "let the server forget a client").add_argument("name")


def _new(options: argparse.Namespace) -> int:
    folder = KeyFolder(options.folder)
    with writing_to(folder.path):
        folder.create()
    print(f"The server's keys are in {folder.path}. Each client needs one of its own: frankapy keys add NAME --role user")
    if options.folder:
        print(f"A server has them with --keys {folder.path}, or [keys] folder in its file.")
    else:
        print("A server that listens beyond this computer has them from there; one on 127.0.0.1 with --keys, or [keys] in its file.")
    return 0


def _add(options: argparse.Namespace) -> int:
    path = options.to or Path(f"{options.name}.key.json")
    # Before the server knows the client: its secret is in that file alone.
    require_writable(path)
    if path.exists():
        raise FrankaArmException(f"{path} is there already: name another file (--to FILE), or remove it.")
    folder = KeyFolder(options.folder)
    with writing_to(folder.path):
        key = folder.add(options.name, options.role)
    with writing_to(path):
        write_client_key(path, key)
    print(f"{path}: copy it to the client's computer, by a way that nobody else reads, as {usual_file()},")
    print(f"or anywhere and name it: FrankaArm(key=FILE), {KEY_VARIABLE}=FILE, frankapy --key FILE. A server that runs knows it at once.")
    return 0


def _list(options: argparse.Namespace) -> int:
    folder = KeyFolder(options.folder)
    rows = [(client.name, f"{proto.Role.Name(client.role).lower():6}{client.public_key}") for client in folder.clients()]
    print_rows(f"{folder.path}: {len(rows) or 'no'} client{'s' * (len(rows) != 1)}", rows)
    return 0


def _remove(options: argparse.Namespace) -> int:
    KeyFolder(options.folder).remove(options.name)
    print(f"{options.name} is refused from now on, but may stop the arm and read states until its connection ends.")
    return 0
