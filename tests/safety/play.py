"""Makes a run happen: an arm in lockstep, a server, two clients, and the events of a scenario."""

import collections
import contextlib
import dataclasses
import faulthandler
import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from answers import time_answers
from draw import HOME, TOPIC, Draw, is_led
from judge import (
    Standing,
    Violation,
    capsules,
    clearance,
    held_capsule,
    judge_joints,
    judge_recordings,
    judge_walls,
    self_distance,
    wire_limits,
)
from errors import error_names
from recorded_server import RecordedServer, recorded_server
from scenario import Event, Scenario

from frankapy import FrankaArm, FrankaArmBusyException, FrankaArmCommException, FrankaArmException, RigidTransform, channel, proto
from frankapy.parts import MinJerkJoint, RelativeMinJerkJoint
from frankapy.sim import ControlChannel
from frankapy.walls import Plane

channel.SILENCE = 60.0  # s: that this computer stands still for a while is no violation
EVENT = 240  # s of the wall, for the end of an event; it mostly takes some two
READY = 120  # s of the wall, for an arm to be ready again
REPORTED = 60  # s of the wall, for the result of a skill that has been stopped
COMES_BESIDE = 0.02  # m, from the arm at rest to a wall that comes
COMES_AHEAD = 0.35  # m, from an arm that moves
LATE = 1.0  # s, for an answer
RECOVERS = "recover"  # is answered when the arm has recovered
MOST_WALLS = 5
SWITCHES = 5  # times some skills, of an event that is made of them
# Far enough for pushes of 30 N: what the campaign looks for are not reflexes of the robot.
THRESHOLDS = "lower_{0} = {1}\nupper_{0} = {2}\n"
SETTINGS = '[arm.recovery]\ncollisions = "itself"\nuser_stop = "itself"\n[arm.collision]\n' + "".join(
    THRESHOLDS.format(f"{what}_thresholds", [20] * count, [most] * count)
    for what, count, most in (("torque", 7, 100), ("force", 6, 120))
)
# What the simulated arm stands on, which no draw knows of.
FLOOR = Plane()
FLOOR.name, FLOOR.fixed = "floor", True
FLOOR_SETTINGS = f'[[arm.wall]]\nname = "{FLOOR.name}"\nshape = "plane"\nposition = {list(FLOOR.position)}\n'
# What an arm may meet that is led by hand or by a force: itself, and what stands around it. The server keeps references from that.
MEETS_ITSELF = "self_collision_avoidance_violation"
NEAR_ITSELF = 0.04  # m; motions keep 0.031
MET = {MEETS_ITSELF, "tau_j_range_violation", "joint_reflex", "cartesian_reflex"}
NEXT_TO_END = 0.05  # rad; who pushes a joint that is so near to the end of its range can make it faster than it may be there
KEPT = 8000  # last datagrams of either way
TOUCH = 10, 5  # N, N m, felt by an arm at rest that leans on something
VICTIM = """
import json, sys, time
from frankapy import FrankaArm
from frankapy.parts import RelativeMinJerkJoint
fa = FrankaArm(server=sys.argv[1], with_gripper=False)
fa.run(RelativeMinJerkJoint(json.loads(sys.argv[2]), 0.8), block=False)
print("runs", flush=True)
time.sleep(600)
"""


class _Enough(Exception):
    """No more of a sequence."""


class _NotReady(Exception):
    """The arm does not become ready: no more of the run."""


@dataclasses.dataclass
class Outcome:
    """What came of a run."""

    violations: list[Violation] = dataclasses.field(default_factory=list)
    skills: int = 0
    changes: int = 0  # of skills that ran
    ran: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)  # kinds, in how many skills and changes
    commands: int = 0  # that were judged
    seconds: float = 0.0  # simulated
    answers: int = 0
    late_answers: int = 0
    longest_answer: float = 0.0  # s
    endings: dict[str, int] = dataclasses.field(default_factory=dict)
    said: list[str] = dataclasses.field(default_factory=list)  # what happened, event by event


