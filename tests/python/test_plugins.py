"""Parts from outside the repository: begun with `frankapy new`, built against the build tree, loaded, run; and bad ones."""

import itertools
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import HOME, REPOSITORY

from frankapy import FrankaArm, FrankaArmArgumentError, FrankaArmCommException, FrankaArmException, cli, proto
from frankapy.connection import list_arms
from frankapy.new_part import package_folder
from frankapy.parts import AnyOf, CartesianImpedance, InternalImpedance, JointImpedance, Never, RelativeMinJerkJoint, StayJoint, Time
from frankapy.sim import SimulatedArm, Simulation, program, read_truth

TUTORIAL = REPOSITORY / "docs" / "your-own-part.md"
TO_BUILD = 600  # s, on a busy computer

pytestmark = pytest.mark.timeout(TO_BUILD)


def blocks() -> dict[str, str]:
    """Return the tutorial's files."""
    return dict(re.findall(r"^```\w+ (\S+)\n(.*?)^```", TUTORIAL.read_text(), re.MULTILINE | re.DOTALL))


def run(*command, **options) -> subprocess.CompletedProcess:
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, timeout=TO_BUILD, check=False, **options
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done


def new(folder: Path, role: str, name: str, **files: str) -> Path:
    """Begin a project, replace files of it, build it and run its test; return its build folder."""
    assert cli.main(["new", role, name, "--folder", str(folder)]) == 0
    for path, text in files.items():
        assert (folder / path).exists(), f"`frankapy new` wrote no {path}"
        (folder / path).write_text(text)
    return build(folder, package_folder())


def build(folder: Path, package: Path) -> Path:
    built = folder / "build"
    # What was compiled before is found again, whatever the folder's name is.
    environment = os.environ | {"CCACHE_BASEDIR": "/", "CCACHE_NOHASHDIR": "1"}
    launcher = ["-DCMAKE_CXX_COMPILER_LAUNCHER=ccache"] if shutil.which("ccache") else []
    run("cmake", "-S", folder, "-B", built, f"-Dfranka-interface_DIR={package}", *launcher)
    run("cmake", "--build", built, "--parallel", os.cpu_count(), env=environment)
    run("ctest", "--test-dir", built, "--output-on-failure")
    return built


@pytest.fixture(scope="session")
def build_folder():
    """Return a folder in the build tree, as near to the headers in every clone: only so is found what another compiled."""
    with tempfile.TemporaryDirectory(prefix="parts-", dir=REPOSITORY / "build") as folder:
        yield Path(folder)


@pytest.fixture(scope="session")
def tutorial(build_folder):
    """Return the build folders of the tutorial's parts."""
    built = {}
    for role, name in (("controller", "lqr"), ("trajectory", "spiral_search")):
        files = {path: text for path, text in blocks().items() if name in path and path != f"{name}.py"}
        assert set(files) == {f"{name}.proto", f"{name}.cpp", f"test_{name}.cpp"}
        built[name] = new(build_folder / name, role, name, **files)
    return built


