"""Sweeps on a cluster of dask.distributed: two workers of this machine."""

import os
import signal

import pytest
from sweeping import TEXT, content, swept

from parallel_robot.cli.command_line import main
from parallel_robot.studies.sweep.workers import Cluster
from parallel_robot_model.common.errors import RunError

distributed = pytest.importorskip('distributed')
pytest_plugins = ['sweeping']


@pytest.fixture(scope='module')
def scheduler():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=':0', silence_logs='CRITICAL'
    ) as cluster:
        yield cluster


class Killing(Cluster):
    """Kills one worker of the cluster after the first task."""

    victim = None

    def wait(self):
        ended = super().wait()
        if self.victim is None:
            self.victim = min(self._client.run(os.getpid).values())
            os.kill(self.victim, signal.SIGKILL)
        return ended


@pytest.mark.endurance
def test_a_cluster_of_which_one_worker_is_killed_makes_the_same_file(scheduler, whole, tmp_path):
    killed = tmp_path / 'killed'
    workers = Killing(scheduler.scheduler_address)
    swept(killed, workers=workers, count=4)
    assert workers.victim
    assert content(killed) == content(whole)


@pytest.mark.endurance
def test_the_command_runs_on_a_scheduler(scheduler, tmp_path, capsys):
    file, out = tmp_path / 'study.yaml', tmp_path / 'out'
    file.write_text(TEXT)
    words = ['--runs', '3', '--scheduler', scheduler.scheduler_address]
    assert main(['sweep', str(file), '--out', str(out), *words]) == 0
    assert '3 runs of each law' in capsys.readouterr().out


@pytest.mark.parametrize('address', ['tcp://127.0.0.1:9', 'nonsense://x', ''])
def test_a_scheduler_that_is_not_there_costs_one_line(address, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('parallel_robot.studies.sweep.workers.PATIENCE', 0.5)
    file = tmp_path / 'study.yaml'
    file.write_text(TEXT)
    words = ['sweep', str(file), '--out', str(tmp_path / 'out'), '--scheduler', address]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert f'cannot reach {address}' in error and error.count('\n') == 1
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.endurance
def test_a_scheduler_that_goes_away_costs_one_line_and_no_row(scheduler, tmp_path):
    """The last test here: there is no cluster any more."""
    ended = []

    class Leaving(Cluster):
        """Loses its scheduler after the first task."""

        def wait(self):
            ended.extend(super().wait())
            scheduler.close()
            return ended[-1:]

    with pytest.raises(RunError, match='the scheduler'):
        swept(tmp_path, workers=Leaving(scheduler.scheduler_address), count=4)
    assert len(list((tmp_path / 'parts').iterdir())) == len(ended) > 0
