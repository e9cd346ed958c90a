"""People and things around a simulated arm, for a client that asks for them while it runs."""

import json
import time

import numpy as np
from frankapy.exceptions import FrankaArmException
from frankapy.sim import ControlChannel

BLOCK = "block"
PEDESTAL = 0.1  # m, its height
LEADING, LETTING_GO, STILL = 0.4, 0.8, 1.1  # s from now: the hand is there, lets go, and the arm is at rest
PATIENCE = 60  # s


class World:
    """What report.world() of clients/ may ask for, by the names of these methods."""

    def __init__(self, address: str) -> None:
        """Over the control channel of the arm at an address."""
        self._arm = ControlChannel(address)
        self._pedestals = 0

    def do(self, call: str, arguments: str) -> str:
        """Do what a line asks for, with arguments in JSON; the line that answers."""
        try:
            return json.dumps({"value": getattr(self, call)(*json.loads(arguments))})
        except (FrankaArmException, TimeoutError) as error:
            return json.dumps({"error": str(error)})

    def user_stop(self, pressed: bool) -> None:
        """Press or release it."""
        self._arm.user_stop(pressed)

    def guide(self, pressed: bool) -> None:
        """Press or release the guiding buttons."""
        self._arm.guide(pressed)

    def push(self, force: list[float]) -> None:
        """Push the tool with a force, N, until the next push."""
        self._arm.push([*force, 0, 0, 0], duration=PATIENCE)

    def lead(self, way: list[float]) -> None:
        """Lead the tool by the hand along a way, m, and let go; when the arm is at rest this is done."""
        now = self._arm.truth()
        self._arm.hand(now.O_T_TCP[:3, 3] + way, LEADING, duration=LETTING_GO)
        deadline = time.monotonic() + PATIENCE
        while self._arm.truth().time < now.time + STILL:
            if time.monotonic() > deadline:
                raise TimeoutError(f"the world has not gone on by {STILL} s within {PATIENCE} s")
            time.sleep(0.01)

    def put_block(self, width: float) -> None:
        """Put a cube between the fingers, on a pedestal; the block that is there already is put back."""
        arm = self._arm.truth()
        under = np.eye(4)
        under[2, 3] = width / 2 + PEDESTAL / 2  # the tool's z points down
        self._pedestals += 1
        self._arm.add_object(f"pedestal{self._pedestals}", "box", [width, width, PEDESTAL], 0.0, arm.O_T_TCP @ under)
        if BLOCK in arm.objects:
            self._arm.move_object(BLOCK, arm.O_T_TCP)
        else:
            self._arm.add_object(BLOCK, "box", [width] * 3, 0.1, arm.O_T_TCP)

    def block_height(self) -> float:
        """m over the base."""
        return float(self._arm.truth().objects[BLOCK][2, 3])
