"""`make setup` with a Python of its own, which installs one file, and no network where the file `offline` is."""

import shutil
import subprocess

import pytest
from conftest import REPOSITORY
from test_run_stages import OUTSIDE

PYTHON = """#!/bin/sh
case "$*" in
  "-m venv --clear "*) rm -rf "$4"/* && mkdir -p "$4/bin" "$4/lib" && cp "$0" "$4/bin/python" ;;
  "-m pip install "*-e*) ;;
  "-m pip install "*) test ! -e "${0%/*}/../../offline" && echo code > "${0%/*}/../lib/package" ;;
  -c*) echo 3 ;;
  *) false ;;
esac
"""


@pytest.fixture
def make_setup(tmp_path):
    """Return a function that runs it, and gives its exit status and what it said; there is an environment already."""
    (tmp_path / "python").write_text(PYTHON)
    (tmp_path / "python").chmod(0o755)

    def run() -> tuple[int, str]:
        command = ["make", "--no-print-directory", "setup", f"VENV={tmp_path / 'venv'}", f"PYTHON={tmp_path / 'python'}"]
        done = subprocess.run(
            command, cwd=REPOSITORY, env=OUTSIDE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        waited = "Another make is at work here"  # which may be: tests of another file make the wheel
        return done.returncode, "".join(line for line in done.stdout.splitlines(keepends=True) if waited not in line)

    assert run()[0] == 0
    return run


def test_with_all_there_no_network_is_needed(make_setup, tmp_path):
    (tmp_path / "offline").touch()
    assert make_setup() == (0, "")


@pytest.mark.parametrize("lost", [".installed", ".frankapy", "lib/package", "lib", "bin", ""])
def test_what_is_cut_off_half_way_is_made_anew(make_setup, tmp_path, lost):
    path = tmp_path / "venv" / lost
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert make_setup()[0] == 0
    assert (tmp_path / "venv" / "lib" / "package").read_text() == "code\n"
    assert make_setup() == (0, "")


def test_what_is_a_link_to_anothers_is_replaced_and_theirs_left_alone(make_setup, tmp_path):
    (tmp_path / "venv").rename(tmp_path / "theirs")
    (tmp_path / "theirs" / "lib" / "package").write_text("their own code\n")
    (tmp_path / "venv").symlink_to(tmp_path / "theirs")
    assert make_setup()[0] == 0
    assert (tmp_path / "venv" / "lib" / "package").read_text() == "code\n"
    assert (tmp_path / "theirs" / "lib" / "package").read_text() == "their own code\n"


def test_a_file_that_is_shorter_than_installed_is_mended(make_setup, tmp_path):
    (tmp_path / "venv" / "lib" / "package").write_text("")
    status, said = make_setup()
    assert (status, "is not whole" in said) == (0, True)
    assert (tmp_path / "venv" / "lib" / "package").read_text() == "code\n"


def test_without_a_network_it_says_so_and_goes_on_when_there_is_one(make_setup, tmp_path):
    shutil.rmtree(tmp_path / "venv")
    (tmp_path / "offline").touch()
    status, said = make_setup()
    assert (status, "let there be a network" in said) == (2, True)
    (tmp_path / "offline").unlink()
    assert make_setup()[0] == 0