BAD_PROTO = """
syntax = "proto2";
package bad_part;
import "frankapy/proto/rules.proto";
message BadPart {
  enum What {
    NOTHING = 0; ALLOCATES = 1; NOT_FINITE = 2; LATE = 3; NEVER = 4; CRASHES = 5; THROWS = 6; THROWS_AT_ONCE = 7;
    CRASHES_ASKED = 8;  // for its duration, in the loop
  }
  optional What what = 1 [default = NOTHING];
}
message BadTrajectory {
  optional BadPart.What what = 1 [default = NOTHING];
}
message BadTermination {
  optional BadPart.What what = 1 [default = NOTHING];
}
message Hint {
  optional string note = 1;
  optional sint64 count = 2;
  optional BadPart.What what = 3;
  optional uint32 unused = 4;
  repeated double q = 5 [(frankapy.proto.rule) = {size: 3}];
}
"""
BAD_CPP = """
#include <cmath>
#include <ctime>

#include "bad_part.pb.h"
#include "server/part.hpp"

namespace {

using namespace realtime;
using bad_part::BadPart;

double processor_time() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec + 1e-9 * now.tv_nsec;
}

double* volatile taken = nullptr;
volatile int* volatile nowhere = nullptr;

// Does it.
double misbehave(BadPart::What what) {
  switch (what) {
    case BadPart::ALLOCATES: taken = new double[4]; delete[] taken; break;
    case BadPart::NOT_FINITE: return std::nan("");
    case BadPart::LATE: for (const double end = processor_time() + 4e-3; processor_time() < end;) {} break;
    case BadPart::NEVER: for (;;) { (void)processor_time(); }
    case BadPart::CRASHES: *nowhere = 1; break;
    case BadPart::THROWS: throw std::runtime_error("no exceptions here");
    default: break;
  }
  return 0;
}

class Controls : public Controller {
 public:
  Controls(const BadPart& message, const Arm&) : what_(message.what()) {
    if (what_ == BadPart::THROWS_AT_ONCE) throw std::invalid_argument("what is THROWS_AT_ONCE, which nobody wants");
  }
  Channels takes() const noexcept override { return Channels::kJoint; }
  robot::Mode mode(Channels) const noexcept override { return robot::kTorque; }
  void start(const Cycle&, Reference&) noexcept override {}
  void step(const Cycle& cycle, const Reference& reference, Vector7& tau_J_d) noexcept override {
    tau_J_d = 600 * (reference.joint.q - cycle.q) - 30 * cycle.dq;
    if (cycle.time > 0.1) tau_J_d[3] += misbehave(what_);
  }

 private:
  BadPart::What what_;
};

class Leads : public TrajectoryGenerator {
 public:
  Leads(const bad_part::BadTrajectory& message, const Arm&) : what_(message.what()) {}
  Channels fills() const noexcept override { return Channels::kJoint; }
  void start(const Reference& from) noexcept override { goal_ = at_rest(from), steps_ = 0; }
  bool step(const Cycle&, double time, Reference& reference) noexcept override {
    reference = goal_;
    // The server's look at it takes less than 400 steps.
    if (++steps_ > 400) reference.joint.q[3] += misbehave(what_);
    return time >= 1;
  }
  const Reference& goal() const noexcept override { return goal_; }
  double duration() const noexcept override {
    if (what_ == BadPart::CRASHES_ASKED && steps_ > 400) *nowhere = 1;
    return 1;
  }
  double stretch() const noexcept override { return 1; }
  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return {input_}; }

 private:
  const std::shared_ptr<SensorInput> input_ =
      std::make_shared<SensorInput>("heard", std::vector<std::string>{"JointPositionSensorMessage"}, 0.1);
  BadPart::What what_;
  int steps_ = 0;
  Reference goal_;
};

class Ends : public Termination {
 public:
  Ends(const bad_part::BadTermination& message, const Arm&) : what_(message.what()) {}
  bool step(const Cycle& cycle, const Progress&) noexcept override {
    if (cycle.time > 0.1) misbehave(what_);
    SensorSample hint;
    if (!input_->newest(hint)) return false;
    const auto& of = hint.values;
    return of[0] == -41 && of[1] == BadPart::LATE && std::isnan(of[2]) && of[3] == 1 && of[4] == 2 && of[5] == 3;
  }
  std::vector<std::shared_ptr<SensorInput>> sensor_inputs() const override { return {input_}; }

 private:
  const std::shared_ptr<SensorInput> input_ = std::make_shared<SensorInput>("hints", std::vector<std::string>{"bad_part.Hint"});
  BadPart::What what_;
};

}  // namespace

FRANKA_INTERFACE_PARTS(parts) {
  parts.add<Controls, BadPart>();
  parts.add<Leads, bad_part::BadTrajectory>();
  parts.add<Ends, bad_part::BadTermination>();
}
"""
BAD_BUILD = """
cmake_minimum_required(VERSION 3.25)
project(bad_part LANGUAGES CXX)
find_package(franka-interface REQUIRED)
franka_interface_part(bad_part bad_part.cpp bad_part.proto)
"""


