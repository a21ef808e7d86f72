"""A graph that runs, as the page sees it: its nodes come and go, and nothing waits for them."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from parallel_robot.analysis.replay.replayed import Ghost
from parallel_robot.live import source
from parallel_robot.live.frames import Camera, Motion, MotionBuffer, States
from parallel_robot.live.recording import Recording
from parallel_robot.live.source import RefusedError
from parallel_robot.watch.robots import Robots
from parallel_robot_control.configuration import available, nominal_of
from parallel_robot_control.configuration import configure as configure_control
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import given_zero_angles
from parallel_robot_model.messages import topics
from parallel_robot_model.processes.child_process import command, die_with_parent
from parallel_robot_sim.imperfections import reported_age
from parallel_robot_sim.motions import differs

if TYPE_CHECKING:
    from parallel_robot.live.ros_live_graph import LiveGraph

# The configuration of a graph from what its nodes say, and values for its parameters.

SEEN = re.compile(r'robot_model|joints|(robot|controller)\.')  # on which a picture depends
SHIPPED = 'paper_circle'  # where nothing is known of the scenario


def known_values(
    parameters: Mapping[str, Mapping[str, Any]], given: Mapping[str, Any] | None
) -> dict[str, Any]:
    """The configuration of a graph, as far as it is known.

    Code and files that the nodes name are not opened: they come over the wire.

    Args:
        parameters: Parameters by node.
        given: Configuration of a graph that was started here; None for any other.

    Raises:
        InputError: its robot is not one of the suite.
    """
    heard = {
        key: value
        for node in ('trajectory', 'controller')
        for key, value in parameters.get(node, {}).items()
        if value is not None and key not in config.CUSTOM
    }
    values = dict(given or _shipped(heard))
    return values | {key: value for key, value in heard.items() if key in values}


def of_robot(values: Mapping[str, Any]) -> dict[str, Any]:
    """What a picture of the robot depends on, of a configuration."""
    return {key: value for key, value in values.items() if SEEN.match(key)}


def _shipped(heard: Mapping[str, Any]) -> dict[str, Any]:
    scenario = str(heard.get('scenario', SHIPPED))
    if '/' not in scenario:
        try:
            return config.resolve(scenario)
        except ParallelRobotError:
            pass
    robot = str(heard.get('robot_model', 'planar_3rrr'))
    return config.resolve(SHIPPED, {'robot_model': robot})


def meant(key: str, present: Any, value: Any) -> Any:
    """A value from a browser as the type that a parameter has; its node checks the rest.

    A single number stands for all joints.

    Raises:
        RefusedError: it is of another type.
    """
    if isinstance(present, list) and present and isinstance(present[0], float):
        items = value if isinstance(value, list) else [value] * len(present)
        return [_number(key, item) for item in items]
    if isinstance(present, float):
        return _number(key, value)
    if type(value) is not type(present):
        raise RefusedError(f'{key} must be like {present!r}, not {value!r:.40}')
    return value


def _number(key: str, value: Any) -> float:
    try:
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return float(value)
    except OverflowError:
        pass
    raise RefusedError(f'{key} must be a number, not {value!r:.40}')


# Which robot of a graph is watched, and what its nodes say of themselves.


class Watched:
    """The robot of a namespace, or the first that is heard."""

    def __init__(self, graph: LiveGraph, robots: Robots, namespace: str | None) -> None:
        """Watch.

        Args:
            graph: The graph; the caller enters and leaves it.
            robots: What its nodes report.
            namespace: Full name; None for the first that is heard.
        """
        self._graph, self._robots = graph, robots
        # full name of its namespace
        self._fixed, self.namespace = namespace is not None, namespace or ''
        # parameters by node, as they were when they were last looked at
        self.parameters: dict[str, dict[str, Any]] = {}
        self.started = False  # whether its trajectory node was not known before that
        graph.watch(self.namespace)

    def changed(self) -> bool:
        """See which nodes run; whether their parameters are others than before."""
        names = self._robots.names()
        if not self._fixed and names and self.namespace not in names:
            self.namespace = names[0]
            self._graph.watch(names[0])
        if names:
            self._graph.ask_parameters()
        before, self.parameters = self.parameters, dict(self._graph.parameters)
        self.started = 'trajectory' in self.parameters.keys() - before.keys()
        return self.parameters != before


EVERY = 6  # looks, from one check of what runs to the next: five a second
LONGEST = 100  # characters of a name that a browser sends


class GraphSource:
    """Shows one robot of a graph: the one of a namespace, or the first that is heard."""

    def __init__(
        self,
        graph: LiveGraph,
        robots: Robots,
        recording: Recording,
        namespace: str | None,
        values: Mapping[str, Any] | None = None,
    ) -> None:
        """Prepare.

        Args:
            graph: The graph; the caller enters and leaves it.
            robots: What its nodes report.
            recording: Records it when asked.
            namespace: Full name; None for the first that is heard.
            values: Configuration of a graph that was started here; None for any other.
        """
        self._graph, self._robots, self._recording = graph, robots, recording
        self._watched, self._given = Watched(graph, robots, namespace), values
        self._looks = self._layouts = 0
        self._texts: dict[str, Any] = {}
        self._values: dict[str, Any] | None = None
        self._seen: dict[str, Any] = {}
        self._camera: Camera | None = None
        self._ghost: Ghost | None = None
        self._trouble = ''
        self._origin = self._end = 0

    def look(self) -> list[bytes]:
        """Frames since the last call."""
        self._graph.look()
        if self._looks % EVERY == 0:
            self._check()
        self._looks += 1
        if self._camera is None or self._values is None:
            return []
        joints = tuple(self._values['joints'])
        self._buffer.add_references(*self._graph.heard(topics.REFERENCE, joints))
        states = self._buffer.add_states(*self._graph.heard(topics.JOINT_STATES, joints))
        return [] if states is None else self._frames(self._camera, states)

    def texts(self) -> dict[str, Any]:
        """Layout, state and setup."""
        return self._texts

    async def act(self, action: str, value: Any) -> str:
        """Do what a browser asks for, with a value that nobody has checked; say what was done.

        Raises:
            RefusedError: it is not done.
            KeyError: there is no such action.
        """
        do = {
            'law': self._set_law,
            'gain': self._set_gain,
            'motion': self._set_motion,
            'preset': lambda _: self._set('controller', 'preset', 'paper'),
            'emergency_stop': lambda _: self._asked(self._graph.emergency_stop),
            'clear_fault': lambda _: self._asked(self._graph.clear_fault),
            'reset': lambda _: self._asked(self._graph.reset),
            'record': self._record,
            'ghost': self._set_ghost,
        }[action]
        return await do(value)

    def _check(self) -> None:
        """See which nodes run, and what they are."""
        if self._watched.changed():
            self._prepare()
        robot = self._robots[self._watched.namespace]
        self._texts = {
            **({'layout': source.frame_layout(self._camera)} if self._camera else {}),
            'state': {
                **source.robot_state(robot, time.monotonic()),
                'ghost': self._ghost.law if self._ghost else '',
                'recording': self._recording.state(),
                'trouble': self._trouble,
            },
            'setup': {
                **source.laws_and_shapes(
                    self._watched.parameters, self._graph.descriptions, robot.laws
                ),
                'seen': 'plant' not in robot.nodes or differs(self._values or {}),
            },
        }

    def _prepare(self) -> None:
        """Make a camera for the robot that the nodes know, where it is a new one."""
        parameters = self._watched.parameters
        if 'controller' not in parameters:
            return
        try:
            self._values = known_values(parameters, self._given)
            seen = of_robot(self._values)
            if seen != self._seen or self._watched.started:  # not where a motion goes on
                self._layouts += 1
                self._seen, joints = seen, self._values['joints']
                self._zero_angle = given_zero_angles(self._values)
                self._camera = Camera(*nominal_of(self._values), joints, self._layouts)
                self._buffer = MotionBuffer(len(joints), reported_age(self._values))
            self._trouble = ''
        except ParallelRobotError as error:
            self._seen, self._camera, self._trouble = (
                {},
                None,
                f'the robot cannot be drawn: {error}',
            )

    def _frames(self, camera: Camera, states: States) -> list[bytes]:
        if states.anew:
            self._layouts += 1
            camera.number = self._layouts
            camera.begin()
            self._texts = {**self._texts, 'layout': source.frame_layout(camera)}
            self._origin, self._end = int(states.stamps[0]), int(states.stamps[0])
        none = np.full_like(states.effort, np.nan)
        ghost = none if self._ghost is None else self._haunt(self._ghost, states, none)
        motion = Motion(
            (states.stamps - self._origin) / NANOSECONDS,
            states.position - self._zero_angle,
            states.desired,
            states.effort,
            ghost,
        )
        seconds = (int(states.stamps[-1]) - self._end) / NANOSECONDS
        self._end = int(states.stamps[-1])
        return camera.frames(motion, seconds)

    def _haunt(self, ghost: Ghost, states: States, none: Any) -> Any:
        """Torques of the other law, NaN while there are no references."""
        known = np.isfinite(states.references.position).all(axis=1)
        if not known.all():
            return none
        velocity, effort = np.nan_to_num(states.velocity), np.nan_to_num(states.effort)
        return ghost.answer(states.stamps, states.position, velocity, states.references, effort)

    async def _asked(self, ask: Callable[..., None], *words: Any) -> str:
        """Ask a node and wait for its answer, which comes while the graph is looked at.

        Raises:
            RefusedError: it refuses or does not answer.
        """
        answered: asyncio.Future[tuple[bool, str]] = asyncio.get_running_loop().create_future()

        def tell(done: bool, text: str) -> None:
            if not answered.done():
                answered.set_result((done, text))

        ask(*words, tell)
        done, text = await answered
        if not done:
            raise RefusedError(text.removeprefix('refused: '))
        return text

    async def _set(self, node: str, key: str, value: Any) -> str:
        return await self._asked(self._graph.set_parameter, node, key, value)

    async def _set_law(self, value: Any) -> str:
        return await self._set('controller', 'law', _name(value, 'law'))

    async def _set_gain(self, value: Any) -> str:
        key, wanted = _pair(value, 'gain')
        controller = self._watched.parameters.get('controller', {})
        laws = self._robots[self._watched.namespace].laws
        if key not in controller or key.partition('.')[0] not in laws:
            raise RefusedError(f'there is no gain {key!r}')
        return await self._set('controller', key, meant(key, controller[key], wanted))

    async def _set_motion(self, value: Any) -> str:
        """Change the shape of the motion, or a parameter of it."""
        key, wanted = _pair(value, 'parameter')
        known = self._watched.parameters.get('trajectory', {})
        told = self._graph.descriptions.get('trajectory', {})
        if key not in source.motion_parameters(known, told):
            raise RefusedError(f'there is no parameter {key!r} of a motion')
        return await self._set('trajectory', key, meant(key, known[key], wanted))

    async def _record(self, value: Any) -> str:
        if value is True:
            known = self._watched.parameters.get('controller', {})
            return self._recording.start(known, self._watched.namespace)
        return await self._recording.stop()

    async def _set_ghost(self, value: Any) -> str:
        """Compute what another law would ask for, or no longer."""
        law = _name(value, 'law')
        if not law:
            self._ghost = None
            return 'off'
        if self._values is None:
            raise RefusedError('nothing is known of the robot yet')
        values = self._values
        if law not in available(values['custom_laws']):
            raise RefusedError(f'the law {law!r} is not known here')
        wanted = {**values, 'law': law}
        process = await asyncio.create_subprocess_exec(
            *command('parallel_robot.analysis.replay.replayed'),
            stdin=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            preexec_fn=die_with_parent,
        )
        await process.communicate(json.dumps(wanted).encode())
        configured = await asyncio.to_thread(configure_control, wanted)
        self._ghost = await asyncio.to_thread(Ghost, configured, reported_age(values))
        return law


def _pair(value: Any, what: str) -> tuple[str, Any]:
    if not isinstance(value, dict) or set(value) != {'key', 'value'}:
        raise RefusedError(f'a {what} is a key and a value')
    return _name(value['key'], what), value['value']


def _name(value: Any, what: str) -> str:
    if not isinstance(value, str) or len(value) > LONGEST:
        raise RefusedError(f'a {what} is a name')
    return value
