"""The motions of one client: one at a time, or in a sequence; sent, waited for, stopped, and judged when they have ended."""

from __future__ import annotations

import contextlib
import logging
import os
import time
from collections.abc import Iterator, Sequence

from google.protobuf.message import Message

from frankapy import interrupts, proto
from frankapy.channel import Call, advised, answered
from frankapy.connection import Connected, Connection
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmException, FrankaArmFrankaInterfaceNotReadyException
from frankapy.fork import Lock
from frankapy.progress import progress
from frankapy.skill import any_of, check_part
from frankapy.validation import number

logger = logging.getLogger("frankapy")

_STRETCH_WORTH_A_WORD = 1.01
_LONG, _TICK = 2.0, 0.1  # s: of a motion with a progress bar, between looks at it
_STOP_TIME = 3.0  # s after which an interrupted call no longer waits for the arm to rest
_MAX_BLEND = 10.0  # s

# What an ended skill may look like without anything being wrong.
_GOOD_ENDINGS = (proto.TERMINATED, proto.STOPPED, proto.PREEMPTED)


class Motion:
    """A skill of this client which the server has taken."""

    def __init__(self, call: Call, server: Connection, description: str, duration: float, led: bool) -> None:
        self.call = call
        self.name = description or "The skill"
        self.duration = duration  # s, that was asked for
        self.led = led
        self.judged = False
        self.forgotten = False  # the next one takes over from it
        self.ended: proto.SkillResult | None = None  # how, once it was judged
        self.started: proto.SkillStarted = call.first().skill_started
        self.id = int(self.started.skill_id)  # at the server
        self.recovery = call.request.start_skill.skill.recovery
        self._server = server
        self._pid = os.getpid()

    def result(self, timeout: float | None = None) -> proto.SkillResult | None:
        """Wait for its end, at most `timeout` (s); None when it has not come. Raises as Call.final does."""
        if os.getpid() != self._pid:
            return self._asked_result(timeout)
        reply = self.call.final() if timeout is None else self.call.last(timeout)
        return None if reply is None else reply.skill_result

    def _asked_result(self, timeout: float | None) -> proto.SkillResult | None:
        # After a fork: the server tells the process that has started it, and others when they ask.
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            reply = self._server.ask(proto.Request(skill_status=proto.SkillStatus(skill_id=self.id)))
            if reply.HasField("skill_result"):
                return reply.skill_result
            if deadline is not None and time.monotonic() >= deadline:
                return None
            time.sleep(_TICK)


class MotionSequence:
    """Motions that wait for each other, each with whether its errors are ignored."""

    def __init__(self, blend: float) -> None:
        self.blend = blend
        self.motions: list[tuple[Motion, bool]] = []


