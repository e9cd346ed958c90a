"""Projects of one's own parts, outside the repository: `frankapy new`."""

from __future__ import annotations

import keyword
import re
import string
from pathlib import Path

from frankapy.exceptions import FrankaArmArgumentError, FrankaArmException
from frankapy.sim import program

ROLES = ("controller", "trajectory", "termination")

_TEMPLATES = Path(__file__).parent / "templates"
_FILES = {  # of a project, by template
    "{role}.cpp": "{name}.cpp",
    "{role}.proto": "{name}.proto",
    "{role}.test.cpp": "test_{name}.cpp",
    "CMakeLists.txt": "CMakeLists.txt",
    "README.md": "README.md",
}
_TAKEN = {
    # Namespaces in C++, its words that are none of Python's, classes that a part is made of, and functions of the C library.
    *("std google frankapy fci models realtime robot server wire").split(),
    *("alignas alignof asm auto bool catch char concept const constexpr decltype default delete do double enum explicit "
      "export extern false float friend goto inline int long mutable namespace new noexcept nullptr operator private "
      "protected public register requires return short signed sizeof static struct switch template this throw true "
      "typedef typeid typename union unsigned using virtual void volatile xor").split(),
    *("controller trajectory termination part model cycle reference").split(),
    *("time signal index abs exp log pow sin cos tan floor random read write open close select remove rename system clock").split(),
}  # fmt: skip
_IMPORTS = {
    "controller": "from frankapy.parts import RelativeMinJerkJoint\nfrom {name}_pb2 import {Name}",
    "trajectory": "from frankapy.parts import JointImpedance\nfrom {name}_pb2 import {Name}",
    "termination": "from frankapy.parts import CartesianImpedance, RelativeMinJerkPose\nfrom {name}_pb2 import {Name}",
}
_RUN = {
    "controller": "fa.run(RelativeMinJerkJoint([0, 0.1, 0, 0, 0, 0, 0], 2), {Name}())",
    "trajectory": "fa.run({Name}(angle=0.1), JointImpedance())",
    "termination": (
        'fa.run(RelativeMinJerkPose([0, 0, -0.1], frame="base"), CartesianImpedance(600, 50), {Name}(height=0.45))'
    ),
}


def write_project(role: str, name: str, folder: Path) -> list[Path]:
    """Write a part that works, with its message, test, build file and README, into a new folder; return the files.

    Raises FrankaArmArgumentError for a name that cannot be one, and for a folder with something in it.
    """
    if role not in ROLES:
        raise FrankaArmArgumentError(f"{role} is no role of a part: expected {', '.join(ROLES)}")
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or keyword.iskeyword(name) or name in _TAKEN:
        raise FrankaArmArgumentError(f"{name!r} cannot name a part: expected words such as spiral_search")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FrankaArmArgumentError(f"{folder} is there already: name an empty folder with --folder")
    title = "".join(word.capitalize() for word in name.split("_"))
    values = {
        "name": name,
        "Name": title,
        "role": role,
        "package": str(package_folder()),
        "imports": _IMPORTS[role].format(name=name, Name=title),
        "run": _RUN[role].format(Name=title),
    }
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for template, target in _FILES.items():
        text = (_TEMPLATES / template.format(role=role)).read_text()
        path = folder / target.format(name=name)
        path.write_text(string.Template(text).substitute(values))
        files.append(path)
    return files


def package_folder() -> Path:
    """Return where the CMake package of the franka-interface that is here lies, for -Dfranka-interface_DIR.

    Raises FrankaArmException when there is none.
    """
    root = Path(program("franka-interface")).resolve().parents[1]
    for folder in (root, *sorted(root.glob("lib*/cmake/franka-interface")), *sorted(root.glob("lib/*/cmake/franka-interface"))):
        if (folder / "franka-interface-config.cmake").is_file():
            return folder
    raise FrankaArmException(f"{root} has a franka-interface and no CMake package of it: build it anew")
