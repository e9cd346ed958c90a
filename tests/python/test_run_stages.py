"""scripts/run_stages.py with stages of a Makefile of its own, in a folder of its own."""

import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from conftest import REPOSITORY

# Runs the stages that it is given; its clock is ahead of the real one by what the file `ahead` says (s), so that a stage
# itself says when its time is over.
DRIVER = """
import sys, time, types
from pathlib import Path
import run_stages
from run_stages import Stage

def monotonic():
    try:
        return time.monotonic() + float(Path("ahead").read_text())
    except OSError:
        return time.monotonic()

run_stages.time = types.SimpleNamespace(monotonic=monotonic, sleep=time.sleep)
run_stages.GATE = run_stages.NIGHTLY = [{stages}]
sys.exit(run_stages.main())
"""
MAKEFILE = """
PASSED := <testcase classname="a" name="good"/>
FAILED := <testcase classname="a" name="bad"><failure message="it is 3">and should be 4</failure></testcase>
AHEAD   = echo $(1) > ahead.new && mv ahead.new ahead
.PHONY: passes fails hangs leaves_behind counts luck whole_luck no_luck then_hangs chooses_none often unreadable late waits tells
passes: ; @echo fine
fails: ; @echo 'no such wire' && false
hangs: ; @echo $$$$ > pid && $(call AHEAD,1000) && exec sleep 1000
leaves_behind:
\t@setsid sh -c 'trap "$(call AHEAD,5000)" TERM; echo $$$$ > pid; while :; do sleep 0.05; done' > /dev/null 2>&1 < /dev/null &
\t@until test -s pid; do sleep 0.01; done
counts: ; @echo '<s>$(PASSED)$(FAILED)<testcase name="other"><skipped/></testcase></s>' > $(JUNIT)/a.xml && false
luck: ; @echo try >> tries && echo '<s>$(if $(AGAIN),,$(FAILED))$(PASSED)</s>' > $(JUNIT)/a.xml && test -n '$(AGAIN)'
whole_luck: ; @echo try$(AGAIN) >> tries && test $$(wc -l < tries) = 2
no_luck: ; @echo try >> tries && echo '<s>$(FAILED)$(PASSED)</s>' > $(JUNIT)/a.xml && false
then_hangs: ; @$(if $(AGAIN),echo $$$$ > pid && $(call AHEAD,1000) && exec sleep 1000,echo '<s>$(FAILED)</s>' > $(JUNIT)/a.xml && false)
chooses_none: ; @echo '<s></s>' > $(JUNIT)/a.xml
often: ; @for i in 1 2 3; do echo '<s>$(PASSED)</s>' > $(JUNIT)/a-$$i.xml; done; echo '<s>$(subst bad,good,$(FAILED))</s>' > $(JUNIT)/a-2.xml; false
unreadable: ; @echo '<s>' > $(JUNIT)/a.xml
late: ; @$(call AHEAD,90)
waits: ; @echo $$$$ > pid && exec sleep 1000
tells: ; @echo so far && $(call AHEAD,70) && until test -e told; do sleep 0.01; done
"""


# What this test's own make says to others is not for them.
OUTSIDE = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MFLAGS", "MAKEOVERRIDES", "AGAIN", "JUNIT")}