@pytest.fixture(scope="session")
def bad(build_folder):
    """Return the build folder of parts that break the rules when told to."""
    return new(
        build_folder / "bad_part", "controller", "bad_part",
        **{"bad_part.proto": BAD_PROTO, "bad_part.cpp": BAD_CPP, "CMakeLists.txt": BAD_BUILD},
    )  # fmt: skip


@pytest.fixture(scope="session")
def messages(bad):
    """Return the Python module of their messages."""
    sys.path.insert(0, str(bad))
    import bad_part_pb2

    return bad_part_pb2


@pytest.fixture(scope="module")
def two_arms(bad):
    arm = SimulatedArm(ideal=True, lockstep=True)
    with Simulation(arm, arm, load=[bad / "libbad_part.so"]) as simulation:
        yield simulation


@pytest.fixture(scope="module")
def prompt_arm(bad):
    """Return a simulation whose arm keeps real time."""
    with Simulation(SimulatedArm(ideal=True), load=[bad / "libbad_part.so"]) as simulation:
        yield simulation


@pytest.fixture(scope="module")
def patient_arm(bad):
    """Return a simulation whose arm waits for every command, however long a part takes."""
    with Simulation(SimulatedArm(ideal=True, lockstep=True), load=[bad / "libbad_part.so"]) as simulation:
        yield simulation


# --- what `frankapy new` writes ----------------------------------------------------------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("role", ["controller", "trajectory", "termination"])
def test_what_new_writes_is_built_tested_and_run_as_its_readme_says(role, tmp_path):
    built = new(tmp_path / "mine", role, f"my_{role}")
    library = built / f"libmy_{role}.so"
    readme = (tmp_path / "mine" / "README.md").read_text()
    assert f"libmy_{role}.so" in readme
    (script,) = re.findall(r"^```python\n(.*?)^```", readme, re.MULTILINE | re.DOTALL)
    with Simulation(SimulatedArm(lockstep=True), load=[library]) as simulation:
        run_script(script, built, simulation, tmp_path)


def run_script(script: str, built: Path, simulation: Simulation, folder: Path) -> None:
    (folder / "script.py").write_text(script)
    environment = os.environ | {"PYTHONPATH": str(built), "FRANKA_INTERFACE_SERVER": simulation.server}
    run(sys.executable, folder / "script.py", env=environment)


@pytest.mark.parametrize("name", ["Spiral", "spiral-search", "2nd", "std", "lambda", ""])
def test_a_name_that_cannot_be_one_is_refused(name, tmp_path, capsys):
    assert cli.main(["new", "controller", name, "--folder", str(tmp_path / "mine")]) == 1
    assert "expected words such as spiral_search" in capsys.readouterr().err
    assert not (tmp_path / "mine").exists()


def test_a_folder_with_something_in_it_is_left_alone(tmp_path, capsys):
    (tmp_path / "thesis.tex").touch()
    for folder, told in ((tmp_path, "is there already"), (tmp_path / "thesis.tex" / "mine", "cannot be written: Not a directory")):
        assert cli.main(["new", "controller", "mine", "--folder", str(folder)]) == 1
        assert told in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


PUBLISHES = """
#include "client/sensor_publisher.hpp"
#include "frankapy/proto/sensors.pb.h"

int main(int, char** arguments) {
  client::SensorPublisher publisher("policy", arguments[1]);
  frankapy::proto::JointPositionSensorMessage message;
  for (const double q : {0., -0.785, 0., -2.356, 0., 1.571, 0.785}) message.add_joints(q);
  for (int i = 0; i < 50; ++i) publisher.publish(message);
}
"""
PUBLISHER_BUILD = """
cmake_minimum_required(VERSION 3.25)
project(publishes LANGUAGES CXX)
find_package(franka-interface REQUIRED)
add_executable(publishes main.cpp)
target_link_libraries(publishes PRIVATE franka-interface::client)
enable_testing()
"""


