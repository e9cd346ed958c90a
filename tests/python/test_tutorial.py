"""The scripts of docs/tutorial.md, one after the other, on one arm; judged by the truth."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY

TUTORIAL = REPOSITORY / "docs" / "tutorial.md"
# Where the tutorial's pictures are to be written anew: `make pictures`.
PICTURES = os.environ.get("TUTORIAL_PICTURES")


def scripts() -> dict[str, str]:
    return dict(re.findall(r"^```python (\S+)\n(.*?)^```", TUTORIAL.read_text(), re.MULTILINE | re.DOTALL))


@pytest.mark.nightly
@pytest.mark.timeout(120)
def test_the_tutorial_puts_the_peg_into_its_hole(start, monkeypatch, capsys):
    arm = start(scene="peg_in_hole")
    simulation = arm.simulation
    monkeypatch.setenv("FRANKA_INTERFACE_SERVER", arm.server)
    simulation.pause(between_motions=True)  # so that each run is as the one before
    seen = {}
    for name, script in scripts().items():
        variables: dict = {}
        exec(compile(script, name, "exec"), variables)
        seen[name] = simulation.truth()
        variables["fa"].close()
        picture = name.replace(".py", ".png")
        if PICTURES and picture in TUTORIAL.read_text():
            import matplotlib.image

            Path(PICTURES).mkdir(exist_ok=True)
            matplotlib.image.imsave(Path(PICTURES) / picture, simulation.image()[0])
    said = capsys.readouterr().out

    tool = {name: truth.O_T_TCP[:3, 3] for name, truth in seen.items()}
    np.testing.assert_allclose(tool["first_motion.py"], [0.4, 0, 0.15], atol=0.005)
    assert "ForceAbove after" in said
    assert 0 < tool["contact.py"][2] < 0.015, "the fingertips reach some 10 mm below the tool's centre"
    soft, stiff = (float(force) for force in re.findall(r"N/m: (\S+) N", said))
    assert soft == pytest.approx(3, abs=1) and stiff == pytest.approx(9, abs=1.5)
    np.testing.assert_allclose(tool["streaming.py"], tool["stiffness.py"] + [0, -0.05, 0.1], atol=0.01)
    peg = {name: truth.objects["peg"][:3, 3] for name, truth in seen.items()}
    assert peg["pick_up.py"][2] > 0.12
    np.testing.assert_allclose(peg["peg_in_hole.py"], [0.5, 0.15, 0.04], atol=0.004)
    assert "OutsideBox after" in said