class Stages:
    """A folder with the script and a Makefile."""

    def __init__(self, folder: Path):
        self.folder = folder
        (folder / "scripts").mkdir()
        shutil.copy(REPOSITORY / "scripts" / "run_stages.py", folder / "scripts")
        (folder / "Makefile").write_text(MAKEFILE)

    def start(self, *stages: str, which: str = "gate") -> subprocess.Popen:
        """Begin; each stage is a target, and what follows in Stage()."""
        listed = ", ".join(f'Stage("{stage.partition(",")[0]}", {stage.partition(",")[2] or "60"})' for stage in stages)
        (self.folder / "scripts" / "driver.py").write_text(DRIVER.replace("{stages}", listed))
        return subprocess.Popen(
            [sys.executable, "scripts/driver.py", which],
            cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env=OUTSIDE | {"CCACHE_DIR": str(self.folder / "ccache")},
        )  # fmt: skip

    def run(self, *stages: str, **how) -> tuple[int, str]:
        """Return exit status and what was printed."""
        process = self.start(*stages, **how)
        printed, _ = process.communicate(timeout=300)
        return process.returncode, printed

    def has_started(self) -> bool:
        """Whether a stage has said which process it is."""
        return (self.folder / "pid").exists() and bool((self.folder / "pid").read_text())

    @property
    def left_over(self) -> bool:
        """Whether the process that a stage has started is still there."""
        try:
            status = Path(f"/proc/{(self.folder / 'pid').read_text().strip()}/stat").read_text()
        except OSError:
            return False
        return status.rpartition(")")[2].split()[0] != "Z"  # of one that has ended and whom nobody asks for


@pytest.fixture
def stages(tmp_path):
    made = Stages(tmp_path)
    yield made
    if (tmp_path / "pid").exists() and made.left_over:
        os.kill(int((tmp_path / "pid").read_text()), signal.SIGKILL)


def last_line(printed: str) -> str:
    return printed.splitlines()[-1]


def table(printed: str) -> dict[str, tuple[int, int, str]]:
    """Return tests, failures and verdict of each stage."""
    rows = re.findall(r"^(\S+) +(\d+) +(\d+) +\d+ +\d+  (\S+)$", printed, re.MULTILINE)
    return {stage: (int(tests), int(failed), verdict) for stage, tests, failed, verdict in rows}


def test_a_stage_that_fails_hides_no_later_one(stages):
    status, printed = stages.run("passes", "fails", "counts")
    assert status == 1
    assert table(printed) == {"passes": (1, 0, "ok"), "fails": (1, 1, "FAILED"), "counts": (2, 1, "FAILED")}
    assert "no such wire" in printed
    assert "failed: fails: make fails" in printed
    assert last_line(printed) == "2 passed, 2 failed"


def test_a_stage_that_cannot_write_its_log_fails_and_says_why_and_the_next_runs(stages):
    (stages.folder / "build" / "stages" / "passes.log").mkdir(parents=True)  # as little to be written to as a full disk
    status, printed = stages.run("passes", "counts")
    assert status == 1
    assert re.search(r"--- passes: make passes\n.*Is a directory: .*passes.log", printed)
    assert table(printed) == {"passes": (1, 1, "FAILED"), "counts": (2, 1, "FAILED")}


def test_an_arm_of_another_run_is_named_where_a_stage_fails(stages):
    with subprocess.Popen(["fci-sim", "1000"], executable="/bin/sleep") as other:
        try:
            _, printed = stages.run("passes", "fails")
        finally:
            other.kill()
    told = re.findall(rf"^this computer after (.*): .*fci-sim \(process {other.pid}\).* of other runs", printed, re.MULTILINE)
    assert told == ["fails"]


def test_where_all_pass_the_status_is_0(stages):
    status, printed = stages.run("passes")
    assert (status, last_line(printed)) == (0, "1 passed, 0 failed")


def test_junit_files_are_counted_without_what_was_skipped(stages):
    _, printed = stages.run("counts", "unreadable")
    assert "failed: counts: a.bad" in printed
    assert "it is 3\nand should be 4" in printed
    assert table(printed)["unreadable"] == (1, 1, "FAILED")
    assert last_line(printed) == "1 passed, 2 failed"


def test_of_a_test_that_ran_more_than_once_it_says_how_often_it_failed(stages):
    _, printed = stages.run("often")
    assert "failed: often: a.good (1 of 3 times)" in printed


def test_a_stage_that_hangs_is_ended_and_the_next_runs(stages):
    status, printed = stages.run("hangs,100", "passes")
    assert status == 1
    assert "ended after 200 s" in printed
    assert not stages.left_over
    assert table(printed)["passes"] == (1, 0, "ok")
    assert last_line(printed) == "1 passed, 1 failed"


