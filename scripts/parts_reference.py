"""Writes docs/parts.md, what skills are made of, from wire/proto: comments, fields, units, defaults, and what fits.

    .venv/bin/python scripts/parts_reference.py [FILE]
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet

from frankapy import parts

REPOSITORY = Path(__file__).resolve().parent.parent
ROLES = {"trajectory": "Trajectory generators", "controller": "Feedback controllers", "termination": "Terminations", "ending": "Soft endings"}
FILES = {"trajectory": "trajectories", "controller": "controllers", "termination": "terminations", "ending": "endings"}
MESSAGES, FIELDS = 4, 2  # numbers of these fields in FileDescriptorProto and DescriptorProto

HEAD = """# What skills are made of

Written by `scripts/parts_reference.py` from `wire/proto`, which is where the server has it from. `frankapy kinds` and
`fa.kinds()` say the same. In Python each kind is a function of `frankapy.parts` whose arguments are these fields.

Words: the *reference* is where the trajectory is now, inside the limits of the arm; the *robot controller* is what the
robot is commanded in. O is the base, F the flange, EE the end effector as Desk and `[arm.tool]` set it, K where forces are
estimated and springs of the robot act. Quaternions are w, x, y, z.
"""


def comments(role: str) -> dict[tuple[int, ...], str]:
    """Return the comments of a role's file by their place in it."""
    with tempfile.NamedTemporaryFile(suffix=".pb") as file:
        subprocess.run(
            ["protoc", f"-Ifrankapy/proto={REPOSITORY / 'wire/proto'}", "--include_source_info",
             f"--descriptor_set_out={file.name}", f"frankapy/proto/{FILES[role]}.proto"],
            check=True,
        )  # fmt: skip
        (described,) = FileDescriptorSet.FromString(Path(file.name).read_bytes()).file
    assert isinstance(described, FileDescriptorProto)
    found = {}
    for location in described.source_code_info.location:
        text = location.leading_comments or location.trailing_comments
        found[tuple(location.path)] = " ".join(text.split())
    return found


def table_of_fits() -> list[str]:
    """Return which trajectory runs with which controller, by their groups."""
    columns: dict[tuple[str, ...], list[str]] = {}
    for kind in parts.describe("controller"):
        row = tuple(", ".join(kind.fits.get(name, ["—"])) for name in [each.name for each in parts.describe("trajectory")])
        columns.setdefault(row, []).append(kind.name)
    rows: dict[tuple[str, ...], list[str]] = {}
    for number, kind in enumerate(parts.describe("trajectory")):
        rows.setdefault(tuple(row[number] for row in columns), []).append(kind.name)
    lines = [
        "\n## What fits\n",
        "The robot controllers in which they run together; `auto` takes the first. A controller that is told to exert a force",
        "along an axis, or an Admittance without stiffness there, runs in `torque` alone.\n",
        "| | " + " | ".join(", ".join(names) for names in columns.values()) + " |",
        "|---" * (len(columns) + 1) + "|",
    ]
    return lines + [f"| {', '.join(names)} | {' | '.join(row)} |" for row, names in rows.items()]


def reference() -> str:
    """Return the text of docs/parts.md."""
    lines = [HEAD]
    for role, title in ROLES.items():
        lines.append(f"## {title}\n")
        said = comments(role)
        for number, (_, descriptor) in enumerate(parts.kinds(role)):
            lines.append(f"### {descriptor.name}\n")
            if text := said.get((MESSAGES, number)):  # one may stand for the kinds that follow, too
                lines.append(text + "\n")
            if descriptor.fields:
                lines += ["| field | takes | |", "|---|---|---|"]
            for place, field in enumerate(descriptor.fields):
                lines.append(f"| `{field.name}` | {parts.text_of(field).replace('|', '&#124;')} "
                             f"| {said.get((MESSAGES, number, FIELDS, place), '')} |")  # fmt: skip
            lines.append("")
    lines += table_of_fits()
    return "\n".join(lines).replace("\n\n\n", "\n\n") + "\n"


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else REPOSITORY / "docs/parts.md"
    target.write_text(reference(), encoding="utf-8")
