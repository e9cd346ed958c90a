"""`make wheel`: what is installed on other computers, where nothing was built, commands an arm."""

import json
import os
import re
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY
from test_run_stages import OUTSIDE

PACKAGE = REPOSITORY / "python" / "frankapy"
CLIENT = """
import json, sys
import frankapy, frankapy.proto.state_pb2
with frankapy.FrankaArm(server=sys.argv[1]) as fa:
    print(json.dumps([frankapy.__file__, frankapy.proto.state_pb2.__file__, list(fa.get_joints())]))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    # What it needs is built: with -o make does not look.
    command = ["make", "-o", "programs", "-o", ".venv/.frankapy", "wheel", f"BUILD={folder}"]
    subprocess.run(command, cwd=REPOSITORY, env=OUTSIDE, stdout=subprocess.DEVNULL, check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def test_the_wheel_has_all_files_of_the_package_and_leaves_nothing_in_its_folder(wheel):
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("frankapy/")}
    there = (path for path in PACKAGE.rglob("*") if path.is_file() and path.parent.name != "__pycache__")
    assert packed == {str(path.relative_to(PACKAGE.parent)) for path in there}
    assert not (PACKAGE.parent / "build").exists()


def test_the_wheel_has_the_version_of_the_server(wheel):
    (version,) = re.findall(r"^project\(franka-interface VERSION (\S+)", (REPOSITORY / "CMakeLists.txt").read_text(), re.MULTILINE)
    assert wheel.name == f"frankapy-{version}-py3-none-any.whl"


def test_unpacked_elsewhere_it_reads_the_joints_of_an_arm(wheel, ideal_arm, tmp_path):
    zipfile.ZipFile(wheel).extractall(tmp_path)
    # -S: without .pth files, so that the package of this repository, which one of them brings, is not there.
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{sysconfig.get_path('purelib')}"}
    command = [sys.executable, "-S", "-c", CLIENT, ideal_arm.server]
    said = subprocess.run(command, cwd="/", env=environment, stdout=subprocess.PIPE, check=True).stdout
    *files, joints = json.loads(said)
    assert all(Path(file).is_relative_to(tmp_path) for file in files)
    assert len(joints) == 7 and np.isfinite(joints).all()
