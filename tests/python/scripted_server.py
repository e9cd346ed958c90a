"""A server that says what a test tells it to: for what a sound server never does."""

import threading
import time

import zmq

from frankapy import proto

HOME = [0, -0.785398, 0, -2.356194, 0, 1.570796, 0.785398]


class ScriptedServer:
    """Supervisor and arm in one socket; skills last `skill_time` s, or until StopSkill; gripper commands likewise."""

    def __init__(self, skill_time: float = 0.05, port: int = 0):
        self.skill_time = skill_time
        self.gripper_time = 0.0
        self.withholds: set[str] = set()  # answers that wait until this is emptied
        self.version = proto.CURRENT
        self.result = {"ending": proto.TERMINATED}
        self.state_endpoint = ""
        self.sensor_endpoint = ""
        self.silent = False
        self.not_taken = proto.NotTaken()
        self.topics: list[proto.Topics.Topic] = []
        self.forgets_clients = False
        self.recovers = True  # and says so
        self.refusals: list[proto.Error] = []  # one for each of the next StartSkill
        self.phase = proto.READY
        self.tool = (0.0, 0.0, 0.1034)  # on the flange, m
        self.requests: list[tuple[float, proto.Request]] = []
        self._context = zmq.Context()
        self._router = self._context.socket(zmq.ROUTER)
        self._router.linger = 0
        self._router.bind(f"tcp://127.0.0.1:{port or '*'}")
        self.address = self._router.last_endpoint.decode().removeprefix("tcp://")
        self._clients: set[bytes] = set()
        self._running: list[tuple[float, bytes, int, int]] = []
        self._gripping: list[tuple[float, bytes, int]] = []
        self._withheld: list[list[bytes]] = []
        self._results: dict[int, proto.SkillResult] = {}
        self._skills = 0
        self._quit = False
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._quit = True
        self._thread.join()
        self._context.destroy(linger=0)

    def calls(self, kind: str) -> list[proto.Request]:
        return [request for _, request in self.requests if request.WhichOneof("call") == kind]

    def _serve(self):
        while not self._quit:
            if self._router.poll(5):
                identity, frame = self._router.recv_multipart()
                request = proto.Request.FromString(frame)
                self.requests.append((time.monotonic(), request))
                if not self.silent:
                    self._answer(identity, request)
            for skill in [s for s in self._running if s[0] <= time.monotonic()]:
                self._running.remove(skill)
                result = self._results[skill[3]] = proto.SkillResult(skill_id=skill[3], **self.result)
                self._send(skill[1], skill[2], skill_result=result)
            for command in [c for c in self._gripping if c[0] <= time.monotonic()]:
                self._gripping.remove(command)
                self._send(*command[1:], gripper_result=proto.GripperResult(success=True))
            while self._withheld and not self.withholds:
                self._router.send_multipart(self._withheld.pop(0))

    def _answer(self, identity: bytes, request: proto.Request):
        kind, number = request.WhichOneof("call"), request.request_id
        if kind == "list_arms":
            arm = proto.Arms.Arm(name="arm1", address="127.0.0.2", endpoint=f"tcp://{self.address}", status="ready")
            arm.sensor_endpoint = self.sensor_endpoint
            self._send(identity, number, arms=proto.Arms(arms=[arm], version=self.version))
            return
        if kind == "hello":
            self._clients.add(identity)
            welcome = proto.Welcome(version=proto.CURRENT, arm="arm1", gripper=True, sensor_endpoint=self.sensor_endpoint)
            welcome.state_endpoint = self.state_endpoint
            self._send(identity, number, welcome=welcome)
            return
        if self.forgets_clients:
            self.forgets_clients = False
            self._clients.clear()
        if identity not in self._clients:
            error = proto.Error(code=proto.Error.UNKNOWN_CLIENT, message="say Hello first")
            self._send(identity, number, error=error)
        elif kind == "get_state":
            place = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
            robot = proto.RobotState(q=HOME, O_T_EE=[*place, 0.3, 0, 0.5, 1], F_T_EE=[*place, *self.tool, 1])
            self._send(identity, number, state=proto.ArmState(phase=self.phase, robot=robot, not_taken=self.not_taken))
        elif kind == "get_server_status":
            self._send(identity, number, server_status=proto.ServerStatus(commander="somebody"))
        elif kind == "list_topics":
            self._send(identity, number, topics=proto.Topics(topics=self.topics))
        elif kind == "start_skill" and self.refusals:
            self._send(identity, number, error=self.refusals.pop(0))
        elif kind == "start_skill" and any(s[1] == identity for s in self._running) and not request.start_skill.preempt:
            error = proto.Error(code=proto.Error.BUSY, message="a skill of this client still runs: wait for it, or preempt it")
            self._send(identity, number, error=error)
        elif kind == "start_skill":
            self._skills += 1
            self._running.append((time.monotonic() + self.skill_time, identity, number, self._skills))
            self._send(identity, number, skill_started=proto.SkillStarted(skill_id=self._skills))
        elif kind == "recover" and not self.recovers:
            pass
        elif kind == "recover":
            self.phase = proto.READY
            self._send(identity, number, recovery=proto.Recovery(recovered=True))
        elif kind == "stop_skill":
            self._running = [(0.0, *rest) for _, *rest in self._running]
            self._send(identity, number, done=proto.Done())
        elif kind == "skill_status":
            skill = request.skill_status.skill_id
            answer = {"skill_result": self._results[skill]} if skill in self._results else {"done": proto.Done()}
            self._send(identity, number, **answer)
        elif kind == "gripper":
            stop = request.gripper.HasField("stop")
            if stop:
                self._gripping = [(0.0, *rest) for _, *rest in self._gripping]
            self._gripping.append((0.0 if stop else time.monotonic() + self.gripper_time, identity, number))
            self._send(identity, number, gripper_started=proto.GripperStarted())
        else:
            self._send(identity, number, done=proto.Done())

    def _send(self, identity: bytes, number: int, **answer):
        reply = proto.Reply(request_id=number, **answer)
        frames = [identity, reply.SerializeToString()]
        if self.withholds & set(answer):
            self._withheld.append(frames)
        else:
            self._router.send_multipart(frames)