def test_what_has_left_its_session_and_does_not_heed_a_word_is_ended_too(stages):
    status, printed = stages.run("leaves_behind", "passes")
    assert not stages.left_over
    assert (status, last_line(printed)) == (0, "2 passed, 0 failed")


def test_a_second_try_is_named_and_counts(stages):
    status, printed = stages.run("luck,60,3")
    assert "needed a second try: a.bad" in printed
    assert (stages.folder / "tries").read_text() == "try\n" * 2
    assert (status, last_line(printed)) == (0, "2 passed, 0 failed")


def test_a_stage_without_tests_has_its_second_try_as_a_whole(stages):
    status, printed = stages.run("whole_luck,60,2")
    assert "needed a second try: make whole_luck" in printed
    assert (stages.folder / "tries").read_text() == "try\n" * 2
    assert (status, last_line(printed)) == (0, "1 passed, 0 failed")


def test_what_never_passes_is_tried_so_often_and_has_failed(stages):
    status, printed = stages.run("no_luck,60,3")
    assert (stages.folder / "tries").read_text() == "try\n" * 3
    assert (status, last_line(printed)) == (1, "1 passed, 1 failed")


def test_what_failed_before_a_second_try_that_hangs_has_not_passed(stages):
    status, printed = stages.run("then_hangs,60,2")
    assert "failed: then_hangs: a.bad" in printed
    assert "a further try passed" not in printed
    assert (status, last_line(printed)) == (1, "0 passed, 2 failed")


def test_a_stage_that_chooses_no_test_has_failed(stages):
    status, printed = stages.run("chooses_none")
    assert "failed: chooses_none: no test" in printed
    assert (status, last_line(printed)) == (1, "0 passed, 1 failed")


def test_a_stage_that_takes_long_is_slow_and_has_passed(stages):
    status, printed = stages.run("late,60")
    assert table(printed) == {"late": (1, 0, "SLOW")}
    assert (status, last_line(printed)) == (0, "1 passed, 0 failed")


def test_while_a_stage_takes_long_its_last_line_is_told(stages):
    process = stages.start("tells")
    line = process.stdout.readline()
    (stages.folder / "told").touch()
    rest, _ = process.communicate(timeout=300)
    assert re.fullmatch(r"tells +7\d s  so far\n", line)
    assert last_line(rest) == "1 passed, 0 failed"


def until(so) -> None:
    deadline = time.monotonic() + 60
    while not so():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_what_a_run_that_is_killed_has_started_ends_with_it(stages):
    process = stages.start("waits")
    until(stages.has_started)
    process.kill()
    process.communicate(timeout=300)
    until(lambda: not stages.left_over)


def test_sigterm_ends_all_and_is_a_failure(stages):
    process = stages.start("passes", "waits", "passes")
    until(stages.has_started)
    process.send_signal(signal.SIGTERM)
    printed, _ = process.communicate(timeout=300)
    assert process.returncode == 1
    assert not stages.left_over
    assert table(printed) == {"passes": (1, 0, "ok"), "waits": (1, 1, "FAILED")}
    assert "failed: waits: stopped by SIGTERM" in printed


def test_the_nightly_leaves_what_came_of_it_in_a_file(stages):
    stages.run("passes", "fails", which="nightly")
    written = (stages.folder / "build" / "nightly.json").read_text()
    assert '"failed": [\n      "make fails"\n    ]' in written


@pytest.mark.parametrize("which", ["gate", "nightly"])
def test_every_stage_is_a_target_that_make_knows(which):
    script = textwrap.dedent(f"""
        import run_stages
        print(*(stage.target for stage in run_stages.{which.upper()}))
    """)
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY / "scripts"), "PYTHONDONTWRITEBYTECODE": "1"}
    listed = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    for target in listed.stdout.split():
        asked = subprocess.run(["make", "--dry-run", target], cwd=REPOSITORY, capture_output=True, text=True, check=False)
        assert asked.returncode == 0, asked.stderr
        for room in re.findall(r"(\w+)_test\b", asked.stdout):
            assert f"add_room_test({room} " in (REPOSITORY / "tests" / "CMakeLists.txt").read_text()