@pytest.mark.nightly
def test_a_program_in_cpp_is_built_with_the_package_and_publishes(tmp_path):
    (tmp_path / "main.cpp").write_text(PUBLISHES)
    (tmp_path / "CMakeLists.txt").write_text(PUBLISHER_BUILD)
    built = build(tmp_path, package_folder())
    with Simulation(SimulatedArm(lockstep=True)) as simulation, FrankaArm(server=simulation.server) as fa:
        run(built / "publishes", simulation.server)
        deadline = time.monotonic() + 60
        while "policy" not in fa.topics() or fa.topics()["policy"].received < 50:
            assert time.monotonic() < deadline
        assert fa.topics()["policy"].lost == 0


def test_a_part_is_built_against_the_installed_package_and_runs_in_the_installed_server(build_folder, monkeypatch):
    run("cmake", "--install", REPOSITORY / "build", "--prefix", build_folder / "prefix")
    headers = build_folder / "prefix" / "include" / "franka-interface"
    for header in headers.rglob("*.hpp"):
        for included in re.findall(r'^#include "(.+)"', header.read_text(), re.MULTILINE):
            assert any((folder / included).exists() for folder in (headers, headers / "src")), f"{header} includes {included}"
    assert cli.main(["new", "termination", "mine", "--folder", str(build_folder / "mine")]) == 0
    programs = build_folder / "prefix" / "bin"
    (programs / "fci-sim").symlink_to(program("fci-sim"))
    monkeypatch.setenv("FRANKAPY_PROGRAMS", str(programs))
    package = package_folder()
    assert package.is_relative_to(build_folder / "prefix")
    built = build(build_folder / "mine", package)
    for line in (build_folder / "mine" / "build" / "CMakeCache.txt").read_text().splitlines():
        assert not line.startswith("franka-interface_DIR") or str(package) in line
    with Simulation(SimulatedArm(lockstep=True), load=[built / "libmine.so"]) as simulation:
        assert str(programs) in os.readlink(f"/proc/{simulation.processes[-1]}/exe")


# --- the tutorial ------------------------------------------------------------------------------------------------------


def test_the_tutorials_parts_are_short():
    for name in ("lqr", "spiral_search"):
        assert blocks()[f"{name}.cpp"].count("\n") <= 60


@pytest.fixture(scope="module")
def tutorial_arm(tutorial, tmp_path_factory):
    truth = tmp_path_factory.mktemp("truth") / "truth.npy"
    libraries = [built / f"lib{name}.so" for name, built in tutorial.items()]
    with Simulation(SimulatedArm(lockstep=True, ideal=True, truth=truth), load=libraries) as simulation:
        simulation.truth_file = truth
        yield simulation


@pytest.mark.parametrize("name", ["lqr", "spiral_search"])
def test_the_tutorials_scripts_run(name, tutorial, tutorial_arm, tmp_path):
    run_script(blocks()[f"{name}.py"], tutorial[name], tutorial_arm, tmp_path)


def test_lqr_leads_the_arm_and_yields_to_a_push_as_its_weights_say(tutorial, tutorial_arm):
    sys.path.insert(0, str(tutorial["lqr"]))
    from lqr_pb2 import Lqr

    errors, torques = np.full(7, 0.05), np.array([20, 20, 20, 20, 8, 8, 4])
    with FrankaArm(server=tutorial_arm.server) as fa:
        fa.goto_joints(HOME, 2)
        result = fa.run(RelativeMinJerkJoint([0.1, 0.1, -0.1, 0.1, 0.1, -0.1, 0.1], 1.5), Lqr(), Time(after_trajectory=1))
        assert result.ending == proto.TERMINATED
        np.testing.assert_allclose(tutorial_arm.truth().q, HOME + [0.1, 0.1, -0.1, 0.1, 0.1, -0.1, 0.1], atol=1e-3)

        fa.goto_joints(HOME, 2)
        # After the push has come into balance with the torques: |torque| = |error|, each in its own weights.
        tutorial_arm.push([10, 5, -10, 0, 0, 0], duration=60)
        last = fa.run(StayJoint(4), Lqr()).last_state
        tutorial_arm.push(np.zeros(6), duration=0.01)
        rows = read_truth(tutorial_arm.truth_file, until=last.robot.message_id, timeout=60)
        balanced = rows[rows["cycle"] == last.robot.message_id][0]
        tau = fa.get_jacobian(balanced["q"]).T @ balanced["push"]
        error = balanced["q"] - np.array(last.q_ref)
        assert np.linalg.norm(error) > 0.01
        np.testing.assert_allclose(np.linalg.norm(error / errors), np.linalg.norm(tau / torques), rtol=0.03)
        with pytest.raises(FrankaArmArgumentError, match=r"Lqr.q_error has 6 elements: expected 7 \(rad\)"):
            fa.run(StayJoint(1), Lqr(q_error=[0.02] * 6))
        with pytest.raises(FrankaArmArgumentError, match=r"Lqr.torque\[2\] is 1000 N m: expected 0.1 to 100"):
            fa.run(StayJoint(1), Lqr(torque=[20, 20, 1000, 20, 8, 8, 4]))


