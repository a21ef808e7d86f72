"""A small study, and sweeps of it, for the tests."""

import pyarrow.parquet as pq
import pytest

from parallel_robot.studies.sweep import study, summary
from parallel_robot.studies.sweep.plan import plan
from parallel_robot.studies.sweep.run_chunk import run_task
from parallel_robot.studies.sweep.sweep import run

RUNS = 16
ROWS = 2 * RUNS
TEXT = f"""
scenarios: [paper_circle]
laws: [smc, computed_torque]
runs: {RUNS}
seed: 3
duration: 0.2
uncertainty:
  true_robot.m1: {{distribution: uniform, relative: 0.2}}
  friction.viscous: {{distribution: log_uniform, factor: [0.5, 2.0], common: true}}
  plant.integrator: {{distribution: choice, values: [ode3, rk4]}}
"""
FAILING = """
scenarios: [paper_circle]
laws: [smc]
runs: 6
method: random
duration: 0.2
uncertainty:
  circle.radius: {distribution: choice, values: [0.03, 3.0]}
  true_robot.m1: {distribution: normal, mean: 1.0, std: 2.0}
"""


class Inline:
    """Workers that run a task in this process when they are waited for."""

    slots = 1

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def submit(self, task):
        self.task = task

    def wait(self):
        return [(self.task, run_task(self.task))]


@pytest.fixture
def inline(monkeypatch):
    """Runs of studies take place in this process; workers are tried in test_sweep_losses.py."""
    for module in ('studies.sweep.workers', 'studies.sweep.sweep', 'studies.tuning.tuned'):
        monkeypatch.setattr(f'parallel_robot.{module}.Processes', lambda _: Inline())


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures of sweeps and searches are empty files; to draw them takes a second."""
    for place in ('sweep.picture', 'tuning.output'):
        monkeypatch.setattr(
            f'parallel_robot.studies.{place}.encoded',
            lambda _, suffixes: dict.fromkeys(suffixes, b''),
        )


def planned(text=TEXT, runs=None):
    return plan(study.parse(text).changed(runs, {}))


def swept(out, text=TEXT, runs=None, workers=None, count=2, summarised=False):
    """Run a sweep, usually without its summary, which takes longer than the rows."""
    with pytest.MonkeyPatch.context() as patch:
        if not summarised:
            patch.setattr('parallel_robot.studies.sweep.sweep.summarise', lambda *_: '')
        plan = planned(text, runs)
        found = run(plan, text, out, workers or Inline(), count)
        return summary.text(plan, found) if summarised else found


@pytest.fixture(scope='session')
def whole(tmp_path_factory):
    """A sweep that ran through in one process."""
    out = tmp_path_factory.mktemp('sweep') / 'whole'
    swept(out, summarised=True)
    return out


def runs(out):
    return pq.read_table(out / 'runs.parquet')


def content(out):
    return (out / 'runs.parquet').read_bytes()