def may_drift(controller: str) -> bool:
    """Whether the arm may go on as it was pushed: led, or by the weights of its law too weak to hold it."""
    return controller == "Lqr" or is_led(controller)


class Player:
    """A run under way."""

    def __init__(
        self,
        recorded: RecordedServer,
        scenario: Scenario,
        outcome: Outcome,
        hung: Callable[[Outcome], None],
        keep: Path | None = None,  # folder for what passed before a command was beyond a limit, or the robot reported an error
    ) -> None:
        self._recorded, self._scenario, self._outcome = recorded, scenario, outcome
        self._limits = wire_limits.LIMITS[scenario.robot]
        self._errors = error_names()
        self._control = ControlChannel(recorded.arm)
        self._hung, self._keep = hung, keep
        self.standing = [Standing(FLOOR, 0)]
        self.skills: list[int] = []  # that the server's process, as it is now, has started
        self.processes = 1
        self._endings: collections.Counter[str] = collections.Counter()
        self._place: int | None = None  # of the event
        self._expected: set[str] = set()  # errors that the event provokes
        self._pushed = False  # by somebody, in this event
        self._alone = True  # nobody has killed the server in this event
        time_answers(self._answered)
        self._motions: list = []
        self._connect()
        self._home_joints()

    def play(self) -> None:
        """Let all events happen."""
        try:
            with contextlib.suppress(_NotReady):
                for event in self._scenario.events:
                    self._play(event)
        finally:
            self._place = None
            for client in (self._fa, self._other):
                client.close()
            self._outcome.endings = dict(self._endings)

    def _play(self, event: Event) -> None:
        self._place = event.seed[1]
        self._expected, self._alone, self._pushed = set(), True, False
        state = self._fa.get_arm_state().robot
        matrix = np.array(state.O_T_EE).reshape(4, 4).T
        pose = RigidTransform(matrix[:3, :3], matrix[:3, 3])
        draw = Draw(event.seed, self._limits.q, np.array(state.q), pose)
        self._say(event.kind)
        # Where it was led: the robot minds each step nearer, and what it touches may be in the way.
        if self_distance(draw.q) < NEAR_ITSELF:
            self._expected.add(MEETS_ITSELF)
        if np.linalg.norm(state.O_F_ext_hat_K[:3]) > TOUCH[0] or np.abs(state.tau_ext_hat_filtered).max() > TOUCH[1]:
            self._expected |= MET
        with self._watched(event.kind):
            getattr(self, f"_{event.kind}")(draw)
            self._settle(judged=event.kind != "loss")
        self._outcome.skills += len(self._motions)
        self._motions.clear()

    # --- events ---

    def _skills(self, draw: Draw, torque: bool = False, during: Callable[[], None] | None = None) -> None:
        self._some_skills(draw, torque=torque, during=during)
        if draw.chance(0.8):  # else they are stopped
            self._try(self._fa.wait_for_skill)

    def _switches(self, draw: Draw) -> None:
        """Many, each of which finds the one before as it is; in one event of four also some that let the arm be led."""
        led = draw.chance(0.25)
        for _ in range(SWITCHES):
            self._some_skills(draw, led=led)

    def _some_skills(
        self, draw: Draw, torque: bool = False, led: bool = True, during: Callable[[], None] | None = None
    ) -> None:
        """One to four: waited for, taken over, taken over at once, stopped, changed, or queued."""
        how = draw.one(["wait", "preempt", "preempt", "at once", "stop", "sequence", "change"])
        number = draw.one([1, 1, 2, 3, 4])
        if how == "sequence" and during is None:
            with self._tried(), contextlib.suppress(_Enough), self._fa.sequence(blend=draw.one([0, draw.uniform(0, 0.3)])):
                for _ in range(number):
                    self._run(draw.skill(torque, led))
                if draw.chance(0.3):
                    self._pass(draw.uniform(0, 0.5))
                    raise _Enough  # stops them
            return
        for _ in range(number):
            skill = draw.skill(torque, led)
            self._run(skill)
            self._publish(draw)
            if during is not None:
                self._pass(draw.uniform(0, 0.4))
                self._try(during)
            elif how == "change":
                for _ in range(draw.one([1, 2, 3])):
                    self._pass(draw.one([0, draw.uniform(0, 0.1), draw.uniform(0, 0.3)]))
                    change = draw.change(skill, led)
                    if "controller" in change and may_drift(type(change["controller"]).__name__):
                        self._expected |= MET
                    if self._try(lambda change=change: self._fa.change(**change)):
                        self._say(f"changed: {', '.join(change)}")
                        self._count(change)
                        self._outcome.changes += 1
            if how == "wait":
                self._try(self._fa.wait_for_skill)
            elif how != "at once":
                self._pass(draw.one([0, draw.uniform(0, 0.05), draw.uniform(0, 0.5)]))
        if how == "stop":
            self._try(self._fa.stop_skill)

    def _push(self, draw: Draw) -> None:
        self._expected |= MET
        self._pushed = True
        self._skills(draw, torque=True, during=lambda: self._control.push(**draw.push()))
        self._try(self._fa.stop_skill)
        self._control.push([0] * 6, 0)

    def _walls(self, draw: Draw) -> None:
        walls = self._fa.walls
        there = self._there()
        if there and (len(there) >= MOST_WALLS or draw.chance(0.3)):
            gone = draw.one([wall.name for wall in there])
            self._ends({gone}, self._control.truth().cycle)
            self._try(lambda: walls.remove(gone))
            return
        moving = draw.chance(0.3)
        if moving:
            self._run(draw.skill())
            self._pass(draw.uniform(0, 0.3))
        name = f"wall {self._place}"
        if there and draw.chance(0.3):  # one that is there becomes another
            name = draw.one([wall.name for wall in there])
            there = [wall for wall in there if wall.name != name]
        q = self._control.truth().q
        held = [held_capsule(body) for body in there if body.held]
        for _ in range(20):
            wall = draw.wall()
            wall.name = name
            if wall.held:
                gaps = [clearance(other, q, [held_capsule(wall)]) for other in [FLOOR, *there] if not other.held]
            else:
                gaps = [clearance(wall, q, [*capsules(), *held])]
            if min(gaps) > (COMES_AHEAD if moving else COMES_BESIDE):
                before = self._control.truth().cycle
                if self._try(lambda wall=wall: walls.add(name, wall)):
                    self._ends({name}, before)
                    # The loop takes it in its next cycle.
                    self.standing.append(Standing(wall, self._control.truth().cycle + 2))
                    self._say(f"{wall.WhichOneof('shape')} {wall.name!r}")
                break

    def _home(self, _: Draw) -> None:
        names = {wall.name for wall in self._there()}
        self._ends(names, self._control.truth().cycle)
        self._try(lambda: self._fa.walls.remove(*names))
        self._home_joints()

    def _loss(self, draw: Draw) -> None:
        # Commands that were sent and did not come are no steps of the robot's reference: there its own checks judge.
        self._judge_commands()
        way = lambda: draw.one([0.0, draw.uniform(0, 0.1)])  # noqa: E731
        self._control.network(
            **{name: way() for name in ("loss_in", "loss_out", "delayed_in", "delayed_out")},
            **{name: 0.002 for name in ("delay_in", "delay_out")},
            seed=draw.one(range(1000)),
        )
        self._skills(draw)
        self._try(self._fa.stop_skill)
        self._control.network()

    def _robot_error(self, draw: Draw) -> None:
        error = draw.one(self._errors)
        self._expected.add(error)
        self._say(error)
        self._run(draw.skill())
        self._pass(draw.uniform(0, 0.4))
        if self._try(lambda: self._control.inject(error)) and not self._broke_off():
            self._try(lambda: self._fa.wait_for(lambda state: bool(state.robot.errors), REPORTED))

    def _user_stop(self, draw: Draw) -> None:
        self._run(draw.skill())
        self._pass(draw.uniform(0, 0.4))
        self._control.user_stop(True)
        with self._tried():
            if self._motions:
                self._motions[-1].result(REPORTED)
        self._try(lambda: self._fa.run(**draw.skill(), preempt=True, block=False, recover="ask"))  # refused, and waits for nobody
        self._control.user_stop(False)

    def _another_client(self, draw: Draw) -> None:
        self._run(draw.skill())
        self._pass(draw.uniform(0, 0.2))
        with contextlib.suppress(FrankaArmBusyException), self._tried():
            self._other.run(draw.skill()["trajectory"], block=False)
        self._try(lambda: self._other.walls)
        self._try(self._other.stop_skill)
        with self._tried():  # where it commands the arm now, it would for the rest of the run
            self._other.close()
            self._other = self._client()

    def _client_is_killed(self, draw: Draw) -> None:
        self._fa.close()
        delta = [draw.uniform(-0.2, 0.2) for _ in range(7)]
        command = [sys.executable, "-c", VICTIM, self._recorded.server, json.dumps(delta)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as victim:
            assert victim.stdout is not None
            victim.stdout.readline()
            time.sleep(draw.uniform(0, 0.1))
            victim.kill()
        self._connect()
        # The dead one's lease ends within a second; then its motion is taken over.
        until = time.monotonic() + REPORTED
        while time.monotonic() < until:
            try:
                self._fa.run(RelativeMinJerkJoint([0.01] * 7, 0.2), preempt=True, ignore_errors=True)
                break
            except FrankaArmBusyException:
                time.sleep(0.05)
            except FrankaArmException as error:
                self._endings[f"refused: {str(error)[:40]}"] += 1
                break
        else:
            self._found("hung", f"the arm is not free {REPORTED} s after its client was killed")

    def _server_is_killed(self, draw: Draw) -> None:
        self._judge_commands()
        names = {wall.name for wall in self._there()}
        self._expected.add("communication_constraints_violation")
        self._alone = False
        self._run(draw.skill())
        self._pass(draw.uniform(0, 0.4))
        how = draw.one([signal.SIGKILL, signal.SIGSEGV, signal.SIGSTOP])
        supervisor = self._recorded.process.pid
        children = Path(f"/proc/{supervisor}/task/{supervisor}/children")
        child = children.read_text()
        os.kill(int(child), how)
        self._say(how.name)
        with self._tried():
            self._fa.wait_for_skill()
        self._motions.clear()  # of which no more is heard, and that was said
        self.skills.clear()
        self.processes += 1
        for client in (self._fa, self._other):
            client.close()
        until = time.monotonic() + READY
        while children.read_text() == child:  # what is over already may have been waited for, and it takes time to die
            if time.monotonic() > until:
                raise TimeoutError(f"{READY} s after {how.name} the process is there")
            time.sleep(0.01)
        while True:
            try:
                self._connect()
                self._fa.wait_for_franka_interface(60)
                break
            except FrankaArmException as error:
                if time.monotonic() > until:
                    raise TimeoutError(f"{READY} s after {how.name} the arm is not ready: {error}") from error
                time.sleep(0.2)
        if (there := set(self._fa.walls)) != names | {FLOOR.name}:
            self._found("hung", f"walls {sorted(names)} became {sorted(there)} by {how.name}")

    # --- what events are made of ---

    def _connect(self) -> None:
        self._fa, self._other = self._client(), self._client()

    def _client(self) -> FrankaArm:
        client = FrankaArm(server=self._recorded.server, with_gripper=False)
        client.recovery = 1000  # times in a row: nobody is there to be asked
        return client

    def _home_joints(self) -> None:
        self._run({"trajectory": MinJerkJoint(HOME, 1.0)})
        self._try(self._fa.wait_for_skill)

    def _run(self, skill: dict) -> None:
        before = self._running()
        self._try(lambda: self._fa.run(**skill, preempt=self._fa._motions.sequence is None, block=False, ignore_errors=True))
        motion = self._running()
        if motion is not None and motion is not before:
            self._motions.append(motion)
            self.skills.append(motion.id)
            self._count(skill)
            ends = ", ".join(type(end).__name__ for end in skill.get("until", ()))
            law = type(skill["controller"]).__name__ if "controller" in skill else "InternalImpedance"
            if may_drift(law):
                self._expected |= MET
            self._say(f"{type(skill['trajectory']).__name__} with {law} in {skill.get('robot_controller', 'auto')} until {ends}")

    def _broke_off(self) -> bool:
        """Whether an error ends the last skill, or keeps it from beginning: it may be over by then, as the arm recovers by itself."""
        self._try(self._fa.wait_for_skill)
        with self._tried():
            result = self._motions[-1].result(REPORTED) if self._motions else None
            return result is not None and result.ending in (proto.ROBOT_ERROR, proto.REFUSED)
        return False

    def _count(self, arguments: dict) -> None:
        ends = arguments.get("until", ())
        them = [arguments[role] for role in ("trajectory", "controller") if role in arguments]
        self._outcome.ran.update(type(part).__name__ for part in [*them, *ends])
        after = [end.then for end in ends if isinstance(end, proto.Contact) and end.HasField("then")]
        self._outcome.ran.update(each.TypeName().split(".")[-1] for each in after)

    def _running(self):  # noqa: ANN202
        # What has not been waited for is only there.
        return self._fa._motions.running

    def _pass(self, seconds: float) -> None:
        """Let so much of the arm's time go by, or less where nothing moves."""
        until = self._control.truth().cycle + 1000 * seconds
        with self._tried():
            while self._control.truth().cycle < until and not self._fa.is_skill_done():
                time.sleep(0.0005)

    def _publish(self, draw: Draw) -> None:
        """Send messages of every kind where the skill that runs listens to any."""
        motion = self._running()
        if motion is None or TOPIC.encode() not in motion.call.request.SerializeToString():
            return
        with self._tried(), self._fa.publisher(TOPIC) as publisher:
            for _ in range(draw.one([1, 5, 20])):
                for message in draw.sensor_messages():
                    publisher.publish(message)
                self._pass(draw.uniform(0, 0.03))

    def _there(self) -> list[proto.Wall]:
        return [standing.wall for standing in self.standing if standing.end is None and not standing.wall.fixed]

    def _ends(self, names: set[str], cycle: int) -> None:
        for standing in self.standing:
            if standing.wall.name in names and standing.end is None:
                standing.end = cycle

    def _settle(self, judged: bool) -> None:
        """Bring the arm to rest, and see that all was reported and that it is ready."""
        self._try(self._fa.stop_skill)
        for motion in self._motions:
            try:
                if (result := motion.result(REPORTED)) is None:
                    self._found("unreported", f"skill {motion.id} has no result {REPORTED} s after it was stopped")
                    continue
                self._endings[proto.Ending.Name(result.ending)] += 1
            except FrankaArmException as error:
                self._found("unreported", f"skill {motion.id}: {error}")
        try:  # whatever has happened to it, and whoever may bring it back has been asked
            self._fa.wait_for_franka_interface(READY)
        except FrankaArmException as error:
            self._found("hung", f"the arm does not become ready: {error}")
            raise _NotReady from error
        finally:  # an error is in the states until then
            self._judge_commands(judged)

    def _judge_commands(self, judged: bool = True) -> None:
        commands, states = self._recorded.wire.recorded()
        if not states:
            return
        version = wire_limits.FLOAT_STATES if len(states[0]) < 2000 else 5
        found = len(self._outcome.violations)
        if judged:
            beyond, count = wire_limits.violations(self._limits, version, commands, states)
            self._outcome.commands += count
            if beyond:
                self._found("limit", f"{len(beyond)} commands: {beyond[0]}")
        seen = wire_limits.parsed("RobotState", version, states)
        names = {name for name, there in zip(self._errors, seen["errors"].any(axis=0), strict=True) if there}
        if self._pushed and np.abs(seen["q"][:, None] - self._limits.q).min() < NEXT_TO_END:
            names.discard("joint_velocity_violation")
        if unprovoked := names - self._expected:
            self._found("limit", f"the robot reports {', '.join(sorted(unprovoked))}")
        if self._keep is not None and len(self._outcome.violations) > found:
            np.savez_compressed(
                self._keep / f"{self._scenario.robot}-{self._scenario.seed}-{self._place}.npz",
                commands=np.frombuffer(b"".join(commands[-KEPT:]), np.uint8).reshape(-1, len(commands[0])),
                states=np.frombuffer(b"".join(states[-KEPT:]), np.uint8).reshape(-1, len(states[0])),
            )

    # --- calls ---

    def _try(self, do: Callable[[], object]) -> bool:
        """Do it; return whether it was done. Refusals are no violations, anything else that is raised is."""
        with self._tried():
            do()
            return True
        return False

    @contextlib.contextmanager
    def _tried(self) -> Iterator[None]:
        try:
            yield
        except FrankaArmCommException as error:  # also where an answer has not come for some seconds
            if self._alone:
                self._found("hung", f"{error}")
        except FrankaArmException as error:
            self._endings[f"{type(error).__name__}: {str(error).split(':')[0][:40]}"] += 1
            self._say(f"{type(error).__name__}: {' '.join(str(error).split())[:160]}")
        except Exception as error:  # noqa: BLE001
            self._found("unreported", f"a call raised {error!r}")

    @contextlib.contextmanager
    def _watched(self, what: str) -> Iterator[None]:
        def give_up() -> None:
            self._found("hung", f"{what} does not come to its end")
            self._say("stacks are in hung.txt")
            self._hung(self._outcome)

        watch = threading.Timer(EVENT, give_up)
        watch.daemon = True
        watch.start()
        try:
            yield
        finally:
            watch.cancel()

    def _found(self, kind: str, text: str) -> None:
        self._outcome.violations.append(Violation(kind, " ".join(text.split())[:400], self._place))
        self._say(f"! {kind}: {text}")

    def _answered(self, kind: str, took: float) -> None:
        if not self._alone or kind == RECOVERS:
            return
        self._outcome.answers += 1
        self._outcome.longest_answer = max(self._outcome.longest_answer, took)
        if took > LATE:
            self._outcome.late_answers += 1
            self._say(f"{kind} was answered after {took:.2f} s")

    def _say(self, text: str) -> None:
        self._outcome.said.append(f"{self._place}: {text}")


def play(scenario: Scenario, server: str | Path, record: str, folder: Path, report: Callable[[Outcome], None]) -> None:
    """Play and judge a run; everything of it is left in `folder`, and `report` gets what came of it, also where it hangs."""
    logging.getLogger("frankapy").setLevel(logging.CRITICAL)
    outcome = Outcome()
    truth_file = folder / "truth.npy"

    def hung(outcome: Outcome) -> None:
        with (folder / "hung.txt").open("w") as stacks:
            faulthandler.dump_traceback(stacks)
        report(outcome)
        os._exit(1)

    arm_options = ["--truth", str(truth_file), "--pause", "between-motions", "--seed", str(scenario.seed)]
    arm_options += ["--ideal"] * scenario.ideal
    player = None
    try:
        with (
            (folder / "server.log").open("w") as log,
            recorded_server(
                scenario.robot,
                server,
                arm_options,
                f"hold_time = {scenario.hold_time}\n{SETTINGS}{FLOOR_SETTINGS}",
                ["--record", record, "--recordings", str(folder)],
                log,
            ) as recorded,
        ):
            player = Player(recorded, scenario, outcome, hung)
            player.play()
    except Exception as error:  # noqa: BLE001
        outcome.violations.append(Violation("hung", f"{error!r}"[:400]))
    if truth_file.exists():
        truth = np.load(truth_file)
        outcome.seconds = len(truth) * 1e-3
        if player is not None:
            outcome.violations += judge_walls(truth, player.standing)
            outcome.violations += judge_joints(truth, wire_limits.LIMITS[scenario.robot])
            outcome.violations += judge_recordings(folder, player.skills, player.processes)
    report(outcome)
