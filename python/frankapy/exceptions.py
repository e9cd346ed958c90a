"""Everything that frankapy raises on purpose, under one root."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from frankapy import proto


class FrankaArmException(Exception):
    """The arm or its server could not do what was asked; root of all exceptions of frankapy.

    `message` says what happened and what to do. Of a skill that failed `result` says the same and more: which errors, where, what
    became of the arm, and the file with the seconds before. `recovery` is what came of an arm that was to recover.
    """

    def __init__(
        self, message: str = "", result: proto.SkillResult | None = None, recovery: proto.Recovery | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.result = result
        self.recovery = recovery if result is None or recovery is not None else result.recovery


class FrankaArmCommException(FrankaArmException):
    """No server there, or it no longer answers, or it speaks another version."""


class FrankaArmFrankaInterfaceNotReadyException(FrankaArmException):
    """The arm cannot move now: an error, the user stop, no connection to the robot."""


class FrankaArmBusyException(FrankaArmException):
    """Another client commands the arm."""


class FrankaArmNotPermittedException(FrankaArmException):
    """The role of this client's key does not allow it; see docs/keys.md."""


class FrankaArmArgumentError(FrankaArmException, ValueError, AssertionError):
    """What was asked cannot be: sizes, values, frames, unreachable goals. Nothing has moved.

    A ValueError, and for scripts that expect it an AssertionError, which the published client raised for sizes.
    """
