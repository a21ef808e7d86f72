"""Every declared option of every command is used or refused: a wrong value of it is never taken.

Each command is tried in each of its modes, as far as options differ between them. Work itself is
replaced, so that an option whose value nobody reads comes to light at once.
"""

import pytest

from parallel_robot.cli.command_line import COMMANDS, main, module_of
from parallel_robot.cli.commands import simulate
from parallel_robot_model.common.options import Parser

WRONG = {  # a value that is refused wherever it is looked at, by what argparse calls the option
    'param_file': '{tmp}/none.yaml',
    'assignments': 'no_such_key=1',
    'law': 'no_such_law',
    'laws': 'no_such_law',
    'study': 'no_such_study',
    'scenario': 'no_such_scenario',
    'machine': 'no_such_machine',
    'ros2_control': '{tmp}/file',
    'topic': 'no_such=/topic',
    'joints': 'a',
    'run': 'no_such_scenario',
    'design': 'no_such_scenario',
    'bag': '{tmp}/none',
    'validate': '{tmp}/none',
    'poses': '{tmp}/none',
    'pose_topic': 'none',
    'out': '{tmp}/file/out.mp4',
    'json': '{tmp}/file/out.json',
    'figure': '{tmp}/figure.none',
    'plot': '{tmp}/plot.none',
    'workspace': '{tmp}/workspace.none',
    'foxglove': '{tmp}/file/out',
    'row': '1000000000',
    'duration': 'nan',
    'hold': 'nan',
    'start': 'nan',
    'stop': 'nan',
    'fit_speed': '-1',
    'namespace': '1 2',
    'host': 'no such host',
    'port': '-1',
    'cutoff': 'nan',
    'hold_out': '1.5',
    'torque_constant': 'nan',
    'trials': '0',
    'seed': '-1',
    'study_seed': '-1',
    'runs': '0',
    'workers': '0',
    'scheduler': 'no scheduler',
    'patience': '0',
    'improvement': '-1',
    'weights': 'none',
    'bounds': 'none',
    'search': 'none.none',
    'pick': '-1',
    'chattering': '-1',
    'effort': 'none',
    'robots': '0',
    'rate': '0',
    'state': 'none',
    'speed': '0',
    'magnify': '0',
    'phrase': ' ',
    'rest': '-1',
    'protocol': 'no_such_protocol',
    'check': '{tmp}/none',
}
OUT = ('--out', '{tmp}/out')
MODES = {  # words of each command, by what changes which options have a meaning
    'run': [('paper_circle', *OUT)],
    'simulate': [('paper_circle', *OUT), ('uncertain_robot', '--row', '0', *OUT)],
    'live': [(), ('--run', 'paper_circle'), ('--bag', '{bag}')],
    'top': [()],
    'param': [],
    'call': [],
    'analyze': [('{bag}',)],
    'replay': [('{bag}',), ('{bag}', '--law', 'pid')],
    'rerun': [('{bag}', *OUT)],
    'report': [('{bag}', *OUT)],
    'export': [('{bag}', '--out', '{tmp}/out.csv')],
    'video': [('{bag}', '--out', '{tmp}/out.gif')],
    'recover': [('{bag}', *OUT)],
    'show': [('paper_circle',)],
    'robot': [('five_bar',)],
    'fmu': [
        ('law', 'pid', '--out', '{tmp}/out.fmu'),
        ('plant', 'paper_circle', '--out', '{tmp}/out.fmu'),
        ('loop', 'paper_circle', '--out', '{tmp}/out.fmu'),
        ('law', 'pid', '--ros2-control', '{tmp}/law'),
        ('plant', 'paper_circle', '--ros2-control', '{tmp}/plant'),
    ],
    'urdf': [('paper_circle',)],
    'sweep': [('uncertain_robot', *OUT)],
    'benchmark': [('pid', *OUT)],
    'tune': [
        ('pid', 'paper_circle', *OUT),
        ('pid', 'paper_circle', '--study', 'uncertain_robot', *OUT),
    ],
    'fronts': [('{tmp}', '--out', '{tmp}/out.svg')],
    'identify': [
        ('{bag}',),
        ('{bag}', '--rest'),
        ('--design', 'paper_circle', '--out', '{tmp}/out'),
    ],
    'calibrate': [('{bag}',), ('--scenario', 'paper_circle', '--design', '8')],
    'rehearse': [OUT],
    'limit': [('paper_circle',), ('uncertain_robot',)],
    'verify': [(), ('--set', 'robot_model=axes')],
    'compare': [('paper_circle',)],
}  # fmt: skip
WORK = (  # what a command does when it has read all options
    'parallel_robot.cli.commands.simulate.parts',
    'parallel_robot.cli.commands.run._supervise',
    'parallel_robot.studies.sweep.sweep.completed',
    'parallel_robot.studies.tuning.tuned.run',
    'parallel_robot.studies.least_errors.least_error',
    'parallel_robot.cli.commands.compare.simulation.attempt',
    'parallel_robot.studies.verification.verify_kind',
    'parallel_robot.cli.commands.fmu.unit',
    'parallel_robot.cli.commands.fmu.ros2_package',
    'parallel_robot.studies.identification.design.Excitation',
    'parallel_robot.studies.calibration.design.nominal_of',
    'parallel_robot.live.command.NodeProcesses',
    'os.nice',  # the page begins to serve
)


