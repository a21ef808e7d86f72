"""What every law imports, beside terms.py and what it computes with vectors."""

from parallel_robot_control.contract import ControlOutput as ControlOutput
from parallel_robot_model.common.errors import InputError as InputError
from parallel_robot_model.common.units import Array as Array
from parallel_robot_model.compiler import kernel as kernel
from parallel_robot_model.configuration.fields import Field as Field
from parallel_robot_model.robots.contract import inverse_dynamics as inverse_dynamics
