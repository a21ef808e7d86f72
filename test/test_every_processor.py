"""A simulation writes the same bytes on every x86-64: here on this one, with parts switched off.

An old processor is told to the C library, to numpy, to OpenBLAS and to LLVM.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import small_protocol
from bags import content

RUNS = {
    'noisy': [
        'paper_circle',
        '--set',
        'sensor.position_noise=1e-5',
        '--set',
        'actuator.noise=0.01',
    ],
    'powers': ['paper_circle', '--law', 'predefined_time_smc'],
    'points': ['eight_waypoints', '--law', 'lqg_tracking'],
    'near': ['eight_waypoints', '--set', 'waypoints.smoothing=0.1'],
}
OLD_LIBRARIES = {
    'GLIBC_TUNABLES': 'glibc.cpu.hwcaps=-AVX2,-FMA',
    'OPENBLAS_CORETYPE': 'Nehalem',
    'NPY_DISABLE_CPU_FEATURES': 'AVX2 FMA3 AVX512F X86_V3 X86_V4',  # names of numpy 1 and 2
}
OLD = {**OLD_LIBRARIES, 'NUMBA_CPU_NAME': 'nehalem', 'NUMBA_CPU_FEATURES': ''}
SCRIPT = """
import json, sys
from parallel_robot.cli.command_line import main
for name, words in json.loads(sys.argv[2]).items():
    assert main(['simulate', *words, '--duration', '1', '--out', f'{sys.argv[1]}/{name}']) == 0
"""
COMMAND = 'import sys; from parallel_robot.cli.command_line import main; sys.exit(main())'
SINE = 'import math; print([math.sin(0.37 * k).hex() for k in range(1000)])'


def python(environment, *words):
    root = str(Path(__file__).parents[1])
    paths = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH', '')]))
    environment = {**os.environ, 'PYTHONPATH': paths, **environment}
    done = subprocess.run(
        [sys.executable, '-c', *words], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def usual(tmp_path_factory):
    """Bags of this processor."""
    return simulated({}, tmp_path_factory.mktemp('usual'))


def simulated(environment, out):
    python(environment, SCRIPT, str(out), json.dumps(RUNS))
    return {name: content(out / name / f'{name}_0.mcap') for name in RUNS}


@pytest.mark.parametrize(
    'environment',
    [
        pytest.param(OLD_LIBRARIES, id='libraries'),
        pytest.param(OLD, id='all', marks=pytest.mark.endurance),  # compiles all anew
    ],
)
def test_bags_are_the_same_bytes(environment, usual, tmp_path):
    other = simulated(environment, tmp_path)
    for name, streams in usual.items():
        assert streams == other[name], name


@pytest.mark.endurance
def test_a_score_is_the_same_to_the_last_digit(tmp_path):
    protocol = small_protocol.written(tmp_path / 'small.yaml', 'planar_3rrr', trials=32)
    words = ['--protocol', str(protocol), '--workers', '1']
    out = tmp_path / 'score'
    python({}, COMMAND, 'benchmark', 's_smc', *words, '--out', str(out))
    python(OLD_LIBRARIES, COMMAND, 'benchmark', '--check', str(out / 'score.json'), *words)


def test_libm_is_another_one_there():
    """Else the test above would find nothing, on a processor with FMA."""
    if ' fma ' not in Path('/proc/cpuinfo').read_text():
        pytest.skip('this processor has no FMA')
    assert python({}, SINE) != python(OLD_LIBRARIES, SINE)
