"""Who may command: keys, roles, and what is done to bytes between a client and its server."""

import os
import socket
import stat
import subprocess
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
import zmq
from conftest import HOME, Arm
from zmq.utils.monitor import recv_monitor_message

from frankapy import (
    FrankaArm,
    FrankaArmArgumentError,
    FrankaArmCommException,
    FrankaArmException,
    FrankaArmNotPermittedException,
    SensorPublisher,
    proto,
)
from frankapy.cli import main
from frankapy.client_key import KEY_VARIABLE, find_key, usual_file
from frankapy.connection import find_server, list_arms
from frankapy.key_folder import KeyFolder, write_client_key
from frankapy.parts import InternalImpedance, StreamJoint, Time
from frankapy.sim import SimulatedArm, Simulation, program
from frankapy.walls import Sphere

LONG = 1000  # s of the robot's clock


class Keyed(Arm):
    """An arm whose server has keys, of which there are files."""

    def __init__(self, simulation: Simulation, folder: KeyFolder, files):
        super().__init__(simulation, None)
        self.folder, self.files = folder, files

    def key(self, name: str, role: str | None = None):
        """Return the file of a key; with a role it is made first."""
        path = self.files / f"{name}.json"
        if role:
            write_client_key(path, self.folder.add(name, role))
        return path


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    files = tmp_path_factory.mktemp("keys")
    folder = KeyFolder(files / "server")
    folder.create()
    for name, role in (("reader", "read"), ("anna", "user"), ("bob", "user"), ("lab", "lab")):
        write_client_key(files / f"{name}.json", folder.add(name, role))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(KEY_VARIABLE, str(files / "lab.json"))
        with Simulation(SimulatedArm(lockstep=True, ideal=True), keys=folder.path) as simulation:
            yield Keyed(simulation, folder, files)
            simulation.check()