class WorkedError(Exception):
    """A command began to work."""


def declared(command):
    parser = Parser()
    module_of(command).add_arguments(parser)
    return [
        action
        for action in parser._actions
        if action.option_strings and action.nargs != 0 and not action.choices
    ]


def cases():
    for command in sorted(set(COMMANDS) - {'node'}):  # a node has the options of ROS
        for mode in MODES[command]:
            for action in declared(command):
                if action.option_strings[-1] not in mode:
                    name = f'{command} {" ".join(mode)} {action.option_strings[-1]}'
                    yield pytest.param(command, mode, action, id=name)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp('options') / 'bag'
    words = ['simulate', 'paper_circle', '--duration', '0.2', '--out', str(directory)]
    assert main(words) == 0
    return directory


@pytest.fixture
def idle(monkeypatch):
    def work(*_, **__):
        raise WorkedError

    for name in WORK:
        monkeypatch.setattr(name, work)


@pytest.mark.parametrize(('command', 'mode', 'action'), [*cases()])
def test_a_wrong_value_of_an_option_is_never_taken(
    command, mode, action, bag, idle, tmp_path, capsys
):
    (tmp_path / 'file').write_text('')
    words = [*mode, action.option_strings[-1], WRONG[action.dest]]
    given = [word.format(bag=bag, tmp=tmp_path) for word in words]
    assert main([command, *given]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1 and err.startswith(f'parallel_robot {command}: ')
    assert [path.name for path in tmp_path.iterdir()] == ['file']


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ('identify {bag} --seed 0', '--seed goes with --design alone'),
        ('identify {bag} --param-file {file}', '--override permits that'),
        ('identify {bag} --rest --cutoff 5', '--rest identifies no robot: no --cutoff'),
        ('identify --design paper_circle --rest --out x', '--design reads no bag: no --rest'),
        ('calibrate {bag} --seed 0', '--seed goes with --design alone'),
        ('calibrate {bag} --param-file {file}', '--override permits that'),
        ('calibrate {bag} --design 8', '--design reads no bag'),
        ('calibrate {bag} --poses x --pose-topic y', '--poses and --pose-topic exclude'),
        ('calibrate --scenario paper_circle', 'either a bag or --scenario SCENARIO --design N'),
        ('calibrate --scenario paper_circle --design 8 --poses x', 'reads no bag: no --poses'),
        ('calibrate --scenario paper_circle --design 8 --trust', 'reads no bag: no --trust'),
        ('simulate robustness --row 0 --fit-speed 1 --out x', '--fit-speed and --row exclude'),
        ('run robustness --row 0 --out x', "unknown option '--row'"),
        ('simulate paper_circle --law pid --set law=smc --out x', '--law pid and --set law=smc'),
        ('simulate paper_circle --duration 1 --set duration=2 --out x', 'duration=2 differ'),
        ('compare paper_circle --set law=pid', '--set law: compare has all laws'),
        ('verify --robots 2 --set robot_model=axes', 'axes is not described by a file'),
        ('verify --duration 1 --set robot_model=axes', 'without MuJoCo: no --duration'),
        ('rehearse --set duration=3 --out x', '--set duration: each step has its own'),
        ('analyze {bag} --set pid.Kp=1', 'pid.Kp=1 would change; --override permits that'),
        ('report {bag} --set custom_robots=7 --out x', 'must be a list of texts, not 7'),
        ('export {bag} --set custom_robots=[none.py] --out x.csv', 'none.py does not exist'),
        ('video {bag} --set robot.l1=1 --out x.gif', '--override permits that'),
        ('live --trust', '--trust goes with --bag alone'),
        ('live --bag {bag} --out x', '--out: only the page of a graph records'),
        ('live --bag {bag} --namespace left', 'has nothing in --namespace /left'),
    ],
)
def test_an_option_without_a_meaning_is_refused(words, message, bag, idle, tmp_path, capsys):
    file = tmp_path / 'gains.yaml'
    file.write_text('pid: {Kp: 1.0}\n')
    assert main(words.format(bag=bag, file=file).split()) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1 and message in err


@pytest.mark.parametrize('more', [(), ('--set', 's_fotsmc.G=13')])
def test_a_parameter_file_counts_in_a_study(more, tmp_path, monkeypatch):
    (tmp_path / 'tuned.yaml').write_text('s_fotsmc: {G: 12.0, lambda: 30.0}\n')
    found = []
    run = 'parallel_robot.studies.sweep.sweep.run'
    monkeypatch.setattr(run, lambda plan, *_: found.append(plan.row(0)) or {})
    monkeypatch.setattr(simulate, 'record', lambda _, changed, *__: found.append(changed) or 0)
    given = ['--param-file', str(tmp_path / 'tuned.yaml'), *more, '--out', str(tmp_path / 'out')]
    assert main(['sweep', 'uncertain_robot', *given]) == 0
    assert main(['simulate', 'uncertain_robot', '--row', '0', *given]) == 0
    for changed in (dict(found[0].overrides), found[1]):
        assert changed['s_fotsmc.G'] == (13 if more else 12.0)
        assert changed['s_fotsmc.lambda'] == 30.0
