"""One row of a study, to be run alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from parallel_robot.studies.sweep import store, study
from parallel_robot.studies.sweep.plan import Row, plan
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config


def row_of(name: str, number: int, fixed: Mapping[str, Any]) -> tuple[Row, list[str]]:
    """Find a row.

    Args:
        name: Directory of a sweep, file of a study, or name of one in config/studies.
        number: Number of the row.
        fixed: What the command line sets; for the row of a sweep, its custom modules alone.

    Returns:
        The row, and doubts whether it is the one that was run.

    Raises:
        InputError: there is no such row.
    """
    directory = Path(name)
    if not directory.is_dir():
        file = study.file_of(name)
        asked = study.parse(study.read(file), str(file), file.parent).changed(None, fixed)
        return plan(asked).row(number), []
    manifest = store.manifest_of(directory)
    for key in fixed:
        if key not in config.CUSTOM:
            raise InputError(f'--set {key}: a row of a sweep is run as it was; only code is given')
    for key in config.CUSTOM:
        if manifest['set'].get(key) and key not in fixed:
            raise InputError(
                f'{directory} was made with code of its own; give --set {key}=... once more'
            )
    file = directory / store.STUDY
    parsed = study.parse(study.read(file), str(file))
    asked = replace(parsed, scenarios=tuple(map(str, manifest['scenarios'])))  # it is a copy
    found = plan(asked.changed(manifest['runs'], {**manifest['set'], **fixed}))
    doubts = [store.study_doubt(manifest, found), store.version_doubt(manifest)]
    return found.row(number), [f'{directory}: {doubt}' for doubt in doubts if doubt]
