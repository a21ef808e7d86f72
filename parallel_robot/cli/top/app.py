"""The terminal application: draws a robot twice a second and turns keys into requests."""

from __future__ import annotations

import time
from typing import ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen
from textual.widgets import Footer, OptionList, Static

from parallel_robot.cli.top import view
from parallel_robot.watch.graph import Graph, Tell
from parallel_robot.watch.robots import ERROR, OK, Robots
from parallel_robot_model.common.errors import printable

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

    def __init__(self, robots: Robots, graph: Graph, domain: str, namespace: str | None) -> None:
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
        picture = view.screen(
            self._robots, self._shown, self._domain, time.monotonic(), self.size.width
        )
        self._picture.update(picture)

    def action_choose_law(self) -> None:
        """Let the user choose one of the controller's laws."""
        robot = self._robots[self._shown]
        if not robot.laws:
            self._say('there is no controller that reports its laws', view.STYLES[ERROR])
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
            self._say(printable(text, LONGEST), view.STYLES[OK if done else ERROR])

        self._say(f'{asked} ...', 'dim')
        return tell

    def _say(self, text: str, style: str) -> None:
        self._said.update(Text(text, style))
