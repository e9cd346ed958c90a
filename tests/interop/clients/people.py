"""What people do to a robot while a client speaks to it: they press the user stop, and they lead the arm by hand.

`read` gives the client's newest state of the robot.
"""

import contextlib

import report

WAY = 0.05  # m


def expect_mode(read, wanted):
    """Raise unless one of the next states shows that mode of the robot, by libfranka's name without a k."""
    for _ in range(200):
        mode = read().robot_mode.name.removeprefix("k")
        if mode == wanted:
            return
    raise AssertionError(f"the robot's mode is {mode}, and should be {wanted}")


def presser():
    """A function of the time (s) since a motion to and fro began, which has the user stop pressed on its way."""
    pressed = False

    def press_at(t):
        nonlocal pressed
        if t > report.TIME / 2 and not pressed:
            pressed = True
            report.ask("user_stop", True)
        if t > report.LONG:
            raise AssertionError("nothing stopped the arm")

    return press_at


def user_stop(read, motion, refused, go_on):
    """A motion during which it is pressed, what is refused then, and, once it is let go, what is possible again."""
    try:
        report.expect_refused("User Stop pressed", motion)
        report.answer()
        expect_mode(read, "UserStopped")
        for attempt in refused:
            report.expect_refused("User stopped", attempt)
    finally:
        report.world("user_stop", False)
    expect_mode(read, "Idle")
    go_on()


@contextlib.contextmanager
def guiding(read):
    """Somebody holds the guiding buttons."""
    try:
        report.world("user_stop", True)
        report.world("guide", True)
        expect_mode(read, "Guiding")
        yield
        report.world("guide", False)
        expect_mode(read, "UserStopped")
    finally:
        report.world("guide", False)
        report.world("user_stop", False)
    expect_mode(read, "Idle")


def lead(place, axis, free):
    """Somebody leads the tool along an axis of O that is free, or is not; place() is where the tool is, m (3,)."""
    start = place()
    report.world("lead", [WAY if i == axis else 0.0 for i in range(3)])
    moved = place()[axis] - start[axis]
    report.expect(f"the way along {'xyz'[axis]}", moved, WAY if free else 0.0, 0.02 if free else 0.005)
