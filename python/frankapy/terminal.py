"""What commands print: rows, and colours where there is a terminal."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence


def print_rows(title: str, rows: Sequence[tuple[str, str]]) -> None:
    """Print a title, and under it names with their texts."""
    print(bold(title))
    for name, value in rows:
        first = f"   {name:16}" if name else "   " + " " * 16 * any(name for name, _ in rows)
        print(textwrap.fill(value, 112, initial_indent=first, subsequent_indent=" " * len(first)))


def bold(text: str) -> str:
    """Return a text as a terminal shows it in bold, where there is one."""
    return colored(text, "1")


def colored(text: str, code: str) -> str:
    """Return a text in a colour (a code of ANSI terminals), where there is a terminal."""
    return f"\033[{code}m{text}\033[0m" if sys.stdout.isatty() else text
