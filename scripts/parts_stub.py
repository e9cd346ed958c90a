"""Writes python/frankapy/parts.pyi, what editors and type checkers know of the kinds of parts, from wire/proto.

    .venv/bin/python scripts/parts_stub.py [FILE]
"""

import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

from google.protobuf.descriptor import Descriptor, FieldDescriptor
from parts_reference import FIELDS, MESSAGES, REPOSITORY, ROLES, comments

from frankapy import kinds, parts
from frankapy.validation import is_repeated, rule_of

HEAD = '''"""{doc}"""

# Written by scripts/parts_stub.py from wire/proto.

from collections.abc import Sequence
from typing import Literal, overload

from google.protobuf.message import Message
from numpy.typing import ArrayLike

from frankapy import proto
{imports}
'''
LINE = 120


def type_of(field: FieldDescriptor) -> str:
    """Return what a field takes."""
    if is_repeated(field):
        return "ArrayLike"
    if kinds.holds_parts(field):
        return " | ".join(f"proto.{descriptor.name}" for _, descriptor in kinds.kinds("ending"))
    if field.enum_type is not None:
        names = [*field.enum_type.values_by_name]
        return f"Literal[{', '.join(repr(name).replace(chr(39), chr(34)) for name in [*map(str.lower, names), *names])}]"
    simple = {FieldDescriptor.CPPTYPE_STRING: "str", FieldDescriptor.CPPTYPE_BOOL: "bool"}
    return simple.get(field.cpp_type, "float")


def arguments(fields: list[FieldDescriptor], pose: bool) -> Iterator[str]:
    """Yield the arguments of a kind; with `pose`, one that stands for position and quaternion."""
    replaced = kinds.pose_fields(fields) if pose else []
    needed = True  # until one may be left out
    for field in fields:
        if field in replaced[1:]:
            continue
        if field in replaced:
            name, taken = "pose", "Sequence[Pose]" if rule_of(field).row else "Pose"
        else:
            name, taken = field.name, type_of(field)
        needed = needed and rule_of(field).required
        yield f"{name}: {taken}" if needed else f"{name}: {taken} | None = None"


def function(role: str, descriptor: Descriptor, text: str, said: dict[str, str]) -> Iterator[str]:
    """Yield the lines of a kind's function."""
    fields = list(descriptor.fields)
    if fields and kinds.holds_parts(fields[0]):
        signatures = [[f"*{fields[0].name}: Message"]]
    else:
        poses = [False, True] if len(kinds.pose_fields(fields)) == 2 else [False]
        signatures = [list(arguments(fields, pose)) for pose in poses]
    for signature in signatures:
        if len(signatures) > 1:
            yield "@overload"
        taken = ", ".join(signature)
        if len(taken) > LINE - 2 * len(descriptor.name) - 20:
            taken = "\n    " + ",\n    ".join(signature) + ",\n"
        yield f"def {descriptor.name}({taken}) -> proto.{descriptor.name}:"
        lines = textwrap.wrap(text or f"{descriptor.name}, a kind of {role}.", LINE)
        if fields and not kinds.holds_parts(fields[0]):
            lines += ["", "Args:"]
            for field in fields:
                about = f"{field.name}: {parts.text_of(field)}. {said.get(field.name, '')}".strip()
                lines += textwrap.wrap(about, LINE, initial_indent="    ", subsequent_indent="        ")
        yield textwrap.indent("\n".join(['"""' + lines[0], *lines[1:], '"""']), "    ")
    yield ""


def stub() -> str:
    """Return the text of parts.pyi."""
    imports = "".join(f"from frankapy.kinds import {name} as {name}\n" for name in parts.__all__ if hasattr(kinds, name))
    lines = [HEAD.format(doc=parts.__doc__, imports=imports)]
    for role in ROLES:
        said = comments(role)
        for number, (_, descriptor) in enumerate(parts.kinds(role)):
            of_fields = {f.name: said.get((MESSAGES, number, FIELDS, place), "") for place, f in enumerate(descriptor.fields)}
            lines += function(role, descriptor, said.get((MESSAGES, number), ""), of_fields)
    return "\n".join(lines)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else REPOSITORY / "python/frankapy/parts.pyi"
    target.write_text(stub(), encoding="utf-8")