def test_spiral_search_leads_the_tool_on_a_spiral(tutorial, tutorial_arm):
    sys.path.insert(0, str(tutorial["spiral_search"]))
    from spiral_search_pb2 import SpiralSearch

    radius, turns = 0.03, 3
    with FrankaArm(server=tutorial_arm.server) as fa:
        fa.goto_joints(HOME, 2)
        began = fa.get_arm_state().robot.message_id
        result = fa.run(SpiralSearch(radius=radius, turns=turns, duration=4), InternalImpedance())
        assert result.ending == proto.TERMINATED
        assert result.limited_cycles == 0
        ended = fa.get_arm_state().robot.message_id
        rows = read_truth(tutorial_arm.truth_file, until=ended, timeout=60)
        rows = rows[(rows["cycle"] >= began) & (rows["cycle"] <= ended)]
        position = rows["O_T_TCP"].reshape(-1, 4, 4)[:, 3, :3]
        way = position - position[0]
        assert np.abs(way[:, 2]).max() < 1e-3
        r = np.hypot(way[:, 0], way[:, 1])
        assert abs(r[-1] - radius) < 5e-4
        outside = r > 0.2 * radius  # where its angle is sure
        angle = np.unwrap(np.arctan2(way[outside, 1], way[outside, 0]))
        angle += 2 * np.pi * turns - angle[-1]  # it ends after whole turns
        np.testing.assert_allclose(r[outside], radius * angle / (2 * np.pi * turns), atol=1e-3)

        with pytest.raises(FrankaArmArgumentError, match="SpiralSearch: duration is 1, and should lie within"):
            fa.run(SpiralSearch(radius=0.1, turns=20, duration=1), CartesianImpedance())


def test_parts_that_do_not_fit_are_refused_with_those_that_do(tutorial, tutorial_arm):
    sys.path[:0] = [str(built) for built in tutorial.values()]
    from lqr_pb2 import Lqr
    from spiral_search_pb2 import SpiralSearch

    with FrankaArm(server=tutorial_arm.server) as fa:
        with pytest.raises(FrankaArmArgumentError, match=r"lqr.Lqr cannot|is no trajectory that this server knows"):
            fa.run(Lqr(), JointImpedance())
        with pytest.raises(FrankaArmArgumentError, match=r"is no .*known are .*spiral_search\.SpiralSearch"):
            fa.run(JointImpedance(), Lqr())
        # The robot makes joints of a pose, which a controller of joints may follow.
        assert fa.run(SpiralSearch(duration=2), Lqr()).ending == proto.TERMINATED
        with pytest.raises(FrankaArmArgumentError, match=r"robot controller TORQUE does not fit lqr\.Lqr"):
            fa.run(SpiralSearch(), Lqr(), robot_controller="torque")