class Motions(Connected):
    """What this client moves; of a client without a server nothing, which it says."""

    def __init__(self, server: Connection | None) -> None:
        self._connection = server
        self._starting = Lock()  # from the look at what runs to the new one
        self._judging = Lock()
        self.running: Motion | None = None  # the last that was sent, until it was seen to have ended
        self.sequence: MotionSequence | None = None  # that is being made
        self.last_result = proto.SkillResult()

    def run(
        self, skill: proto.Skill, duration: float, block: bool, ignore_errors: bool, preempt: bool = False, led: bool = False
    ) -> proto.SkillResult | None:
        """Send a skill, which was asked to take `duration` (s); where asked to, wait for its end and return its result.

        `led`: somebody leads the arm in it; that it does not stay where it began is then nothing to tell.
        """
        if self._connection is None:
            logger.warning("%s is not made: this FrankaArm is offline.", skill.description or "The skill")
            return None
        interrupts.watch()
        interruptions = interrupts.count()
        try:
            with self._starting:
                motion = self._start(skill, duration, ignore_errors, preempt, led)
            if interrupts.count() != interruptions:  # in another thread, before this was sent
                self._server.stop_commands()
            if not block or self.sequence is not None:
                return None
            return self.wait(motion, ignore_errors)
        except (KeyboardInterrupt, SystemExit):
            self._server.stop_commands()
            raise

    def _start(self, skill: proto.Skill, duration: float, ignore_errors: bool, preempt: bool, led: bool) -> Motion:
        sequence = self.sequence
        preempt = preempt or (sequence is None and self.running is not None and self.running.forgotten and not self.is_done())
        if sequence is not None and preempt:
            raise FrankaArmArgumentError("preempt=True is not for motions of a sequence, which wait for each other.")
        # What has ended is told of first, and where it failed does not cancel a sequence that comes behind it.
        is_first = not preempt and (sequence is None or not sequence.motions)
        if is_first and not self.is_done() and sequence is None:
            raise FrankaArmArgumentError(
                "Cannot send another command when the previous skill is active! fa.wait_for_skill() waits for its end, "
                "fa.stop_skill() stops it, fa.run(..., preempt=True) takes over from it"
            )
        start = proto.StartSkill(skill=skill, preempt=preempt)
        if sequence is not None and (before := self.before_next()) is not None:
            start.after, start.blend = before.skill_id, sequence.blend
        request = proto.Request(start_skill=start)
        try:
            call = self._server.start(request)
        except FrankaArmFrankaInterfaceNotReadyException as error:
            if skill.recovery.who != proto.RecoveryPolicy.ITSELF:
                raise
            logger.warning("%s: the arm is told to recover.", error.message)
            self._server.wait_until_ready(under=skill.recovery)
            call = self._server.start(request)
        motion = self.running = Motion(call, self._server, skill.description, duration, led)
        if sequence is not None:
            sequence.motions.append((motion, ignore_errors))
        return motion

    def before_next(self) -> proto.SkillStarted | None:
        """Return what the server said of the motion that the next one of a sequence waits for; None without one."""
        if self.sequence is None:
            return None
        motion = self.sequence.motions[-1][0] if self.sequence.motions else self.running
        return None if motion is None else motion.started

    def change(self, trajectory: Message | None, controller: Message | None, until: Message | Sequence[Message]) -> None:
        """Give the motion that runs other parts; None and () leave what it has."""
        motion = self.running
        if motion is None or self.is_done():
            raise FrankaArmException("No skill of this client runs: there is nothing to change.")
        change = proto.ChangeSkill(skill_id=motion.id)
        if trajectory is not None:
            check_part("trajectory", trajectory)
            change.trajectory.Pack(trajectory)
        if controller is not None:
            check_part("controller", controller)
            change.controller.Pack(controller)
        for termination in any_of(until):
            check_part("until", termination)
            change.terminations.add().Pack(termination)
        self._server.ask(proto.Request(change_skill=change))

    @contextlib.contextmanager
    def in_sequence(self, blend: float) -> Iterator[list[proto.SkillResult]]:
        """Queue the motions that are called for inside, and wait for all of them at the end; gives the list of their results."""
        blend = number("blend", blend)
        if not 0 <= blend <= _MAX_BLEND:
            raise FrankaArmArgumentError(f"blend is {blend:g} s: expected 0 to {_MAX_BLEND:g} s")
        if self.sequence is not None:
            raise FrankaArmArgumentError("A sequence is being made already: end it before another one begins.")
        sequence = self.sequence = MotionSequence(blend)
        results: list[proto.SkillResult] = []
        try:
            yield results
        except BaseException:
            self.sequence = None
            self.stop()
            raise
        self.sequence = None
        failure: FrankaArmException | None = None
        for motion, ignore_errors in sequence.motions:
            try:
                self.wait(motion, ignore_errors)
            except FrankaArmException as error:
                failure = failure or error
            if motion.ended is not None:
                results.append(motion.ended)
        if failure is not None:
            raise failure

    def stop(self) -> None:
        """Bring the arm to rest, whoever moves it, and wait until the motion of this client has ended."""
        if self._connection is not None:
            self._connection.ask(proto.Request(stop_skill=proto.StopSkill()))
            self.wait_for_last()

    def wait_for_last(self) -> None:
        """Return when the motion that was last sent has ended, however it ended."""
        if (motion := self.running) is not None:
            with contextlib.suppress(FrankaArmFrankaInterfaceNotReadyException):
                self.wait(motion, ignore_errors=True)

    async def finished(self, ignore_errors: bool) -> proto.SkillResult:
        """Wait in a coroutine for the end of the motion that was last sent, which is stopped where the coroutine is cancelled."""
        import asyncio  # which takes its time

        result = None
        if (motion := self.running) is not None:
            stop = proto.Request(stop_skill=proto.StopSkill())
            await answered(lambda: motion.result(timeout=0), lambda: self._server.send(stop))
            result = await asyncio.to_thread(self.wait, motion, ignore_errors)
        return self.last_result if result is None else result

    def wait(self, motion: Motion, ignore_errors: bool) -> proto.SkillResult | None:
        """Wait for the end of a motion, judge it, and return its result.

        Raises, in each thread that waits for it, FrankaArmException for one that failed where errors are not ignored,
        FrankaArmFrankaInterfaceNotReadyException where a person has to look at the arm, FrankaArmCommException where the connection
        was lost.
        """
        try:
            if motion.duration < _LONG:
                motion.result()
            else:
                _show(motion)
        except (KeyboardInterrupt, SystemExit):
            with contextlib.suppress(FrankaArmException):
                self._server.send(proto.Request(stop_skill=proto.StopSkill()))
                motion.result(_STOP_TIME)
                self._judge(motion, ignore_errors=True)
            raise
        except FrankaArmException:
            pass  # found again below
        return self._judge(motion, ignore_errors)

    def is_done(self, ignore_errors: bool = True) -> bool:
        """Return whether the motion that was last sent has ended; raises as `wait` does, once."""
        motion = self.running
        if motion is None:
            return True
        try:
            if motion.result(timeout=0) is None:
                return False
        except FrankaArmException:
            pass  # found again below
        try:
            self._judge(motion, ignore_errors)
        except FrankaArmFrankaInterfaceNotReadyException:
            if not ignore_errors:
                raise
        return True

    def _judge(self, motion: Motion, ignore_errors: bool) -> proto.SkillResult | None:
        """Return the result of one that has ended: told of, and recovered from, once; raised for whoever does not ignore errors."""
        result: proto.SkillResult | None = None
        lost: FrankaArmException | None = None
        try:
            result = motion.result(timeout=0)
        except FrankaArmException as error:
            lost = error
        with self._judging:
            judged, motion.judged = motion.judged, True
            if result is not None and not judged:
                self.last_result = motion.ended = result
            if self.running is motion:
                self.running = None
        if lost is not None:
            raise lost
        if result is None:
            return None
        if not judged:
            self._tell(motion, result)
        if result.ending in _GOOD_ENDINGS:
            return result
        text = f"{motion.name} ended with {proto.Ending.Name(result.ending)}: {result.message or ', '.join(result.errors)}"
        if not ignore_errors:
            raise FrankaArmException(advised(text), result)
        if not judged:
            logger.warning("%s", text)
            if result.ending in (proto.ROBOT_ERROR, proto.REFUSED) and not result.recovery.recovered:
                self._server.wait_until_ready(under=motion.recovery)
        return result

    @staticmethod
    def _tell(motion: Motion, result: proto.SkillResult) -> None:
        """Say what of a motion was not as it was asked for, though it may have ended well."""
        if result.stretch > _STRETCH_WORTH_A_WORD and not motion.led:
            logger.warning("%s was too fast for the arm and took %.2f times as long.", motion.name, result.stretch)
        if result.wall:
            logger.warning("%s was held back by the wall %r.", motion.name, result.wall)
        if result.ending in _GOOD_ENDINGS and result.message and not motion.led:
            logger.warning("%s has ended, but %s", motion.name, result.message)


def _show(motion: Motion) -> None:
    """Wait for the end of a skill, with a bar where there is a terminal."""
    begin = time.monotonic()
    with progress(motion.duration, motion.name, unit="s") as bar:
        while motion.result(_TICK) is None:
            bar.update(max(0.0, min(time.monotonic() - begin, motion.duration) - bar.n))
