"""What a hand is asked for by every client that has one; their calls have the same names.

`read` gives the newest state of the hand.
"""

import threading

import report

WIDTH = 0.04  # m, of the block
SPEED, FORCE = 0.1, 20.0  # m/s, N
SLOW = 0.001  # m/s: also where 80 s of the arm are a few of the computer
GRASPS = [  # width and tolerances, m, and whether the block fits them
    (WIDTH + 0.02, 0.005, 0.005, False),
    (WIDTH - 0.02, 0.005, 0.005, False),
    (WIDTH + 0.02, 0.03, 0.0, True),
    (WIDTH, 0.005, 0.005, True),
]


def expect_hand(read, width, grasped):
    """Raise unless one of the next states has that width, and holds something or not."""
    for _ in range(30):
        state = read()
        if state.is_grasped == grasped and abs(state.width - width) < 0.001:
            return
    raise AssertionError(f"is_grasped is {state.is_grasped} at a width of {state.width:.4f} m, "
                         f"and should be {grasped} at {width:.4f} m")  # fmt: skip


def grasp(hand, read, raise_arm):
    """A block that does not fit what is asked for, and does; it goes where the arm goes."""
    if not hand.homing():
        raise AssertionError("homing failed")
    report.world("put_block", WIDTH)
    for width, inner, outer, fits in GRASPS:
        if hand.grasp(width, SPEED, FORCE, epsilon_inner=inner, epsilon_outer=outer) != fits:
            raise AssertionError(f"{'' if fits else 'not '}to be grasped: -{inner} +{outer} about {width} m")
        expect_hand(read, WIDTH, fits)
    height = report.world("block_height")
    raise_arm()
    report.expect("the block's rise", report.world("block_height") - height, report.DISTANCE, 0.01)
    expect_hand(read, WIDTH, True)
    if not hand.stop():
        raise AssertionError("stop failed")
    expect_hand(read, WIDTH, False)
    if not hand.move(2 * WIDTH, SPEED):
        raise AssertionError("move failed")
    expect_hand(read, 2 * WIDTH, False)


def out_of_range(hand, _read):
    """Widths and speeds that no hand has."""
    for width, speed in ((-0.01, SPEED), (1.0, SPEED), (WIDTH, -SPEED)):
        report.expect_refused("failed", lambda width=width, speed=speed: hand.move(width, speed))
    report.expect_refused("failed", lambda: hand.grasp(WIDTH, SPEED, -FORCE, epsilon_inner=0.005, epsilon_outer=0.005))
    if not hand.move(WIDTH, SPEED):
        raise AssertionError("move after one that was refused failed")


def stop(hand, read):
    """A slow move, stopped from another thread."""
    hand.move(0.0, SPEED)
    ends = []

    def move():
        try:
            ends.append("arrived" if hand.move(0.08, SLOW) else "unsuccessful")
        except Exception as error:  # noqa: BLE001 - each client has classes of its own
            ends.append(str(error))

    while read().width > 0.001:  # of before: it has waited in the socket
        pass
    mover = threading.Thread(target=move)
    mover.start()
    try:
        while read().width < 0.002 and not ends:
            pass
    finally:  # the next attempt, after a computer that stood still, finds a hand that nobody moves
        hand.stop()
        mover.join()
    if "abort" not in ends[0]:
        raise AssertionError(f"the move ended with {ends[0]} at {read().width} m")
    width = read().width
    if not width < 0.078:  # how far it came until then is the computer's
        raise AssertionError(f"the hand went on to {width} m")
    expect_hand(read, width, False)
