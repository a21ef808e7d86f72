"""How a bag is read that does not say all itself: its topics, its robot, a part of its run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from parallel_robot.bags.messages import planned_motion
from parallel_robot_control.configuration import load, resolve
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config
from parallel_robot_model.messages.topics import RECORDED, REFERENCE, Topic
from parallel_robot_model.robots.registry import robot_of

BASE = 'paper_circle'  # what a bag without a configuration is taken to be of
NAMES = {topic.name.rpartition('/')[2]: topic for topic in RECORDED} | {
    topic.name: topic for topic in RECORDED
}

INSTEAD = {REFERENCE: (planned_motion.STATE,)}  # types that are taken where they are chosen


class BagView(NamedTuple):
    """How a bag is to be read.

    Attributes:
        topics: Name of a topic of the suite to that which takes its place in the bag.
        namespace: Of the robot, with its leading slash; None: the only one, or none.
        scenario: What a bag without a configuration is of; None: BASE.
        values: Keys of the configuration and their values, over those of the scenario.
        spare: The same for a bag without a configuration alone; with one, they are not used here.
        override: Whether they take the place of what a bag says itself.
        start: Time from which on states are looked at [s]; None: from the first one.
        stop: Time up to which they are looked at [s]; None: to the last one.
        whole: Whether the others are read, too.
    """

    topics: Mapping[str, str] = MappingProxyType({})
    namespace: str | None = None
    scenario: str | None = None
    values: Mapping[str, Any] = MappingProxyType({})
    spare: Mapping[str, Any] = MappingProxyType({})
    override: bool = False
    start: float | None = None
    stop: float | None = None
    whole: bool = False

    def of(self, configured: bool) -> BagView:
        """How a bag with a configuration, or without one, is read."""
        given = self.values if configured else {**self.spare, **self.values}
        return self._replace(values=given, spare={})

    @property
    def assumes(self) -> bool:
        """Whether it says what the bag is of."""
        return self.scenario is not None or any(key not in config.CUSTOM for key in self.values)

    def topic_of(self, name: str, kind: str, topics: Iterable[Topic]) -> Topic | None:
        """Which of some topics a channel may be.

        Args:
            name: Full name of the channel.
            kind: Its type; empty where it is not known.
            topics: The topics.
        """
        for topic in topics:
            chosen = self.topics.get(topic.name)
            meant = name.endswith(f'/{topic.name}') if chosen is None else name == chosen
            kinds = (topic.type, '', *(INSTEAD.get(topic, ()) if chosen is not None else ()))
            if meant and kind in kinds:
                return topic
        return None

    def assumed(self) -> dict[str, Any]:
        """The configuration of a bag that has none.

        Raises:
            UnknownNameError: no such scenario or key.
            InputError: a value or a file is wrong.
        """
        values = resolve(self.scenario or BASE, self.values)
        try:
            robot_of(values)  # its joints are as many as are named
        except InputError as error:
            if self.scenario is None and 'robot_model' not in self.values:
                raise InputError(f'{error}; --scenario chooses another robot') from None
            raise
        return values

    def changed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The configuration of a bag with what takes its place.

        Raises:
            UnknownNameError: no such scenario or key.
            InputError: a value or a file is wrong.
        """
        if self.scenario is not None:
            return self.assumed()
        asked = {**values, **self.values}
        # A key of the true robot that equals that of the robot follows it.
        followers = {
            f'true_{key}': value
            for key, value in self.values.items()
            if key.startswith('robot.') and values.get(f'true_{key}') == values.get(key)
        }
        return config.changed(values, followers | dict(self.values), load(asked))

    def told(self) -> str:
        """What it says of a bag, for people; empty where it says nothing."""
        parts = [f'scenario {self.scenario}'] if self.scenario is not None else []
        keys = {key: value for key, value in self.values.items() if key not in config.CUSTOM}
        return ', '.join([*parts, *(f'{key}={_plain(value)}' for key, value in keys.items())])


AS_RECORDED = BagView()


def view(
    topics: Mapping[str, str],
    namespace: str | None,
    joints: Iterable[str],
    scenario: str | None,
    values: Mapping[str, Any],
    override: bool,
    window: tuple[float | None, float | None] = (None, None),
) -> BagView:
    """How a bag is to be read, by options that are checked.

    Args:
        topics: Name of a topic of the suite, or the last word of it, to that of the bag.
        namespace: Of the robot.
        joints: Names of its joints in the bag, in the order of those of the robot.
        scenario: What a bag without a configuration is of.
        values: Keys of the configuration and their values.
        override: Whether scenario, joints and values take the place of what a bag says.
        window: First and last time of the part that is read [s].

    Raises:
        InputError: one of them is wrong.
    """
    named = {}
    for name, full in topics.items():
        if name.strip('/') not in NAMES:
            raise UnknownNameError('topic', name, NAMES)
        if not full.strip('/'):
            raise InputError(f'--topic {name}= needs the name of a topic')
        named[NAMES[name.strip('/')].name] = f'/{full.strip("/")}'
    given = list(joints)
    if given:
        if 'joints' in values and list(values['joints']) != given:
            raise InputError(f'--joints {",".join(given)} and joints={values["joints"]} differ')
        values = {**values, 'joints': given}
    begin, end = window
    if begin is not None and end is not None and not begin < end:
        raise InputError(f'--from {begin:g} must be before --to {end:g}')
    return BagView(named, namespace, scenario, values, override=override, start=begin, stop=end)


def _plain(value: Any) -> str:
    return ','.join(map(str, value)) if isinstance(value, list | tuple) else str(value)