def test_what_the_server_has_loaded_is_listed_and_marked(tutorial_arm, capsys):
    with FrankaArm(server=tutorial_arm.server) as fa:
        kinds = {kind.name: kind for kind in fa.kinds()}
        assert kinds["lqr.Lqr"].loaded
        assert kinds["lqr.Lqr"].role == "controller"
        assert kinds["lqr.Lqr"].fields["q_error"].startswith("7 numbers, rad")
        assert kinds["spiral_search.SpiralSearch"].fields["duration"].startswith("s, ")
        assert {kind.name for kind in fa.kinds("trajectory") if kind.loaded} == {"spiral_search.SpiralSearch"}
        motions = ["torque_and_cartesian_pose", "torque_and_cartesian_velocity"]
        assert kinds["spiral_search.SpiralSearch"].fits["lqr.Lqr"] == motions == kinds["lqr.Lqr"].fits["MinJerkPose"]
        assert kinds["MinJerkJoint"].fits["lqr.Lqr"] == kinds["MinJerkJoint"].fits["JointImpedance"]
        assert "InternalImpedance" in kinds["spiral_search.SpiralSearch"].fits
        assert {kind.name for kind in FrankaArm(offline=True).kinds()} == {name for name, kind in kinds.items() if not kind.loaded}
    assert cli.main(["kinds", "controller", "--server", tutorial_arm.server]) == 0
    listed = capsys.readouterr().out
    assert "lqr.Lqr (loaded by the server)\n" in listed
    assert "Spiral" not in listed


# --- libraries that are refused ----------------------------------------------------------------------------------------


