"""Recordings: what is in them, that they survive what they are made for, and what can be done with them."""

import os
import random
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from conftest import HOME, server_processes
from mcap.reader import make_reader

from frankapy import FrankaArm, FrankaArmArgumentError, FrankaArmException, cli, latency, proto, wire_arrays
from frankapy.parts import JointImpedance, Never, RelativeMinJerkJoint, StreamJoint
from frankapy.recording import Recording
from frankapy.sim import SimulatedArm, Simulation
from frankapy.wire_arrays import columns

AWAY = HOME + [0.2, -0.1, 0.1, 0.1, 0, 0.1, 0.3]


def newest(folder, what, longest=60.0):
    """Return the only recording of that name, once it is complete."""
    until = time.monotonic() + longest
    while time.monotonic() < until:
        for path in folder.glob(f"*/*{what}*.mcap"):
            if (recording := Recording(path)).complete:
                return recording
        time.sleep(0.1)
    raise AssertionError(f"no {what} in {list(folder.rglob('*'))}")


@pytest.fixture(scope="module")
def recorded(start_for_module):
    """Return a client and the recording of a skill, a stream of sensor messages and an error."""
    arm = start_for_module(ideal=True)
    with arm.client() as fa:
        fa.goto_joints(HOME, 1)
        with fa.recording() as status:
            fa.goto_joints(AWAY, 1, skill_desc="there")
            fa.run(StreamJoint("goal"), JointImpedance(), Never(), block=False, skill_desc="streamed")
            with fa.publisher("goal") as publisher:
                for _ in range(10):
                    publisher.publish(proto.JointPositionSensorMessage(joints=AWAY))
                    time.sleep(0.01)
            fa.stop_skill()
        yield fa, Recording(status().file)


def test_every_cycle_is_in_it(recorded):
    _, recording = recorded
    states = recording.states
    assert recording.complete and recording.about["arm"] == "arm1"
    cycles = states["cycles"]
    moving = states["phase"] == proto.RUNNING
    first, last = np.flatnonzero(moving)[[0, -1]]
    idle = states["phase"] == proto.READY
    whole = ~idle[first:last] & ~idle[first + 1 : last + 1]
    assert np.all(np.diff(cycles[first : last + 1])[whole] == 1)
    assert states["q"].shape == (len(recording), 7)
    assert np.abs(states["q"][last] - AWAY).max() < 0.01
    assert np.all(np.isfinite(states["command.tau_J_d"][moving & (states["controller_mode"] == 2)]))
    assert np.all(np.diff(states["time"]) >= 0)
    assert abs(recording.start - time.time()) < 600


def test_arrays_are_what_the_messages_say(recorded):
    _, recording = recorded
    states = recording.states
    for i in random.Random(1).sample(range(len(recording)), 50):
        message = proto.ArmState.FromString(recording._raw[i])
        for name, value in [*((f.name, v) for f, v in message.robot.ListFields()), ("compute_us", message.compute_us),
                            ("time_ns", message.time_ns), ("cycles", message.cycles), ("skill_id", message.skill_id)]:  # fmt: skip
            assert np.array_equal(states[name][i], tuple(value) if name in ("errors", "reflex_reason") else value), name
        if not message.q_ref:
            assert np.isnan(states["q_ref"][i]).all()


def test_skills_and_sensor_messages_are_in_it(recorded):
    _, recording = recorded
    started = [event for _, event in recording.skills if event.HasField("started")]
    ended = [event for _, event in recording.skills if event.HasField("ended")]
    assert [event.started.description for event in started] == ["there", "streamed"]
    assert [event.ended.ending for event in ended] == [proto.TERMINATED, proto.STOPPED]
    assert f"pid {os.getpid()}" in started[0].client
    messages = recording.sensors["goal"]
    assert [noted.sequence for noted in messages] == list(range(1, 11))
    assert np.allclose(messages[0].message.joints, AWAY)
    assert all(abs(noted.sent - noted.time) < 5 for noted in messages)


