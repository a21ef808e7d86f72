"""The screen of the command ``top``."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, ClassVar

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen
from textual.widgets import Footer, OptionList, Static

from parallel_robot.watch.robots import (
    ERROR,
    NODES,
    OK,
    SILENT,
    WARNING,
    JointAngle,
    Report,
    Robot,
    Robots,
    Tell,
)
from parallel_robot_model.common.errors import printable
from parallel_robot_model.processes.realtime import LOCKED

if TYPE_CHECKING:
    from parallel_robot.watch.ros_graph import RosGraph

# What a terminal shows of a robot, drawn by rich; plain text where there is no colour.

UNKNOWN = '-'
SAYS = 90  # characters of a node's message, four lines of 80 columns
MOST_JOINTS = 12
LONGEST_NAME = 30  # columns
HUGE = 1e4  # rad
CALM = ('none', '')  # no fault, no limit
PRIORITY = ('real-time priority', 'real time', 'realtime', 'priority')  # keys of a node
TIMES = (('lag', 'controller'), ('round trip', 'plant'), ('delay', 'plant'))  # who reports them
BARS = ' ▁▂▃▄▅▆▇█'
EIGHTHS = len(BARS) - 1  # of a row
FLOOR, DECADES = 1e-7, 5  # m; bars of the end-effector error reach from 0.1 µm to 1 cm
SCALE = ('  1 cm ', '       ', '0.1 µm ')  # beside their rows, from the top
STYLES = {OK: 'green', WARNING: 'yellow', ERROR: 'bold red'}


def screen(robots: Robots, shown: str, domain: str, now: float, width: int) -> Group:
    """Everything about one robot.

    Args:
        robots: All robots that are known.
        shown: Namespace of the robot.
        domain: Number of the ROS domain.
        now: Time [s].
        width: Columns of the terminal.
    """
    robot, names = robots[shown], robots.names()
    count = f' ({names.index(shown) + 1} of {len(names)})' if shown in names and names[1:] else ''
    state = robot.value('plant', 'state')
    title = Table.grid(expand=True)
    title.add_column()
    title.add_column(justify='right', style='dim')
    title.add_row(
        Text.assemble((' parallel_robot top  ', 'bold'), shown or '/', count),
        Text(f'state {state}, ROS domain {domain} ' if state else f'ROS domain {domain} '),
    )
    if not robot.nodes:
        others = ', '.join(name or '/' for name in names)
        known = f'nodes run in {others}' if others else 'waiting for the nodes of a run'
        return Group(title, framed('nodes', Text(f'none is heard in {shown or "/"}: {known}')))
    middle = Table.grid(expand=True)
    middle.add_column(ratio=1)
    middle.add_column(width=36)
    middle.add_row(framed('loop', loop(robot), 7), framed('times', times(robot), 7))
    parts: list[RenderableType] = [title, framed('nodes', nodes(robot, now)), middle]
    angles = robot.joints(now)
    if angles:
        rate = ' or '.join(f'{unit}/s' for unit in robot.unit.split(' or '))
        parts.append(framed(f'joints ({robot.unit}, {rate})', joints(angles)))
    if robot.placed:
        parts.append(framed('end-effector error', error(robot, width - 4)))
    return Group(*parts)


def nodes(robot: Robot, now: float) -> Table:
    """A row for each node: rate, share of a processor, priority, message."""
    table = Table(box=None, expand=True, pad_edge=False, header_style='dim')
    table.add_column('node', width=10, no_wrap=True)
    for title, width in (('rate', 7), ('cpu', 7), ('priority', 12), ('memory', 6)):
        table.add_column(title, justify='right', width=width, no_wrap=True)
    table.add_column('says', ratio=1, overflow='fold')
    known = [name for name in NODES if name in robot.nodes]
    for name in [*known, *sorted(set(robot.nodes) - set(known))]:
        table.add_row(
            Text(name),
            Text(rounded(robot.value(name, 'rate [Hz]'), 0, 'Hz')),
            Text(rounded(robot.value(name, 'processor [%]'), 1, '%')),
            *granted(robot.value(name, *PRIORITY)),
            said(robot.nodes[name], now),
        )
    return table


def granted(text: str) -> tuple[Text, Text]:
    """What realtime.acquire returned, short enough for two columns: priority, memory."""
    *schedule, last = text.split(', ')
    locked = last == LOCKED
    words = schedule if locked else [*schedule, last]
    priority = words[-1].removeprefix('SCHED_') if words else ''
    return Text(priority or UNKNOWN), Text('locked' if locked else UNKNOWN)


def loop(robot: Robot) -> Table:
    """Law, fault, limits that acted."""
    table = Table.grid(padding=(0, 1), expand=True)
    table.add_column(style='dim', width=6, no_wrap=True)
    table.add_column(ratio=1, overflow='fold')
    fault = '' if robot.fault in CALM else STYLES[ERROR]
    limits = '' if robot.limits in CALM else STYLES[WARNING]
    table.add_row('law', Text(robot.law or UNKNOWN, 'bold'))
    table.add_row('fault', Text(robot.fault or UNKNOWN, fault))
    table.add_row('limits', Text(robot.limits or UNKNOWN, limits))
    return table


def times(robot: Robot) -> Group:
    """Lag, round trip and delay of the last second: p50, p99, max [ms]; states."""
    table = Table(box=None, expand=True, pad_edge=False, header_style='dim')
    table.add_column('ms', width=10, no_wrap=True, style='dim')
    for title in ('p50', 'p99', 'max'):
        table.add_column(title, justify='right', ratio=1, no_wrap=True)
    for name, node in TIMES:
        words = robot.value(node, f'{name} p50/p99/max [ms]').split('/')
        shown = words if len(words) == 3 else [UNKNOWN] * 3
        table.add_row(name, *(Text(number(word)) for word in shown))
    answered, skipped = (
        robot.value('controller', key) or UNKNOWN for key in ('answered', 'skipped')
    )
    states = Text.assemble(('answered ', 'dim'), answered, (', skipped ', 'dim'), skipped)
    states.no_wrap = True
    return Group(table, states)


def joints(known: list[JointAngle]) -> Columns:
    """Name, angle and rate of each joint, several in a row where there is room."""
    shown = known[:MOST_JOINTS]
    width = min(LONGEST_NAME, max(len(joint.name) for joint in shown))
    cells = [
        Text.assemble(
            f'{joint.name[:width]:<{width}}',
            (f'{fixed(joint.angle, 4):>10}', 'bold'),
            (f'{fixed(joint.rate, 3):>9}', 'dim'),
        )
        for joint in shown
    ]
    return Columns(cells, padding=(0, 3))


def error(robot: Robot, width: int) -> Text:
    """End-effector error of the last look; bars of the earlier ones on a logarithmic scale."""
    found, columns = robot.error, width - len(SCALE[0])
    text = f'{length(found.rms)} rms, {length(found.largest)} max' if found else UNKNOWN
    drawn, looks = Text(text), [*robot.history][-columns:]
    for row, label in zip(reversed(range(len(SCALE))), SCALE, strict=True):
        bars = ''.join(bar(metres, row) for metres in looks)
        drawn.append('\n').append(label, 'dim').append(bars.rjust(columns), 'cyan')
    return drawn


def said(report: Report, now: float) -> Text:
    """The message of a node, or for how long it has been silent."""
    silent = now - report.time
    if silent >= SILENT:
        return Text(f'silent for {silent:.0f} s', STYLES[ERROR])
    return Text(printable(report.text, SAYS), STYLES.get(report.level, ''))


def number(word: str) -> str:
    """A number with three significant digits; other words as they are."""
    try:
        value = float(word)
    except ValueError:
        return word
    return f'{value:#.3g}' if abs(value) < 100.0 else f'{value:.0f}'


def fixed(value: float, digits: int) -> str:
    """A number with some digits after the point, or a short one where it is huge or none."""
    return f'{value:.{digits}f}' if abs(value) < HUGE else f'{value:.3g}'


def rounded(word: str, digits: int, unit: str) -> str:
    """A number with some digits after the point and its unit; other words as they are."""
    try:
        return f'{float(word):.{digits}f} {unit}'
    except ValueError:
        return word or UNKNOWN


def length(metres: float) -> str:
    """A length in a fitting unit."""
    unit, factor = ('mm', 1e3) if metres >= 1e-3 else ('µm', 1e6)
    return f'{number(str(factor * metres))} {unit}'


def bar(metres: float, row: int) -> str:
    """The part of the bar of a length that is in a row, 0 being the lowest; blank for NaN."""
    if math.isnan(metres):
        return BARS[0]
    share = math.log10(max(metres, FLOOR) / FLOOR) / DECADES
    height = 1 + math.floor(share * (len(SCALE) * EIGHTHS - 1))
    return BARS[min(EIGHTHS, max(0, height - row * EIGHTHS))]


def framed(title: str, content: RenderableType, height: int | None = None) -> Panel:
    """A frame with a title."""
    return Panel(content, title=title, title_align='left', border_style='dim', height=height)


# The terminal application: draws a robot twice a second and turns keys into requests.

PERIOD = 0.5  # s between two pictures
ASK = 0.1  # s between two checks for an answer
LONGEST = 300  # characters of an answer


class LawChooser(ModalScreen[str]):
    """A list of laws; Enter chooses one, Escape none."""

    CSS = """
    LawChooser { align: center middle; }
    OptionList { width: 30; height: auto; max-height: 80%; border: round $primary; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape,l', 'dismiss', 'back'),
    ]

    def __init__(self, laws: list[str], active: str) -> None:
        """Show some laws, of which one is active."""
        super().__init__()
        self._laws = laws
        self._active = active

    def compose(self) -> ComposeResult:
        """Build the list."""
        yield OptionList(*self._laws, markup=False)
        yield Footer()

    def on_mount(self) -> None:
        """Highlight the active law."""
        options = self.query_one(OptionList)
        options.border_title, options.border_subtitle = 'law', 'enter, esc'
        if self._active in self._laws:
            options.highlighted = self._laws.index(self._active)

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Return the law that was chosen."""
        self.dismiss(self._laws[event.option_index])


class Top(App[None]):
    """Shows one robot at a time; keys switch its law, stop it, or show the next robot."""

    CSS = """
    #said { dock: bottom; height: auto; max-height: 3; margin-bottom: 1; padding: 0 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('l', 'choose_law', 'law'),
        Binding('e', 'emergency_stop', 'emergency stop'),
        Binding('c', 'clear_fault', 'clear fault'),
        Binding('n', 'next_robot', 'next robot'),
        Binding('q,ctrl+c', 'quit', 'quit'),
    ]
    ENABLE_COMMAND_PALETTE = False

    def __init__(
        self, robots: Robots, graph: RosGraph, domain: str, namespace: str | None
    ) -> None:
        """Prepare.

        Args:
            robots: The robots that are known; the graph adds to them.
            graph: The running graph.
            domain: Number of the ROS domain.
            namespace: Namespace of the robot; None for the first that is heard.
        """
        super().__init__()
        self._robots = robots
        self._graph = graph
        self._domain = domain
        self._chosen = namespace is not None
        self._shown = namespace or ''
        # Held, not looked up: a tick of the timer may come while the screen is taken down.
        self._picture = Static(id='picture')
        self._said = Static(id='said')
        graph.watch(self._shown)

    def compose(self) -> ComposeResult:
        """Build the screen."""
        yield self._picture
        yield self._said
        yield Footer()

    def on_mount(self) -> None:
        """Look at once, then periodically."""
        self.look()
        self.set_interval(PERIOD, self.look)
        self.set_interval(ASK, self._graph.answers)

    def look(self) -> None:
        """Take new messages and draw the screen."""
        self._graph.look()
        names = self._robots.names()
        if not self._chosen and names and self._shown not in names:
            self._show(names[0])
        picture = screen(
            self._robots, self._shown, self._domain, time.monotonic(), self.size.width
        )
        self._picture.update(picture)

    def action_choose_law(self) -> None:
        """Let the user choose one of the controller's laws."""
        robot = self._robots[self._shown]
        if not robot.laws:
            self._say('there is no controller that reports its laws', STYLES[ERROR])
            return
        self.push_screen(LawChooser(robot.laws, robot.law), self._switch_law)

    def action_emergency_stop(self) -> None:
        """Stop the robot."""
        self._graph.emergency_stop(self._teller('emergency stop'))

    def action_clear_fault(self) -> None:
        """End the safe action."""
        self._graph.clear_fault(self._teller('clear fault'))

    def action_next_robot(self) -> None:
        """Show the robot of the next namespace."""
        names = self._robots.names()
        if names:
            later = [name for name in names if name > self._shown]
            self._chosen = True
            self._show((later or names)[0])
            self.look()

    def _show(self, namespace: str) -> None:
        if namespace != self._shown:
            self._shown = namespace
            self._graph.watch(namespace)

    def _switch_law(self, law: str | None) -> None:
        if law is not None:
            self._graph.switch_law(law, self._teller(f'law {law}'))

    def _teller(self, asked: str) -> Tell:
        """Function that shows the result of a request."""

        def tell(done: bool, answer: str) -> None:
            text = f'{asked}: {answer or "done"}'
            self._say(printable(text, LONGEST), STYLES[OK if done else ERROR])

        self._say(f'{asked} ...', 'dim')
        return tell

    def _say(self, text: str, style: str) -> None:
        self._said.update(Text(text, style))
