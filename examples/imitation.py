"""Lead the arm by hand; it does it again, and then twice as fast. Start an arm first, a real one, or `frankapy sim`.

Of a simulated arm the hand is `frankapy.sim.ControlChannel(ADDRESS).hand(positions, times)`, from another terminal, as in
docs/imitation.md. The
picture needs matplotlib.
"""

from frankapy import FrankaArm, dmp

fa = FrankaArm()
fa.reset_joints(duration=2)

print("Lead the arm for 8 s.")
motion = fa.demonstrate(8).trimmed().smooth()
primitive = dmp.fit(motion, "joint")
print(primitive)
primitive.plot(motion, limits=fa.limits).savefig("imitation.png")  # what it will do, over what was shown
for line in primitive.beyond(fa):
    print("the arm will be slower:", line)

for duration in (motion.duration, motion.duration / 2):
    (result,) = fa.imitate(primitive, duration=duration)
    print(f"asked for {duration:.1f} s, took {result.time:.1f} s")