def test_times_of_other_computers_are_the_servers(tmp_path, capsys):
    with Simulation(SimulatedArm(), recordings=tmp_path) as simulation, FrankaArm(server=simulation.server) as fa:
        with fa.recording() as status, fa.publisher("far") as publisher:
            for sequence in range(1, 21):
                sent = time.time_ns() + 3600 * 10**9
                envelope = proto.SensorMessage(topic="far", publisher=5, sequence=sequence, sent_ns=sent, way_ns=10**6)
                envelope.message.Pack(proto.JointPositionSensorMessage(joints=HOME))
                publisher._socket.send(envelope.SerializeToString())
                time.sleep(0.1)
            while fa.topics()["far"].received < 20:
                time.sleep(0.01)
        recording = Recording(status().file)
    ahead, uncertain = recording.clocks["topic far"]
    assert abs(ahead - 3600) < 1
    assert uncertain == pytest.approx(1e-3)
    assert any(f"pid {os.getpid()}" in sender and abs(ahead) < 1 for sender, (ahead, _) in recording.clocks.items())
    messages = recording.sensors["far"]
    assert len(messages) == 20
    assert all(abs(noted.sent - noted.time) < 5 for noted in messages)
    assert cli.main(["info", str(recording.path)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert re.search(r"topic far: 3(600|599)\d+\.\d\d ms ahead \(± 1\.00 ms\)", told), told
    assert np.all(recording.states["time"] >= recording.measured - 1e-9)


def test_motions_before_and_after_a_restart_of_the_robot_are_not_one(recorded):
    recording = Recording(recorded[1].path)
    assert len(recording.motion()) > 1000
    clock = recording.states["message_id"]
    clock[len(clock) // 2 :] -= clock[len(clock) // 2] - clock[0]
    with pytest.raises(FrankaArmArgumentError, match="started anew"):
        recording.motion()


def test_it_is_told_and_drawn(recorded, tmp_path, capsys):
    _, recording = recorded
    assert cli.main(["info", str(recording.path)]) == 0
    told = capsys.readouterr().out
    assert "there terminated" in told and "StreamJoint, JointImpedance, Never" in told and "goal: 10 JointPosition" in told
    assert cli.main(["plot", str(recording.path), "--save", str(tmp_path / "page.png")]) == 0
    assert (tmp_path / "page.png").stat().st_size > 50_000
    assert cli.main(["plot", str(recording.path), "--save", str(tmp_path / "page.doc")]) == 1


SCREEN = """
import sys
from matplotlib._pylab_helpers import Gcf
from matplotlib.backend_bases import FigureManagerBase
from matplotlib.backends.backend_agg import FigureCanvasAgg

class FigureManager(FigureManagerBase):
    @classmethod
    def pyplot_show(cls, *, block=None):
        for manager in Gcf.get_all_fig_managers():
            manager.canvas.figure.savefig(sys.argv[-1] + ".shown.png", dpi=110)

class FigureCanvas(FigureCanvasAgg):
    manager_class = FigureManager
"""


@pytest.mark.nightly
def test_its_page_is_shown_in_a_window_where_there_is_a_screen(recorded, tmp_path, capsys):
    _, recording = recorded
    (tmp_path / "screen.py").write_text(SCREEN)
    file = tmp_path / "a.mcap"
    file.write_bytes(recording.path.read_bytes())

    environment = {**os.environ, "MPLBACKEND": "module://screen", "PYTHONPATH": str(tmp_path)}
    subprocess.run([sys.executable, "-m", "frankapy.cli", "plot", file], env=environment, check=True)
    assert cli.main(["plot", "--save", str(tmp_path / "saved.png"), str(file)]) == 0
    assert (tmp_path / "a.mcap.shown.png").read_bytes() == (tmp_path / "saved.png").read_bytes()
    assert cli.main(["plot", str(file)]) == 1 and "no screen" in capsys.readouterr().err


def test_the_command_records_what_another_client_does_until_it_is_interrupted(ideal_arm, fa):
    fa.goto_joints(HOME, 1)
    for how, number in ((["--seconds", "3600"], signal.SIGINT), ([], signal.SIGINT), ([], signal.SIGTERM)):
        command = [sys.executable, "-m", "frankapy.cli", "record", "--server", ideal_arm.server, *how]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            path = re.match(r"recording to (.*) on the server's computer; Ctrl-C ends it\n", process.stdout.readline())[1]
            fa.goto_joints(AWAY, 1, skill_desc="there")
            fa.goto_joints(HOME, 1, skill_desc="and back")
            process.send_signal(number)
            told = process.communicate(timeout=300)[0]
        finally:
            process.kill()
            process.wait()
        assert process.returncode == 0
        recording = Recording(path)
        assert recording.complete and f"{path}: " in told and f" {len(recording)} states" in told
        begun = [event.started.description for _, event in recording.skills if event.HasField("started")]
        assert begun == ["there", "and back"]
        assert np.abs(recording.states["q"] - AWAY).max(axis=1).min() < 0.01
    assert cli.main(["record", "--server", ideal_arm.server, "--seconds", "0.1"]) == 0


def test_other_programs_read_what_is_exported(recorded, tmp_path, capsys):
    _, recording = recorded
    for name in ("a.parquet", "a.csv"):
        assert cli.main(["export", str(recording.path), str(tmp_path / name)]) == 0
    parquet = pyarrow.parquet.read_table(tmp_path / "a.parquet")
    csv = pyarrow.csv.read_csv(tmp_path / "a.csv")
    for table in (parquet, csv):
        assert table.num_rows == len(recording)
        assert np.array_equal(table["q_3"].to_numpy(), recording.states["q"][:, 3])
    with pytest.raises(FrankaArmArgumentError, match="csv or .parquet"):
        recording.export(tmp_path / "a.xls")


def test_an_arm_does_it_again(recorded, capsys):
    fa, recording = recorded
    fa.goto_joints(HOME, 1)
    path = recording.motion()
    assert np.abs(path[0] - HOME).max() < 0.01 and np.abs(path[-1] - AWAY).max() < 0.01
    server = fa._server_name
    fa.close()  # the arm is free for the command
    assert cli.main(["replay", str(recording.path), "--server", server]) == 0
    with type(fa)(server=server) as again:
        assert np.abs(again.get_joints() - AWAY).max() < 0.01


def test_a_file_that_is_cut_anywhere_is_read_as_far_as_it_goes(recorded, tmp_path):
    _, recording = recorded
    data = recording.path.read_bytes()
    lengths = []
    for cut in [*sorted(random.Random(2).sample(range(9, len(data)), 40)), len(data) - 1]:
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[:cut])
        part = Recording(path)
        lengths.append(len(part))
        assert part.damaged == 0
        assert np.array_equal(part.states.get("cycles", []), recording.states["cycles"][: len(part)])
    assert lengths == sorted(lengths) and lengths[-1] == len(recording)
    for garbage in (b"", b"no recording", data[:8] + bytes(1000), data[:2000] + os.urandom(2000)):
        path.write_bytes(garbage)
        if garbage.startswith(data[:8]):
            assert len(Recording(path)) == 0
        else:
            with pytest.raises(FrankaArmArgumentError, match="is no recording"):
                Recording(path)
    with pytest.raises(FrankaArmArgumentError, match="cannot be read"):
        Recording(tmp_path / "none.mcap")


def test_of_a_file_that_is_damaged_only_that_part_is_missing(tmp_path, capsys):
    with Simulation(SimulatedArm(lockstep=True), record="skills", recordings=tmp_path) as simulation:
        with FrankaArm(server=simulation.server) as fa:
            with fa.recording() as status:
                for goal in (AWAY, HOME) * 2:
                    fa.goto_joints(goal, 2)
            whole = Recording(status().file)
    data = whole.path.read_bytes()
    cycles = whole.states["cycles"]
    with whole.path.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    for chunk in (0, len(chunks) // 2):  # the one that says what the messages are, and another
        damaged = bytearray(data)
        at = chunks[chunk].chunk_start_offset + 200
        damaged[at : at + 50] = bytes(byte ^ 0x5A for byte in damaged[at : at + 50])
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        read = Recording(tmp_path / "damaged.mcap")
        assert read.damaged == 1 and not read.complete
        assert 0 < len(read) < len(whole)
        assert np.all(np.isin(read.states["cycles"], cycles))
        assert read.states["cycles"][-1] == cycles[-1]
        assert (read.states["cycles"][0] == cycles[0]) == (chunk > 0)
        assert cli.main(["info", str(read.path)]) == 0
        assert "1 parts of the file cannot be read" in capsys.readouterr().out


def test_what_cannot_be_written_is_said(recorded, tmp_path, capsys):
    _, recording = recorded
    missing = "No such file or directory"
    for why, command, *to in (
        (missing, "export", "a.csv"),
        (missing, "export", "a.parquet"),
        (f"there is no folder {tmp_path / 'no'}", "plot", "--save", "a.png"),
    ):
        to[-1] = str(tmp_path / "no" / to[-1])
        assert cli.main([command, str(recording.path), *to]) == 1
        assert f"{to[-1]} cannot be written: {why}" in capsys.readouterr().err


def test_garbage_is_no_message():
    for garbage in (b"\x07", b"\x0a\xff", b"\xff" * 20):
        with pytest.raises(ValueError, match="message"):
            columns(proto.ArmState.DESCRIPTOR, [garbage])


def test_blocks_whose_messages_are_all_like_the_first_are_read(monkeypatch):
    monkeypatch.setattr(wire_arrays, "_BLOCK", 1)  # byte: a block for each message
    here, there = proto.ArmState(cycles=3), proto.ArmState(lost_states=3)  # of one size
    messages = [state.SerializeToString() for state in (here, there, here, there, here)]
    found = columns(proto.ArmState.DESCRIPTOR, messages)
    assert found["cycles"].tolist() == [3, 0, 3, 0, 3]
    assert found["lost_states"].tolist() == [0, 3, 0, 3, 0]


# --- the black box ---------------------------------------------------------------------------------------------------


def test_before_an_error_ten_seconds_are_kept(tmp_path):
    with Simulation(SimulatedArm(lockstep=True), recordings=tmp_path) as simulation:
        with FrankaArm(server=simulation.server) as fa:
            fa.goto_joints(HOME, 2)
            fa.goto_joints(AWAY, 2)
            simulation.inject("joint_reflex")
            recording = newest(tmp_path, "error-joint_reflex")
    states = recording.states
    assert [name for _, name in recording.errors] == ["joint_reflex"]
    assert np.abs(states["q"] - AWAY).max(axis=1).max() > 0.1  # the motion before it
    assert len(recording.skills) >= 2
    assert any("commands the arm" in text for _, _, text in recording.log)
    assert states["message_id"][-1] > states["message_id"][np.flatnonzero(states["phase"] == proto.ERROR)[0]]


def test_of_a_process_that_crashed_the_last_seconds_are_kept(tmp_path):
    with Simulation(SimulatedArm(lockstep=True), recordings=tmp_path) as simulation:
        with FrankaArm(server=simulation.server) as fa:
            fa.goto_joints(HOME, 1)
            fa.run(RelativeMinJerkJoint([0.1] * 7, 1000), skill_desc="the last", block=False)
            fa.wait_for(lambda state: state.phase == proto.RUNNING and state.skill_time > 1)
            os.kill(server_processes(simulation)[1], signal.SIGKILL)
            recording = newest(tmp_path, "crash-was-killed-by-signal-9")
    started = [event for _, event in recording.skills if event.HasField("started")]
    assert started[-1].started.description == "the last"
    assert recording.states["skill_id"][-1] == started[-1].skill_id
    assert np.all(np.diff(recording.states["cycles"]) == 1)


def test_of_a_server_that_was_killed_whole_the_last_seconds_are_kept(tmp_path):
    with Simulation(SimulatedArm(lockstep=True), recordings=tmp_path) as simulation:
        with FrankaArm(server=simulation.server) as fa:
            fa.goto_joints(HOME, 1)
            fa.run(StreamJoint("goal"), JointImpedance(), Never(), skill_desc="the last", block=False)
            with fa.publisher("goal") as publisher:
                for _ in range(50):
                    publisher.publish(proto.JointPositionSensorMessage(joints=AWAY))
                    time.sleep(0.01)
            fa.wait_for(lambda state: state.phase == proto.RUNNING and state.skill_time > 1)
            for process in server_processes(simulation):
                os.kill(process, signal.SIGKILL)
    # The next server of this user writes it down.
    with Simulation(SimulatedArm(lockstep=True), recordings=tmp_path):
        recording = newest(tmp_path, "crash-the-server-was-killed")
    started = [event for _, event in recording.skills if event.HasField("started")]
    assert started[-1].started.description == "the last"
    assert recording.states["skill_id"][-1] == started[-1].skill_id
    assert np.all(np.diff(recording.states["cycles"]) == 1)
    assert len(recording.sensors["goal"]) == 50


def test_a_client_that_dies_in_the_middle_is_worth_it(tmp_path):
    with Simulation(SimulatedArm(lockstep=True), recordings=tmp_path) as simulation:
        script = (
            "import os\nfrom frankapy import FrankaArm\nfrom frankapy.parts import RelativeMinJerkJoint\n"
            f"fa = FrankaArm(server={simulation.server!r})\n"
            "fa.run(RelativeMinJerkJoint([0.05] * 7, 3600), block=False)\nos.kill(os.getpid(), 9)"
        )
        subprocess.run([sys.executable, "-c", script], check=False)
        recording = newest(tmp_path, "error-a-client-is-gone")
    assert recording.states["phase"][-1] == proto.RUNNING


def test_a_recording_inside_of_another_is_a_part_of_it(ideal_arm):
    with ideal_arm.client() as fa:
        with fa.recording():
            with fa.recording() as inner:
                pass
            states = inner().states
            deadline = time.monotonic() + 100
            while inner().states == states:
                assert time.monotonic() < deadline
        assert not inner().open


@pytest.mark.wall  # how much is missing at its end
def test_a_server_that_is_killed_leaves_what_it_recorded(tmp_path):
    for attempt, wait in enumerate(random.Random(3).sample(range(300, 1500), 3)):
        folder = tmp_path / str(attempt)
        with Simulation(SimulatedArm(), record="always", recordings=folder) as simulation:
            time.sleep(wait * 1e-3)
            supervisor, arm = server_processes(simulation)
            os.kill(supervisor, signal.SIGKILL)
            os.kill(arm, signal.SIGKILL)
            killed = time.time()
        (path,) = folder.glob("*/*-all.mcap")
        recording = Recording(path)
        assert not recording.complete
        assert len(recording) > 0
        # A computer that is busy keeps the one that writes waiting as well.
        assert killed - (recording.start + recording.states["time"][-1]) < 2.0


@pytest.mark.nightly
@pytest.mark.timeout(3000)
def test_a_server_that_is_killed_at_any_moment_leaves_all_but_half_a_second(tmp_path):
    for attempt, wait in enumerate(random.Random(4).choices(range(1500), k=100)):
        folder = tmp_path / str(attempt)
        with Simulation(SimulatedArm(), record="always", recordings=folder) as simulation:
            with FrankaArm(server=simulation.server) as fa:
                fa.goto_joints(AWAY, 5, block=False)
                fa.wait_for(lambda state: state.phase == proto.RUNNING)
                time.sleep(wait * 1e-3)
                for process in server_processes(simulation):
                    os.kill(process, signal.SIGKILL)
        (path,) = folder.glob("*/*-all.mcap")
        recording = Recording(path)
        with Simulation(SimulatedArm(lockstep=True), recordings=folder):
            rest = newest(folder, "crash-the-server-was-killed")
        # The black box has all up to the last cycle.
        last = rest.start + rest.states["time"][-1]
        times = recording.start + recording.states["time"]  # none of a server that had just begun
        written = times[-1] if len(times) else rest.start + rest.states["time"][0]
        assert last - written < 0.5, attempt
        assert rest.start <= written
        assert np.all(np.diff(rest.states["cycles"][rest.states["phase"] == proto.RUNNING]) == 1)


# A disk of its own, for this process and its children only.
_SMALL_DISK = """
import sys, time
from pathlib import Path
import numpy as np
from frankapy import FrankaArm, FrankaArmException, FrankaConstants
from frankapy.recording import Recording
from frankapy.sim import SimulatedArm, Simulation

folder = Path(sys.argv[1])
home = np.array(FrankaConstants.HOME_JOINTS)
arm = SimulatedArm(lockstep=True)
with Simulation(arm, record="always", recordings=folder) as simulation, FrankaArm(server=simulation.server) as fa:
    error = ""
    deadline = time.monotonic() + 200
    while not error:
        assert time.monotonic() < deadline
        fa.goto_joints(home + 0.1, 1)
        fa.goto_joints(home, 1)
        try:
            with fa.recording() as status:
                pass
        except FrankaArmException as refused:
            error = refused.message
    fa.goto_joints(home + 0.1, 1)
    assert np.abs(fa.get_joints() - home - 0.1).max() < 0.01
files = list(folder.glob("*/*.mcap"))
print(error, len(files), sum(len(Recording(file)) for file in files if file.stat().st_size > 0), sep="|")
"""


def on_a_disk(tmp_path, options):
    """Run a script that records there until an error says why not; return error, files, states."""
    mount = f"mount -t tmpfs -o {options} tmpfs '{tmp_path}'"
    for how in ("-m", "-Urm"):  # as root, or as root of a namespace of users
        own = ["unshare", how, "sh", "-c"]
        if subprocess.run([*own, mount], capture_output=True, check=False).returncode == 0:
            break
    else:
        pytest.skip("no mounts of its own can be made here")
    run = f"{mount} && exec '{sys.executable}' -c '{_SMALL_DISK}' '{tmp_path}'"
    done = subprocess.run([*own, run], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    error, files, states = done.stdout.strip().splitlines()[-1].split("|")
    return error, int(files), int(states)


def test_a_full_disk_costs_the_recording_and_nothing_else(tmp_path):
    error, files, states = on_a_disk(tmp_path, "size=2m")
    assert "No space left" in error
    assert files >= 1 and states > 500


def test_a_disk_that_is_read_only_is_said(tmp_path):
    error, files, _ = on_a_disk(tmp_path, "ro,size=2m")
    assert "Read-only" in error
    assert files == 0


# Loaded before the C library: writes to recordings wait as long as the file DISK_STANDS_STILL is there.
_STANDING_DISK = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void wait_for_disk(int fd) {
  const char* still = getenv("DISK_STANDS_STILL");
  struct stat about;
  char link[64], path[4096];
  if (still == NULL || fstat(fd, &about) != 0 || !S_ISREG(about.st_mode)) return;
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const ssize_t size = readlink(link, path, sizeof path - 1);
  if (size < 5 || memcmp(path + size - 5, ".mcap", 5) != 0) return;
  while (access(still, F_OK) == 0) usleep(1000);
}

ssize_t write(int fd, const void* data, size_t size) {
  wait_for_disk(fd);
  return ((ssize_t(*)(int, const void*, size_t))dlsym(RTLD_NEXT, "write"))(fd, data, size);
}

int fdatasync(int fd) {
  wait_for_disk(fd);
  return ((int (*)(int))dlsym(RTLD_NEXT, "fdatasync"))(fd);
}
"""


@pytest.mark.nightly
def test_a_slow_disk_costs_the_recording_and_nothing_else(tmp_path, monkeypatch):
    source, library, still = tmp_path / "disk.c", tmp_path / "disk.so", tmp_path / "still"
    source.write_text(_STANDING_DISK)
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    monkeypatch.setenv("LD_PRELOAD", str(library))
    monkeypatch.setenv("DISK_STANDS_STILL", str(still))
    with Simulation(SimulatedArm(lockstep=True), recordings=tmp_path) as simulation:
        monkeypatch.delenv("LD_PRELOAD")
        with FrankaArm(server=simulation.server) as fa, FrankaArm(server=simulation.server) as other:
            fa.goto_joints(HOME, 1)
            with fa.recording() as status:
                still.touch()
                stood = status().states
                # For longer than the ring of states lasts. As the disk stands, this ends only if nobody waits for it.
                for _ in range(8):
                    fa.goto_joints(AWAY, 1)
                    assert np.abs(other.get_joints() - AWAY).max() < 0.01
                    fa.goto_joints(HOME, 1)
                assert status().states - stood < 8000
                still.unlink()
                while status().lost == 0:
                    time.sleep(0.01)
                fa.goto_joints(AWAY, 1)
            lost, path = status().lost, status().file
    recording = Recording(path)
    assert recording.complete
    assert lost > 1000 and recording.about["lost"] == str(lost)
    assert np.sum(np.diff(recording.states["cycles"].astype(int)) - 1) >= lost
    assert np.abs(recording.states["q"][-1] - AWAY).max() < 0.01  # it went on


def test_skills_are_recorded_each(tmp_path):
    with Simulation(SimulatedArm(lockstep=True), record="skills", recordings=tmp_path) as simulation:
        with FrankaArm(server=simulation.server) as fa:
            fa.goto_joints(AWAY, 1, skill_desc="recorded by itself")
            recording = newest(tmp_path, "-skill")
    started = [event for _, event in recording.skills if event.HasField("started")]
    assert [event.started.description for event in started] == ["recorded by itself"]
    assert (recording.states["phase"] == proto.RUNNING).sum() > 900


def test_where_nothing_can_be_written_that_is_said(tmp_path):
    with Simulation(SimulatedArm(lockstep=True), recordings="/proc/nowhere") as simulation:
        with FrankaArm(server=simulation.server) as fa:
            with pytest.raises(FrankaArmException, match="/proc/nowhere"), fa.recording():
                pass
            fa.goto_joints(HOME, 1)
    with pytest.raises(FrankaArmException, match='expected "off", "errors", "skills" or "always"'):
        Simulation(SimulatedArm(lockstep=True), record="now and then")


# --- reads -----------------------------------------------------------------------------------------------------------


@pytest.mark.wall
def test_the_newest_state_is_new(fa):
    fa.get_arm_state()
    for _ in range(50):
        state = fa.get_arm_state()
        assert 0 <= state.age < 0.5
        time.sleep(0.002)


def test_reads_go_on(fa):
    before = fa.get_arm_state().cycles
    deadline = time.monotonic() + 60
    while fa.get_arm_state().cycles <= before:
        assert time.monotonic() < deadline


def test_clocks_of_one_computer_agree(fa):
    difference, uncertain = fa._server.clock_difference
    assert abs(difference) < 0.05 + uncertain


def test_latency_is_measured_and_judged(ideal_arm, capsys, monkeypatch):
    monkeypatch.setattr(latency, "_LISTEN", 1.0)
    monkeypatch.setattr(latency, "_HOLD", 1.0)
    assert cli.main(["latency", "--server", ideal_arm.server, "--hold"]) in (0, 1)
    told = capsys.readouterr().out
    for what in ("question, answer", "clocks", "arm to script", "computing", "commands in time", "sensor message"):
        assert what in told
    for slowest, level in ((1, "ok"), (3, "warn"), (30, "bad")):
        found = latency._judged("question, answer", [0.5] * 95 + [slowest] * 5, "ms", (2, 20), "a cable")
        assert (found.level, found.advice) == (level, "" if level == "ok" else "a cable")
        assert found.found == f"0.50 ms, the slowest of a hundred {slowest:.2f} ms"
