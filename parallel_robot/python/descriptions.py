"""A scenario described: its keys as a table, its robot as URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.analysis.monitor import Posture, posture_of
from parallel_robot.analysis.table import fields_of
from parallel_robot.bags import output
from parallel_robot_control.configuration import load, resolve
from parallel_robot_model.common.errors import Frame, pandas
from parallel_robot_model.common.options import named, optional_path
from parallel_robot_model.common.tables import returning
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.config import Changes, Place, changes
from parallel_robot_model.configuration.config_files import scenario_of
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_sim.configuration import configure


def show(
    scenario: Place,
    *,
    param_file: Changes = None,
    **values: Any,
) -> Frame:
    """The effective configuration of a scenario, as ``parallel_robot show`` prints it.

    >>> import parallel_robot as pr
    >>> table = pr.show('paper_line', **{'s_fotsmc.G': 12})
    >>> table.loc['s_fotsmc.G', ['value', 'unit', 'source']].tolist()
    [12, 'rad/s^3', '--set']

    Args:
        scenario: Name of a scenario, or the path of a YAML file.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values; they win over `param_file`.

    Returns:
        A pandas.DataFrame, a row a key: value, unit, description and source.

    Raises:
        InputError: a name, a key, a value or a file is wrong, or pandas is not installed.
    """
    frames = pandas()
    changed = changes(param_file, values)
    name = named('scenario', scenario)
    resolved, sources = config.resolve_with_sources(name, changed, load(changed))
    configure(resolved)  # a wrong value is refused here as in a run
    fields, unknown = fields_of(resolved), Field('', '')
    rows = {
        key: (value, *fields.get(key, unknown)[:2], sources[key])
        for key, value in sorted(resolved.items())
    }
    columns = ['value', 'unit', 'description', 'source']
    return frames.DataFrame.from_dict(rows, orient='index', columns=columns)


class Urdf(NamedTuple):
    """The robot of a scenario as URDF."""

    posture: Posture
    out: Path | None  # the file that was written

    def text(self) -> str:
        """The URDF."""
        return self.posture.description

    def __str__(self) -> str:
        """What the command prints."""
        if not self.out:
            return self.text()
        unsaid = [f'unsaid  {line}\n' for line in self.posture.beside.unsaid]
        return ''.join([f'urdf    {self.out}, {len(self.posture.links)} links\n', *unsaid])


@returning(Urdf.text)
def urdf(
    scenario: Place, *, out: Place | None = None, param_file: Changes = None, **values: Any
) -> Urdf:
    """The robot of a scenario as URDF, as ``parallel_robot urdf`` prints it.

    >>> import parallel_robot as pr
    >>> pr.urdf('paper_circle').startswith('<?xml')
    True

    Args:
        scenario: Name of a scenario in ``config/scenarios``, or the path of a YAML file.
        out: File to which it is written, which must not exist; default: none.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values; they win over `param_file`.

    Raises:
        InputError: a name or value is wrong, or the robot has no description.
    """
    file = optional_path('out', out)
    if file:
        output.check_new(file, '--out')
    resolved = resolve(scenario_of(named('scenario', scenario)), changes(param_file, values))
    with with_location(resolved):
        found = Urdf(posture_of(resolved), file)
    if file:
        output.save(file, found.text().encode())
    return found