def refused(*libraries: Path, expected_lines: int = 1) -> str:
    """Start a server with these; return what it says when it does not start."""
    command = [program("franka-interface"), "--robot", "127.0.0.1", "--port", "0"]
    for library in libraries:
        command += ["--load", str(library)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1
    assert not done.stdout
    assert done.stderr.count("\n") == expected_lines
    return done.stderr


def compile_library(folder: Path, text: str) -> Path:
    (folder / "library.cpp").write_text(text)
    run("c++", "-shared", "-fPIC", "-o", folder / "library.so", folder / "library.cpp")
    return folder / "library.so"


def test_a_file_that_is_not_there_or_no_library_is_refused(tmp_path):
    assert "there is no such file" in refused(tmp_path / "nothing.so")
    (tmp_path / "text.so").write_text("This is text.")
    assert "text.so: cannot be loaded: " in refused(tmp_path / "text.so")


def test_a_library_without_parts_is_refused(tmp_path):
    assert "is no library of parts: it does not export franka_interface_abi" in refused(compile_library(tmp_path, ""))


def test_a_library_that_was_built_for_another_server_is_refused(tmp_path):
    library = compile_library(
        tmp_path,
        'extern "C" const char* franka_interface_abi() { return "franka-interface 0.0.1, headers 0"; }\n'
        'extern "C" void franka_interface_parts(void*) { __builtin_trap(); }\n',
    )
    text = refused(library)
    assert "was built for another server: build it anew (it has: franka-interface 0.0.1, headers 0; expected: " in text
    assert "compiler" in text


def test_a_library_that_crashes_when_it_is_loaded_is_refused(tmp_path):
    library = compile_library(tmp_path, "__attribute__((constructor)) void begin() { __builtin_trap(); }\n")
    assert f"{library}: ends the process that loads it (signal 4, Illegal instruction)" in refused(library)


@pytest.mark.nightly
def test_a_library_that_does_not_come_to_an_end_of_being_loaded_is_refused(tmp_path):
    library = compile_library(tmp_path, "__attribute__((constructor)) void begin() { for (volatile int i = 0;; i = i + 1) {} }\n")
    assert f"{library}: has not come to an end of being loaded after 20 s" in refused(library)


def test_a_kind_that_is_there_already_is_refused(bad, tmp_path):
    library = bad / "libbad_part.so"
    assert f"{library}: the kind bad_part.BadTrajectory is there already" in refused(library, library)
    # Another library with the same message, as protobuf sees it.
    copy = shutil.copy(library, tmp_path / "libcopy.so")
    text = refused(library, Path(copy))
    assert f"{copy}: ends the process that loads it" in text
    assert "already exists" in text


def test_the_configuration_file_names_libraries_relative_to_itself(tmp_path):
    (tmp_path / "arms.toml").write_text('load = ["parts/none.so"]\n[[arm]]\nname = "arm"\naddress = "127.0.0.1"\n')
    done = subprocess.run(
        [program("franka-interface"), "--config", str(tmp_path / "arms.toml")],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"{tmp_path}/parts/none.so: there is no such file" in done.stderr


# --- parts that break the rules of the loop ----------------------------------------------------------------------------


def skill_with(messages, role: str, what: str) -> tuple:
    """Return the parts of a skill of which that one does that."""
    bad = getattr(messages, {"controller": "BadPart", "trajectory": "BadTrajectory", "termination": "BadTermination"}[role])(
        what=messages.BadPart.What.Value(what)
    )
    if role == "controller":
        return StayJoint(2), bad
    if role == "trajectory":
        return bad, JointImpedance()
    return StayJoint(2), JointImpedance(), bad


NAMES = {"controller": "bad_part.BadPart", "trajectory": "bad_part.BadTrajectory", "termination": "bad_part.BadTermination"}
WHY = {
    "ALLOCATES": "took memory from the heap in the 1 kHz loop",
    "NOT_FINITE": "gave a value that is not finite",
    "LATE": r"takes too long for the 1 kHz loop: the last step took \d+\.\d\d ms, and should take 0.3 ms at most",
}


@pytest.mark.parametrize("role", ["controller", "trajectory", "termination"])
@pytest.mark.parametrize("what", WHY)
def test_a_part_that_does_not_belong_into_the_loop_is_taken_out_and_named(role, what, messages, patient_arm):
    if (role, what) == ("termination", "NOT_FINITE"):
        pytest.skip("a termination gives no numbers")
    with FrankaArm(server=patient_arm.server) as fa:
        fa.wait_for_franka_interface()
        with pytest.raises(FrankaArmException, match=f"COMPONENT_FAULT: the {role} {NAMES[role]} {WHY[what]}"):
            fa.run(*skill_with(messages, role, what))
        # The arm goes on.
        assert fa.run(StayJoint(0.1), JointImpedance()).ending == proto.TERMINATED
        assert [arm.starts for arm in list_arms(patient_arm.server)] == [1]


@pytest.mark.wall
def test_where_a_slow_part_makes_the_robot_stop_it_is_named(messages, prompt_arm):
    """Whichever comes first, the robot's patience or the loop's."""
    name = NAMES["controller"]
    seen = f"controller {name} {WHY['LATE']}|communication_constraints_violation.* step of the controller {name} took"
    with FrankaArm(server=prompt_arm.server) as fa:
        fa.wait_for_franka_interface()
        with pytest.raises(FrankaArmException, match=seen):
            fa.run(*skill_with(messages, "controller", "LATE"))


def test_a_part_that_keeps_to_the_rules_is_left_alone(messages, two_arms):
    with FrankaArm(server=two_arms.server) as fa:
        fa.wait_for_franka_interface()
        end = messages.BadTermination()
        result = fa.run(messages.BadTrajectory(), messages.BadPart(), [end, Time(0.5)])
        assert (result.ending, result.termination) == (proto.TERMINATED, "Time")


def test_what_is_older_than_the_timeout_of_a_part_that_listens_is_stale(messages, two_arms):
    message = proto.SensorMessage(topic="heard", publisher=1, sent_ns=time.time_ns())
    message.message.Pack(proto.JointPositionSensorMessage(joints=HOME))
    with FrankaArm(server=two_arms.server) as fa, fa.publisher("heard") as publisher:
        fa.wait_for_franka_interface()
        fa.run(messages.BadTrajectory(), messages.BadPart(), Never(), block=False)
        for message.sequence in (1, 2):
            publisher._socket.send(message.SerializeToString())
            until = time.monotonic() + 60
            while "heard" not in fa.topics() or fa.topics()["heard"].received < message.sequence:
                assert time.monotonic() < until
                time.sleep(0.005)
            time.sleep(0.2)  # longer than its 0.1 s, and less than what is stale for all
        heard = fa.topics()["heard"]
        assert (heard.late, heard.stale, heard.overrun) == (0, 1, 0)
        fa.stop_skill()


def test_a_constructor_that_throws_is_a_refusal(messages, two_arms):
    with FrankaArm(server=two_arms.server) as fa:
        fa.wait_for_franka_interface()
        with pytest.raises(FrankaArmArgumentError, match="bad_part.BadPart: what is THROWS_AT_ONCE, which nobody wants"):
            fa.run(*skill_with(messages, "controller", "THROWS_AT_ONCE"))


def test_a_termination_of_ones_own_may_be_one_of_any(messages, two_arms):
    with FrankaArm(server=two_arms.server) as fa:
        fa.wait_for_franka_interface()
        assert fa.run(StayJoint(1), JointImpedance(), AnyOf(messages.BadTermination(), Time(0.2))).termination == "Time"


def test_a_part_of_ones_own_gets_messages_of_ones_own(messages, two_arms):
    with FrankaArm(server=two_arms.server) as fa, fa.publisher("hints") as publisher:
        fa.wait_for_franka_interface()
        fa.run(StayJoint(1), JointImpedance(), messages.BadTermination(), block=False)
        fa.wait_for(lambda state: state.phase == proto.RUNNING, 60)
        publisher.publish(messages.Hint(note="nothing to see", count=-41, what="LATE", q=[1, 2, 4]))
        publisher.publish(messages.Hint(note="here", count=-41, what="LATE", q=[1, 2, 3]))
        fa.wait_for_skill()
        assert fa.last_skill_result.termination == "bad_part.BadTermination"
        with pytest.raises(FrankaArmArgumentError, match="q has 2 elements: expected 3"):
            publisher.publish(messages.Hint(q=[1, 2]))


ENDS = {
    "CRASHES": r"was killed by signal 11 \(Segmentation fault\)",
    "THROWS": r"was killed by signal 6 \(Aborted\)",
    "NEVER": "hung and gave up",
}


@pytest.mark.parametrize(
    ("role", "what"),
    [*itertools.product(["controller", "trajectory", "termination"], list(ENDS)), ("trajectory", "CRASHES_ASKED")],
)
def test_a_part_that_ends_its_process_is_named_and_costs_one_arm(role, what, messages, two_arms):
    with FrankaArm(server=two_arms.server) as fa, FrankaArm(server=two_arms.server, robot_num=2) as other:
        fa.wait_for_franka_interface()
        other.wait_for_franka_interface()
        before = list_arms(two_arms.server)
        other.run(RelativeMinJerkJoint([0, 0.01, 0, 0, 0, 0, 0], 1000), JointImpedance(), Never(), block=False)
        seen = f"{ENDS[what.removesuffix('_ASKED')]} in the {role} {NAMES[role]}"
        with pytest.raises(FrankaArmCommException, match=seen):
            fa.run(*skill_with(messages, role, what))
        ended = time.monotonic()
        while not (after := list_arms(two_arms.server))[0].endpoint:
            assert time.monotonic() - ended < 60, after[0].status
            time.sleep(0.01)

        # It is recovered, and goes on; the other arm has not noticed.
        fa.wait_for_franka_interface(60)
        assert fa.run(StayJoint(0.1), JointImpedance()).ending == proto.TERMINATED
        assert after[0].starts == before[0].starts + 1
        assert re.fullmatch(seen, after[0].ended)
        assert after[1].starts == before[1].starts
        other.stop_skill()
        assert other.last_skill_result.ending == proto.STOPPED


@pytest.mark.wall
def test_an_arm_whose_part_crashes_is_ready_again_within_two_seconds(messages, prompt_arm):
    with FrankaArm(server=prompt_arm.server) as fa:
        fa.wait_for_franka_interface()
        with pytest.raises(FrankaArmCommException, match=ENDS["CRASHES"]):
            fa.run(*skill_with(messages, "controller", "CRASHES"))
        ended = time.monotonic()
        fa.wait_for_franka_interface()
        assert fa.run(StayJoint(0.1), JointImpedance()).ending == proto.TERMINATED
        assert time.monotonic() - ended < 2
