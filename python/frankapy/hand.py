"""The hand: one gripper command after the other, sent, waited for, stopped, and judged when it has ended."""

from __future__ import annotations

import contextlib
import logging
import time
from typing import Any

from frankapy import interrupts, proto
from frankapy.channel import Call, answered
from frankapy.connection import Connected, Connection
from frankapy.exceptions import FrankaArmArgumentError, FrankaArmException
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.validation import number, validate

logger = logging.getLogger("frankapy")

_STOP_TIME = 3.0  # s after which an interrupted call no longer waits for the fingers
_STATE_TIME, _TICK = 0.2, 0.005  # s: in which the hand has told of what it did, some 30 times a second; between looks

HOMING = proto.GripperCommand(homing=proto.GripperCommand.Homing())
STOP = proto.GripperCommand(stop=proto.GripperCommand.StopGripper())


def move(width: Any, speed: Any) -> proto.GripperCommand:
    """Return the command that brings the fingers so far apart; m, m/s."""
    return proto.GripperCommand(move=proto.GripperCommand.Move(width=_width(width), speed=number("speed", speed)))


def grasp(width: Any, speed: Any, force: Any, epsilon_inner: Any, epsilon_outer: Any) -> proto.GripperCommand:
    """Return the command that closes the fingers until a force (N; 0: the usual one) is met at about a width (m)."""
    return proto.GripperCommand(
        grasp=proto.GripperCommand.Grasp(
            width=_width(width),
            speed=number("speed", speed),
            force=number("force", force) or None,
            epsilon_inner=number("epsilon_inner", epsilon_inner),
            epsilon_outer=number("epsilon_outer", epsilon_outer),
        )
    )


def _width(width: Any) -> float:
    width = number("width", width)
    if not FC.GRIPPER_WIDTH_MIN <= width <= FC.GRIPPER_WIDTH_MAX:
        raise FrankaArmArgumentError(f"width is {width:g} m: expected {FC.GRIPPER_WIDTH_MIN} to {FC.GRIPPER_WIDTH_MAX}")
    return float(width)


class Hand(Connected):
    """The hand of an arm; of a client without a server it stays where it is, which is said."""

    def __init__(self, server: Connection | None, wanted: bool) -> None:
        """Command over `server`; `wanted`: False for an arm that is used without a hand."""
        self._connection, self._wanted = server, wanted
        self._last: Call | None = None  # that was sent, until it was seen to have ended

    def state(self, arm: proto.ArmState) -> proto.GripperState:
        """Return what a state of the arm says of the hand. Raises FrankaArmException where there is none."""
        self._require()
        if not arm.HasField("gripper"):
            raise FrankaArmException("The server has no hand on this arm.")
        return arm.gripper

    def _require(self) -> None:
        if not self._wanted:
            raise FrankaArmException("This FrankaArm was made with with_gripper=False.")

    def command(self, command: proto.GripperCommand, block: bool, ignore_errors: bool) -> None:
        """Send a command, and wait for its end where asked to."""
        self._require()
        validate(command)
        if self._connection is None:
            logger.warning("The gripper stays: this FrankaArm is offline.")
            return
        interrupts.watch()
        interruptions = interrupts.count()
        try:
            call = self._last = self._server.start(proto.Request(gripper=command))
            if interrupts.count() != interruptions:  # in another thread, before this was sent
                self._server.stop_commands()
            if block:
                self._finish(call, ignore_errors)
        except (KeyboardInterrupt, SystemExit):
            self._server.stop_commands()
            raise

    def wait(self) -> None:
        """Wait for the end of the command that was last sent. Raises FrankaArmCommException where the connection was lost."""
        call = self._last
        if call is not None:
            self._finish(call, ignore_errors=True)

    async def finished(self, ignore_errors: bool) -> None:
        """Wait in a coroutine for the end of the command that was last sent; the hand is stopped where that is cancelled."""
        import asyncio  # which takes its time

        if (call := self._last) is not None:
            await answered(lambda: call.last(timeout=0), lambda: self._server.send(proto.Request(gripper=STOP)))
            await asyncio.to_thread(self._finish, call, ignore_errors)

    def is_done(self) -> bool:
        """Return whether the command that was last sent has ended; raises as `wait` does, once."""
        call = self._last
        if call is None:
            return True
        try:
            if call.last(timeout=0) is None:
                return False
        except FrankaArmException:
            pass  # found again below
        self._finish(call, ignore_errors=True)
        return True

    def _finish(self, call: Call, ignore_errors: bool) -> None:
        try:
            result = call.final().gripper_result
        except (KeyboardInterrupt, SystemExit):
            with contextlib.suppress(FrankaArmException):
                self._server.stop_commands()
                call.last(_STOP_TIME)
            raise
        finally:
            if self._last is call:
                self._last = None
        self._await_state(call.request.gripper, result)
        if not result.success:
            text = f"The gripper did not succeed: {result.message or 'it gave no reason'}"
            if not ignore_errors:
                raise FrankaArmException(text)
            logger.warning("%s", text)

    def _await_state(self, command: proto.GripperCommand, result: proto.GripperResult) -> None:
        """Wait until the hand's state says what the result does: reads that follow are not to be older than the command."""
        if command.HasField("stop"):
            return
        is_grasped = command.HasField("grasp") and result.success
        deadline = time.monotonic() + _STATE_TIME
        while time.monotonic() < deadline:
            try:
                state = self._server.state()
            except FrankaArmException:
                return
            if not state.HasField("gripper") or state.gripper.is_grasped == is_grasped:
                return
            time.sleep(_TICK)
