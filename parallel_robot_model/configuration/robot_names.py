"""Descriptions of machines, whose text takes the place of the name of their file."""

from __future__ import annotations

from pathlib import Path

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config_files, robot_file
from parallel_robot_model.configuration.plain_data import Placed, locating

MODEL, DESCRIPTION = 'robot_model', 'robot_description'
SUFFIXES = ('.xml', '.mjcf', '.urdf', '.sdf', '.xacro')
FOLDER = 'machines'  # of the shipped ones, in config/


def is_path(model: str) -> bool:
    """Whether a robot is given as the path of a description."""
    return '/' in model or model.lower().endswith(SUFFIXES)


def shipped() -> list[str]:
    """Names of the machines that the suite ships as descriptions."""
    return sorted(path.stem for path in (config_files.directory() / FOLDER).glob('*.xml'))


def filled(values: Placed) -> Placed:
    """Values with the text of the machine that they name, if any, and its name.

    A path counts from the file in which it stands, or else from the current directory.

    Raises:
        InputError: it cannot be read, or has the name of another robot of the suite.
    """
    model = values.get(MODEL)
    if not isinstance(model, str) or values.get(DESCRIPTION):
        return values
    stands = values.places.get(MODEL)
    if not is_path(model):
        text = robot_file.text_of(place(model)) if model in shipped() else ''
        name = model
    else:
        with locating(values):
            try:
                path = Path(stands.file if stands else '').parent / Path(model).expanduser()
                text, name = robot_file.text_of(path), path.stem
            except (RuntimeError, InputError) as error:  # home of an unknown user
                raise InputError(f'{MODEL}: {error}', MODEL) from None
            taken = {*config_files.shipped().robots, *shipped()}
            if name in taken and path.resolve() != place(name).resolve():
                what = f'there is already a robot {name}; rename the file'
                raise InputError(f'{MODEL}: {path}: {what}', MODEL)
    entries = {MODEL: name, DESCRIPTION: text}
    return values | Placed(entries, dict.fromkeys(entries, stands) if stands else {})


def scenario_of(name: str) -> str:
    """The scenario that is called so, or the description of the shipped machine of that name."""
    return str(place(name)) if name in shipped() else name


def place(name: str) -> Path:
    """Place of a shipped machine."""
    return config_files.directory() / FOLDER / f'{name}.xml'
