"""Custom files as they are for a process that has just started, and as bags that lack them."""

from parallel_robot.analysis.report import report_files
from parallel_robot_model.processes import custom_module


def forget(monkeypatch):
    """Let no custom file be loaded yet, as in a new process; its reports have no pictures."""
    custom_module._module.cache_clear()
    monkeypatch.setattr(custom_module, '_loaded', {})
    monkeypatch.setattr(report_files, 'draw_chart', lambda *_: None)


def detach(bag, key, name):
    """Let a bag no longer hold the source of a custom file, which it still names."""
    (file,) = bag.glob('*.mcap')
    data, held = file.read_bytes(), f'{key}/{name}'.encode()
    assert held in data
    file.write_bytes(data.replace(held, held.replace(b's/', b'z/')))