def eventually(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


# --- getting in --------------------------------------------------------------------------------------------------


def test_the_right_key_commands(arm):
    with arm.client(key=arm.key("anna")) as fa:
        fa.goto_joints(HOME, 1)
        assert fa.server_status().commander.startswith("anna: ")
        with fa.states(rate=100) as states:
            assert states.receive() is not None
        fa.wait_for(lambda state: state.phase != proto.RUNNING, timeout=60)


def test_without_a_key_nobody_gets_in_and_is_told_so(arm, monkeypatch):
    monkeypatch.delenv(KEY_VARIABLE)
    for connect in (arm.client, lambda: SensorPublisher("left", server=arm.server), lambda: list_arms(arm.server)):
        with pytest.raises(FrankaArmCommException, match="takes only clients with a key, and there is none here.*frankapy keys add"):
            connect()


def test_a_key_that_the_server_does_not_know_is_refused_and_counted(arm, tmp_path):
    stranger = KeyFolder(arm.folder.path).add("stranger", "user")
    arm.folder.remove("stranger")
    write_client_key(tmp_path / "stranger.json", stranger)
    with pytest.raises(FrankaArmCommException, match="does not know the key 'stranger' of .*stranger.json"):
        arm.client(key=tmp_path / "stranger.json")
    with pytest.raises(FrankaArmCommException, match="does not know the key"):
        SensorPublisher("left", server=arm.server, key=tmp_path / "stranger.json")


PORTS = {"endpoint": zmq.DEALER, "state_endpoint": zmq.SUB, "sensor_endpoint": zmq.PUSH}  # of an arm, and what knocks there
SHAKEN = zmq.EVENT_HANDSHAKE_SUCCEEDED
NOT_SHAKEN = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL


@pytest.mark.parametrize("port", PORTS)
@pytest.mark.parametrize("who", ["reader", "stranger", "nobody"])
def test_each_port_of_an_arm_takes_known_keys_alone(who, port, arm, tmp_path):
    path = arm.key("reader")
    if who == "stranger":
        path = tmp_path / "stranger.json"
        write_client_key(path, KeyFolder(arm.folder.path).add("stranger", "user"))
        arm.folder.remove("stranger")
    endpoint = getattr(list_arms(arm.server)[0], port)
    context = zmq.Context()
    knocking = context.socket(PORTS[port])
    monitor = knocking.get_monitor_socket(SHAKEN | NOT_SHAKEN)
    if who != "nobody":
        find_key(path).use_for(knocking)
    knocking.connect(endpoint)
    try:
        assert monitor.poll(30_000)
        assert (recv_monitor_message(monitor)["event"] == SHAKEN) == (who == "reader")
    finally:
        knocking.disable_monitor()
        context.destroy(linger=0)


def test_a_key_for_another_server_gets_nowhere(arm, tmp_path):
    other = KeyFolder(tmp_path / "other")
    other.create()
    write_client_key(tmp_path / "anna.json", other.add("anna", "user"))
    with pytest.raises(FrankaArmCommException, match="is not the one that the key 'anna' .* is for"):
        arm.client(key=tmp_path / "anna.json")


def test_a_server_without_keys_gets_nothing_that_was_meant_for_one_with(arm, ideal_arm, monkeypatch):
    with pytest.raises(FrankaArmCommException, match="has no keys, and the key 'anna'"):
        ideal_arm.client(key=arm.key("anna"))
    # One that was not named for it is left out, on this computer.
    assert os.environ[KEY_VARIABLE]
    assert find_server(ideal_arm.server).key is None
    with ideal_arm.client() as fa:
        with pytest.raises(FrankaArmNotPermittedException, match="nobody has where a server has no keys"):
            fa.limits.allow(tool_speed=0.5)


def test_a_key_is_found_by_its_name_in_the_environment_or_in_the_usual_place(arm, monkeypatch, tmp_path):
    assert find_key(arm.key("anna")).content.name == "anna"
    assert find_key().content.name == "lab"
    monkeypatch.delenv(KEY_VARIABLE)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert find_key() is None
    usual_file().parent.mkdir()
    usual_file().symlink_to(arm.key("bob"))
    assert find_key().content.name == "bob"
    with arm.client() as fa:
        assert fa.get_joints().shape == (7,)


def test_files_that_are_no_keys_or_that_others_can_read_are_refused(arm, tmp_path):
    with pytest.raises(FrankaArmArgumentError, match="nothing.json: cannot be read"):
        arm.client(key=tmp_path / "nothing.json")
    path = tmp_path / "key.json"
    path.write_bytes(arm.key("anna").read_bytes())
    path.chmod(0o644)
    with pytest.raises(FrankaArmArgumentError, match=r"others can read or change it \(mode 644\)"):
        arm.client(key=path)
    for content in ("{", "{}", '{"public_key": "x"}', "[1]", '{"role": "KING"}'):
        path.write_text(content)
        path.chmod(0o600)
        with pytest.raises(FrankaArmArgumentError, match="key.json"):
            arm.client(key=path)
    with pytest.raises(FrankaArmArgumentError, match="key is 3"):
        arm.client(key=3)


def test_a_server_that_others_reach_does_not_start_without_keys(tmp_path):
    command = [program("franka-interface"), "--robot", "127.0.0.9", "--listen", "0.0.0.0", "--port", "0"]
    environment = os.environ | {"XDG_CONFIG_HOME": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60, check=False)
    assert done.returncode != 0
    assert "not without keys at 0.0.0.0" in done.stderr + done.stdout
    assert "frankapy keys new" in done.stderr + done.stdout


# --- roles -------------------------------------------------------------------------------------------------------


def test_the_role_read_reads_and_stops_and_does_not_command(arm):
    with arm.client(key=arm.key("anna")) as anna, arm.client(key=arm.key("reader")) as reader:
        assert reader.get_joints().shape == (7,)
        assert reader.server_status().clients >= 2
        assert len(reader.walls) == 0
        assert reader.limits.velocity == 1
        anna.goto_joints(HOME, 1)
        anna.goto_joints(HOME + 0.3, LONG, block=False)
        with pytest.raises(FrankaArmNotPermittedException, match='StartSkill needs the role user, and the key "reader" has read'):
            reader.goto_joints(HOME, 1)
        for command in (
            reader.open_gripper,
            lambda: setattr(reader.limits, "velocity", 0.5),
            lambda: reader.walls.add("ball", Sphere(0.1, [0, 2, 0])),
        ):
            with pytest.raises(FrankaArmNotPermittedException):
                command()
        with pytest.raises(FrankaArmNotPermittedException), reader.recording():
            pass
        assert not anna.is_skill_done()
        reader.stop_skill()
        anna.wait_for_skill()
        assert anna.last_skill_result.ending == proto.STOPPED


def test_only_the_role_lab_changes_what_is_protected(arm):
    with arm.client(key=arm.key("anna")) as anna, arm.client(key=arm.key("lab")) as lab:
        anna.walls.add("ball", Sphere(0.1, [0, 2, 0]))  # and anna has the lease
        lab.walls.add("table", Sphere(0.1, [0, -2, 0]), protect=True)
        for forbidden in (
            lambda: anna.walls.remove("table"),
            lambda: anna.walls.add("table", Sphere(0.01, [0, -2, 0])),
            lambda: anna.walls.add("own", Sphere(0.1, [0, 2, 1]), protect=True),
            lambda: anna.limits.allow(tool_speed=1.0),
        ):
            with pytest.raises(FrankaArmNotPermittedException, match="needs the role lab"):
                forbidden()
        anna.walls.clear()
        assert list(anna.walls) == ["table"]
        lab.limits.allow(tool_speed=0.5, torque=0.5)
        assert anna.limits.tool_speed == 0.5
        with pytest.raises(FrankaArmArgumentError, match="tool_speed is 0.6 m/s: expected 0.01 to 0.5"):
            anna.limits.tool_speed = 0.6
        anna.limits.reset()
        assert anna.limits.most.tool_speed == anna.limits.tool_speed == 0.5
        lab.walls.remove("table")
        lab.limits.allow(tool_speed=1.5, torque=1)
        anna.limits.tool_speed = 1.5
        anna.limits.reset()
        with pytest.raises(FrankaArmArgumentError, match="the most that the robot allows"):
            lab.limits.allow(tool_speed=9)


def test_a_key_that_is_removed_commands_no_more(arm):
    with arm.client(key=arm.key("carl", role="user")) as carl:  # while the server runs
        carl.goto_joints(HOME, 1)
        carl.goto_joints(HOME + 0.3, LONG, block=False)
        arm.folder.remove("carl")

        def is_refused():
            try:
                carl.get_arm_state()
            except FrankaArmNotPermittedException:
                return True
            return False

        eventually(is_refused)
        with pytest.raises(FrankaArmNotPermittedException, match="was removed"):
            carl.limits.velocity = 0.5
        with pytest.raises(FrankaArmCommException, match="does not know the key 'carl'"):
            arm.client(key=arm.key("carl"))
        carl.stop_skill()
        carl.wait_for_skill()
        assert carl.last_skill_result.ending == proto.STOPPED
    with arm.client(key=arm.key("anna")) as anna:
        anna.goto_joints(HOME, 1)


def test_a_skill_takes_sensor_messages_of_the_publishers_that_it_names(arm):
    target = proto.JointPositionSensorMessage(joints=HOME + 0.2)
    with (
        arm.client(key=arm.key("anna")) as anna,
        SensorPublisher("policy", server=arm.server, key=arm.key("bob")) as of_bob,
        SensorPublisher("policy", server=arm.server, key=arm.key("reader")) as of_reader,
    ):
        anna.goto_joints(HOME, 1)
        with pytest.raises(FrankaArmArgumentError, match='"dora" of the topic "policy": expected names of keys'):
            anna.run(StreamJoint("policy"), InternalImpedance(), Time(1), publishers={"policy": ["dora"]})
        with pytest.raises(FrankaArmArgumentError, match='the topic "other": expected one that a part of the skill listens to'):
            anna.run(StreamJoint("policy"), InternalImpedance(), Time(1), publishers={"other": ["anna"]})
        anna.run(StreamJoint("policy"), InternalImpedance(), Time(LONG), block=False, publishers={"policy": ["anna"]})
        of_bob.publish(target)
        eventually(lambda: "policy" in anna.topics() and anna.topics()["policy"].refused == 1)
        assert anna.topics()["policy"].why_refused == 'it is of the key "bob": the skill that listens takes anna (its `publishers`)'
        of_reader.publish(target)
        eventually(lambda: anna.topics()["policy"].refused == 2)
        assert "needs the role user" in anna.topics()["policy"].why_refused
        np.testing.assert_allclose(anna.get_joints(), HOME, atol=0.002)
        with anna.publisher("policy") as own:
            own.publish(target)
            eventually(lambda: np.abs(anna.get_joints() - HOME).min() > 0.19)
        anna.stop_skill()


# --- between client and server -----------------------------------------------------------------------------------


class Meddler:
    """Hands bytes to and fro between a client and a server, and does to the client's as it is told."""

    def __init__(self, endpoint: str):
        host, port = endpoint.removeprefix("tcp://").rsplit(":", 1)
        self._server = (host, int(port))
        self._door = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp://127.0.0.1:{self._door.getsockname()[1]}"
        self.change = None  # of the next bytes of the client
        self._sockets = [self._door]
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def close(self):
        for each in list(self._sockets):
            try:
                each.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
            each.close()
        for thread in self._threads:
            thread.join()

    def _accept(self):
        while True:
            try:
                client, _ = self._door.accept()
                server = socket.create_connection(self._server)
            except OSError:
                return
            self._sockets += [client, server]
            for thread in (
                threading.Thread(target=self._pass, args=(client, server, True)),
                threading.Thread(target=self._pass, args=(server, client, False)),
            ):
                self._threads.append(thread)
                thread.start()

    def _pass(self, source, to, is_client):
        try:
            while data := source.recv(65536):
                if is_client and self.change is not None:
                    change, self.change = self.change, None
                    data = change(data)
                to.sendall(data)
        except OSError:
            pass
        for each in (source, to):
            try:
                each.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass


@contextmanager
def client_behind(arm, meddler):
    """Give a client's socket behind a meddler, and what tells when its connection ends."""
    context = zmq.Context()
    dealer = context.socket(zmq.DEALER)
    dealer.reconnect_ivl = -1
    monitor = dealer.get_monitor_socket(zmq.EVENT_DISCONNECTED)
    find_key(arm.key("anna")).use_for(dealer)
    dealer.connect(meddler.endpoint)
    try:
        yield dealer, monitor
    finally:
        dealer.disable_monitor()
        context.destroy(linger=0)
        meddler.close()


def altered(data: bytes) -> bytes:
    return data[:-1] + bytes([data[-1] ^ 1])


@pytest.mark.parametrize("change", [altered, lambda data: data + data], ids=["altered", "replayed"])
def test_a_message_that_is_altered_or_replayed_ends_its_connection_and_nothing_else(arm, change):
    meddler = Meddler(list_arms(arm.server)[0].endpoint)
    with arm.client(key=arm.key("bob")) as bob, client_behind(arm, meddler) as (dealer, monitor):
        before = bob.topics()  # bob is there meanwhile
        dealer.send(proto.Request(request_id=1, hello=proto.Hello(version=proto.CURRENT, client="test")).SerializeToString())
        assert dealer.poll(30_000)
        assert proto.Reply.FromString(dealer.recv()).HasField("welcome")
        meddler.change = change
        dealer.send(proto.Request(request_id=2, recover=proto.Recover()).SerializeToString())
        assert monitor.poll(30_000)
        assert recv_monitor_message(monitor)["event"] == zmq.EVENT_DISCONNECTED
        answers = 0
        while dealer.poll(0):
            assert proto.Reply.FromString(dealer.recv()).request_id == 2
            answers += 1
        assert answers <= (change is not altered)  # of what was replayed the first was good
        assert bob.topics().keys() == before.keys()
        bob.wait_for_franka_interface(60)
        bob.goto_joints(HOME, 1)


def test_secrets_do_not_go_over_the_wire(arm):
    seen = []
    meddler = Meddler(list_arms(arm.server)[0].endpoint)
    with client_behind(arm, meddler) as (dealer, _):

        def look(data):
            seen.append(data)
            meddler.change = look
            return data

        meddler.change = look
        request = proto.Request(request_id=1, hello=proto.Hello(version=proto.CURRENT, client="who is at the wheel"))
        dealer.send(request.SerializeToString())
        assert dealer.poll(30_000)
        assert proto.Reply.FromString(dealer.recv()).HasField("welcome")
    sent = b"".join(seen)
    assert len(sent) > 300
    for secret in (b"who is at the wheel", find_key(arm.key("anna")).content.secret_key.encode()):
        assert secret not in sent


# --- the command line --------------------------------------------------------------------------------------------


def test_keys_are_made_listed_and_removed_from_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    folder = ["--folder", "server"]
    assert main(["keys", "add", "anna", "--role", "user", *folder]) == 1
    assert "frankapy keys new" in capsys.readouterr().err
    assert main(["keys", "new", *folder]) == 0
    assert main(["keys", "new", *folder]) == 1
    assert "has a server's keys already" in capsys.readouterr().err
    assert main(["keys", "add", "anna", "--role", "user", *folder]) == 0
    assert main(["keys", "add", "bob", "--role", "lab", "--to", "b.json", *folder]) == 0
    assert main(["keys", "add", "bob", "--role", "read", "--to", "c.json", *folder]) == 1
    assert "There is a key 'bob'" in capsys.readouterr().err
    assert main(["keys", "add", "../x", "--role", "read", "--to", "c.json", *folder]) == 1
    for file in ("server/server.json", "server/clients.json", "anna.key.json", "b.json"):
        assert stat.S_IMODE((tmp_path / file).stat().st_mode) == 0o600
    key = find_key("anna.key.json")
    assert (key.content.name, key.content.role) == ("anna", proto.USER)
    assert key.content.secret_key not in (tmp_path / "server/clients.json").read_text()
    capsys.readouterr()
    assert main(["keys", "list", *folder]) == 0
    listed = capsys.readouterr().out
    assert "anna" in listed and "lab" in listed and key.content.public_key in listed
    assert main(["keys", "remove", "anna", *folder]) == 0
    assert main(["keys", "remove", "anna", *folder]) == 1
    assert [client.name for client in KeyFolder("server").clients()] == ["bob"]


def test_what_cannot_be_written_is_told_and_leaves_no_client_behind(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    assert main(["keys", "new", "--folder", "file/keys"]) == 1
    assert "file/keys cannot be written: Not a directory" in capsys.readouterr().err
    assert main(["keys", "new", "--folder", "server"]) == 0

    def add(file):
        status = main(["keys", "add", "anna", "--role", "user", "--to", file, "--folder", "server"])
        return status, capsys.readouterr().err

    for file, told in (("missing/anna.json", "there is no folder missing"), ("file", "file is there already"), ("server", "is a folder")):
        status, text = add(file)
        assert status == 1 and told in text
        assert KeyFolder("server").clients() == []
    (tmp_path / "server/clients.json.part").mkdir()
    status, text = add("anna.json")
    assert status == 1 and "server cannot be written" in text


def test_the_command_line_connects_with_a_key_and_status_says_whose(arm, capsys, monkeypatch):
    monkeypatch.setenv(KEY_VARIABLE, "")
    assert main(["status", "--server", arm.server]) == 1
    assert "takes only clients with a key" in capsys.readouterr().err
    assert main(["status", "--server", arm.server, "--key", str(arm.key("reader"))]) == 0
    assert "reader, role read" in capsys.readouterr().out


def test_offline_needs_no_key():
    assert FrankaArm(offline=True, key="nowhere.json").get_joints().shape == (7,)
    with pytest.raises(FrankaArmException):
        find_key("nowhere.json")
