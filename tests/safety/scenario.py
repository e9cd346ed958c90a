"""What happens in a run of the campaign, drawn from its seed."""

import dataclasses

import numpy as np

EVENTS = 40  # of a run
ROBOTS = ("fer", "fr3")
# Kinds of event, and how often they come; each is a method of play.Player.
KINDS = {
    "skills": 60,  # some skills: waited for, taken over, stopped, changed, queued
    "push": 15,  # while our torques hold the arm
    "walls": 20,  # come and go
    "home": 5,  # without walls
    "loss": 5,  # of packets, each way
    "robot_error": 4,
    "user_stop": 2,
    "another_client": 3,  # that wants to command, and that stops
    "client_is_killed": 0.7,
    "server_is_killed": 0.7,
}


@dataclasses.dataclass(frozen=True)
class Event:
    """Something that happens; all of it is drawn from its own seed, so that it stays the same when others are left out."""

    kind: str
    seed: tuple[int, int]  # of the run, and its place in it


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A run: an arm, and what happens to it."""

    seed: int
    robot: str
    ideal: bool  # joints without friction, sensors without noise
    hold_time: float  # s, of the server
    events: tuple[Event, ...]

    def kind_at(self, place: int) -> str:
        """Of the event at a place of the whole run."""
        return next(event.kind for event in self.events if event.seed[1] == place)

    def only(self, places: list[int]) -> "Scenario":
        """The same with these events alone, by their places in the whole run."""
        return dataclasses.replace(self, events=tuple(event for event in self.events if event.seed[1] in places))


def draw(seed: int, events: int = EVENTS) -> Scenario:
    """Draw the run of a seed."""
    random = np.random.default_rng(seed)
    shares = np.array(list(KINDS.values())) / sum(KINDS.values())
    kinds = random.choice(list(KINDS), events, p=shares)
    return Scenario(
        seed=seed,
        robot=ROBOTS[seed % len(ROBOTS)],
        ideal=bool(random.random() < 0.5),
        hold_time=float(random.choice([0, 0.2])),
        events=tuple(Event(str(kind), (seed, place)) for place, kind in enumerate(kinds)),
    )


def switches(seed: int, robot: str, events: int) -> Scenario:
    """A run of switches alone, on an ideal arm."""
    return Scenario(seed, robot, ideal=True, hold_time=2.0, events=tuple(Event("switches", (seed, place)) for place in range(events)))
